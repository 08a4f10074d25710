"""How one arm gets to its goal while the other follows a curve that is given: which path, begun when."""

from __future__ import annotations

import numpy as np

from planners.certify import Certificate, certify_beside
from planners.clock import Beside, Clock
from planners.collision import CollisionWorld, Contact
from planners.compiled.layout import FREE
from planners.given import numbers
from planners.motion import (
    RANGE,
    SLACK,
    Exhausted,
    GoalInCollision,
    JointPath,
    NoPath,
    OutOfLimits,
    both_arms,
    past_limit,
    plan,
    precheck,
)
from planners.ompl_search import search
from planners.reasons import OtherInTheWay
from planners.shorten import Edge, rounded
from planners.timing import NotTimeable, retime
from robots.model import ArmKinematics
from robots.spatial import Array
from robots.trajectory import Trajectory
from robots.workcell import SIDES

DELAY = 0.1
"""Time between the begins that are tried [s]."""

LOOK = 0.004
"""Time between the states that are looked at before a curve is proven [s]."""

MOMENTS = 3
"""Moments of the other arm's curve, its end first, to whose posture a path is planned."""

SWEEP = 10
"""Moments of the other arm's curve that a path must be free of together, to pass it at any time."""

SWEEP_EDGES = 1500
"""Edges that may be asked for on the search for such a path."""

CUTS = 40
"""Attempts to shorten it."""


def plan_beside(
    world: CollisionWorld,
    arm: ArmKinematics,
    start: Array,
    goals: Array,
    other_curve: Trajectory,
    *,
    begin: float = 0.0,
    seed: int,
    speed: float = 1.0,
) -> Beside | NoPath:
    """Find a timed motion of one arm that is free while the other arm follows its curve.

    Paths are planned past single postures of the other arm, and past its whole sweep at once. Each is timed and begun
    ever later until it meets nothing; of those that do, the one that arrives first is returned. It is proven at every
    instant, from ``begin`` until both arms rest. To wait until the other arm rests is one of the choices.

    Args:
        world: Collisions, already set up, and the same all the time.
        arm: The arm that is planned for.
        start: ``(7,)`` [rad]; there the arm stands from ``begin`` until its motion begins.
        goals: ``(m, 7)`` [rad], any of which will do; there it stands afterwards.
        other_curve: The other arm's motion; it stands at its ends before and after.
        begin: Earliest begin of the motion, on the other arm's clock [s].
        seed: Makes the call repeatable.
        speed: Share of the velocity limits, as in ``retime``.

    Returns:
        The motion and when it begins, or why there is none.
    """
    start, goals = numbers(start, (7,), "the start"), numbers(np.atleast_2d(goals), (-1, 7), "the goals")
    if not (np.isfinite(begin) and begin >= 0.0):
        raise ValueError(f"begin must be a time from 0 s on, not {begin} s")
    usable = _usable(world, arm, goals, other_curve.positions[-1])
    if refused := precheck(world, arm, start, start[None], other_curve.at(begin)):
        return NoPath(refused)
    if isinstance(usable, NoPath):
        return usable
    tried = _Tried(world, arm, other_curve, begin)
    nothing: NoPath | None = None
    for moment in range(MOMENTS):
        at = begin + (max(begin, other_curve.duration) - begin) * (1.0 - moment / (MOMENTS - 1))
        path = plan(world, arm, start, usable, other_curve.at(at), seed=seed + moment)
        if isinstance(path, JointPath):
            tried.begins(retime(path, world.workcell.arm(arm.side), speed=speed))
        else:
            nothing = nothing or path
    if tried.best is None or tried.best.begin > begin:
        around = _past_sweep(world, arm, start, usable, other_curve, begin, seed)
        if around is not None:
            tried.begins(retime(around, world.workcell.arm(arm.side), speed=speed))
    return tried.best or tried.failure() or nothing or NoPath(Exhausted(0, 0))


def _usable(world: CollisionWorld, arm: ArmKinematics, goals: Array, q_other: Array) -> Array | NoPath:
    """The goals at which the arm may stay, or why there is none."""
    legal = [goal for goal in goals if arm.within_limits(goal)]
    if not legal:
        return NoPath(OutOfLimits("goal", *past_limit(arm, goals[0])))
    contacts = [world.contact(both_arms(arm, goal, q_other)) for goal in legal]
    free = [goal for goal, contact in zip(legal, contacts, strict=True) if contact is None]
    if not free and contacts[0] is not None:
        return NoPath(GoalInCollision(contacts[0]))
    return np.array(free)


