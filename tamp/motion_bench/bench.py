"""All asked methods on all problems of a file, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from robots.cache import write_atomic
from robots.errors import UnknownName
from tamp.motion_bench.ours import Panda, plan, plan_plain
from tamp.motion_bench.peers import PEERS, run_peer
from tamp.motion_bench.problems import Problem, dump_paths
from tamp.motion_bench.rows import Row

METHODS = ("ours", "ours-ompl", "ompl-plain", *PEERS)
"""Names of methods."""


def solve_all(
    problems: Sequence[Problem], methods: Sequence[str], *, seed: int, told: Callable[[str], None]
) -> list[Row]:
    """The rows of all methods; ``told`` hears what is going on.

    Raises:
        UnknownName: A method does not exist.
    """
    for method in methods:
        if method not in METHODS:
            raise UnknownName("method", method, METHODS)
    arm, rows = Panda(), []
    for method in methods:
        if method in PEERS:
            told(f"{method}: {len(problems)} problems")
            rows += run_peer(method, problems, seed=seed)
            continue
        _one(arm, problems[0], method, seed)  # compiles, reads tables
        for k, problem in enumerate(problems):
            told(f"{method}: {k + 1} of {len(problems)}")
            rows.append(_one(arm, problem, method, seed))
    return rows


def _one(arm: Panda, problem: Problem, method: str, seed: int) -> Row:
    if method == "ompl-plain":
        return plan_plain(arm, problem, seed=seed)
    return plan(arm, problem, seed=seed, planner=None if method == "ours" else "RRTConnect")


def write_paths(path: Path, rows: Sequence[Row]) -> None:
    """The final paths of solved rows as a file; the method stands in each entry when there are several."""
    several = len({row.method for row in rows}) > 1
    entries = [
        {
            "scene": row.scene,
            "index": row.index,
            "path": row.path.tolist(),
            **({"method": row.method} if several else {}),
        }
        for row in rows
        if row.solved
    ]
    write_atomic(path, dump_paths(entries))
