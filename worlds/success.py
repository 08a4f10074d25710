"""Whether an episode succeeded: the paper's criterion, judged on the simulated state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from robots.spatial import angle_between
from robots.workcell import Side
from worlds.bullet.world import BulletWorld
from worlds.tasks import Task


@dataclass(frozen=True, slots=True)
class Verdict:
    """The judgement with its numbers.

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


def holds(world: BulletWorld, side: Side) -> bool:
    """Whether both fingers of a hand touch the object."""
    return len({touch.finger for touch in world.touches(side) if touch.force > 0.0}) == 2


def part_motion(world: BulletWorld) -> float:
    """Motion of the functional joint in the operating sense since the start [m] or [rad]."""
    part = world.asset.part
    return part.sense * (world.joint_position(part.joint) - part.start)


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
    checks = [
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
    ]
    reasons = [text for good, text in checks if not good]
    return Verdict(not reasons, peak_moved, part.threshold, slip, turn, held, peak_force, "; ".join(reasons))


def _amount(world: BulletWorld, value: float) -> str:
    turning = world.client.getJointInfo(world.object, world.object_joints[world.asset.part.joint])[2] == 0
    return f"{np.degrees(value):.0f} deg" if turning else f"{1e3 * value:.1f} mm"
