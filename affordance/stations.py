"""What decides whether the planner takes a hand pose: where it is for the arm, at which stage, how near the table?"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from affordance.examples import Surroundings
from affordance.grip import PALM
from affordance.preparing import near_edge
from affordance.settings import SCALE
from robots.spatial import Array, pose, unit
from robots.workcell import Gripper, Side, Table, Workcell
from worlds.tasks import TaskType

STAGES = ("pregrasp", "lift", "reorient", "push", "press", "operate", "grasp", "present")
"""Stages that candidates are proposed for, in the order of their one-hot channels."""

FAR = 1.0
"""Distances from the table beyond this are not told apart, in units of ``SCALE``."""


def station(workcell: Workcell, side: Side, T_world_hand: pin.SE3, stage: str) -> Array:
    """``(25,)`` what the feasibility critic is told of a hand pose.

    The pose in the frame of the arm's base, as code (approach, then opening) and position; the stage one-hot; the
    signed distances from the table at the corners of the hand. Positions and distances are in units of ``SCALE``.
    """
    placement = workcell.placement(side)
    T = pose(placement.base_xyz, placement.base_rpy).inverse() * T_world_hand
    one_hot = np.zeros(len(STAGES))
    one_hot[STAGES.index(stage)] = 1.0
    corners = hand_corners(workcell.arm(side).gripper, T_world_hand)
    near = np.clip(table_distance(workcell.table, corners) / SCALE, -FAR, FAR)
    return np.concatenate([T.rotation[:, 2], T.rotation[:, 1], T.translation / SCALE, one_hot, near])


def hand_corners(gripper: Gripper, T_world_hand: pin.SE3, length: float | None = None) -> Array:
    """``(8, 3)`` corners of a hand's bounding box [m], which ends at the finger tips or after a ``length`` [m]."""
    x, y = PALM
    ends = (0.0, gripper.tip_offset if length is None else length)
    box = [[sx * x, sy * y, z] for sx in (-1, 1) for sy in (-1, 1) for z in ends]
    return np.asarray(np.array(box) @ T_world_hand.rotation.T + T_world_hand.translation)


def table_distance(table: Table, spots: Array) -> Array:
    """Signed distance ``(n,)`` of points ``(n, 3)`` from the table's top, a box; negative inside [m]."""
    middle = np.array([*table.centre, table.top - 0.5 * table.thickness])
    beyond = np.abs(spots - middle) - 0.5 * np.array([*table.size, table.thickness])
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
    return np.asarray(outside + np.minimum(beyond.max(axis=-1), 0.0))


def surroundings(workcell: Workcell, task: TaskType, primary: Side | None) -> Surroundings:
    """The edge to push over, or the place to hold the object in and the way from there to whom it is held out to.

    Args:
        workcell: The cell.
        task: What is done.
        primary: The arm that will act; ``None`` while that is open, then no place is told.
    """
    edge = place = None
    if task == "edge_push":
        near = near_edge(workcell.table)
        edge = np.array([near.at * near.outward + [0.0, 0.0, near.top], near.outward])
    elif task == "handover" and workcell.human is not None:
        place = np.array([workcell.human.zone_centre, unit(workcell.human.towards)])
    elif task == "articulated" and primary is not None:
        middle, base = np.asarray(workcell.shared), np.asarray(workcell.placement(primary).base_xyz)
        place = np.array([middle, unit([*(base - middle)[:2], 0.0])])
    return Surroundings(edge, place)
