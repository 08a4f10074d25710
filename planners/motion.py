"""Which collision-free joint path leads from one configuration of an arm to another: OMPL's RRT-Connect."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from planners.collision import CollisionWorld, Contact
from robots.model import ArmKinematics
from robots.spatial import Array, frozen

RESOLUTION = 1.0 / 32.0
"""Distance between checked states of an edge while searching, L2 [rad]; what is returned is checked at half of it."""

RANGE = 1.0
"""Longest extension of the trees, L2 [rad]: the best of five values on MotionBenchMaker."""

STATES_PER_ITERATION = 15
"""The search also ends after this many checked states for each iteration allowed."""

TRIES = 3
"""Searches, each with half the resolution of the one before, until a path passes the finer check."""

SHORTCUTS = 60
"""Attempts to replace a part of the path by a straight line."""

ROUNDS = 4
"""Times that corners are cut; every time halves the turn at them."""

INSET = 0.02
"""How far inside the joint limits the search keeps between start and goal [rad]: a curve through its points may bulge."""


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


Free = Callable[[Array], bool]
"""Whether joint positions ``(7,)`` [rad] of the moving arm are free."""


def plan(
    world: CollisionWorld, arm: ArmKinematics, start: Array, goals: Array, q_other: Array, *, seed: int,
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
        if all(edge_free(free, a, b, resolution / 2) for a, b in zip(found[:-1], found[1:], strict=True)):
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


def edge_free(free: Free, a: Array, b: Array, resolution: float = RESOLUTION) -> bool:
    """Whether the straight line between two configurations ``(7,)`` [rad] is free, coarse to fine, ends excluded."""
    steps = max(1, int(np.ceil(np.linalg.norm(b - a) / resolution)))
    return all(free(a + (b - a) * (k / steps)) for k in _coarse_to_fine(steps))


def _coarse_to_fine(steps: int) -> list[int]:
    """1..steps-1, halving the gaps: a collision is found early wherever it is."""
    order, stride = [], 1 << max(0, (steps - 1).bit_length() - 1)
    while stride:
        order += range(stride, steps, 2 * stride)
        stride //= 2
    return order


def _rrt_connect(
    budget: _Budget, arm: ArmKinematics, start: Array, goals: list[Array], seed: int, resolution: float
) -> Array | None:
    """OMPL's RRT-Connect with our own edge check; everything lives in this function, so OMPL leaves no noise at exit."""
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


def shortened(free: Free, path: Array, rng: np.random.Generator, resolution: float = RESOLUTION / 2) -> Array:
    """The path ``(n, 7)`` [rad] with detours cut: random pairs of points on it are joined by lines where these are free.

    Geraerts and Overmars, "Creating High-quality Paths for Motion Planning", IJRR 2007, section 3.1. Points that can be
    left out without a contact are left out at the end.
    """
    points = list(path)
    for _ in range(SHORTCUTS):
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        ends = np.concatenate([[0.0], np.cumsum(lengths)])
        s, t = np.sort(rng.uniform(0.0, ends[-1], 2))
        i, j = (min(int(np.searchsorted(ends, x, "right")) - 1, len(points) - 2) for x in (s, t))
        if i == j:
            continue
        a = points[i] + (points[i + 1] - points[i]) * ((s - ends[i]) / lengths[i])
        b = points[j] + (points[j + 1] - points[j]) * ((t - ends[j]) / lengths[j])
        if edge_free(free, a, b, resolution):
            points = [*points[: i + 1], a, b, *points[j + 1 :]]
    k = 1
    while k < len(points) - 1:
        if edge_free(free, points[k - 1], points[k + 1], resolution):
            del points[k]
        else:
            k += 1
    return np.array(points)


def rounded(free: Free, path: Array, resolution: float = RESOLUTION / 2) -> Array:
    """The path ``(n, 7)`` [rad] with its corners cut again and again, so that it can be followed without stopping.

    Chaikin, "An Algorithm for High-Speed Curve Generation", 1974, with a smaller cut at a corner where the full one
    touches something. All points stay in the convex hull of the path's, hence within joint limits.
    """
    for _ in range(ROUNDS):
        points = [path[0]]
        for a, corner, b in zip(path[:-2], path[1:-1], path[2:], strict=True):
            points += _cut(free, a, corner, b, resolution)
        path = np.array([*points, path[-1]])
    return path


def _cut(free: Free, a: Array, corner: Array, b: Array, resolution: float) -> list[Array]:
    """What stands in place of a corner: two points on its edges whose connection is free, or the corner itself."""
    for share in (0.25, 0.125, 0.0625):
        first, second = corner + share * (a - corner), corner + share * (b - corner)
        if free(first) and free(second) and edge_free(free, first, second, resolution):
            return [first, second]
    return [corner]
