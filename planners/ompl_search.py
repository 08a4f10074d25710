"""Which chain of edges leads from a start to a goal, by OMPL's planners, with any check of whole edges."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from robots.errors import UnknownName
from robots.spatial import Array

Edge = Callable[[Array, Array], bool]
"""Whether the straight line between two configurations ``(d,)`` [rad], its end included, is free."""

Free = Callable[[Array], bool]
"""Whether a configuration ``(d,)`` [rad] is free."""

PLANNERS = ("RRTConnect", "AORRTC", "RRTstar", "InformedRRTstar", "BITstar", "PRMstar", "KPIECE1")
"""Names that may be asked for."""


def search(
    free: Free,
    edge: Edge,
    start: Array,
    goals: Array,
    bounds: Array,
    *,
    seed: int,
    stop: Callable[[], bool] | float,
    planner: str = "RRTConnect",
    longest: float = 1.0,
    simplify: float = 0.0,
    clock: list[float] | None = None,
) -> tuple[Array | None, Array | None]:
    """OMPL's path, and what its simplifier makes of it.

    All of OMPL lives inside this function, so that it leaves no noise at exit.

    Args:
        free: Check of a state.
        edge: Check of an edge.
        start: ``(d,)`` [rad]; must be free.
        goals: ``(m, d)`` [rad]; must be free, else the whole budget is burnt.
        bounds: ``(2, d)`` where samples are drawn; widened to contain start and goals [rad].
        seed: Makes the call repeatable.
        stop: Ends the search when it says so, or after so many seconds.
        planner: One of ``PLANNERS``.
        longest: Longest extension of RRT-Connect's trees, L2 [rad].
        simplify: Time for OMPL's simplifier [s]; none without it.
        clock: Its first entry becomes the thread's CPU time at which the search ended [s].

    Returns:
        Points ``(n, d)`` [rad] or ``None``, and the simplified points or ``None``.
    """
    if planner not in PLANNERS:
        raise UnknownName("planner", planner, PLANNERS)
    from ompl import base, geometric, util

    util.setLogLevel(util.LOG_NONE)
    util.RNG.setSeed(max(1, seed))
    size = len(start)
    space = _space(np.vstack([start, goals, bounds]))
    info = base.SpaceInformation(space)

    def values(state: Any) -> Array:
        return np.array([state[k] for k in range(size)])

    class Edges(base.MotionValidator):  # type: ignore[misc]
        """Checks a whole edge, with its end; the search asks only for edges that begin at a free state."""

        def checkMotion(self, a: Any, b: Any) -> bool:
            return edge(values(a), values(b))

    info.setStateValidityChecker(lambda state: free(values(state)))
    info.setMotionValidator(Edges(info))
    info.setup()
    problem = base.ProblemDefinition(info)
    problem.addStartState(_state(space, start))
    targets = base.GoalStates(info)
    for goal in goals:
        targets.addState(_state(space, goal))
    problem.setGoal(targets)
    chosen = getattr(geometric, planner)(info)
    if planner == "RRTConnect":
        chosen.setRange(longest)
    else:
        problem.setOptimizationObjective(base.PathLengthOptimizationObjective(info))
    chosen.setProblemDefinition(problem)
    chosen.setup()
    chosen.solve(float(stop) if isinstance(stop, int | float) else base.PlannerTerminationCondition(stop))
    if clock is not None:
        clock[0] = time.thread_time()
    if not problem.hasExactSolution():
        return None, None
    path = problem.getSolutionPath()
    raw = np.array([values(state) for state in path.getStates()])
    if simplify <= 0.0:
        return raw, None
    geometric.PathSimplifier(info).simplify(path, simplify)
    return raw, np.array([values(state) for state in path.getStates()])


def _space(ends: Array) -> Any:
    """A box of joint space around the rows of ``ends``."""
    from ompl import base

    space, box = base.RealVectorStateSpace(ends.shape[1]), base.RealVectorBounds(ends.shape[1])
    for k in range(ends.shape[1]):
        box.setLow(k, float(ends[:, k].min()))
        box.setHigh(k, float(ends[:, k].max()))
    space.setBounds(box)
    return space


def _state(space: Any, q: Array) -> Any:
    state = space.allocState()
    for k in range(len(q)):
        state[k] = float(q[k])
    return state
