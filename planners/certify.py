"""Whether this exact timed curve is legal and free, at every instant of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from planners.clock import Beside, Clock
from planners.collision import CollisionWorld, Contact
from planners.compiled.cell import Motion
from planners.compiled.layout import FREE, HIT
from planners.given import numbers
from planners.motion import both_arms, past_limit
from planners.timing import Together, peaks
from robots.model import ArmKinematics, DualArm
from robots.spatial import Array
from robots.trajectory import Trajectory
from robots.workcell import SIDES, ArmModel, Side

STEP_TIME = 0.004
"""Longest time between sampled states [s]."""

STEP_JOINT = 0.01
"""Largest joint change between sampled states [rad]."""

CLEARANCE_EVERY = 40
"""Every how many sampled states the clearance is measured, besides at every state inside the margin."""

MARGIN_KEPT = 0.5
"""Share of the world's margin that must remain everywhere. Planners keep all of it at the states that they look at;
between these, and where a curve rounds a corner, some of it may go."""

PARTS = 4
"""Into how many equal times a stretch is cut that could not be proven."""

SMALLEST = 2e-5
"""Stretches in which no joint moves further from the middle [rad] are not cut: a hundredth of a millimetre of clearance
beyond what must be kept is the least that can be proven."""


class Curve(Protocol):
    """A timed motion of one arm or of both: cubic between its knots."""

    @property
    def times(self) -> Array:
        """Of the knots ``(n,)`` [s]."""

    def sample(self, t: Any) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations ``(m, d)`` at ``(m,)`` times."""


@dataclass(frozen=True, slots=True)
class Certificate:
    """The curve is legal and free at every instant.

    Attributes:
        states: Sampled states, and stretches of the curve that were proven free as a whole.
        max_velocity_ratio: Largest velocity over its limit.
        max_acceleration_ratio: Largest acceleration over its limit.
        min_clearance: Smallest distance between bodies that may not touch [m]; exact at every sampled state inside the
            margin, else measured at the first, the last and every ``CLEARANCE_EVERY``-th state.
    """

    states: int
    max_velocity_ratio: float
    max_acceleration_ratio: float
    min_clearance: float


@dataclass(frozen=True, slots=True)
class Uncertified:
    """The first thing wrong with a curve.

    Attributes:
        time: When [s].
        reason: What, with numbers.
        contact: The contact, where it is one.
    """

    time: float
    reason: str
    contact: Contact | None

    def __str__(self) -> str:
        return f"at {self.time:.2f} s: {self.reason}"


def certify(
    world: CollisionWorld, arm: ArmKinematics, model: ArmModel, trajectory: Trajectory, q_other: Array
) -> Certificate | Uncertified:
    """Prove the stored curve of one arm within limits and, in the world's present state, free of contact.

    Velocity and acceleration peaks are exact for the cubic curve; positions are checked at sampled states, at most
    ``STEP_TIME`` and ``STEP_JOINT`` apart. Contact is excluded at every instant: the curve is cut into stretches, and a
    stretch counts as free when at its middle all bodies are further apart than ``MARGIN_KEPT`` of the world's margin
    plus what any point of them can move within the stretch.

    Args:
        world: Collisions, set up as they will be during the motion.
        arm: The arm that moves.
        model: Whose velocity and acceleration limits hold.
        trajectory: The curve.
        q_other: Joint positions of the other arm ``(7,)`` [rad].
    """
    numbers(q_other, (7,), "the other arm's joint positions")
    ratios = _ratios(model, trajectory)
    if isinstance(ratios, Uncertified):
        return ratios
    times = _times(peaks(trajectory)[0], trajectory.duration)
    if past := _outside(arm, times, trajectory.sample(times)[0]):
        return past
    return _free(world, [arm.side], trajectory, times, ratios, lambda q: both_arms(arm, q, q_other))


def certify_together(world: CollisionWorld, arms: DualArm, curve: Together) -> Certificate | Uncertified:
    """As ``certify``, of both arms that move at once; limits are those of the world's workcell.

    Args:
        world: Collisions, set up as they will be during the motion.
        arms: Both arms.
        curve: Both curves.
    """
    times = _times(np.maximum(peaks(curve.left)[0], peaks(curve.right)[0]), curve.duration)
    found = []
    for side, trajectory in zip(SIDES, (curve.left, curve.right), strict=True):
        ratios = _ratios(world.workcell.arm(side), trajectory)
        if isinstance(ratios, Uncertified):
            return ratios
        if past := _outside(arms[side], times, trajectory.sample(times)[0]):
            return past
        found.append(ratios)
    velocity, acceleration = (max(pair) for pair in zip(*found, strict=True))
    return _free(world, SIDES, curve, times, (velocity, acceleration), lambda q: q)


