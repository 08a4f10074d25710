"""Which collision-free joint path leads from one configuration of an arm to another: OMPL's RRT-Connect."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from planners.collision import CollisionWorld, Contact
from planners.shorten import RESOLUTION, Free, edge_free, path_free, rounded, shortened
from robots.model import ArmKinematics
from robots.spatial import Array, frozen

RANGE = 1.0
"""Longest extension of the trees, L2 [rad]: the best of five values on MotionBenchMaker."""

STATES_PER_ITERATION = 15
"""The search also ends after this many checked states for each iteration allowed."""

TRIES = 3
"""Searches, each with half the resolution of the one before, until a path passes the finer check."""

INSET = 0.02
"""How far inside the joint limits the search keeps [rad], start and goal apart: a curve through it may bulge."""


@dataclass(frozen=True, slots=True, eq=False)
class JointPath:
    """Joint positions joined by straight lines.

    Attributes:
        points: ``(n, 7)`` [rad], ``n >= 2``.
    """

    points: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen(self.points))
        if self.points.ndim != 2 or self.points.shape[0] < 2 or self.points.shape[1] != 7:
            raise ValueError(f"a joint path needs points (n, 7), n >= 2; got {self.points.shape}")


@dataclass(frozen=True, slots=True)
class StartInCollision:
    """The start touches something."""

    contact: Contact

    def __str__(self) -> str:
        return f"the start is in collision: {self.contact}"


@dataclass(frozen=True, slots=True)
class GoalInCollision:
    """Every goal within limits touches something; the contact of the first."""

    contact: Contact

    def __str__(self) -> str:
        return f"the goal is in collision: {self.contact}"


@dataclass(frozen=True, slots=True)
class OutOfLimits:
    """The start, or every goal, leaves a joint's range.

    Attributes:
        which: ``start`` or ``goal``.
        joint: World-unique name of the joint.
        value: Where it is [rad].
        limit: The limit that it is past [rad].
    """

    which: str
    joint: str
    value: float
    limit: float

    def __str__(self) -> str:
        return f"the {self.which} is out of limits: {self.joint} at {self.value:.3f} rad, limit {self.limit:.3f} rad"


@dataclass(frozen=True, slots=True)
class Exhausted:
    """The search used its budget.

    Attributes:
        checks: States checked for collision.
        iterations: Iterations of RRT-Connect.
    """

    checks: int
    iterations: int

    def __str__(self) -> str:
        return f"no path within {self.iterations} iterations ({self.checks} checked states)"


@dataclass(frozen=True, slots=True)
class NoPath:
    """Why there is no path."""

    reason: StartInCollision | GoalInCollision | OutOfLimits | Exhausted

    def __str__(self) -> str:
        return str(self.reason)


def plan(
    world: CollisionWorld,
    arm: ArmKinematics,
    start: Array,
    goals: Array,
    q_other: Array,
    *,
    seed: int,
    iterations: int = 4000,
) -> JointPath | NoPath:
    """Find a collision-free joint path of one arm while the other keeps still.

    A straight line to a goal is tried first, nearest goal first; then RRT-Connect (Kuffner and LaValle, "RRT-Connect:
    An Efficient Approach to Single-Query Path Planning", ICRA 2000), and the result is shortened. The same arguments
    give the same path: the search ends after a number of iterations or checked states, never by the clock.

    Args:
        world: Collisions, already set up (object, fingers, allowed contacts).
        arm: The arm that moves.
        start: ``(7,)`` [rad].
        goals: ``(m, 7)`` [rad], any of which will do.
        q_other: Joint positions of the other arm ``(7,)`` [rad].
        seed: Makes the call repeatable.
        iterations: Of RRT-Connect, over all tries.

    Returns:
        The path, from exactly ``start`` to exactly one of the goals, or why there is none.
    """
    start, goals = np.asarray(start, dtype=np.float64), np.atleast_2d(np.asarray(goals, dtype=np.float64))
    if start.shape != (7,) or goals.shape[1] != 7 or not len(goals):
        raise ValueError(f"start must be (7,) and goals (m, 7), m >= 1; got {start.shape} and {goals.shape}")
    if refused := _precheck(world, arm, start, goals, q_other):
        return NoPath(refused)
    free = checker(world, arm, q_other)
    usable = [goal for goal in goals if arm.within_limits(goal) and free(goal)]
    usable.sort(key=lambda goal: float(np.linalg.norm(goal - start)))
    for goal in usable:
        if edge_free(free, start, goal, RESOLUTION / 2):
            return JointPath(np.stack([start, goal]))
    budget = _Budget(free, iterations, STATES_PER_ITERATION * iterations)
    for attempt in range(TRIES):
        resolution = RESOLUTION / 2**attempt
        found = _rrt_connect(budget, arm, start, usable, seed + attempt, resolution)
        if found is None:
            break
        if path_free(free, found, resolution / 2):
            short = shortened(free, found, np.random.default_rng(seed), resolution / 2)
            return JointPath(rounded(free, short, resolution / 2))
    return NoPath(Exhausted(budget.checks, budget.iterations))


class _Budget:
    """A collision check that counts, and how much counting is allowed."""

    def __init__(self, free: Free, iterations: int, checks: int) -> None:
        self._free, self._most_iterations, self._most_checks = free, iterations, checks
        self.checks = self.iterations = 0

    def free(self, q: Array) -> bool:
        """Check a state."""
        self.checks += 1
        return self._free(q)

    def spent(self) -> bool:
        """Whether the search must stop; RRT-Connect asks once in every iteration."""
        if self.iterations >= self._most_iterations or self.checks >= self._most_checks:
            return True
        self.iterations += 1
        return False


def checker(world: CollisionWorld, arm: ArmKinematics, q_other: Array) -> Free:
    """Whether joint positions of one arm are free while the other is at ``q_other`` ``(7,)`` [rad]."""
    both = np.empty(14)
    mine, others = (slice(0, 7), slice(7, 14)) if arm.side == "left" else (slice(7, 14), slice(0, 7))
    both[others] = q_other

    def free(q: Array) -> bool:
        both[mine] = q
        return world.free(both)

    return free


def both_arms(arm: ArmKinematics, q: Array, q_other: Array) -> Array:
    """Joint positions ``(14,)`` [rad], left then right, of ``arm`` at ``q`` and the other at ``q_other``."""
    return np.concatenate([q, q_other] if arm.side == "left" else [q_other, q])


def _precheck(
    world: CollisionWorld, arm: ArmKinematics, start: Array, goals: Array, q_other: Array
) -> StartInCollision | GoalInCollision | OutOfLimits | None:
    """What makes a search pointless: without this RRT-Connect would burn its whole budget on a bad goal."""
    legal = [goal for goal in goals if arm.within_limits(goal)]
    if not arm.within_limits(start):
        return _past_limit("start", arm, start)
    if not legal:
        return _past_limit("goal", arm, goals[0])
    if contact := world.contact(both_arms(arm, start, q_other)):
        return StartInCollision(contact)
    first = world.contact(both_arms(arm, legal[0], q_other))
    free = checker(world, arm, q_other)
    return GoalInCollision(first) if first and not any(free(goal) for goal in legal) else None


def _past_limit(which: str, arm: ArmKinematics, q: Array) -> OutOfLimits:
    return OutOfLimits(which, *past_limit(arm, q))


def past_limit(arm: ArmKinematics, q: Array) -> tuple[str, float, float]:
    """The joint of ``q`` ``(7,)`` [rad] that is furthest past a limit, its value and that limit [rad]."""
    k = int(np.argmax(np.maximum(arm.lower - q, q - arm.upper)))
    limit = arm.lower[k] if arm.lower[k] - q[k] > q[k] - arm.upper[k] else arm.upper[k]
    return str(arm.model.names[k + 1]), float(q[k]), float(limit)


def _rrt_connect(
    budget: _Budget, arm: ArmKinematics, start: Array, goals: list[Array], seed: int, resolution: float
) -> Array | None:
    """OMPL's RRT-Connect with our own edge check; all of OMPL lives in here, so that it leaves no noise at exit."""
    from ompl import base, geometric, util

    util.setLogLevel(util.LOG_NONE)
    util.RNG.setSeed(max(1, seed))
    space = base.RealVectorStateSpace(7)
    bounds = base.RealVectorBounds(7)
    ends = np.array([start, *goals])
    for k, (low, high) in enumerate(zip(ends.min(axis=0), ends.max(axis=0), strict=True)):
        bounds.setLow(k, float(min(arm.lower[k] + INSET, low)))
        bounds.setHigh(k, float(max(arm.upper[k] - INSET, high)))
    space.setBounds(bounds)
    info = base.SpaceInformation(space)

    class Edges(base.MotionValidator):  # type: ignore[misc]
        """Checks a whole edge, with its end; the search asks only for edges that begin at a free state."""

        def checkMotion(self, a: Any, b: Any) -> bool:
            qa, qb = _values(a), _values(b)
            return budget.free(qb) and edge_free(budget.free, qa, qb, resolution)

    info.setStateValidityChecker(lambda state: budget.free(_values(state)))
    info.setMotionValidator(Edges(info))
    info.setStateValidityCheckingResolution(resolution / space.getMaximumExtent())
    info.setup()
    problem = base.ProblemDefinition(info)
    problem.addStartState(_state(space, start))
    targets = base.GoalStates(info)
    for goal in goals:
        targets.addState(_state(space, goal))
    problem.setGoal(targets)
    planner = geometric.RRTConnect(info)
    planner.setProblemDefinition(problem)
    planner.setRange(RANGE)
    planner.setup()
    planner.solve(base.PlannerTerminationCondition(budget.spent))
    if not problem.hasExactSolution():
        return None
    return np.array([_values(state) for state in problem.getSolutionPath().getStates()])


def _values(state: Any) -> Array:
    return np.array([state[k] for k in range(7)])


def _state(space: Any, q: Array) -> Any:
    state = space.allocState()
    for k in range(7):
        state[k] = float(q[k])
    return state
