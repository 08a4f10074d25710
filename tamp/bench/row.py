"""What is kept of one episode of a benchmark: a line of ``episodes.jsonl``."""

from __future__ import annotations

from typing import Literal

from msgspec import Struct

from tamp.bench.classes import FailureClass
from tamp.bench.jobs import Job, Mode
from worlds.assets.asset import Split
from worlds.tasks import TaskType

Fault = Literal["error", "crashed", "timed_out"]
"""Endings that are no outcome: an exception, a dead process, a process that was killed because it gave no answer."""

FAULTS: tuple[Fault, ...] = ("error", "crashed", "timed_out")


class Row(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One episode and how it went."""

    method: str
    mode: Mode
    category: str
    task_type: TaskType
    split: Split
    seed: int
    named: str | None = None
    """The instance that the benchmark named, where the seed did not choose it."""
    instance: str | None
    """``None`` when the episode ended before one was chosen."""
    status: str
    """``success``, ``no_plan`` or ``execution_failed``, or one of ``FAULTS``."""
    success: bool
    stage: str | None = None
    """Where it failed."""
    reason: str | None = None
    """Our cause of the failure, or one of ``FAULTS``; ``None`` on success."""
    detail: str = ""
    """The failure in words, with numbers."""
    failure_class: FailureClass | None = None
    """The paper's class."""
    plan_seconds: float | None = None
    """Wall time of planning [s]."""
    execute_seconds: float | None = None
    """Wall time of the execution [s]."""
    seconds: float
    """Wall time of the whole episode [s]."""
    stages: list[str] = []
    """The plan's stages with their arms."""
    candidates: int = 0
    """Candidates tried for the stages of the plan, together."""

    @property
    def job(self) -> Job:
        """Which episode it was."""
        return Job(
            method=self.method,
            mode=self.mode,
            category=self.category,
            split=self.split,
            seed=self.seed,
            named=self.named,
        )