def certify_beside(
    world: CollisionWorld, arm: ArmKinematics, beside: Beside, other_curve: Trajectory, since: float
) -> Certificate | Uncertified:
    """As ``certify``, of an arm's curve while the other arm follows its own, whose limits are not looked at again.

    Proven is the time from ``since`` on the other's clock until both rest; before and after its curve an arm stands.

    Args:
        world: Collisions, set up as they will be during the motion.
        arm: The arm.
        beside: Its curve, and when it begins.
        other_curve: The other arm's curve, from time 0 of its clock.
        since: When the proof begins, at most when the arm's curve does [s].
    """
    ratios = _ratios(world.workcell.arm(arm.side), beside.trajectory)
    if isinstance(ratios, Uncertified):
        return ratios
    clock = Clock(arm.side, beside, other_curve, since)
    fastest = np.maximum(peaks(beside.trajectory)[0], peaks(other_curve)[0])
    times = _times(fastest, clock.duration)
    mine = slice(0, 7) if arm.side == "left" else slice(7, 14)
    if past := _outside(arm, times, clock.sample(times)[0][:, mine]):
        return Uncertified(past.time + since, past.reason, None)
    found = _free(world, SIDES, clock, times, ratios, lambda q: q)
    return found if isinstance(found, Certificate) else Uncertified(found.time + since, found.reason, found.contact)


def _free(
    world: CollisionWorld,
    sides: Sequence[Side],
    curve: Curve,
    times: Array,
    ratios: tuple[float, float],
    whole: Callable[[Array], Array],
) -> Certificate | Uncertified:
    """Whether a curve of the arms on ``sides`` is free; ``whole`` makes ``(14,)`` joint positions of its own."""
    positions = curve.sample(times)[0]
    motion = world.motion(sides, whole(positions[0]))
    kept = MARGIN_KEPT * world.margin
    nearest = world.clearance(whole(positions[0]))[0]
    # the motion knows only the pairs that it changes; all others are as they are at the first state
    proven, failed = (0, 0.0) if nearest <= kept else _prove(motion, curve, kept)
    if failed is not None:
        return _refusal(world, whole(curve.sample(failed)[0][0]), failed)
    inside = motion.states(positions, world.margin) != FREE
    for k in np.flatnonzero(inside | (np.arange(len(times)) % CLEARANCE_EVERY == 0) | (times == times[-1])):
        nearest = min(nearest, world.clearance(whole(positions[k]))[0])
    return Certificate(len(times) + proven, *ratios, nearest)


def _prove(motion: Motion, trajectory: Curve, margin: float) -> tuple[int, float | None]:
    """How many stretches of the curve were proven to keep the margin, and the first instant at which that failed [s].

    Inside a stretch the acceleration of the cubic is linear in time, so that its ends bound it, the velocity at the
    middle and that bound give the velocity, and this the way from the middle, joint by joint.
    """
    begins, ends = trajectory.times[:-1], trajectory.times[1:]
    proven = 0
    while len(begins):
        middle, half = (begins + ends) / 2, (ends - begins)[:, None] / 2
        centres, speeds, _ = trajectory.sample(middle)
        inside = half[:, 0] * (1.0 - 1e-9)
        strongest = np.maximum(*(np.abs(trajectory.sample(t)[2]) for t in (middle - inside, middle + inside)))
        plays = half * (np.abs(speeds) + 1.001 * half * strongest + 1e-9)
        verdicts = motion.cells(centres, plays, margin)
        proven += int((verdicts == FREE).sum())
        open_ = verdicts != FREE
        final = (verdicts == HIT) | (open_ & (plays.max(axis=1) < SMALLEST))
        if final.any():
            return proven, float(middle[final].min())
        shares = np.arange(PARTS + 1) / PARTS
        cuts = begins[open_, None] + (ends - begins)[open_, None] * shares
        begins, ends = cuts[:, :-1].ravel(), cuts[:, 1:].ravel()
    return proven, None


def _refusal(world: CollisionWorld, q: Array, time: float) -> Uncertified:
    """What is too close at ``q`` ``(14,)`` [rad]."""
    distance, a, b = world.clearance(q)
    contact = Contact(a, b, max(0.0, -distance))
    return Uncertified(time, f"{contact} (distance {1e3 * distance:.1f} mm)", contact)


def _ratios(model: ArmModel, trajectory: Trajectory) -> tuple[float, float] | Uncertified:
    """Largest velocity and acceleration over their limits."""
    found = []
    limits = (("velocity", model.velocity, "rad/s"), ("acceleration", model.acceleration, "rad/s^2"))
    for peak, (what, limit, unit) in zip(peaks(trajectory), limits, strict=True):
        ratio = peak / np.asarray(limit)
        k = int(np.argmax(ratio))
        found.append(float(ratio[k]))
        if ratio[k] > 1.0 + 1e-9:
            series = trajectory.sample(trajectory.times)[1 if what == "velocity" else 2]
            time = float(trajectory.times[np.argmax(np.abs(series[:, k]))])
            reason = f"{model.joints[k]} reaches {what} {peak[k]:.3f} {unit}, limit {limit[k]:g}"
            return Uncertified(time, reason, None)
    return found[0], found[1]


def _outside(arm: ArmKinematics, times: Array, positions: Array) -> Uncertified | None:
    """The first state at which a joint is past its limits."""
    outside = np.flatnonzero(((positions < arm.lower - 1e-9) | (positions > arm.upper + 1e-9)).any(axis=1))
    if not outside.size:
        return None
    joint, value, limit = past_limit(arm, positions[outside[0]])
    return Uncertified(float(times[outside[0]]), f"{joint} at {value:.4f} rad, limit {limit:.4f} rad", None)


def _times(fastest: Array, duration: float) -> Array:
    """Times at which states are checked [s], for the largest velocity of each joint [rad/s]."""
    step = min(STEP_TIME, STEP_JOINT / max(float(fastest.max()), 1e-9))
    return np.linspace(0.0, duration, int(np.ceil(duration / step)) + 1)
