"""Whether this exact timed curve is legal and free, checked finer than anything before it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planners.collision import CollisionWorld, Contact
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
"""Every how many checked states the clearance is measured."""


@dataclass(frozen=True, slots=True)
class Certificate:
    """The curve is legal and free at every checked state.

    Attributes:
        states: States checked for collision.
        max_velocity_ratio: Largest velocity over its limit.
        max_acceleration_ratio: Largest acceleration over its limit.
        min_clearance: Smallest distance between bodies that may not touch [m], measured at a subset of the states.
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


def certify(
    world: CollisionWorld, arm: ArmKinematics, model: ArmModel, trajectory: Trajectory, q_other: Array
) -> Certificate | Uncertified:
    """Check the stored curve of one arm against limits and, in the world's present state, for contact.

    Velocity and acceleration peaks are exact for the cubic curve; positions are checked at the sampled states.
    """
    v, a = peaks(trajectory)
    v_ratio, a_ratio = float((v / np.asarray(model.velocity)).max()), float((a / np.asarray(model.acceleration)).max())
    if max(v_ratio, a_ratio) > 1.0:
        what, ratio = ("velocity", v_ratio) if v_ratio > 1.0 else ("acceleration", a_ratio)
        return Uncertified(0.0, f"{what} reaches {100 * ratio:.1f} % of its limit", None)
    times = _times(trajectory)
    positions = trajectory.sample(times)[0]
    outside = np.flatnonzero(((positions < arm.lower - 1e-9) | (positions > arm.upper + 1e-9)).any(axis=1))
    if outside.size:
        return Uncertified(float(times[outside[0]]), "a joint leaves its limits", None)
    clearance = np.inf
    for k, (t, q) in enumerate(zip(times, positions, strict=True)):
        both = np.concatenate([q, q_other] if arm.side == "left" else [q_other, q])
        if not world.free(both):
            contact = world.contact(both)
            return Uncertified(float(t), str(contact), contact)
        if k % CLEARANCE_EVERY == 0 or k == len(times) - 1:
            clearance = min(clearance, world.clearance(both)[0])
    return Certificate(len(times), v_ratio, a_ratio, float(clearance))


def _times(trajectory: Trajectory) -> Array:
    """Times at which states are checked [s]."""
    fine = np.linspace(0.0, trajectory.duration, max(2, int(np.ceil(trajectory.duration / STEP_TIME)) + 1))
    fastest = float(np.abs(trajectory.velocities).max())
    finer = fastest * STEP_TIME / STEP_JOINT
    if finer <= 1.0:
        return fine
    return np.linspace(0.0, trajectory.duration, int(np.ceil(len(fine) * finer)))
