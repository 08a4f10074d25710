"""How is a drawn hand laid onto what the camera saw? Fingers centred about it, tips brought to where they touch.

Networks err by millimetres; the seen points do not. Only the observed cloud is used.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from scipy.spatial import ConvexHull, QhullError

from affordance.grip import FINGER_HALF, FINGER_LENGTH, FINGER_THICK, PALM_LENGTH, SPARE
from affordance.preparing import BESIDE, Edge
from affordance.stations import hand_corners, table_distance
from robots.spatial import Array, points
from robots.workcell import Gripper, Table

PAD_HALF = 0.010
"""Half width of a finger pad [m]."""

PAD_LENGTH = 0.026
"""How far behind the tips points count as between the pads [m]."""

MARGIN, LEAST = 0.006, 0.002
"""Room kept between each open finger and what it closes on, and what is enough where they open no wider [m]."""

ASIDE = 0.015
"""Largest shift that centres the fingers [m]; more means that the hand was meant for something else."""

THINNEST, LEEWAY = 0.002, 0.010
"""Half the thickness of what is thinnest, and room kept above what is gripped from above and below [m]: what was pushed
or pressed may lie a centimetre from where it was expected.
"""

LEVEL = 0.5
"""Fingers that open more steeply than this, as the vertical part of the axis, are not centred: a camera above sees only
one of the two sides."""

REACH = 0.020
"""Largest shift along the approach that brings tips to what they touch [m]."""

TIP_HALF = 0.010
"""Half width of a finger tip [m]."""

TABLE_GAP = 0.004
"""Room kept between finger tips and table [m]."""

STEEPER, TURNS = np.radians(24.0), 8
"""A hand that would be in the table is turned up by this much at the most [rad], in so many steps."""

BACK = 0.012
"""Largest shift back that frees open fingers of what was seen [m]; more would miss the part."""

LARGEST_LID, BELOW = 0.045, 0.006
"""Farthest that a hinge is from the middle of its lid, and how far below the tips that grip the lid [m]."""

INSIDE = 0.005
"""How far the middle of what is pushed must stay inside the edge [m]."""

BAND = 0.020
"""Width of the strip in which a finger meets what it pushes with its side [m]."""

PUSHED_ASIDE, PUSHED_ON = 0.025, 0.040
"""Largest shifts across and along a push that bring fingers behind the middle of what they push [m]."""

WAY = 0.10
"""Length of the straight way to a grasp on which the fingers must meet nothing [m]."""


def centred(T_world_hand: pin.SE3, opening: float, cloud: Array, gripper: Gripper) -> tuple[pin.SE3, float]:
    """The hand with its fingers centred about the seen points between them, open wide enough to pass them.

    Args:
        T_world_hand: The hand.
        opening: Of one finger [m].
        cloud: ``(n, 3)`` seen points in the world frame [m].
        gripper: The gripper.

    Returns:
        The hand and the opening of one finger; both unchanged where nothing is seen between the fingers, or where it is
        wider than they open. Fingers above and below something, of which only the upper side is seen, are left where
        they are as far as that side is between them.
    """
    if abs(T_world_hand.rotation[2, 1]) > LEVEL:
        return _around_top(T_world_hand, opening, cloud, gripper)
    seen = points(T_world_hand.inverse(), cloud)
    between = _between_pads(seen, gripper)
    if not between.any():
        return T_world_hand, opening
    low, high = float(seen[between, 1].min()), float(seen[between, 1].max())
    half, middle = 0.5 * (high - low), 0.5 * (high + low)
    if half + LEAST > gripper.finger_travel or abs(middle) > ASIDE:
        return T_world_hand, opening
    shift = pin.SE3(np.eye(3), np.array([0.0, middle, 0.0]))
    return T_world_hand * shift, min(max(opening, half + MARGIN), gripper.finger_travel)


def _between_pads(seen: Array, gripper: Gripper) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Which points ``(n, 3)`` in the frame of the hand lie between the pads, however far the fingers are open."""
    found: np.ndarray[tuple[int], np.dtype[np.bool_]] = (
        (np.abs(seen[:, 0]) < PAD_HALF)
        & (np.abs(seen[:, 1]) < gripper.finger_travel)
        & (seen[:, 2] > gripper.tip_offset - PAD_LENGTH)
        & (seen[:, 2] < gripper.tip_offset)
    )
    return found


def _around_top(T_world_hand: pin.SE3, opening: float, cloud: Array, gripper: Gripper) -> tuple[pin.SE3, float]:
    """The hand with the seen upper side between its fingers, in the upper half, and room above it."""
    up = np.sign(T_world_hand.rotation[2, 1])
    seen = points(T_world_hand.inverse(), cloud)
    height = up * seen[:, 1]
    between = _between_pads(seen, gripper)
    if not between.any():
        return T_world_hand, opening
    top = float(height[between].max())
    down = float(np.clip(top - THINNEST, -ASIDE, 0.0))
    room = top - down + LEEWAY
    if room > gripper.finger_travel:
        return T_world_hand, opening
    shift = pin.SE3(np.eye(3), np.array([0.0, up * down, 0.0]))
    return T_world_hand * shift, float(np.clip(opening, room, gripper.finger_travel))


