"""Which joint path moves a hand along a straight line or about an axis: differential steps, each checked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from planners.collision import CollisionWorld, Contact
from planners.motion import JointPath
from robots.model import ArmKinematics
from robots.spatial import Array, angle_between, interpolate, turned_about

POSITION_TOLERANCE = 5e-5  # [m]
ROTATION_TOLERANCE = 5e-4  # [rad]
JUMP = 0.25
"""Largest joint change in one step [rad]: more means another branch of solutions."""


@dataclass(frozen=True, slots=True)
class Broken:
    """How much of a line could be followed and what ended it.

    Attributes:
        fraction: Share followed, in ``[0, 1)``.
        reason: A contact, or words with names and numbers.
    """

    fraction: float
    reason: str | Contact

    def __str__(self) -> str:
        return f"ends after {100 * self.fraction:.0f} %: {self.reason}"


def straight(
    world: CollisionWorld | None, arm: ArmKinematics, q_start: Array, T_world_hand: pin.SE3, q_other: Array, *,
    step: float = 0.004, turn: float = 0.02,
) -> JointPath | Broken:
    """Move the hand in a straight line, turning by the shortest arc.

    Args:
        world: Collisions, set up for this motion; ``None`` checks none.
        arm: The arm.
        q_start: ``(7,)`` [rad].
        T_world_hand: Where the hand ends.
        q_other: Joint positions of the other arm ``(7,)`` [rad].
        step: Longest translation between waypoints [m].
        turn: Largest turn between waypoints [rad].
    """
    T_start = arm.hand(q_start)
    length = float(np.linalg.norm(T_world_hand.translation - T_start.translation))
    angle = angle_between(T_start.rotation, T_world_hand.rotation)
    steps = max(2, int(np.ceil(max(length / step, angle / turn))))
    return _follow(world, arm, q_start, lambda s: interpolate(T_start, T_world_hand, s), steps, q_other)


def turned(
    world: CollisionWorld | None, arm: ArmKinematics, q_start: Array, point: Array, axis: Array, angle: float,
    q_other: Array, *, turn: float = 0.03,
) -> JointPath | Broken:
    """Turn the hand about a world line through ``point`` ``(3,)`` [m] along ``axis`` by ``angle`` [rad]."""
    T_start = arm.hand(q_start)
    steps = max(2, int(np.ceil(abs(angle) / turn)))
    return _follow(world, arm, q_start, lambda s: turned_about(T_start, point, axis, s * angle), steps, q_other)


def _follow(
    world: CollisionWorld | None, arm: ArmKinematics, q_start: Array, pose_at: Callable[[float], pin.SE3], steps: int,
    q_other: Array,
) -> JointPath | Broken:
    path = [np.asarray(q_start, dtype=np.float64)]
    for k in range(1, steps + 1):
        q = _next(arm, path[-1], pose_at(k / steps))
        done = (k - 1) / steps
        if isinstance(q, str):
            return Broken(done, q)
        if world is not None:
            contact = world.contact(np.concatenate([q, q_other] if arm.side == "left" else [q_other, q]))
            if contact is not None:
                return Broken(done, contact)
        path.append(q)
    return JointPath(np.array(path))


def _next(arm: ArmKinematics, q: Array, T_world_hand: pin.SE3) -> Array | str:
    """The configuration near ``q`` that reaches the pose, or why there is none.

    Newton steps with the damped pseudo-inverse (Nakamura and Hanafusa, 1986); minimum-norm steps keep the free
    seventh dimension where it is.
    """
    model, data = arm.model, arm.data
    start = q
    for _ in range(20):
        pin.computeJointJacobians(model, data, q)
        T = pin.updateFramePlacement(model, data, arm.hand_frame)
        error = pin.log6(T.actInv(T_world_hand)).vector
        if np.linalg.norm(error[:3]) < POSITION_TOLERANCE and np.linalg.norm(error[3:]) < ROTATION_TOLERANCE:
            return _judged(arm, start, q)
        J = pin.getFrameJacobian(model, data, arm.hand_frame, pin.LOCAL)
        q = q + J.T @ np.linalg.solve(J @ J.T + 1e-6 * np.eye(6), error)
        if np.abs(q - start).max() > JUMP:
            break
    return _judged(arm, start, q) if np.abs(q - start).max() <= JUMP else _jump(arm, start, q)


def _judged(arm: ArmKinematics, start: Array, q: Array) -> Array | str:
    if not arm.within_limits(q):
        k = int(np.argmax(np.maximum(arm.lower - q, q - arm.upper)))
        limit = arm.lower[k] if q[k] < arm.lower[k] else arm.upper[k]
        return f"{arm.model.names[k + 1]} past its limit ({q[k]:.2f} against {limit:.2f} rad)"
    return q if np.abs(q - start).max() <= JUMP else _jump(arm, start, q)


def _jump(arm: ArmKinematics, start: Array, q: Array) -> str:
    k = int(np.argmax(np.abs(q - start)))
    return f"{arm.model.names[k + 1]} would have to jump by {abs(q[k] - start[k]):.2f} rad near a singularity"
