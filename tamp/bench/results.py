"""What do the rows of a benchmark say together: rates with intervals, means, paired comparisons, failures, times?"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from itertools import combinations, groupby
from typing import Literal

from msgspec import Struct

from tamp.bench.jobs import Mode, Settings, jobs_of
from tamp.bench.row import FAULTS, Row
from tamp.bench.statistics import mcnemar, quantile, wilson
from worlds.assets.asset import Split
from worlds.tasks import TASK_TYPES, TaskType


class Rate(Struct, frozen=True, kw_only=True):
    """Successes of one method, mode, category and split."""

    method: str
    category: str
    split: Split
    mode: Mode
    task_type: TaskType
    episodes: int
    successes: int
    rate: float
    ci_low: float
    """Wilson's 95 % interval."""
    ci_high: float
    failures: dict[str, int]
    """Failures by our causes."""
    failure_classes: dict[str, int]
    """Failures by the paper's classes."""
    plan_seconds_median: float | None
    """Wall time of planning, found or not [s]."""
    plan_seconds_p95: float | None


class Mean(Struct, frozen=True, kw_only=True):
    """A method's mean over the categories of one task type, each category with the same weight as in the paper."""

    method: str
    mode: Mode
    split: Split
    task_type: TaskType
    categories: int
    rate: float
    """Mean of the categories' rates."""
    episodes: int
    successes: int
    ci_low: float
    """Wilson's 95 % interval of the pooled episodes."""
    ci_high: float
    failures: dict[str, int]
    failure_classes: dict[str, int]
    plan_seconds_median: float | None
    plan_seconds_p95: float | None


class Comparison(Struct, frozen=True, kw_only=True):
    """Two methods in the same mode, or one method in two modes, on the same seeds."""

    kind: Literal["method", "mode"]
    first: str
    second: str
    within: str
    """The mode, or the method, that both share."""
    task_type: TaskType | Literal["all"]
    pairs: int
    both: int
    only_first: int
    only_second: int
    neither: int
    p: float
    """McNemar's exact test, two-sided."""


class FaultRow(Struct, frozen=True, kw_only=True):
    """An episode that came to no outcome."""

    episode: str
    reason: str
    detail: str


class Results(Struct, frozen=True, kw_only=True):
    """The JSON object of ``bipre bench``."""

    rows: list[Rate]
    means: list[Mean]
    comparisons: list[Comparison]
    faults: list[FaultRow]
    complete: bool
    """Every episode was run."""
    episodes: int
    successes: int
    wanted: int
    seconds: float
    """Summed wall time of the episodes [s]."""
    absent: list[str]
    """Columns of the request for which the object source has no instances."""
    settings: Settings
    out: str


def summarise(settings: Settings, rows: list[Row], absent: list[str], out: str) -> Results:
    """All that is reported; the rows may be those of an interrupted run."""
    return Results(
        rows=[_rate(group) for group in _grouped(rows, lambda r: (r.method, r.mode, r.category, r.split))],
        means=[_mean(group) for group in _grouped(rows, lambda r: (r.method, r.mode, r.split, r.task_type))],
        comparisons=_comparisons(rows),
        faults=[
            FaultRow(episode=row.job.key, reason=str(row.reason), detail=row.detail)
            for row in rows
            if row.reason in FAULTS
        ],
        complete=len(rows) == (wanted := len(jobs_of(settings))),
        episodes=len(rows),
        successes=sum(row.success for row in rows),
        wanted=wanted,
        seconds=round(sum(row.seconds for row in rows), 1),
        absent=absent,
        settings=settings,
        out=out,
    )


def _grouped(rows: list[Row], key: Callable[[Row], tuple[object, ...]]) -> list[list[Row]]:
    """The rows by key, groups in the order in which they first appear."""
    order = {found: place for place, found in enumerate(dict.fromkeys(key(row) for row in rows))}
    ranked = sorted(rows, key=lambda row: order[key(row)])
    return [list(group) for _, group in groupby(ranked, key=key)]


