"""How fast both arms can move one object that both hold: one schedule, the loop measured at every instant of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from planners.certify import Certificate, Uncertified, certify_together
from planners.chain import ChainPath, loop_constraint
from planners.collision import CollisionWorld
from planners.constrained import spaced
from planners.loop import relative
from planners.timing import NotTimeable, Together, retime_together
from robots.model import DualArm
from robots.spatial import Array, angle_between
from robots.workcell import SIDES

LOOP_GAP, LOOP_ANGLE = 5e-4, float(np.radians(0.2))
"""How far the loop may open on the timed curve [m] and [rad]: what pads and wrists give way to without slipping."""

LOOK = 1e-3
"""Time between the instants at which the loop is measured [s]."""

FINER = 3
"""How often waypoints are put closer when the timed curve opens the loop too far."""

CLOSER = 0.02
"""Distance to which waypoints are put closer at first [rad]; then half as far each time."""


@dataclass(frozen=True, slots=True, eq=False)
class ChainMotion:
    """A timed motion of both arms with one object.

    Attributes:
        curve: Both arms on one schedule.
        certificate: That it is legal and free.
        gap: Furthest that the loop opens [m].
        angle: Most that it turns open [rad].
    """

    curve: Together
    certificate: Certificate
    gap: float
    angle: float


def timed_chain(
    world: CollisionWorld, arms: DualArm, path: ChainPath, *, speed: float = 1.0
) -> ChainMotion | NotTimeable | Uncertified:
    """The fastest motion of both arms along a path, on one schedule, proven free, with the loop measured on it.

    Args:
        world: Collisions, set up as for ``plan_chain``.
        arms: Both arms.
        path: The path.
        speed: In ``(0, 1]``, as in ``retime``.

    Returns:
        The motion; or that there is no schedule; or the first instant at which the curve is not legal or free, or at
        which the loop is open by more than ``LOOP_GAP`` or ``LOOP_ANGLE``, however close the waypoints are.
    """
    left, right = (world.workcell.arm(side) for side in SIDES)
    constraint = loop_constraint(world, arms, path.points, path.T_left_right)
    points, spacing = path.points, CLOSER
    for _ in range(FINER):
        curve = retime_together(points, (left, right), speed=speed)
        if isinstance(curve, NotTimeable):
            return curve
        times, gaps, angles = loop_errors(arms, curve, path.T_left_right)
        if gaps.max() <= LOOP_GAP and angles.max() <= LOOP_ANGLE:
            proof = certify_together(world, arms, curve)
            if isinstance(proof, Uncertified):
                return proof
            return ChainMotion(curve, proof, float(gaps.max()), float(angles.max()))
        points, spacing = spaced(constraint, points, spacing), spacing / 2
    k = int(np.argmax((gaps > LOOP_GAP) | (angles > LOOP_ANGLE)))
    reason = f"the hands drift apart by {1e3 * gaps[k]:.2f} mm and {np.degrees(angles[k]):.2f} deg"
    return Uncertified(float(times[k]), reason, None)


def loop_errors(arms: DualArm, curve: Together, T_left_right: pin.SE3) -> tuple[Array, Array, Array]:
    """Times ``(m,)`` [s] every ``LOOK``, and how far the loop is open then: ``(m,)`` [m] and ``(m,)`` [rad]."""
    times = np.linspace(0.0, curve.duration, int(np.ceil(curve.duration / LOOK)) + 1)
    found = [relative(arms, q) for q in curve.sample(times)[0]]
    gaps = np.array([np.linalg.norm(T.translation - T_left_right.translation) for T in found])
    return times, gaps, np.array([angle_between(T.rotation, T_left_right.rotation) for T in found])
