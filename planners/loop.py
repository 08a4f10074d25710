"""How two hands that hold one rigid object constrain the joints of both arms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from planners.motion import INSET
from robots.model import ArmKinematics, DualArm
from robots.spatial import Array, frozen
from robots.workcell import SIDES

CLOSED = 1e-7
"""Largest part of the loop's error, [m] and [rad], at a configuration that counts as closed."""

NEWTON_STEPS = 25
"""Of one projection; 3 to 6 are enough near the constraint."""

DAMPING = 1e-8
"""Of the pseudo-inverse; only keeps the equations solvable."""

LONGEST = 0.3
"""Largest joint change of one Newton step [rad]: what needs more is not near."""


@dataclass(frozen=True, slots=True, eq=False)
class Loop:
    """Both arms with their hands fixed to each other.

    Attributes:
        arms: Both arms.
        T_left_right: The right hand in the frame of the left.
        lower: Where projected configurations stay ``(14,)`` [rad].
        upper: The other end ``(14,)`` [rad].
    """

    arms: DualArm
    T_left_right: pin.SE3
    lower: Array
    upper: Array

    @staticmethod
    def of(arms: DualArm, T_left_right: pin.SE3, ends: Array) -> Loop:
        """The loop, a little inside the joint limits but for the configurations ``ends`` ``(n, 14)`` [rad]."""
        low, high = (np.concatenate([getattr(arms[side], end) for side in SIDES]) for end in ("lower", "upper"))
        low, high = np.minimum(low + INSET, ends.min(axis=0)), np.maximum(high - INSET, ends.max(axis=0))
        return Loop(arms, T_left_right.copy(), frozen(low), frozen(high))

    def open_by(self, q: Array) -> tuple[float, float]:
        """How far the right hand is from its place at ``q`` ``(14,)`` [rad]: distance [m] and angle [rad]."""
        error = pin.log3(relative(self.arms, q).rotation.T @ self.T_left_right.rotation)
        gap = np.linalg.norm(relative(self.arms, q).translation - self.T_left_right.translation)
        return float(gap), float(np.linalg.norm(error))

    def project(self, q: Array) -> Array | None:
        """The configuration near ``q`` ``(14,)`` [rad] that closes the loop, by Newton steps of least change.

        The twist of the right hand against the left, in the right hand's frame, is ``J_right qd_right`` less the
        left hand's own twist carried over to it.
        """
        left, right = (self.arms[side] for side in SIDES)
        for _ in range(NEWTON_STEPS):
            T_left, J_left = _placed(left, q[:7])
            T_right, J_right = _placed(right, q[7:])
            error = pin.log6(T_left.actInv(T_right).actInv(self.T_left_right)).vector
            if np.abs(error).max() < CLOSED:
                return q
            J = np.hstack([-T_right.actInv(T_left).action @ J_left, J_right])
            change = J.T @ np.linalg.solve(J @ J.T + DAMPING * np.eye(6), error)
            change *= min(1.0, LONGEST / max(float(np.abs(change).max()), 1e-12))
            q = np.clip(q + change, self.lower, self.upper)
        return None


def relative(arms: DualArm, q: Array) -> pin.SE3:
    """``T_left_right`` of the hands at ``q`` ``(14,)`` [rad]."""
    T: pin.SE3 = arms["left"].hand(q[:7]).actInv(arms["right"].hand(q[7:]))
    return T


def _placed(arm: ArmKinematics, q: Array) -> tuple[pin.SE3, Array]:
    """``T_world_hand`` and the hand's Jacobian ``(6, 7)`` in its own frame."""
    pin.computeJointJacobians(arm.model, arm.data, q)
    T = pin.updateFramePlacement(arm.model, arm.data, arm.hand_frame).copy()
    return T, pin.getFrameJacobian(arm.model, arm.data, arm.hand_frame, pin.LOCAL)
