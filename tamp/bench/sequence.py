"""How long does planning a whole sequence take, how long is the plan, and how close does it come to anything?"""

from __future__ import annotations

import shutil
from pathlib import Path

from msgspec import Struct

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
        folder = scratch / f"{category}-{seed}"
        report = plan_episode(
            Request(
                category=category,
                split="seen",
                seed=seed,
                proposer=proposer,
                timeout=timeout,
                execute=False,
                out=folder,
                page=False,
            )
        )
        seconds.append(report.plan_seconds)
        if report.status != "planned":
            assert report.failure is not None  # what is not planned has failed
            faults.append(SequenceFault(seed=seed, detail=f"no plan: {report.failure.detail}"))
            continue
        plan = plan_file.load(folder)
        found = verify(plan)
        makespans.append(plan.duration)
        clearances.append(found.min_clearance)
        if not found.ok:
            faults.append(SequenceFault(seed=seed, detail=f"faulty plan: {found.violations[0].detail}"))
        shutil.rmtree(folder)
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