class _Tried:
    """The best motion so far, and how far the others came.

    Attributes:
        best: That arrives first, if any is free.
    """

    def __init__(self, world: CollisionWorld, arm: ArmKinematics, other_curve: Trajectory, since: float) -> None:
        self._world, self._arm, self._other, self._since = world, arm, other_curve, since
        self._motion = world.motion(SIDES, both_arms(arm, arm.home, other_curve.positions[0]))
        self._paths, self._furthest = 0, -1.0
        self._contact: Contact | None = None
        self.best: Beside | None = None

    def begins(self, trajectory: Trajectory | NotTimeable) -> None:
        """Try a motion from ever later begins, as long as it would arrive before the best."""
        if isinstance(trajectory, NotTimeable):
            return
        self._paths += 1
        last = max(self._since, self._other.duration)
        count = int(np.ceil((last - self._since) / DELAY))
        for k in range(count + 1):
            beside = Beside(min(last, self._since + k * DELAY), trajectory)
            if self.best is not None and beside.end >= self.best.end:
                return
            if self._looks_free(beside) and self._proven(beside):
                self.best = beside
                return

    def _looks_free(self, beside: Beside) -> bool:
        clock = Clock(self._arm.side, beside, self._other, self._since)
        times = np.linspace(0.0, clock.duration, int(np.ceil(clock.duration / LOOK)) + 1)
        positions = clock.sample(times)[0]
        touching = np.flatnonzero(self._motion.states(positions, self._world.margin) != FREE)
        if not touching.size:
            return True
        time, q = float(times[touching[0]]) + self._since, positions[touching[0]]
        if time > self._furthest:
            distance, a, b = self._world.clearance(q)
            self._furthest, self._contact = time, Contact(a, b, max(0.0, -distance))
        return False

    def _proven(self, beside: Beside) -> bool:
        found = certify_beside(self._world, self._arm, beside, self._other, self._since)
        if isinstance(found, Certificate):
            return True
        if found.contact is not None and found.time > self._furthest:
            self._furthest, self._contact = found.time, found.contact
        return False

    def failure(self) -> NoPath | None:
        """What is in the way of the motion that stayed free for longest."""
        if self._contact is None:
            return None
        return NoPath(OtherInTheWay(self._furthest, self._contact, self._paths))


def _past_sweep(
    world: CollisionWorld,
    arm: ArmKinematics,
    start: Array,
    goals: Array,
    other_curve: Trajectory,
    begin: float,
    seed: int,
) -> JointPath | None:
    """A path that is free of the other arm wherever it is on its curve from ``begin`` on."""
    moments = np.linspace(begin, max(begin, other_curve.duration), SWEEP)
    motions = [world.motion([arm.side], both_arms(arm, start, other_curve.at(t))) for t in moments]
    margin, slack, asked = world.margin, SLACK * world.margin, 0

    def free(q: Array) -> bool:
        return all(motion.states(q[None], margin)[0] == FREE for motion in motions)

    def edge(a: Array, b: Array) -> bool:
        nonlocal asked
        asked += 1
        return all(motion.path(np.stack([a, b]), margin, slack)[1] == FREE for motion in motions)

    usable = np.array([goal for goal in goals if free(goal)])
    if not len(usable) or not free(start):
        return None
    ends = np.vstack([start, usable])
    bounds = np.stack([np.minimum(arm.lower, ends.min(axis=0)), np.maximum(arm.upper, ends.max(axis=0))])
    raw, _ = search(free, edge, start, usable, bounds, seed=seed, stop=lambda: asked > SWEEP_EDGES, longest=RANGE)
    if raw is None:
        return None
    short = _cut(edge, raw, np.random.default_rng(seed))
    return JointPath(rounded(edge, short) if len(short) > 2 else short)


def _cut(edge: Edge, path: Array, rng: np.random.Generator) -> Array:
    """The path ``(n, 7)`` [rad] with random detours replaced by straight lines."""
    for _ in range(CUTS):
        if len(path) < 3:
            break
        i, j = np.sort(rng.choice(len(path) - 1, 2, replace=True))
        a, b = (path[k] + rng.uniform() * (path[k + 1] - path[k]) for k in (i, j))
        if i != j and edge(a, b):
            path = np.concatenate([path[: i + 1], [a, b], path[j + 1 :]])
    return path
