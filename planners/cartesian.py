"""Which joint path moves a hand along a straight line or about an axis: small steps, each solved and checked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from planners.collision import CollisionWorld, Contact
from planners.given import finite_pose, numbers, positive
from planners.motion import JointPath, both_arms, checker, past_limit
from planners.shorten import RESOLUTION, Free
from robots.model import ArmKinematics
from robots.spatial import Array, angle_between, interpolate, turned_about, unit

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

WARY = 0.25
"""Distance to a limit from which on a joint takes a smaller share of every step [rad]."""

LEAST = 0.02
"""The smallest such share: none at all would lose a direction."""

INSIDE = 0.15
"""How far inside the joint limits the posture lies that ``follow_best`` leads back to [rad]."""

ROOM = 0.2
"""Distance to the joint limits beyond which more is no better [rad]."""

CLEAR = 0.03
"""Distance to other bodies beyond which more is no better [m]: hands work close to things on purpose."""

CLEARANCE_EVERY = 4
"""Every how many waypoints the clearance is measured, besides at both ends."""


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
    q_start, q_other = numbers(q_start, (7,), "the start"), numbers(q_other, (7,), "the other arm's joint positions")
    finite_pose(T_world_hand_goal, "the goal")
    positive(step, "the step", "m"), positive(turn, "the turn of a step", "rad")
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
    q_start, q_other = numbers(q_start, (7,), "the start"), numbers(q_other, (7,), "the other arm's joint positions")
    axis_point_world = numbers(axis_point_world, (3,), "the point of the axis")
    axis = unit(numbers(axis_world, (3,), "the axis"))
    angle = float(numbers(angle, (), "the angle"))
    positive(step, "the step", "m"), positive(turn, "the turn of a step", "rad")
    T_start = arm.hand(q_start)
    radius = float(np.linalg.norm(np.cross(axis, T_start.translation - axis_point_world)))
    steps = max(2, int(np.ceil(abs(angle) * max(1.0 / turn, radius / step))))

    def pose_at(s: float) -> pin.SE3:
        return turned_about(T_start, axis_point_world, axis, s * angle)

    return _follow(world, arm, q_start, pose_at, steps, q_other)


def follow_best(
    world: CollisionWorld | None,
    arm: ArmKinematics,
    solutions: Array,
    pose_at: Callable[[float], pin.SE3],
    steps: int,
    q_other: Array,
) -> JointPath | Broken:
    """The best of the ways in which a hand can follow a motion, one from each of several postures at its start.

    Best is the most room to joint limits and to other bodies, whichever is scarcer; what is equally good goes by
    length, then by the order given. Every waypoint, both ends included, has the hand on its pose to ``TOLERANCE``.

    Args:
        world: Collisions, set up for this motion; ``None`` checks none.
        arm: The arm.
        solutions: Joint positions ``(n, 7)`` [rad] that put the hand near ``pose_at(0)``, as ``ik.solve`` finds them.
        pose_at: ``T_world_hand`` at a share of the motion in ``[0, 1]``; continuous.
        steps: Waypoints beside the first.
        q_other: Joint positions of the other arm ``(7,)`` [rad].

    Returns:
        The path, or how far the best one got when none is complete.
    """
    solutions = numbers(solutions, (-1, 7), "the solutions")
    q_other = numbers(q_other, (7,), "the other arm's joint positions")
    positive(steps, "the number of waypoints", "waypoints")
    begin = finite_pose(pose_at(0.0), "the hand at the start")
    finite_pose(pose_at(1.0), "the hand at the end")
    best: tuple[float, float, JointPath] | None = None
    furthest = Broken(-1.0, "")
    for q in solutions:
        exact = next_to(arm, q, q, begin)
        if isinstance(exact, str):
            found: JointPath | Broken = Broken(0.0, exact)
        else:
            posture = np.clip(exact, arm.lower + INSIDE, arm.upper - INSIDE)
            found = _follow(world, arm, exact, pose_at, steps, q_other, posture)
        if isinstance(found, Broken):
            furthest = max(furthest, found, key=lambda broken: broken.fraction)
            continue
        length = float(np.linalg.norm(np.diff(found.points, axis=0), axis=1).sum())
        score = round(_room(world, arm, found.points, q_other), 6), -round(length, 6)
        if best is None or score > best[:2]:
            best = (*score, found)
    return furthest if best is None else best[2]


def _room(world: CollisionWorld | None, arm: ArmKinematics, points: Array, q_other: Array) -> float:
    """How little room a path leaves, in ``[0, 1]``: to joint limits in ``ROOM``, to other bodies in ``CLEAR``."""
    room = float(np.minimum(points - arm.lower, arm.upper - points).min()) / ROOM
    if world is not None:
        looked_at = [*points[:-1:CLEARANCE_EVERY], points[-1]]
        room = min(room, min(world.clearance(both_arms(arm, q, q_other))[0] for q in looked_at) / CLEAR)
    return min(1.0, max(0.0, room))


def _follow(
    world: CollisionWorld | None,
    arm: ArmKinematics,
    q_start: Array,
    pose_at: Callable[[float], pin.SE3],
    steps: int,
    q_other: Array,
    posture: Array | None = None,
) -> JointPath | Broken:
    """Waypoints at ``k / steps`` of a motion, each from the one before; the elbow stays near ``posture``, or start."""
    path = [np.asarray(q_start, dtype=np.float64)]
    if not arm.within_limits(path[0]):
        return Broken(0.0, str(judged(arm, path[0])))
    posture = path[0] if posture is None else posture
    free = None if world is None else checker(world, arm, q_other)
    for k in range(steps + 1):
        q = next_to(arm, posture, path[-1], pose_at(k / steps)) if k else path[0]
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


def next_to(arm: ArmKinematics, posture: Array, start: Array, T_world_hand: pin.SE3) -> Array | str:
    """The configuration near ``start`` that reaches the pose, ``start`` itself if it does, or why there is none.

    Newton steps with the pseudo-inverse; in its null space they lead back to ``posture``, so that the elbow does not
    drift (Liegeois, "Automatic Supervisory Control of the Configuration and Behavior of Multibody Mechanisms", 1977).
    Joints near a limit take a smaller share (Chan and Dubey, "A Weighted Least-Norm Solution Based Scheme for Avoiding
    Joint Limits for Redundant Joint Manipulators", T-RA 1995; with weights that do not depend on the direction).
    """
    model, data, q = arm.model, arm.data, start
    error = np.zeros(6)
    for count in range(NEWTON_STEPS):
        pin.computeJointJacobians(model, data, q)
        T = pin.updateFramePlacement(model, data, arm.hand_frame)
        error = pin.log6(T.actInv(T_world_hand)).vector
        if (count or np.array_equal(posture, start)) and np.abs(error).max() < TOLERANCE:
            return judged(arm, q)
        J = pin.getFrameJacobian(model, data, arm.hand_frame, pin.LOCAL)
        rest = STAY * (posture - q) if count == 0 else np.zeros(7)
        share = np.clip(np.minimum(q - arm.lower, arm.upper - q) / WARY, LEAST, 1.0)
        WJt = share[:, None] * J.T
        q = q + rest + WJt @ np.linalg.solve(J @ WJt + DAMPING * np.eye(6), error - J @ rest)
        if np.abs(q - start).max() > JUMP:
            return _jump(arm, start, q)
    gap, angle = 1e3 * float(np.linalg.norm(error[:3])), float(np.degrees(np.linalg.norm(error[3:])))
    return f"out of reach, {gap:.1f} mm and {angle:.1f} deg short"


def judged(arm: ArmKinematics, q: Array) -> Array | str:
    """``q``, unless it is past a limit."""
    if arm.within_limits(q):
        return q
    joint, value, limit = past_limit(arm, q)
    return f"{joint} past its limit ({value:.2f} against {limit:.2f} rad)"


def _jump(arm: ArmKinematics, start: Array, q: Array) -> str:
    k = int(np.argmax(np.abs(q - start)))
    return f"{arm.model.names[k + 1]} would have to jump by {abs(q[k] - start[k]):.2f} rad near a singularity"
