"""What one method made of one problem, and what that amounts to over many."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from robots.spatial import Array


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """One method on one problem; times are the thread's CPU time.

    Attributes:
        method: Its name.
        scene, index: The problem.
        solved: Whether there is a path.
        setup_ms: Making the scene [ms].
        plan_ms: Search, with the check of start and goal [ms].
        simplify_ms: Shortening [ms].
        certify_ms: Proof of the final path, where the method has one [ms].
        length_raw, length: Before and after shortening, L2 [rad].
        states: Configurations looked at by the search, where known.
        reason: Why there is no path; empty when there is one.
        path: Final points ``(n, 7)`` [rad]; not part of the table.
    """

    method: str
    scene: str
    index: int
    solved: bool
    setup_ms: float = 0.0
    plan_ms: float = 0.0
    simplify_ms: float = 0.0
    certify_ms: float = 0.0
    length_raw: float = 0.0
    length: float = 0.0
    states: int = 0
    reason: str = ""
    path: Array = field(default_factory=lambda: np.zeros((0, 7)))

    @property
    def total_ms(self) -> float:
        """All but the scene [ms]."""
        return self.plan_ms + self.simplify_ms + self.certify_ms

    def table(self) -> dict[str, Any]:
        """The row as it stands in a file."""
        numbers = ("setup_ms", "plan_ms", "simplify_ms", "certify_ms", "length_raw", "length")
        return {
            "method": self.method,
            "scene": self.scene,
            "index": self.index,
            "solved": self.solved,
            **{name: round(float(getattr(self, name)), 4) for name in numbers},
            "states": self.states,
            "reason": self.reason,
        }


def length_of(path: Array) -> float:
    """Length of a path ``(n, d)``, L2 [rad]."""
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def summary(rows: list[Row]) -> dict[str, Any]:
    """Counts, medians and 95th percentiles by method, and ratios to the first method's."""
    methods = list(dict.fromkeys(row.method for row in rows))
    by_method = {method: _of([row for row in rows if row.method == method]) for method in methods}
    first = by_method[methods[0]]
    for figures in by_method.values():
        for name in ("plan_ms_median", "total_ms_median"):
            ratio = first[name] / figures[name] if figures[name] > 0.0 else None
            figures[f"first_over_this_{name}"] = None if ratio is None else round(ratio, 4)
    return {"clock": "thread CPU time", "methods": by_method}


def _of(rows: list[Row]) -> dict[str, Any]:
    done = [row for row in rows if row.solved]
    figures: dict[str, Any] = {"problems": len(rows), "solved": len(done)}
    for name in ("setup_ms", "plan_ms", "simplify_ms", "certify_ms", "total_ms", "length_raw", "length"):
        values = np.array([float(getattr(row, name)) for row in done]) if done else np.zeros(1)
        figures[f"{name}_median"] = round(float(np.median(values)), 4)
        figures[f"{name}_p95"] = round(float(np.percentile(values, 95)), 4)
    return figures
