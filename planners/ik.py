"""Which joint positions put a hand at a pose: every distinct one a budget finds, or by how much all miss."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from robots.model import ArmKinematics
from robots.spatial import Array, angle_between, frozen

POSITION_TOLERANCE = 2e-4  # [m]
ROTATION_TOLERANCE = 1e-3  # [rad]
DISTINCT = 0.25  # [rad] largest joint difference below which two solutions count as one


@dataclass(frozen=True, slots=True, eq=False)
class Reached:
    """Joint positions that reach the pose.

    Attributes:
        solutions: ``(n, 7)`` [rad], ``n >= 1``, nearest to the first seed first.
    """

    solutions: Array


@dataclass(frozen=True, slots=True)
class Missed:
    """No joint positions within limits reach the pose; the best attempt's gap.

    Attributes:
        gap: Distance left [m].
        angle: Rotation left [rad].
    """

    gap: float
    angle: float

    def __str__(self) -> str:
        if self.gap > 1e-3:
            return f"unreachable by {1e3 * self.gap:.0f} mm"
        return f"unreachable by {np.degrees(self.angle):.0f} deg"


def solve(
    arm: ArmKinematics,
    T_world_hand: pin.SE3,
    *,
    rng: np.random.Generator,
    seeds: Iterable[Array] = (),
    restarts: int = 24,
    wanted: int = 4,
) -> Reached | Missed:
    """Solve for the hand pose from the given seeds, then from random ones.

    Args:
        arm: The arm.
        T_world_hand: Desired hand pose in the world frame.
        rng: Draws the random restarts.
        seeds: Joint positions ``(7,)`` [rad] tried first, the first being where the arm would come from.
        restarts: Random restarts after the seeds.
        wanted: Stop as soon as this many distinct solutions are found.

    Returns:
        All distinct solutions, or the smallest miss.
    """
    starts = [np.asarray(seed, dtype=np.float64) for seed in seeds]
    origin = starts[0] if starts else arm.home
    reach = float(np.linalg.norm(T_world_hand.translation - arm.base))
    if reach > 1.1:
        return Missed(reach - 1.1 + 0.1, 0.0)
    found: list[Array] = []
    best = Missed(np.inf, np.inf)
    for k in range(len(starts) + restarts):
        start = starts[k] if k < len(starts) else rng.uniform(arm.lower, arm.upper)
        q, gap, angle = descend(arm, T_world_hand, start)
        if gap < POSITION_TOLERANCE and angle < ROTATION_TOLERANCE:
            if all(np.abs(q - other).max() > DISTINCT for other in found):
                found.append(q)
            if len(found) >= wanted:
                break
        elif gap + 0.1 * angle < best.gap + 0.1 * best.angle:
            best = Missed(gap, angle)
    if not found:
        return best
    found.sort(key=lambda q: float(np.abs(q - origin).max()))
    return Reached(frozen(np.array(found)))


def descend(
    arm: ArmKinematics, T_world_hand: pin.SE3, start: Array, *, iterations: int = 60
) -> tuple[Array, float, float]:
    """Levenberg-Marquardt from one start, clamped to the joint limits.

    The damping follows Sugihara, "Solvability-Unconcerned Inverse Kinematics by the Levenberg-Marquardt
    Method", T-RO 2011, eq. 10: proportional to the squared residual plus a small bias.

    Returns:
        Joint positions ``(7,)`` [rad], distance left [m], rotation left [rad].
    """
    model, data, frame = arm.model, arm.data, arm.hand_frame
    q = np.clip(start, arm.lower, arm.upper)
    error = np.full(6, np.inf)
    for _ in range(iterations):
        pin.computeJointJacobians(model, data, q)
        T = pin.updateFramePlacement(model, data, frame)
        J = pin.getFrameJacobian(model, data, frame, pin.LOCAL)
        error = pin.log6(T.actInv(T_world_hand)).vector
        square = float(error @ error)
        if square < 1e-10:
            break
        step = np.linalg.solve(J.T @ J + (0.5 * square + 1e-5) * np.eye(7), J.T @ error)
        biggest = float(np.abs(step).max())
        q_next = np.clip(q + step * min(1.0, 0.6 / max(biggest, 1e-12)), arm.lower, arm.upper)
        if np.abs(q_next - q).max() < 1e-7:
            break
        q = q_next
    T = arm.hand(q)
    gap = float(np.linalg.norm(T.translation - T_world_hand.translation))
    return q, gap, angle_between(T.rotation, T_world_hand.rotation)
