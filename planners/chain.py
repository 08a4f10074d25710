"""Which paths lead both arms from one configuration to another while both hold one object."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from planners import ik
from planners.cartesian import next_to
from planners.collision import OBJECT, CollisionWorld
from planners.compiled.layout import FREE
from planners.constrained import Constraint, Spent, connect, shortened, smoothed
from planners.given import finite_pose, numbers
from planners.loop import Loop, relative
from planners.motion import (
    SLACK,
    Exhausted,
    GoalInCollision,
    JointPath,
    NoPath,
    OutOfLimits,
    StartInCollision,
    past_limit,
)
from planners.reasons import GoalOutOfReach, LoopOpen
from robots.model import DualArm
from robots.spatial import Array, angle_between, frozen, interpolate
from robots.workcell import SIDES, Side

GRIP_GAP, GRIP_ANGLE = 2e-3, 0.02
"""How far the start may be from the stated grasps [m] and [rad]: hands that closed on something are off by this."""

STEP, TURN = 0.008, 0.03
"""Longest travel [m] and turn [rad] of the object between waypoints when it moves straight."""

POSTURES = 8
"""Most solutions of each arm at a goal pose; every pair of them is a goal."""

SPREAD = 0.5
"""How far around the start solutions are looked for first [rad]: others may lie where the loop cannot be carried."""

ATTEMPTS = 60
"""Shortcuts tried."""

Refusal = OutOfLimits | LoopOpen | GoalInCollision | GoalOutOfReach
"""Why a goal is none."""


@dataclass(frozen=True, slots=True, eq=False)
class ChainPath:
    """Joint positions of both arms that hold one object, joined by short steps.

    Attributes:
        points: ``(n, 14)`` [rad], left then right, each on the loop.
        T_left_right: The right hand in the frame of the left, all along.
    """

    points: Array
    T_left_right: pin.SE3

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen(numbers(self.points, (-1, 14), "the points of a path of both arms")))
        if len(self.points) < 2:
            raise ValueError("a path of both arms needs at least 2 points, not 1")
        object.__setattr__(self, "T_left_right", self.T_left_right.copy())

    def arm(self, side: Side) -> JointPath:
        """What one arm does."""
        return JointPath(self.points[:, :7] if side == "left" else self.points[:, 7:])


def carry(world: CollisionWorld, T_object_left: pin.SE3) -> None:
    """Let the world's object move with the left hand, and both hands and their fingers may touch it."""
    world.attach_object("left", T_object_left.inverse())
    bodies = []
    for side in SIDES:
        gripper = world.workcell.arm(side).gripper
        bodies += [f"{side}/{link}" for link in (gripper.hand_link, *gripper.finger_links)]
    world.allow([(body, OBJECT) for body in bodies if body in world.names])


def plan_chain(
    world: CollisionWorld,
    arms: DualArm,
    start: Array,
    goal: pin.SE3 | Array,
    T_object_left: pin.SE3,
    T_object_right: pin.SE3,
    *,
    seed: int,
    iterations: int = 800,
) -> ChainPath | NoPath:
    """Move an object that both hands hold.

    For a goal pose the object is first led there straight, turning by the shortest arc. If that leaves a joint's range
    or touches something, and for goal joint positions, a projected RRT-Connect searches the joints of both arms, and
    its path is shortened and smoothed on the loop. The loop is the one that the hands form at the start: that is how
    they hold the object. The same arguments give the same path.

    Args:
        world: Collisions, already set up, the object in the left hand (see ``carry``).
        arms: Both arms.
        start: ``(14,)`` [rad], left then right; close to the stated grasps.
        goal: ``T_world_object``, or ``(14,)`` [rad].
        T_object_left: The left hand in the object's frame.
        T_object_right: The right hand in the object's frame.
        seed: Makes the call repeatable.
        iterations: Most samples of the search.

    Returns:
        The path, from exactly ``start`` to the goal, or why there is none.
    """
    start = numbers(start, (14,), "the start")
    (
        finite_pose(T_object_left, "the left hand on the object"),
        finite_pose(T_object_right, "the right hand on the object"),
    )
    if isinstance(goal, pin.SE3):
        finite_pose(goal, "the goal")
    else:
        goal = numbers(goal, (14,), "the goal")
    T_left_right = relative(arms, start)
    if refused := _start_refused(world, arms, start, T_object_left.actInv(T_object_right)):
        return NoPath(refused)
    if isinstance(goal, pin.SE3):
        straight = _straight(world, arms, start, goal, T_object_left)
        if straight is not None:
            return ChainPath(straight, T_left_right)
        goals: Array | Refusal = _goals(world, arms, start, goal * T_object_left, T_left_right, seed)
    else:
        goals = _goal(world, arms, goal, T_left_right)
    if not isinstance(goals, np.ndarray):
        return NoPath(goals)
    return _searched(world, arms, start, goals, T_left_right, seed, iterations)


def _start_refused(
    world: CollisionWorld, arms: DualArm, start: Array, T_left_right: pin.SE3
) -> OutOfLimits | LoopOpen | StartInCollision | None:
    """What makes the start unusable."""
    if past := _past("start", arms, start):
        return past
    gap, angle = Loop.of(arms, T_left_right, start[None]).open_by(start)
    if gap > GRIP_GAP or angle > GRIP_ANGLE:
        return LoopOpen("start", gap, angle)
    contact = world.contact(start)
    return StartInCollision(contact) if contact else None


