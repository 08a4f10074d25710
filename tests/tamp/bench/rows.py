"""Benchmarks and rows for tests."""

from __future__ import annotations

from typing import Any

import msgspec

from tamp.bench.classes import failure_class
from tamp.bench.jobs import Job, Settings
from tamp.bench.row import Row
from worlds.tasks import task_of


def settings(**changes: Any) -> Settings:
    """A small benchmark."""
    values: dict[str, Any] = {
        "methods": ["heuristic"],
        "mode": ["E2"],
        "categories": ["Bottle"],
        "split": ["seen", "unseen"],
        "asset": "synthetic",
        "every_instance": False,
        "episodes": 2,
        "timeout": 60.0,
        "versions": {"ompl": "2.0.1"},
        "program": "abc",
    }
    return Settings(**(values | changes))


def row(job: Job, reason: str | None, plan_seconds: float | None = 1.0) -> Row:
    """A row of a job that failed for that reason, or for ``None`` succeeded."""
    stage = None if reason is None else "pregrasp"
    return Row(
        **msgspec.structs.asdict(job),
        task_type=task_of(job.category).type,
        instance="thing-1",
        status="success" if reason is None else "no_plan",
        success=reason is None,
        stage=stage,
        reason=reason,
        detail="" if reason is None else f"<{reason} & more>",
        failure_class=None if reason is None else failure_class(job.category, stage, reason, ""),
        plan_seconds=plan_seconds,
        seconds=2.0,
    )
