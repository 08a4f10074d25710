"""Which collision-free joint path leads from one configuration of an arm to another: OMPL's RRT-Connect."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from planners.collision import CollisionWorld, Contact
from robots.model import ArmKinematics
from robots.spatial import Array, frozen

RESOLUTION = 1.0 / 32.0
"""Distance between checked states of an edge, L2 [rad]."""

RANGE = 1.0
"""Longest extension of the trees, L2 [rad]."""

SHORTCUTS = 60
"""Attempts to replace a part of the path by a straight line."""


@dataclass(frozen=True, slots=True, eq=False)
class JointPath:
    """Joint positions joined by straight lines.

    Attributes:
        points: ``(n, 7)`` [rad], ``n >= 2``.
    """

    points: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen(self.points))


@dataclass(frozen=True, slots=True)
class StartInCollision:
    """The start touches something."""

    contact: Contact

    def __str__(self) -> str:
        return f"the start is in collision: {self.contact}"


@dataclass(frozen=True, slots=True)
class GoalInCollision:
    """Every goal touches something; the contact of the first."""

    contact: Contact

    def __str__(self) -> str:
        return f"the goal is in collision: {self.contact}"


@dataclass(frozen=True, slots=True)
class OutOfLimits:
    """The start, or every goal, leaves a joint's range [rad]."""

    which: str
    joint: str
    value: float
    limit: float

    def __str__(self) -> str:
        return f"{self.which}: {self.joint} at {self.value:.3f} rad is past its limit {self.limit:.3f} rad"


@dataclass(frozen=True, slots=True)
class Exhausted:
    """The search used its budget of state checks."""

    checks: int

    def __str__(self) -> str:
        return f"no path within {self.checks} checked states"


@dataclass(frozen=True, slots=True)
class NoPath:
    """Why there is no path."""

    reason: StartInCollision | GoalInCollision | OutOfLimits | Exhausted

    def __str__(self) -> str:
        return str(self.reason)


Free = Callable[[Array], bool]


def plan(
    world: CollisionWorld, arm: ArmKinematics, start: Array, goals: Array, q_other: Array, *, seed: int,
    checks: int = 60_000,
) -> JointPath | NoPath:
    """Find a collision-free joint path of one arm while the other keeps still.

    A straight line to a goal is tried first, nearest goal first; then RRT-Connect (Kuffner and LaValle, ICRA 2000), and
    the result is shortened. The same arguments give the same path: the search ends after a number of checked states,
    never by the clock.

    Args:
        world: Collisions, already set up (object, fingers, allowed contacts).
        arm: The arm that moves.
        start: ``(7,)`` [rad].
        goals: ``(m, 7)`` [rad], any of which will do.
        q_other: Joint positions of the other arm ``(7,)`` [rad].
        seed: Makes the call repeatable.
        checks: States the search may check.
    """
    start, goals = np.asarray(start, dtype=np.float64), np.atleast_2d(np.asarray(goals, dtype=np.float64))
    free = _checker(world, arm, q_other)
    if refused := _precheck(world, arm, start, goals, q_other):
        return NoPath(refused)
    usable = [goal for goal in goals if arm.within_limits(goal) and free(goal)]
    usable.sort(key=lambda goal: float(np.linalg.norm(goal - start)))
    for goal in usable:
        if edge_free(free, start, goal):
            return JointPath(np.stack([start, goal]))
    found = _rrt_connect(free, arm, start, usable, seed, checks)
    if found is None:
        return NoPath(Exhausted(checks))
    return JointPath(shortened(free, found, np.random.default_rng(seed)))


def _checker(world: CollisionWorld, arm: ArmKinematics, q_other: Array) -> Free:
    both = np.empty(14)
    mine, others = (slice(0, 7), slice(7, 14)) if arm.side == "left" else (slice(7, 14), slice(0, 7))
    both[others] = q_other

    def free(q: Array) -> bool:
        both[mine] = q
        return world.free(both)

    return free


def _precheck(
    world: CollisionWorld, arm: ArmKinematics, start: Array, goals: Array, q_other: Array
) -> StartInCollision | GoalInCollision | OutOfLimits | None:
    """What makes a search pointless: without this RRT-Connect would burn its whole budget on a bad goal."""
    legal = [goal for goal in goals if arm.within_limits(goal)]
    for which, q, bad in (("start", start, not arm.within_limits(start)), ("goal", goals[0], not legal)):
        if bad:
            return _past_limit(which, arm, q)

    def touching(q: Array) -> Contact | None:
        return world.contact(np.concatenate([q, q_other] if arm.side == "left" else [q_other, q]))

    if contact := touching(start):
        return StartInCollision(contact)
    contacts = [touching(goal) for goal in legal]
    return GoalInCollision(contacts[0]) if contacts[0] is not None and all(contacts) else None


