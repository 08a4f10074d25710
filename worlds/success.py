"""Whether an episode succeeded: the paper's criteria, judged on the simulated state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from robots.spatial import angle_between
from robots.workcell import Side, other
from worlds.bullet.world import BulletWorld
from worlds.tasks import Task


@dataclass(frozen=True, slots=True)
class Verdict:
    """The judgement of an articulated task with its numbers.

    Attributes:
        success: All of the below are within the task's limits.
        moved: Motion of the functional joint in the operating sense since the start [m] or [rad].
        threshold: Motion that counts as operated [m] or [rad].
        slip: Motion of the object in the assistant's hand since the grasp [m].
        turn: Turn of the object in the assistant's hand since the grasp [rad].
        held: Both fingers of the assistant touch the object and it touches neither table nor floor.
        peak_force: Largest force between primary hand and object [N].
        reason: Why not, empty on success.
    """

    success: bool
    moved: float
    threshold: float
    slip: float
    turn: float
    held: bool
    peak_force: float
    reason: str


@dataclass(frozen=True, slots=True)
class LiftVerdict:
    """The judgement of an edge push or a plate lift with its numbers.

    Attributes:
        success: All of the below are within the task's limits.
        rise: How much higher the object's body is than when the episode began [m], at its lowest while held up.
        slip: Motion of the object in the primary's hand while held up [m].
        width: Distance between the primary's fingers [m].
        held: Both fingers of the primary touch the object, neither shut nor wide open.
        alone: Nothing else touches the object: not the other arm, not table or floor.
        reason: Why not, empty on success.
    """

    success: bool
    rise: float
    slip: float
    width: float
    held: bool
    alone: bool
    reason: str


@dataclass(frozen=True, slots=True)
class HandoverVerdict:
    """The judgement of a handover with its numbers.

    Attributes:
        success: All of the below are within the task's limits.
        pull: Force with which the human pulled when the assistant let go [N]; ``None`` if it never did.
        facing: Angle between the long axis, functional end first, and the way to the human when presented [rad].
        in_zone: The object was presented inside the human's zone.
        held: The human holds the object and the assistant does not touch it.
        supported: The object touches table or floor.
        reason: Why not, empty on success.
    """

    success: bool
    pull: float | None
    facing: float
    in_zone: bool
    held: bool
    supported: bool
    reason: str


AnyVerdict = Verdict | LiftVerdict | HandoverVerdict


def holds(world: BulletWorld, side: Side) -> bool:
    """Whether both fingers of a hand touch the object."""
    return len({touch.finger for touch in world.touches(side) if touch.force > 0.0}) == 2


def grips(world: BulletWorld, side: Side) -> bool:
    """Whether a hand holds the object between its fingers: both touch it, neither shut nor wide open.

    An object that merely lies on the fingers leaves them shut or wide open.
    """
    travel = world.workcell.arm(side).gripper.finger_travel
    return holds(world, side) and SHUT < world.opening(side) < WIDE * travel


SHUT = 0.0008
"""Opening of one finger below which the hand is shut [m]."""

WIDE = 0.975
"""Share of the finger travel above which the hand is wide open: 78 of 80 mm."""


def part_motion(world: BulletWorld) -> float:
    """Motion of the functional joint in the operating sense since the start [m] or [rad]."""
    part = world.asset.part
    return part.sense * (world.joint_position(part.joint) - part.start)


def overhang(world: BulletWorld) -> float:
    """How far the object reaches over the edges of the table [m]; 0 or less while it lies inside (privileged)."""
    table = world.workcell.table
    beyond = np.abs(world.object_vertices()[:, :2] - np.asarray(table.centre)) - np.asarray(table.size) / 2
    return float(beyond.max())


def judge(
    world: BulletWorld,
    task: Task,
    assistant: Side,
    T_hand_body: pin.SE3,
    T_hand_body_at_grasp: pin.SE3,
    *,
    peak_moved: float,
    peak_force: float,
) -> Verdict:
    """Judge an ``articulated`` episode.

    Args:
        world: The world at the end, settled.
        task: The limits.
        assistant: The side that must still hold.
        T_hand_body: Object in the assistant's hand now.
        T_hand_body_at_grasp: The same when the lift began.
        peak_moved: Largest motion of the functional joint so far [m] or [rad].
        peak_force: Largest force between primary hand and object so far [N].
    """
    part = world.asset.part
    slip = float(np.linalg.norm(T_hand_body.translation - T_hand_body_at_grasp.translation))
    turn = angle_between(T_hand_body_at_grasp.rotation, T_hand_body.rotation)
    held = holds(world, assistant) and not world.supported()
    reason = _reasons(
        (
            peak_moved >= part.threshold,
            f"joint moved {_amount(world, peak_moved)} of {_amount(world, part.threshold)} needed",
        ),
        (held, "the assistant no longer holds the object"),
        (
            slip <= task.hold_slip,
            f"object slipped {1e3 * slip:.0f} mm in the hand, {1e3 * task.hold_slip:.0f} allowed",
        ),
        (
            turn <= task.hold_turn,
            f"object turned {np.degrees(turn):.0f} deg in the hand, {np.degrees(task.hold_turn):.0f} allowed",
        ),
        (
            part.kind != "press" or peak_force <= task.press_force,
            f"pressed with {peak_force:.0f} N, {task.press_force:.0f} allowed",
        ),
    )
    return Verdict(not reason, peak_moved, part.threshold, slip, turn, held, peak_force, reason)


def judge_lift(
    world: BulletWorld, task: Task, primary: Side, *, rise: float, slip: float, dropped: bool = False
) -> LiftVerdict:
    """Judge an ``edge_push`` or ``plate_lift`` episode.

    Args:
        world: The world at the end of the time for which the object must stay held.
        task: The limits.
        primary: The side that must hold.
        rise: Least height gained while held up [m].
        slip: Motion of the object in the primary's hand while held up [m].
        dropped: Whether the fingers lost the object at some moment of that time.
    """
    held = grips(world, primary) and not dropped
    alone = not world.supported() and not world.touches(other(primary)) and world.contact_force(other(primary)) == 0.0
    width = 2.0 * world.opening(primary)
    reason = _reasons(
        (held, f"the {primary} fingers do not grip the object ({1e3 * width:.0f} mm apart)"),
        (rise >= task.lift_height, f"object rose {1e3 * rise:.0f} mm, {1e3 * task.lift_height:.0f} needed"),
        (alone, "something else still bears the object"),
        (slip <= task.lift_slip, f"object slipped {1e3 * slip:.0f} mm in the hand, {1e3 * task.lift_slip:.0f} allowed"),
    )
    return LiftVerdict(not reason, rise, slip, width, held, alone, reason)


def judge_handover(
    world: BulletWorld,
    task: Task,
    assistant: Side,
    *,
    pull: float | None,
    facing: float,
    in_zone: bool,
    human_holds: bool,
) -> HandoverVerdict:
    """Judge a ``handover`` episode.

    Args:
        world: The world at the end of the time for which the human must hold the object.
        task: The limits.
        assistant: The side that must have let go.
        pull: The human's pull when the assistant let go [N]; ``None`` if it never did.
        facing: Angle between the long axis, functional end first, and the way to the human when presented [rad].
        in_zone: Whether the object was presented inside the human's zone.
        human_holds: Whether the human's hand holds the object now.
    """
    low, high = task.pull_force
    held = human_holds and world.contact_force(assistant) == 0.0
    supported = world.supported()
    reason = _reasons(
        (in_zone, "the object was not presented in the human's zone"),
        (
            facing <= task.facing,
            f"the functional part points {np.degrees(facing):.0f} deg away from the human, "
            f"{np.degrees(task.facing):.0f} allowed",
        ),
        (pull is not None, "the assistant did not let go"),
        (pull is None or low <= pull <= high, f"let go at {pull or 0.0:.1f} N, {low:g} to {high:g} N wanted"),
        (held, "the human does not hold the object alone"),
        (not supported, "the object touches table or floor"),
    )
    return HandoverVerdict(not reason, pull, facing, in_zone, held, supported, reason)


def _reasons(*checks: tuple[bool, str]) -> str:
    return "; ".join(text for good, text in checks if not good)


def _amount(world: BulletWorld, value: float) -> str:
    turning = world.client.getJointInfo(world.object, world.object_joints[world.asset.part.joint])[2] == 0
    return f"{np.degrees(value):.0f} deg" if turning else f"{1e3 * value:.1f} mm"
