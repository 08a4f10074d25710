"""Where can an object be pressed so that its other side rises, and how does it lie then?

A dish pressed outside of its foot rolls over the corners of its profile until the tips no longer press outside of where
it touches the table. How far that is depends on its weight, unless it is pressed where it lands on a long edge.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from affordance.candidates import ContactCandidate
from affordance.preparing import KEPT, TILT, TIP, Body
from robots.spatial import Array, hand_rotation, rotation_about
from robots.workcell import Gripper

PRESS_PAST = 0.004
"""How far below the expected contact the pressing hand may go [m]; it stops at the force."""

LOWEST = 0.0045
"""Least height of the pressing finger tips above the table [m]: a rim is about as thick."""

STANDS = 0.002
"""What is lower above the table touches it [m]."""

LEAST_TILT = 0.02
"""A press that turns an object by less is none [rad]."""

LEAST_EDGE = 0.004
"""A shorter edge of a profile's hull is part of a corner [m]."""

LEAST_LEVER = 0.006
"""How far beyond the foot an object is pressed at least [m]."""

FROM_RIM = 0.009
"""How far inside of its rim an object is pressed at least [m]."""

PLACES = 6
"""Places between foot and rim of which the best is pressed."""

LEVER = 0.1
"""An object's weight over the force at which a press stops: plates of 0.3 kg and 30 N."""

TILT_STEP, MOST_TILT = np.radians(1.0), np.radians(50.0)
"""By which an object is turned at a time to see where it ends, and at most [rad]."""


def presses(body: Body, gripper: Gripper, top: float, rng: np.random.Generator) -> list[ContactCandidate]:
    """Presses straight down between foot and rim, all around, in random order."""
    found = []
    for azimuth in rng.uniform(0.0, 2 * np.pi) + np.linspace(0.0, 2 * np.pi, KEPT, endpoint=False):
        radial = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        pressed = _pressed(body, radial, gripper, top, rng)
        if pressed is not None:
            found.append(pressed)
    return [found[k] for k in rng.permutation(len(found))]


def _pressed(
    body: Body, radial: Array, gripper: Gripper, top: float, rng: np.random.Generator
) -> ContactCandidate | None:
    profile = np.column_stack([(body.surface - body.centre) @ radial, body.surface[:, 2] - top])
    across = np.cross([0.0, 0.0, 1.0], radial)
    strip = profile[np.abs((body.surface - body.centre) @ across) < TIP]
    corners = hull_corners(profile)
    if len(corners) < 2 or not len(strip):
        return None
    rim, foot = float(strip[:, 0].max()), float(corners[0, 0])
    tried = [tilt_under(strip, corners, at) for at in np.linspace(foot + LEAST_LEVER, rim - FROM_RIM, PLACES)]
    sure = [tilt for tilt in tried if tilt is not None]
    if not sure:
        return None
    # Weight and friction are not known: best is where they decide least about how far the object turns.
    tilt = min(sure, key=lambda tilt: tilt.doubt - 0.1 * tilt.angle)
    R = rotation_about(across, tilt.angle)
    below = np.array([*body.centre[:2], top])
    T_move = pin.SE3(R, below + tilt.moved[0] * radial + [0.0, 0.0, tilt.moved[1]] - R @ below)
    begin = below + tilt.at * radial + [0.0, 0.0, tilt.first]
    lowest = max(tilt.last - PRESS_PAST, LOWEST)
    travel = np.array([0.0, 0.0, min(lowest - tilt.first, 0.0)])
    approach = rotation_about(radial, rng.normal(0.0, TILT)) @ np.array([0.0, 0.0, -1.0])
    hand = hand_rotation(approach, across)
    return ContactCandidate(pin.SE3(hand, begin - gripper.tip_offset * approach), 0.0, travel, T_move, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Tilt:
    """How an object turns when finger tips press straight down on it, in a vertical plane through its centre.

    Positions are in that plane: outwards from the centre and up from the table [m].

    Attributes:
        at: Where it is pressed.
        first, last: Height of the tips when they meet it, and when it resists.
        angle: By which it has turned then [rad].
        moved: ``(2,)`` where the point below the centre, on the table, has gone.
        doubt: The angle at a quarter of the expected weight less that at four times the expected weight [rad].
    """

    at: float
    first: float
    last: float
    angle: float
    moved: Array
    doubt: float


def hull_corners(profile: Array) -> Array:
    """Corners ``(k, 2)`` of the lower right part of the convex hull of ``(n, 2)`` points, from the foot outwards.

    The foot is where the points leave the table's height; a corner closer to the last one than roughness makes it is
    left out.
    """
    low = profile[profile[:, 1] < profile[:, 1].min() + STANDS]
    corner = low[int(low[:, 1].argmin())]
    corners: list[Array] = []
    while len(beyond := profile[profile[:, 0] > corner[0] + 1e-4]):
        away = beyond - corner
        slopes = np.arctan2(away[:, 1], away[:, 0])
        if slopes.min() >= LEAST_TILT and (not corners or np.linalg.norm(corner - corners[-1]) >= LEAST_EDGE):
            corners.append(corner)
        corner = beyond[int(slopes.argmin())]
    return np.array([*corners, corner])


def tilt_under(strip: Array, corners: Array, at: float) -> Tilt | None:
    """How an object turns under a press.

    It rolls without slipping over the corners of its profile as long as the tips press outside of where it touches the
    table, by as much as its weight needs: force times lever against weight times the distance of its centre.

    Args:
        strip: ``(n, 2)`` points of the profile that the tips can meet.
        corners: ``(k, 2)`` corners of the profile over which it rolls.
        at: Where it is pressed [m].

    Returns:
        ``None`` where there is nothing under the tips, or it does not turn.
    """
    away = np.diff(corners, axis=0)
    slopes = np.arctan2(away[:, 1], away[:, 0])
    R, t, angle, number = np.eye(2), np.zeros(2), 0.0, 0
    ends: dict[float, tuple[float, float, Array]] = {}
    first = 0.0
    while True:
        points = strip @ R.T + t
        under = points[np.abs(points[:, 0] - at) < TIP]
        if not len(under):
            return None
        touched = under[int(under[:, 1].argmax())]
        first = first or float(touched[1])
        pivot = R @ corners[number] + t
        for share in (4.0, 1.0, 0.25):
            if touched[0] - pivot[0] < share * LEVER * pivot[0] and share not in ends:
                ends[share] = (angle, float(touched[1]), t.copy())
        if len(ends) == 3 or angle > MOST_TILT:
            break
        while number < len(slopes) and slopes[number] <= angle + 1e-9:
            number += 1
        if number == len(slopes):
            break
        step = min(TILT_STEP, float(slopes[number]) - angle)
        pivot = R @ corners[number] + t
        turn = np.array([[np.cos(step), np.sin(step)], [-np.sin(step), np.cos(step)]])
        R, t, angle = turn @ R, pivot + turn @ (t - pivot), angle + step
    here = (angle, float(touched[1]), t.copy())
    likely, light, heavy = (ends.get(share, here) for share in (1.0, 0.25, 4.0))
    if likely[0] < LEAST_TILT:
        return None
    return Tilt(at, first, likely[1], likely[0], likely[2], light[0] - heavy[0])