def _past_limit(which: str, arm: ArmKinematics, q: Array) -> OutOfLimits:
    k = int(np.argmax(np.maximum(arm.lower - q, q - arm.upper)))
    limit = arm.lower[k] if q[k] < arm.lower[k] else arm.upper[k]
    return OutOfLimits(which, str(arm.model.names[k + 1]), float(q[k]), float(limit))


def edge_free(free: Free, a: Array, b: Array, resolution: float = RESOLUTION) -> bool:
    """Whether the straight line between two configurations is free, coarse to fine, ends excluded."""
    steps = max(1, int(np.ceil(np.linalg.norm(b - a) / resolution)))
    for k in _coarse_to_fine(steps):
        if not free(a + (b - a) * (k / steps)):
            return False
    return True


def _coarse_to_fine(steps: int) -> list[int]:
    """1..steps-1 in van der Corput order: a collision is found early wherever it is."""
    order, stride = [], 1 << max(0, steps.bit_length() - 1)
    seen: set[int] = {0, steps}
    while stride >= 1:
        for k in range(stride, steps, stride):
            if k not in seen:
                seen.add(k)
                order.append(k)
        stride //= 2
    return order


def _rrt_connect(
    free: Free, arm: ArmKinematics, start: Array, goals: list[Array], seed: int, checks: int
) -> Array | None:
    """OMPL's RRT-Connect with our own edge check; everything lives in this function, so OMPL leaves no noise at exit."""
    from ompl import base, geometric, util

    util.setLogLevel(util.LOG_NONE)
    util.RNG.setSeed(seed)
    used = 0

    def counted(q: Array) -> bool:
        nonlocal used
        used += 1
        return free(q)

    space = base.RealVectorStateSpace(7)
    bounds = base.RealVectorBounds(7)
    for k in range(7):
        bounds.setLow(k, float(arm.lower[k]))
        bounds.setHigh(k, float(arm.upper[k]))
    space.setBounds(bounds)
    info = base.SpaceInformation(space)

    class Edges(base.MotionValidator):  # type: ignore[misc]
        """Checks a whole edge, with its end."""

        def checkMotion(self, a: object, b: object) -> bool:
            qa, qb = _values(a), _values(b)
            return counted(qb) and edge_free(counted, qa, qb)

    info.setStateValidityChecker(lambda state: counted(_values(state)))
    info.setMotionValidator(Edges(info))
    info.setStateValidityCheckingResolution(RESOLUTION / space.getMaximumExtent())
    info.setup()
    problem = base.ProblemDefinition(info)
    problem.addStartState(_state(space, start))
    ends = base.GoalStates(info)
    for goal in goals:
        ends.addState(_state(space, goal))
    problem.setGoal(ends)
    planner = geometric.RRTConnect(info)
    planner.setProblemDefinition(problem)
    planner.setRange(RANGE)
    planner.setup()
    planner.solve(base.PlannerTerminationCondition(lambda: used >= checks))
    if not problem.hasExactSolution():
        return None
    states = problem.getSolutionPath().getStates()
    return np.array([_values(state) for state in states])


def _values(state: object) -> Array:
    return np.array([state[k] for k in range(7)])  # type: ignore[index]


def _state(space: object, q: Array) -> object:
    state = space.allocState()  # type: ignore[attr-defined]
    for k in range(7):
        state[k] = float(q[k])
    return state


def shortened(free: Free, path: Array, rng: np.random.Generator) -> Array:
    """The path with detours cut: random pairs of points on it are joined by straight lines where these are free.

    Geraerts and Overmars, "Creating High-quality Paths for Motion Planning", IJRR 2007, section 3.1.
    """
    points = [np.asarray(q) for q in path]
    for _ in range(SHORTCUTS):
        if len(points) <= 2:
            break
        lengths = np.array([np.linalg.norm(b - a) for a, b in zip(points[:-1], points[1:], strict=True)])
        ends = np.concatenate([[0.0], np.cumsum(lengths)])
        s, t = np.sort(rng.uniform(0.0, ends[-1], 2))
        i, j = int(np.searchsorted(ends, s, "right") - 1), int(np.searchsorted(ends, t, "right") - 1)
        i, j = min(i, len(points) - 2), min(j, len(points) - 2)
        if i == j:
            continue
        a = points[i] + (points[i + 1] - points[i]) * ((s - ends[i]) / lengths[i])
        b = points[j] + (points[j + 1] - points[j]) * ((t - ends[j]) / lengths[j])
        if edge_free(free, a, b, RESOLUTION / 2):
            points = [*points[: i + 1], a, b, *points[j + 1 :]]
    return np.array(_distinct(points))


def _distinct(points: list[Array]) -> list[Array]:
    kept = [points[0]]
    for q in points[1:]:
        if np.linalg.norm(q - kept[-1]) > 1e-6:
            kept.append(q)
    return kept if len(kept) > 1 else [points[0], points[-1]]
