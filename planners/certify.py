"""Whether this exact timed curve is legal and free, checked finer than anything before it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planners.collision import CollisionWorld, Contact
from planners.motion import both_arms, past_limit
from planners.timing import peaks
from robots.model import ArmKinematics
from robots.spatial import Array
from robots.trajectory import Trajectory
from robots.workcell import ArmModel

STEP_TIME = 0.004
"""Longest time between checked states [s]."""

STEP_JOINT = 0.01
"""Largest joint change between checked states [rad]."""

CLEARANCE_EVERY = 40
"""Every how many checked states the clearance is measured, besides at every state inside the margin."""

MARGIN_KEPT = 0.5
"""Share of the world's margin that must remain. Planners keep all of it at the states that they check; between these,
and where a curve rounds a corner, some of it may go."""


@dataclass(frozen=True, slots=True)
class Certificate:
    """The curve is legal and free at every checked state.

    Attributes:
        states: States checked for collision.
        max_velocity_ratio: Largest velocity over its limit.
        max_acceleration_ratio: Largest acceleration over its limit.
        min_clearance: Smallest distance between bodies that may not touch [m]; exact at every state inside the margin,
            else measured at the first, the last and every ``CLEARANCE_EVERY``-th state.
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
    """Check the stored curve of one arm against limits and, in the world's present state, for contact.

    Velocity and acceleration peaks are exact for the cubic curve; positions and contacts are checked at sampled states,
    at most ``STEP_TIME`` and ``STEP_JOINT`` apart. A state passes with ``MARGIN_KEPT`` of the world's margin.

    Args:
        world: Collisions, set up as they will be during the motion.
        arm: The arm that moves.
        model: Whose velocity and acceleration limits hold.
        trajectory: The curve.
        q_other: Joint positions of the other arm ``(7,)`` [rad].
    """
    ratios = _ratios(model, trajectory)
    if isinstance(ratios, Uncertified):
        return ratios
    times = _times(trajectory)
    positions = trajectory.sample(times)[0]
    if past := _outside(arm, times, positions):
        return past
    nearest = world.clearance(both_arms(arm, positions[0], q_other))[0]
    for k, q in enumerate(positions):
        both = both_arms(arm, q, q_other)
        inside = not world.free(both)
        if not inside and k % CLEARANCE_EVERY and k != len(times) - 1:
            continue
        distance, a, b = world.clearance(both)
        nearest = min(nearest, distance)
        if inside and distance <= MARGIN_KEPT * world.margin:
            contact = Contact(a, b, max(0.0, -distance))
            return Uncertified(float(times[k]), f"{contact} (distance {1e3 * distance:.1f} mm)", contact)
    return Certificate(len(times), *ratios, nearest)


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


def _times(trajectory: Trajectory) -> Array:
    """Times at which states are checked [s]."""
    fastest = float(peaks(trajectory)[0].max())
    step = min(STEP_TIME, STEP_JOINT / max(fastest, 1e-9))
    return np.linspace(0.0, trajectory.duration, int(np.ceil(trajectory.duration / step)) + 1)
