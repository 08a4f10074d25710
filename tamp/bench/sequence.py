"""How long does planning a whole sequence take, how long is the plan, and how close does it come to anything?"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

from msgspec import Struct

from robots.errors import TampError
from tamp import plan as plan_file
from tamp.bench.seeds import benchmark_seeds
from tamp.bench.statistics import quantile
from tamp.episode import Request, plan_episode
from tamp.verify import verify


class SequenceFault(Struct, frozen=True, kw_only=True):
    """An episode without a plan, or with a faulty one."""

    seed: int
    detail: str


class SequenceRow(Struct, frozen=True, kw_only=True):
    """The measurements of one category."""

    category: str
    episodes: int
    planned: int
    verified: int
    """Plans in which the independent verifier finds no fault."""
    plan_seconds_median: float | None
    """Wall time of planning, found or not [s]."""
    plan_seconds_p95: float | None
    makespan_median: float | None
    """Duration of the plan [s]."""
    makespan_p95: float | None
    min_clearance: float | None
    """Smallest distance in any plan between bodies that may not touch [m]."""
    min_clearance_median: float | None
    """Median over the plans of each one's smallest distance [m]."""
    faults: list[SequenceFault]


def measure(category: str, count: int, proposer: str, timeout: float, scratch: Path) -> SequenceRow:
    """Plan and verify the first ``count`` seeds of a column's list of seen objects."""
    seconds: list[float] = []
    makespans: list[float] = []
    clearances: list[float] = []
    faults: list[SequenceFault] = []
    for seed in benchmark_seeds(category, "seen")[:count]:
        found = _measured(category, seed, proposer, timeout, scratch / f"{category}-{seed}")
        if found.plan_seconds is not None:
            seconds.append(found.plan_seconds)
        if found.makespan is not None and found.clearance is not None:
            makespans.append(found.makespan)
            clearances.append(found.clearance)
        if found.fault is not None:
            faults.append(SequenceFault(seed=seed, detail=found.fault))
    return SequenceRow(
        category=category,
        episodes=count,
        planned=len(makespans),
        verified=count - len(faults),
        plan_seconds_median=quantile(seconds, 0.5),
        plan_seconds_p95=quantile(seconds, 0.95),
        makespan_median=quantile(makespans, 0.5),
        makespan_p95=quantile(makespans, 0.95),
        min_clearance=min(clearances, default=None),
        min_clearance_median=quantile(clearances, 0.5),
        faults=faults,
    )


@dataclass(frozen=True, slots=True)
class _Measured:
    """One episode: ``None`` for what it did not come to."""

    plan_seconds: float | None = None
    makespan: float | None = None
    clearance: float | None = None
    fault: str | None = None


def _measured(category: str, seed: int, proposer: str, timeout: float, folder: Path) -> _Measured:
    request = Request(
        category=category,
        split="seen",
        seed=seed,
        proposer=proposer,
        timeout=timeout,
        execute=False,
        out=folder,
        page=False,
    )
    try:
        report = plan_episode(request)
    except TampError as error:  # such as an object that the cameras do not see: this episode's result
        return _Measured(fault=str(error))
    if report.failure is not None:
        return _Measured(report.plan_seconds, fault=f"no plan: {report.failure.detail}")
    plan = plan_file.load(folder)
    found = verify(plan)
    shutil.rmtree(folder)
    fault = None if found.ok else f"faulty plan: {found.violations[0].detail}"
    return _Measured(report.plan_seconds, plan.duration, found.min_clearance, fault)
