"""Which joint path moves a hand along a straight line or about an axis: small steps, each solved and checked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from planners.collision import CollisionWorld, Contact
from planners.motion import JointPath, both_arms, checker, past_limit
from planners.shorten import RESOLUTION, Free
from robots.model import ArmKinematics
from robots.spatial import Array, angle_between, interpolate, turned_about

TOLERANCE = 1e-7
"""How close every waypoint comes to its pose [m] and [rad]: noise in it would show as acceleration once timed."""

JUMP = 0.25
"""Largest joint change in one step [rad]: more means another branch of solutions."""

STAY = 0.05
"""Share of the distance from the first posture that each Newton step takes back where the hand does not notice."""

DAMPING = 1e-8
"""Of the pseudo-inverse; only keeps the equations solvable, singularities end the line by ``JUMP``."""

NEWTON_STEPS = 20
"""Newton steps for one waypoint; 3 or 4 are enough away from singularities."""


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
    world: CollisionWorld | None,
    arm: ArmKinematics,
    q_start: Array,
    T_world_hand_goal: pin.SE3,
    q_other: Array,
    *,
    step: float = 0.004,
    turn: float = 0.02,
) -> JointPath | Broken:
    """Move the hand in a straight line, turning by the shortest arc.

    Args:
        world: Collisions, set up for this motion; ``None`` checks none.
        arm: The arm.
        q_start: ``(7,)`` [rad].
        T_world_hand_goal: Where the hand ends, in the world frame.
        q_other: Joint positions of the other arm ``(7,)`` [rad].
        step: Longest translation between waypoints [m].
        turn: Largest turn between waypoints [rad].

    Returns:
        The path, its last point on the goal, or how far it got.
    """
    T_start = arm.hand(q_start)
    length = float(np.linalg.norm(T_world_hand_goal.translation - T_start.translation))
    angle = angle_between(T_start.rotation, T_world_hand_goal.rotation)
    steps = max(2, int(np.ceil(max(length / step, angle / turn))))
    return _follow(world, arm, q_start, lambda s: interpolate(T_start, T_world_hand_goal, s), steps, q_other)


def turned(
    world: CollisionWorld | None,
    arm: ArmKinematics,
    q_start: Array,
    axis_point_world: Array,
    axis_world: Array,
    angle: float,
    q_other: Array,
    *,
    step: float = 0.004,
    turn: float = 0.03,
) -> JointPath | Broken:
    """Turn the hand about a line in the world, as when a cap is twisted.

    Args:
        world: Collisions, set up for this motion; ``None`` checks none.
        arm: The arm.
        q_start: ``(7,)`` [rad].
        axis_point_world: A point of the line ``(3,)`` [m].
        axis_world: Direction of the line ``(3,)``.
        angle: Right-handed turn about it [rad]; its size may exceed pi.
        q_other: Joint positions of the other arm ``(7,)`` [rad].
        step: Longest travel of the hand's origin between waypoints [m].
        turn: Largest turn between waypoints [rad].
    """
    T_start = arm.hand(q_start)
    axis = np.asarray(axis_world, dtype=np.float64) / np.linalg.norm(axis_world)
    radius = float(np.linalg.norm(np.cross(axis, T_start.translation - axis_point_world)))
    steps = max(2, int(np.ceil(abs(angle) * max(1.0 / turn, radius / step))))

    def pose_at(s: float) -> pin.SE3:
        return turned_about(T_start, axis_point_world, axis, s * angle)

    return _follow(world, arm, q_start, pose_at, steps, q_other)


def _follow(
    world: CollisionWorld | None,
    arm: ArmKinematics,
    q_start: Array,
    pose_at: Callable[[float], pin.SE3],
    steps: int,
    q_other: Array,
) -> JointPath | Broken:
    """Waypoints at ``k / steps`` of a motion, each from the one before."""
    path = [np.asarray(q_start, dtype=np.float64)]
    free = None if world is None else checker(world, arm, q_other)
    for k in range(steps + 1):
        q = _next(arm, path[0], path[-1], pose_at(k / steps)) if k else path[0]
        done = max(0, k - 1) / steps
        if isinstance(q, str):
            return Broken(done, q)
        touched = None if free is None else _first_touching(free, path[-1], q)
        if world is not None and touched is not None:
            contact = world.contact(both_arms(arm, touched, q_other))
            return Broken(done, contact or "touches something at the margin")
        if k:
            path.append(q)
    return JointPath(np.array(path))


def _first_touching(free: Free, a: Array, b: Array) -> Array | None:
    """The first state after ``a`` up to and including ``b`` that is not free."""
    count = max(1, int(np.ceil(np.linalg.norm(b - a) / RESOLUTION)))
    for k in range(1, count + 1):
        q = a + (b - a) * (k / count)
        if not free(q):
            return q
    return None


def _next(arm: ArmKinematics, posture: Array, start: Array, T_world_hand: pin.SE3) -> Array | str:
    """The configuration near ``start`` that reaches the pose, or why there is none.

    Newton steps with the pseudo-inverse; in its null space they lead back to ``posture``, so that the elbow does not
    drift (Liegeois, "Automatic Supervisory Control of the Configuration and Behavior of Multibody Mechanisms", 1977).
    """
    model, data, q = arm.model, arm.data, start
    error = np.zeros(6)
    for count in range(NEWTON_STEPS):
        pin.computeJointJacobians(model, data, q)
        T = pin.updateFramePlacement(model, data, arm.hand_frame)
        error = pin.log6(T.actInv(T_world_hand)).vector
        if count and np.abs(error).max() < TOLERANCE:
            return _judged(arm, q)
        J = pin.getFrameJacobian(model, data, arm.hand_frame, pin.LOCAL)
        rest = STAY * (posture - q) if count == 0 else np.zeros(7)
        q = q + rest + J.T @ np.linalg.solve(J @ J.T + DAMPING * np.eye(6), error - J @ rest)
        if np.abs(q - start).max() > JUMP:
            return _jump(arm, start, q)
    gap, angle = 1e3 * float(np.linalg.norm(error[:3])), float(np.degrees(np.linalg.norm(error[3:])))
    return f"out of reach, {gap:.1f} mm and {angle:.1f} deg short"


def _judged(arm: ArmKinematics, q: Array) -> Array | str:
    """``q``, unless it is past a limit."""
    if arm.within_limits(q):
        return q
    joint, value, limit = past_limit(arm, q)
    return f"{joint} past its limit ({value:.2f} against {limit:.2f} rad)"


def _jump(arm: ArmKinematics, start: Array, q: Array) -> str:
    k = int(np.argmax(np.abs(q - start)))
    return f"{arm.model.names[k + 1]} would have to jump by {abs(q[k] - start[k]):.2f} rad near a singularity"
