"""Where two fingers close on a sheet, a rim or a bar: geometry of points alone, whoever supplies them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pinocchio as pin

from robots.spatial import Array, hand_rotation
from robots.workcell import Gripper

PAD_HALF = 0.010
"""Half width of a finger pad [m]."""

FINGER_HALF, FINGER_THICK, SPARE = 0.0135, 0.018, 0.001
"""Half the width of a finger, how far it reaches outwards from its pad, and room inside the pad [m]: the finger mesh of
``pybullet_data`` and 2 mm for points that are 3 mm apart."""

FINGER_LENGTH = 0.045
"""How far the fingers reach back from the tips before the palm begins [m]."""

PALM, PALM_LENGTH = (0.032, 0.100), 0.066
"""Half extents of the palm across and along the opening, and length of the hand without its fingers [m]."""

SHEET = 0.008
"""A gap between points along the opening larger than this separates two bodies [m]."""

ROOM = 0.007
"""Room kept between each open finger and what it closes on [m]."""

CELL = 0.005
"""Size of the patches in which contact of a pad is counted [m]."""

FACE = 0.004
"""Points this close to the outermost one touch the closed pad [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Grip:
    """Where a hand closes.

    Attributes:
        T_world_hand: Hand pose.
        opening: Opening of one finger before closing [m].
        width: Thickness between the pads [m].
        cover: Share of the two pads that meets points, the lesser of both, in ``[0, 1]``.
        middle: Where the pads close ``(3,)`` [m].
    """

    T_world_hand: pin.SE3
    opening: float
    width: float
    cover: float
    middle: Array


def grip_at(
    surface: Array, spot: Array, approach: Array, opening_axis: Array, depth: float, gripper: Gripper
) -> Grip | None:
    """The grip that reaches ``depth`` past the front of what lies at ``spot``, or ``None`` where fingers do not fit.

    Args:
        surface: ``(n, 3)`` points of the object [m].
        spot: One of them, to be between the pads ``(3,)`` [m].
        approach: Direction in which the hand comes ``(3,)``.
        opening_axis: Direction in which the fingers open, about perpendicular to it ``(3,)``.
        depth: How far the tips reach past the front of the material [m].
        gripper: The gripper.
    """
    R = hand_rotation(approach, opening_axis)
    u, v, w = ((surface - spot) @ R).T
    column = np.abs(u) < PAD_HALF
    at_spot = column & (np.abs(v) < 0.5 * SHEET)
    if not at_spot.any():
        return None
    tip = float(w[at_spot].min()) + depth
    between = column & (w <= tip) & (np.abs(v) <= gripper.finger_travel) & (w > tip - FINGER_LENGTH)
    if not between.any():
        return None
    low, high = _cluster(v[between])
    half, middle = 0.5 * (high - low), 0.5 * (high + low)
    opening = half + ROOM
    if opening > gripper.finger_travel:
        return None
    aside = np.abs(v - middle)
    fingers = (np.abs(u) < FINGER_HALF) & (aside > opening - SPARE) & (aside < opening + FINGER_THICK) & (w < tip)
    palm = (np.abs(u) < PALM[0]) & (aside < PALM[1]) & (w < tip - FINGER_LENGTH)
    if fingers.any() or palm.any():
        return None
    inside = between & (v >= low) & (v <= high)
    cover = min(_patches(u[inside & face], w[inside & face], tip) for face in (v > high - FACE, v < low + FACE))
    centre = spot + middle * R[:, 1] + tip * R[:, 2]
    T_world_hand = pin.SE3(R, centre - gripper.tip_offset * R[:, 2])
    pads = centre - (gripper.tip_offset - gripper.tcp_offset) * R[:, 2]
    return Grip(T_world_hand, min(gripper.finger_travel, opening), 2.0 * half, cover, pads)


def _cluster(v: Array) -> tuple[float, float]:
    """Ends of the run of values around zero that has no gap larger than ``SHEET``."""
    ordered = np.sort(v)
    breaks = np.flatnonzero(np.diff(ordered) > SHEET)
    edges = np.concatenate([[0], breaks + 1, [len(ordered)]])
    runs = [(float(ordered[a]), float(ordered[b - 1])) for a, b in pairwise(edges)]
    return min(runs, key=lambda run: max(run[0], -run[1], 0.0))


def _patches(u: Array, w: Array, tip: float) -> float:
    """Share of a pad 2 x ``PAD_HALF`` wide and as long that has points."""
    across = round(2.0 * PAD_HALF / CELL)
    columns = np.floor((u + PAD_HALF) / CELL).astype(int)
    rows = np.floor((tip - w) / CELL).astype(int)
    kept = (columns >= 0) & (columns < across) & (rows >= 0) & (rows < across)
    return len(set(zip(columns[kept].tolist(), rows[kept].tolist(), strict=True))) / across**2