def touching(T_world_hand: pin.SE3, opening: float, cloud: Array, gripper: Gripper) -> pin.SE3:
    """The hand moved along its approach so that its tips just meet the seen points before them.

    Args:
        T_world_hand: The hand.
        opening: Of one finger [m]; 0 touches with closed fingers.
        cloud: ``(n, 3)`` seen points in the world frame [m].
        gripper: The gripper.

    Returns:
        The hand; unchanged where no point lies before the tips within ``REACH``.
    """
    seen = points(T_world_hand.inverse(), cloud)
    aside = np.abs(np.abs(seen[:, 1]) - (opening + 0.5 * TIP_HALF)) if opening else np.abs(seen[:, 1])
    ahead = seen[:, 2] - gripper.tip_offset
    met = (np.abs(seen[:, 0]) < TIP_HALF) & (aside < TIP_HALF) & (np.abs(ahead) < REACH)
    if not met.any():
        return T_world_hand
    return T_world_hand * pin.SE3(np.eye(3), np.array([0.0, 0.0, float(ahead[met].min())]))


def behind(T_world_hand: pin.SE3, opening: float, heading: Array, cloud: Array, gripper: Gripper) -> pin.SE3:
    """The hand moved level until its fingers just meet the seen points from behind, about the middle of the object.

    An object that is pushed beside its middle turns, and one that is met late stays behind.

    Args:
        T_world_hand: The hand when the push begins, pointing down.
        opening: Of one finger [m].
        heading: Horizontal unit vector ``(3,)`` of the push.
        cloud: ``(n, 3)`` seen points in the world frame [m].
        gripper: The gripper.

    Returns:
        The hand; unchanged across or along where more than ``PUSHED_ASIDE`` or ``PUSHED_ON`` is missing.
    """
    tip = T_world_hand.act(np.array([0.0, 0.0, gripper.tip_offset]))
    aside = float((middle_of(cloud) - tip) @ _across(heading))
    if abs(aside) <= PUSHED_ASIDE:
        tip = tip + aside * _across(heading)
    on = min(_hindmost(cloud, tip, opening, heading)) - BESIDE
    if abs(on) <= PUSHED_ON:
        tip = tip + on * heading
    return pin.SE3(T_world_hand.rotation, tip - gripper.tip_offset * T_world_hand.rotation[:, 2])


def unevenness(T_world_hand: pin.SE3, opening: float, heading: Array, cloud: Array, gripper: Gripper) -> float:
    """How much later one of two pushing fingers meets the seen points than the other [m]: till then the object turns.

    The arguments are those of ``behind``; infinite where a finger meets none.
    """
    tip = T_world_hand.act(np.array([0.0, 0.0, gripper.tip_offset]))
    left, right = _hindmost(cloud, tip, opening, heading)
    return abs(left - right) if np.isfinite([left, right]).all() else np.inf


def _across(heading: Array) -> Array:
    """The horizontal unit vector to the left of a heading."""
    return np.array([-heading[1], heading[0], 0.0])


def _hindmost(cloud: Array, tip: Array, opening: float, heading: Array) -> tuple[float, float]:
    """How far ahead of the tips the hindmost points lie that the left and the right finger meet [m]; or infinite."""
    height, across, ahead = cloud[:, 2] - tip[2], (cloud - tip) @ _across(heading), (cloud - tip) @ heading
    low = (height > -THINNEST) & (height < FINGER_LENGTH)
    out = opening + 0.5 * FINGER_THICK
    left, right = (low & (np.abs(across - side) < 0.5 * BAND) for side in (out, -out))
    return float(ahead[left].min(initial=np.inf)), float(ahead[right].min(initial=np.inf))


def farthest_push(heading: Array, cloud: Array, edge: Edge) -> float:
    """How far an object can be pushed before its middle comes so near the edge that it may tip over it [m].

    Args:
        heading: Horizontal unit vector ``(3,)`` of the push.
        cloud: ``(n, 3)`` seen points in the world frame [m].
        edge: The table's edge.

    Returns:
        Infinite for a push that does not lead there, negative where the middle is there already.
    """
    towards = float(heading @ edge.outward)
    room = edge.at - INSIDE - float(middle_of(cloud) @ edge.outward)
    return room / towards if towards > 1e-6 else np.inf


def middle_of(cloud: Array) -> Array:
    """Centroid ``(3,)`` of the outline from above of points ``(n, 3)``, at their mean height.

    The mean of the points would lie towards the cameras, who see one side better; it stands for points in a line,
    which have no outline.
    """
    try:
        corners = cloud[ConvexHull(cloud[:, :2]).vertices, :2]
    except QhullError:
        return np.asarray(cloud.mean(axis=0))
    following = np.roll(corners, -1, axis=0)
    doubled = corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0]
    centre = ((corners + following) * doubled[:, None]).sum(axis=0) / (3.0 * doubled.sum())
    return np.array([*centre, cloud[:, 2].mean()])


