"""Which joint path of an arm keeps a hand upright, as with a full cup: a projected search, proven at every instant."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from planners.certify import Uncertified
from planners.collision import CollisionWorld
from planners.compiled.layout import FREE
from planners.constrained import Constraint, Spent, connect, shortened, smoothed
from planners.given import numbers
from planners.motion import INSET, SLACK, Exhausted, JointPath, NoPath, both_arms, precheck
from planners.reasons import Tilted
from robots.model import ArmKinematics
from robots.spatial import Array, unit
from robots.trajectory import Trajectory

RESERVE, RESERVE_SHARE = 0.01, 0.1
"""How much less than allowed waypoints tilt the hand [rad], and at most this share of it: edges use up half of it, the
bulges of the timed curve may use the rest."""

AIM = 0.3
"""How far below the limit a projection aims, as a share of it: it stays clear of the edge of the constraint."""

NEWTON_STEPS = 20
"""Of one projection; 2 to 4 are enough."""

LONGEST = 0.5
"""Largest joint change of one Newton step [rad]."""

FINEST = 1e-4
"""How closely the largest tilt of a curve is bounded [rad]; searches prove their edges as closely."""

LOOK = 1e-3
"""Time between the instants at which a certificate looks at the tilt [s]."""

ATTEMPTS = 60
"""Shortcuts tried."""


@dataclass(frozen=True, slots=True)
class Level:
    """A curve never tilts the hand further than allowed.

    Attributes:
        states: Instants looked at.
        sampled: Largest tilt at these [rad].
        bound: No instant between them has more [rad].
    """

    states: int
    sampled: float
    bound: float


class Upright:
    """The tilt of one axis of a hand from the vertical.

    Attributes:
        arm: The arm.
        axis_hand: Unit vector ``(3,)`` in the hand frame that should point up.
    """

    def __init__(self, arm: ArmKinematics, axis_hand: Array) -> None:
        self.arm, self.axis_hand = arm, unit(numbers(axis_hand, (3,), "the axis of the hand"))

    def tilt(self, q: Array) -> float:
        """Angle of the axis from the vertical at ``q`` ``(7,)`` [rad], in ``[0, pi]``."""
        return _from_vertical(self.arm.hand(q).rotation @ self.axis_hand)

    def bound(self, a: Array, b: Array) -> float:
        """No tilt on the straight line between ``a`` and ``b`` [rad] exceeds this by the ends alone.

        A hand turns at most by the sum of its joints' turns, and so does an axis of it.
        """
        return (self.tilt(a) + self.tilt(b) + float(np.abs(b - a).sum())) / 2

    def keeps(self, a: Array, b: Array, limit: float) -> bool:
        """Whether the straight line between two configurations is proven to tilt by ``limit`` [rad] at most.

        The line is halved, and its halves again, until the bound of every part is within ``FINEST`` of the limit.
        """
        parts = [(0.0, 1.0, self.tilt(a), self.tilt(b))]
        if max(parts[0][2:]) > limit:
            return False
        turn = float(np.abs(b - a).sum())
        while parts:
            begin, end, first, last = parts.pop()
            if (first + last + (end - begin) * turn) / 2 <= limit + FINEST:
                continue
            middle = (begin + end) / 2
            tilt = self.tilt(a + middle * (b - a))
            if tilt > limit:
                return False
            parts += [(begin, middle, first, tilt), (middle, end, tilt, last)]
        return True

    def project(self, q: Array, limit: float, lower: Array, upper: Array) -> Array | None:
        """The configuration within limits near ``q`` ``(7,)`` [rad] that tilts by ``limit`` at most, or ``None``."""
        arm = self.arm
        for _ in range(NEWTON_STEPS):
            pin.computeJointJacobians(arm.model, arm.data, q)
            R = pin.updateFramePlacement(arm.model, arm.data, arm.hand_frame).rotation
            axis = R @ self.axis_hand
            over = _from_vertical(axis) - limit
            if over <= 0.0:
                return q
            J = R @ pin.getFrameJacobian(arm.model, arm.data, arm.hand_frame, pin.LOCAL)[3:]
            upward = np.cross(axis, [0.0, 0.0, 1.0])
            row = upward / max(float(np.linalg.norm(upward)), 1e-9) @ J
            change = row * ((over + AIM * limit) / max(float(row @ row), 1e-6))
            change *= min(1.0, LONGEST / max(float(np.abs(change).max()), 1e-12))
            q = np.clip(q + change, lower, upper)
        return None


def plan_level(
    world: CollisionWorld,
    arm: ArmKinematics,
    start: Array,
    goals: Array,
    q_other: Array,
    *,
    axis_hand: Array,
    tilt: float,
    seed: int,
    iterations: int = 1500,
) -> JointPath | NoPath:
    """Find a collision-free joint path of one arm that keeps an axis of its hand near the vertical.

    RRT-Connect with every step projected, then shortened and smoothed by the same rules. Each edge is proven free, as
    in ``motion.plan``, and proven upright: between two states the axis turns by no more than the joints do. The search
    stays a little inside the limit but for start and goal, so that a timed curve may bulge; ``certify_level`` proves
    that curve. The same
    arguments give the same path.

    Args:
        world: Collisions, already set up (object, fingers, allowed contacts).
        arm: The arm that moves.
        start: ``(7,)`` [rad].
        goals: ``(m, 7)`` [rad], any of which will do.
        q_other: Joint positions of the other arm ``(7,)`` [rad].
        axis_hand: Direction in the hand frame that is to point up ``(3,)``.
        tilt: Largest angle of it from the vertical [rad], in ``(0, pi]``.
        seed: Makes the call repeatable.
        iterations: Most samples.

    Returns:
        The path, from exactly ``start`` to exactly one of the goals, or why there is none.
    """
    start, goals = numbers(start, (7,), "the start"), numbers(np.atleast_2d(goals), (-1, 7), "the goals")
    q_other = numbers(q_other, (7,), "the other arm's joint positions")
    upright, tilt = Upright(arm, axis_hand), _allowed(tilt)
    if refused := precheck(world, arm, start, goals, q_other) or _tilted(upright, start, goals, tilt):
        return NoPath(refused)
    usable = [
        goal
        for goal in goals
        if arm.within_limits(goal) and upright.tilt(goal) <= tilt and world.free(both_arms(arm, goal, q_other))
    ]
    if not usable:
        least = min((goal for goal in goals), key=upright.tilt)
        return NoPath(Tilted("goal", upright.tilt(least), tilt))
    usable.sort(key=lambda goal: float(np.linalg.norm(goal - start)))
    ends = np.array([start, *usable])
    constraint = _constraint(world, upright, ends, q_other, tilt)
    rng = np.random.default_rng(seed)
    raw = connect(constraint, start, np.array(usable), rng=rng, iterations=iterations)
    if isinstance(raw, Spent):
        return NoPath(Exhausted(raw.edges, raw.samples))
    return JointPath(smoothed(constraint, shortened(constraint, raw, rng=rng, attempts=ATTEMPTS)))


def certify_level(arm: ArmKinematics, trajectory: Trajectory, axis_hand: Array, tilt: float) -> Level | Uncertified:
    """Prove that a curve keeps an axis of the hand near the vertical, at every instant.

    The tilt is computed every ``LOOK``. Between two instants it is less than the mean of both and half of what all
    joints can turn meanwhile; where that is too much, instants are put between them until it is not, to ``FINEST``.

    Args:
        arm: The arm that moves.
        trajectory: The curve.
        axis_hand: Direction in the hand frame that is to point up ``(3,)``.
        tilt: Largest angle of it from the vertical [rad].
    """
    upright, tilt = Upright(arm, axis_hand), _allowed(tilt)
    even = np.linspace(0.0, trajectory.duration, int(np.ceil(trajectory.duration / LOOK)) + 1)
    times = np.union1d(even, trajectory.times)

    def tilts_at(instants: Array) -> Array:
        return np.array([upright.tilt(q) for q in trajectory.sample(instants)[0]])

    tilts = tilts_at(times)
    states, sampled, bound = len(times), float(tilts.max()), float(tilts.max())
    begins, ends, first, last = times[:-1], times[1:], tilts[:-1], tilts[1:]
    while sampled <= tilt and len(begins):
        most = (first + last + _turns(trajectory, begins, ends)) / 2
        wide = most > tilt + FINEST
        bound = max(bound, float(most[~wide].max(initial=0.0)))
        begins, ends, first, last = (values[wide] for values in (begins, ends, first, last))
        times = (begins + ends) / 2
        tilts = tilts_at(times)
        states, sampled = states + len(times), max(sampled, float(tilts.max(initial=0.0)))
        begins, ends = np.concatenate([begins, times]), np.concatenate([times, ends])
        first, last = np.concatenate([first, tilts]), np.concatenate([tilts, last])
    if sampled > tilt:
        reason = f"the hand is tilted by {np.degrees(sampled):.2f} deg, limit {np.degrees(tilt):.2f} deg"
        return Uncertified(float(times[np.argmax(tilts)]), reason, None)
    return Level(states, sampled, max(bound, sampled))


def _turns(trajectory: Trajectory, begins: Array, ends: Array) -> Array:
    """No more than this do all joints together turn in each stretch ``(m,)`` [rad]; none contains a knot.

    Inside a stretch the acceleration is linear in time: its ends bound it, and with the velocity at the middle this
    bounds the velocity.
    """
    middle, half = (begins + ends) / 2, (ends - begins)[:, None] / 2
    inside = half[:, 0] * (1.0 - 1e-9)
    strongest = np.maximum(*(np.abs(trajectory.sample(t)[2]) for t in (middle - inside, middle + inside)))
    most = 2.0 * half * (np.abs(trajectory.sample(middle)[1]) + half * strongest)
    return np.asarray(most.sum(axis=1))


def _constraint(world: CollisionWorld, upright: Upright, ends: Array, q_other: Array, tilt: float) -> Constraint:
    """An upright hand among obstacles; waypoints keep the reserve and some room to joint limits, ``ends`` need not."""
    arm, reserve = upright.arm, min(RESERVE, RESERVE_SHARE * tilt)
    motion = world.motion([arm.side], both_arms(arm, ends[0], q_other))
    lower = np.minimum(arm.lower + INSET, ends.min(axis=0))
    upper = np.maximum(arm.upper - INSET, ends.max(axis=0))

    def project(q: Array) -> Array | None:
        is_end = bool((q == ends).all(axis=1).any())
        return q if is_end else upright.project(q, tilt - reserve, lower, upper)

    def edge(a: Array, b: Array) -> bool:
        if motion.path(np.stack([a, b]), world.margin, SLACK * world.margin)[1] != FREE:
            return False
        needed = max(tilt - reserve, upright.tilt(a), upright.tilt(b))
        return upright.keeps(a, b, min(tilt, needed + reserve / 2))

    return Constraint(project, edge, lower, upper)


def _tilted(upright: Upright, start: Array, goals: Array, limit: float) -> Tilted | None:
    """Whether the start, or every goal, tilts the hand too far."""
    if (tilt := upright.tilt(start)) > limit:
        return Tilted("start", tilt, limit)
    least = min(upright.tilt(goal) for goal in goals)
    return Tilted("goal", least, limit) if least > limit else None


def _allowed(tilt: float) -> float:
    """The limit itself; ``ValueError`` for one that means nothing."""
    if not 0.0 < tilt <= np.pi:
        raise ValueError(f"the tilt must lie in (0, pi] rad, not {tilt} rad")
    return float(tilt)


def _from_vertical(axis: Array) -> float:
    """Angle of a unit vector ``(3,)`` from the vertical [rad]; exact also near zero."""
    x, y, z = axis.tolist()
    return math.atan2(math.hypot(x, y), z)
