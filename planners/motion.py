"""Which collision-free joint path leads from one configuration of an arm to another: RRT-Connect on proven edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planners.collision import CollisionWorld, Contact
from planners.compiled.layout import FREE
from planners.given import numbers
from planners.ompl_search import PLANNERS, search
from planners.reasons import GoalOutOfReach, LoopOpen, OtherInTheWay, Tilted
from planners.shorten import SHORTCUTS, Free, rounded
from robots.errors import UnknownName
from robots.model import ArmKinematics
from robots.spatial import Array, frozen

TREE = "tree"
"""The planner that is used unless another one is asked for: RRT-Connect, compiled as a whole."""

RANGE = 1.0
"""Longest extension of the trees, L2 [rad]: the best of five values on MotionBenchMaker."""

SAMPLES_PER_ITERATION = 25
"""Samples of the compiled tree for each iteration allowed: most of them are refused before any check."""

OPTIMISING_TIME = 1.0
"""Time for OMPL's optimising planners [s], which use all of it."""

SLACK = 0.4
"""Share of the margin that may be lost between checked states; certificates ask for half of the margin."""

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
        numbers(self.points, (-1, 7), "the points of a joint path")


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
        checks: Configurations looked at; edges for OMPL's planners.
        iterations: Samples drawn.
    """

    checks: int
    iterations: int

    def __str__(self) -> str:
        return f"no path within {self.iterations} iterations ({self.checks} checked states)"


@dataclass(frozen=True, slots=True)
class NoPath:
    """Why there is no path."""

    reason: (
        StartInCollision
        | GoalInCollision
        | OutOfLimits
        | Exhausted
        | Tilted
        | LoopOpen
        | GoalOutOfReach
        | OtherInTheWay
    )

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
    planner: str = TREE,
) -> JointPath | NoPath:
    """Find a collision-free joint path of one arm while the other keeps still.

    A straight line to a goal is tried first, nearest goal first; then RRT-Connect, and the result is shortened and its
    corners are cut. Every edge is proven: at the states looked at it keeps the world's margin, and between them not
    more than ``SLACK`` of the margin can be lost. The same arguments give the same path: the search ends after a number
    of iterations, never by the clock, except for OMPL's optimising planners, which use all their time.

    Args:
        world: Collisions, already set up (object, fingers, allowed contacts).
        arm: The arm that moves.
        start: ``(7,)`` [rad].
        goals: ``(m, 7)`` [rad], any of which will do.
        q_other: Joint positions of the other arm ``(7,)`` [rad].
        seed: Makes the call repeatable.
        iterations: Of RRT-Connect.
        planner: ``TREE``, which is compiled as a whole, or a name of ``ompl_search.PLANNERS``.

    Returns:
        The path, from exactly ``start`` to exactly one of the goals, or why there is none.
    """
    start, goals = numbers(start, (7,), "the start"), numbers(np.atleast_2d(goals), (-1, 7), "the goals")
    q_other = numbers(q_other, (7,), "the other arm's joint positions")
    if planner != TREE and planner not in PLANNERS:
        raise UnknownName("planner", planner, (TREE, *PLANNERS))
    if refused := precheck(world, arm, start, goals, q_other):
        return NoPath(refused)
    free = checker(world, arm, q_other)
    usable = [goal for goal in goals if arm.within_limits(goal) and free(goal)]
    usable.sort(key=lambda goal: float(np.linalg.norm(goal - start)))
    search = _Search(world, arm, q_other, seed)
    found = (
        search.tree(start, usable, iterations) if planner == TREE else search.ompl(start, usable, planner, iterations)
    )
    if isinstance(found, Exhausted):
        return NoPath(found)
    if len(found) == 2:
        return JointPath(found)
    short = search.motion.shorten(found, seed=seed, margin=world.margin, slack=search.slack, attempts=SHORTCUTS)
    return JointPath(rounded(search.edge, short))


class _Search:
    """The compiled checks of one arm, and the searches that use them."""

    def __init__(self, world: CollisionWorld, arm: ArmKinematics, q_other: Array, seed: int) -> None:
        self.motion = world.motion([arm.side], both_arms(arm, arm.home, q_other))
        self.margin, self.slack, self.seed, self._arm = world.margin, SLACK * world.margin, seed, arm
        self.checks = 0

    def edge(self, a: Array, b: Array) -> bool:
        """Whether the straight line between two configurations ``(7,)`` [rad] is proven free."""
        self.checks += 1
        return self.motion.path(np.stack([a, b]), self.margin, self.slack)[1] == FREE

    def tree(self, start: Array, goals: list[Array], iterations: int) -> Array | Exhausted:
        """The compiled RRT-Connect."""
        found = self.motion.connect(
            start,
            np.array(goals),
            self._bounds(start, goals),
            seed=self.seed,
            margin=self.margin,
            slack=self.slack,
            longest=RANGE,
            samples=SAMPLES_PER_ITERATION * iterations,
        )
        return found.points if len(found.points) else Exhausted(found.states, found.samples)

    def ompl(self, start: Array, goals: list[Array], planner: str, iterations: int) -> Array | Exhausted:
        """One of OMPL's planners with the compiled check of edges."""
        for goal in goals:
            if self.edge(start, goal):
                return np.stack([start, goal])

        def free(q: Array) -> bool:
            return bool(self.motion.states(q[None], self.margin)[0] == FREE)

        asked = 0

        def spent() -> bool:
            nonlocal asked
            asked += 1
            return asked > iterations

        bounds = self._bounds(start, goals)
        stop = spent if planner == "RRTConnect" else OPTIMISING_TIME
        raw, _ = search(
            free, self.edge, start, np.array(goals), bounds, seed=self.seed, stop=stop, planner=planner, longest=RANGE
        )
        return Exhausted(self.checks, asked) if raw is None else raw

    def _bounds(self, start: Array, goals: list[Array]) -> Array:
        """Where samples are drawn ``(2, 7)`` [rad]: inside the limits, start and goals included."""
        ends = np.array([start, *goals])
        low = np.minimum(self._arm.lower + INSET, ends.min(axis=0))
        return np.stack([low, np.maximum(self._arm.upper - INSET, ends.max(axis=0))])


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


def precheck(
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