def hinge_of(T_world_hand: pin.SE3, opening: float, side: float, cloud: Array, gripper: Gripper) -> tuple[Array, Array]:
    """Axis and a point of the hinge of a lid between two fingers.

    Who grips a lid to turn it open does so with fingers that open along its hinge, which is at one of the lid's two
    other sides. A turn opens if it takes the side away from the hinge back towards the hand.

    Args:
        T_world_hand: The hand that grips.
        opening: Of one finger [m].
        side: Positive if the hinge is on the side of the hand's x axis, else negative.
        cloud: ``(n, 3)`` seen points in the world frame [m].
        gripper: The gripper.

    Returns:
        The unit vector ``(3,)`` about which a right-hand turn opens and a point ``(3,)`` of the hinge, in the frame of
        the hand: at the lid's edge, or at that of the pads where nothing is seen between the fingers.
    """
    sign = 1.0 if side > 0.0 else -1.0
    seen = points(T_world_hand.inverse(), cloud)
    ahead = seen[:, 2] - gripper.tip_offset
    lid = (np.abs(seen[:, 1]) < max(opening, MARGIN)) & (ahead > -PAD_LENGTH) & (ahead < THINNEST)
    out = float(np.clip((sign * seen[lid, 0]).max(initial=PAD_HALF), PAD_HALF, LARGEST_LID))
    return np.array([0.0, -sign, 0.0]), np.array([sign * out, 0.0, gripper.tip_offset + BELOW])


def above_table(T_world_hand: pin.SE3, top: float, gripper: Gripper) -> pin.SE3:
    """The hand raised until the lower corners of its finger tips are clear of the table at height ``top`` [m]."""
    corners = [[0.0, y, gripper.tip_offset] for y in (-gripper.finger_travel, gripper.finger_travel)]
    lowest = float(points(T_world_hand, np.array(corners))[:, 2].min())
    lift = max(0.0, top + TABLE_GAP - lowest)
    return pin.SE3(T_world_hand.rotation, T_world_hand.translation + np.array([0.0, 0.0, lift]))


def raised(T_world_hand: pin.SE3, table: Table, gripper: Gripper) -> pin.SE3:
    """The hand turned up about its pinch point until its palm is clear of the table, by up to ``STEEPER``.

    A rim that was tilted up is low: between fingers above and below it, the palm would be in the table. It is turned
    about the axis across approach and opening, and as little as is enough; unchanged where nothing is enough.
    """
    pinch = pin.SE3(np.eye(3), np.array([0.0, 0.0, gripper.tcp_offset]))
    for angle in sorted(np.linspace(-STEEPER, STEEPER, 2 * TURNS + 1), key=abs):
        turn = pin.SE3(pin.utils.rotate("x", float(angle)), np.zeros(3))
        T: pin.SE3 = T_world_hand * pinch * turn * pinch.inverse()
        if table_distance(table, hand_corners(gripper, T, PALM_LENGTH)).min() > TABLE_GAP:
            return T
    return T_world_hand


def backed_off(T_world_hand: pin.SE3, opening: float, cloud: Array, gripper: Gripper) -> pin.SE3 | None:
    """The hand drawn back until its open fingers meet no seen point on their straight way; ``None`` beyond ``BACK``."""
    seen = points(T_world_hand.inverse(), cloud)
    ahead = gripper.tip_offset - seen[:, 2]
    beside = (
        (np.abs(seen[:, 0]) < FINGER_HALF)
        & (np.abs(seen[:, 1]) > opening - SPARE)
        & (np.abs(seen[:, 1]) < opening + FINGER_THICK)
    )
    met = beside & (ahead > 0.0) & (ahead < WAY)
    if not met.any():
        return T_world_hand
    back = float(ahead[met].max()) + SPARE
    if back > BACK:
        return None
    return T_world_hand * pin.SE3(np.eye(3), np.array([0.0, 0.0, -back]))


def deepened(T_world_hand: pin.SE3, opening: float, cloud: Array, gripper: Gripper, depth: float) -> pin.SE3:
    """The hand moved on until its tips are ``depth`` [m] past the front of the seen points between its fingers.

    Unchanged where they are already, where nothing lies between them, or where ``REACH`` is not enough.
    """
    seen = points(T_world_hand.inverse(), cloud)
    ahead = seen[:, 2] - gripper.tip_offset
    between = (np.abs(seen[:, 0]) < PAD_HALF) & (np.abs(seen[:, 1]) < opening) & (ahead < REACH)
    if not between.any():
        return T_world_hand
    on = float(ahead[between].min()) + depth
    if not 0.0 < on <= REACH + depth:
        return T_world_hand
    return T_world_hand * pin.SE3(np.eye(3), np.array([0.0, 0.0, on]))