def _rate(rows: list[Row]) -> Rate:
    successes, first = sum(row.success for row in rows), rows[0]
    low, high = wilson(successes, len(rows))
    return Rate(
        method=first.method,
        category=first.category,
        split=first.split,
        mode=first.mode,
        task_type=first.task_type,
        episodes=len(rows),
        successes=successes,
        rate=successes / len(rows),
        ci_low=low,
        ci_high=high,
        failures=tally(row.reason for row in rows),
        failure_classes=tally(row.failure_class for row in rows),
        plan_seconds_median=quantile(_plan_seconds(rows), 0.5),
        plan_seconds_p95=quantile(_plan_seconds(rows), 0.95),
    )


def _mean(rows: list[Row]) -> Mean:
    pooled, first = _rate(rows), rows[0]
    rates = [_rate(group).rate for group in _grouped(rows, lambda row: (row.category,))]
    return Mean(
        method=first.method,
        mode=first.mode,
        split=first.split,
        task_type=first.task_type,
        categories=len(rates),
        rate=sum(rates) / len(rates),
        episodes=pooled.episodes,
        successes=pooled.successes,
        ci_low=pooled.ci_low,
        ci_high=pooled.ci_high,
        failures=pooled.failures,
        failure_classes=pooled.failure_classes,
        plan_seconds_median=pooled.plan_seconds_median,
        plan_seconds_p95=pooled.plan_seconds_p95,
    )


def tally(names: Iterable[str | None]) -> dict[str, int]:
    """How often each name occurs, the most frequent first; ``None`` is not counted."""
    return dict(Counter(name for name in names if name is not None).most_common())


def _plan_seconds(rows: list[Row]) -> list[float]:
    return [row.plan_seconds for row in rows if row.plan_seconds is not None]


# -- paired comparisons ------------------------------------------------------------------------------------------------


Solved = dict[tuple[object, ...], Row]
"""Rows by method, mode, category, split, seed and the instance that was named."""


def _comparisons(rows: list[Row]) -> list[Comparison]:
    methods = list(dict.fromkeys(row.method for row in rows))
    modes = sorted({row.mode for row in rows})
    solved: Solved = {(row.method, row.mode, row.category, row.split, row.seed, row.named): row for row in rows}
    found: list[Comparison | None] = []
    scopes: list[TaskType | Literal["all"]] = ["all", *(t for t in TASK_TYPES if any(r.task_type == t for r in rows))]
    for scope in scopes:
        mine = {key: row for key, row in solved.items() if scope in ("all", row.task_type)}
        for mode in modes:
            for first, second in combinations(methods, 2):
                found.append(_compared(mine, "method", (first, second), mode, scope))
        for method in methods:
            for earlier, later in combinations(modes, 2):
                found.append(_compared(mine, "mode", (earlier, later), method, scope))
    return [comparison for comparison in found if comparison is not None]


def _compared(
    rows: Solved,
    kind: Literal["method", "mode"],
    names: tuple[str, str],
    within: str,
    scope: TaskType | Literal["all"],
) -> Comparison | None:
    """The two on the episodes that both have run; ``None`` when there is none."""
    counts: Counter[tuple[bool, bool]] = Counter()
    for (method, mode, *episode), row in rows.items():
        if (method, mode) != ((names[0], within) if kind == "method" else (within, names[0])):
            continue
        other = (names[1], mode, *episode) if kind == "method" else (method, names[1], *episode)
        if (partner := rows.get(other)) is not None:
            counts[row.success, partner.success] += 1
    if not counts:
        return None
    return Comparison(
        kind=kind,
        first=names[0],
        second=names[1],
        within=within,
        task_type=scope,
        pairs=counts.total(),
        both=counts[True, True],
        only_first=counts[True, False],
        only_second=counts[False, True],
        neither=counts[False, False],
        p=mcnemar(counts[True, False], counts[False, True]),
    )