def _past(which: str, arms: DualArm, q: Array) -> OutOfLimits | None:
    for side, mine in zip(SIDES, (q[:7], q[7:]), strict=True):
        if not arms[side].within_limits(mine):
            return OutOfLimits(which, *past_limit(arms[side], mine))
    return None


def loop_constraint(world: CollisionWorld, arms: DualArm, ends: Array, T_left_right: pin.SE3) -> Constraint:
    """The closed loop among obstacles, a little inside the joint limits but for the configurations ``ends``."""
    motion, loop = world.motion(SIDES, ends[0]), Loop.of(arms, T_left_right, ends)

    def edge(a: Array, b: Array) -> bool:
        return motion.path(np.stack([a, b]), world.margin, SLACK * world.margin)[1] == FREE

    return Constraint(loop.project, edge, loop.lower, loop.upper)


def _straight(
    world: CollisionWorld, arms: DualArm, start: Array, T_world_object: pin.SE3, T_object_left: pin.SE3
) -> Array | None:
    """The object led straight to its goal: waypoints ``(n, 14)`` [rad], or ``None``."""
    T_start, T_left_right = arms["left"].hand(start[:7]) * T_object_left.inverse(), relative(arms, start)
    length = float(np.linalg.norm(T_world_object.translation - T_start.translation))
    angle = angle_between(T_start.rotation, T_world_object.rotation)
    steps = max(2, int(np.ceil(max(length / STEP, angle / TURN))))
    points = [start]
    for k in range(1, steps + 1):
        T_world_left = interpolate(T_start, T_world_object, k / steps) * T_object_left
        left = next_to(arms["left"], start[:7], points[-1][:7], T_world_left)
        right = next_to(arms["right"], start[7:], points[-1][7:], T_world_left * T_left_right)
        if isinstance(left, str) or isinstance(right, str):
            return None
        points.append(np.concatenate([left, right]))
    motion = world.motion(SIDES, start)
    found = np.array(points)
    return found if motion.path(found, world.margin, SLACK * world.margin)[1] == FREE else None


def _goals(
    world: CollisionWorld, arms: DualArm, start: Array, T_world_left: pin.SE3, T_left_right: pin.SE3, seed: int
) -> Array | Refusal:
    """Configurations ``(m, 14)`` [rad] with the hands where the goal needs them, nearest to the start first."""
    rng, found = np.random.default_rng(seed), []
    for side, mine, T in zip(SIDES, (start[:7], start[7:]), (T_world_left, T_world_left * T_left_right), strict=True):
        nearby = [mine, *(mine + rng.normal(size=(POSTURES, 7)) * SPREAD)]
        solved = ik.solve(arms[side], T, rng=rng, seeds=nearby, wanted=POSTURES)
        if isinstance(solved, ik.Missed):
            return GoalOutOfReach(side, solved.gap, solved.angle)
        exact = [next_to(arms[side], q, q, T) for q in solved.solutions]
        found.append([q for q in exact if not isinstance(q, str)])
        if not found[-1]:
            return GoalOutOfReach(side, ik.POSITION_TOLERANCE, ik.ROTATION_TOLERANCE)
    whole = [np.concatenate([left, right]) for left in found[0] for right in found[1]]
    loop = Loop.of(arms, T_left_right, np.array(whole))
    pairs = [closed for q in whole if (closed := loop.project(q)) is not None]
    pairs.sort(key=lambda q: float(np.linalg.norm(q - start)))
    free = [q for q in pairs if world.free(q)]
    if free:
        return np.array(free)
    contact = next(contact for q in pairs if (contact := world.contact(q)))
    return GoalInCollision(contact)


def _goal(world: CollisionWorld, arms: DualArm, goal: Array, T_left_right: pin.SE3) -> Array | Refusal:
    """The goal ``(1, 14)`` [rad], moved by the little by which it may miss the loop."""
    if past := _past("goal", arms, goal):
        return past
    loop = Loop.of(arms, T_left_right, goal[None])
    gap, angle = loop.open_by(goal)
    closed = loop.project(goal)
    if gap > GRIP_GAP or angle > GRIP_ANGLE or closed is None:
        return LoopOpen("goal", gap, angle)
    contact = world.contact(closed)
    return GoalInCollision(contact) if contact else closed[None]


def _searched(
    world: CollisionWorld, arms: DualArm, start: Array, goals: Array, T_left_right: pin.SE3, seed: int, iterations: int
) -> ChainPath | NoPath:
    """A path on the loop by sampling."""
    rng = np.random.default_rng(seed)
    constraint = loop_constraint(world, arms, np.vstack([start, goals]), T_left_right)
    raw = connect(constraint, start, goals, rng=rng, iterations=iterations)
    if isinstance(raw, Spent):
        return NoPath(Exhausted(raw.edges, raw.samples))
    short = shortened(constraint, raw, rng=rng, attempts=ATTEMPTS)
    return ChainPath(smoothed(constraint, short), T_left_right)
