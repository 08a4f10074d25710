"""Where on a part is there room for fingers: how much of a lid can be gripped, and where can a head be pressed?"""

from __future__ import annotations

import numpy as np

from robots.spatial import Array, perpendicular, unit
from worlds.assets.convex import dense
from worlds.assets.solids import Mesh, merged

DIRECTIONS = 12
"""Closing directions tried, spread over half a turn."""

SECTOR = np.cos(np.radians(25.0))
"""Finger pads 20 mm wide beside a 25 mm radius cover about 25 degrees on either side."""

FLUSH = 0.0003
"""Where the body comes this close to the lid's outline, fingers around the lid touch the body too [m]."""

FINGERTIP = 0.006
"""Half the side of the spot a fingertip needs [m]."""

CELL = 0.001
"""Grid on which a top surface is searched [m]."""

LEVEL = 0.002
"""Height differences under a fingertip that still count as flat [m]."""


UPRIGHT = 0.3
"""Triangles steeper than this cosine between normal and pressing direction carry no fingertip."""

ENOUGH = 0.4
"""Share of a fingertip that must be carried: a bar half as wide as the tip carries it."""

HEIGHT_WORTH, CENTRE_WORTH = 20.0, 15.0
"""A spot 10 mm higher, or 13 mm nearer to the line of motion, makes up for 0.2 less support [1/m]."""


def _frame_along(direction: Array) -> Array:
    """A right-handed ``(3, 3)`` rotation whose third column is ``direction``."""
    z = unit(direction)
    x = perpendicular(z)
    return np.column_stack([x, np.cross(z, x), z])


def grip(lid: Array, body: Array, centre: Array, outward: Array) -> tuple[float, float]:
    """The tallest band of a lid that two opposite fingers reach past the body, and the lid's width there.

    Args:
        lid: Points ``(n, 3)`` of the lid [m].
        body: Points ``(m, 3)`` of everything else [m].
        centre: A point on the lid's axis.
        outward: Unit vector from the body through the lid.

    Returns:
        Height of the band [m] and width between the fingers [m], for the best closing direction.
    """
    R = _frame_along(outward)
    lid, body = (lid - centre) @ R, (body - centre) @ R
    angles = np.arange(DIRECTIONS) * np.pi / DIRECTIONS
    bands = [_band(lid, body, np.array([np.cos(angle), np.sin(angle)])) for angle in angles]
    return max(bands, key=lambda band: (round(band[0], 3), -band[1]))


def _band(lid: Array, body: Array, direction: Array) -> tuple[float, float]:
    across = lid[:, :2] @ direction
    half = np.abs(across).max()
    reach = np.linalg.norm(body[:, :2], axis=1)
    facing = np.abs(body[:, :2] @ direction) > SECTOR * reach
    blocking = body[facing & (reach > half - FLUSH), 2]
    floor = max(float(lid[:, 2].min()), float(blocking.max(initial=-np.inf)))
    return float(lid[:, 2].max()) - floor, float(np.ptp(across))


def flat_spot(part: tuple[Mesh, ...], others: tuple[Mesh, ...], axis_point: Array, outward: Array) -> Array | None:
    """The middle of the highest flat spot on ``part`` that ``others`` leave open, or None.

    Args:
        part: Meshes of what is pressed [m].
        others: Meshes of everything else [m].
        axis_point: A point on the line along which the part moves; spots near it are preferred.
        outward: Unit vector against the pressing direction.

    Returns:
        A point ``(3,)`` on the part's outer surface.
    """
    R = _frame_along(outward)
    top = (_upper_surface(part, outward) - axis_point) @ R
    corner = top[:, :2].min(axis=0) - 2.0 * FINGERTIP
    shape = tuple(np.ceil((np.ptp(top[:, :2], axis=0) + 4.0 * FINGERTIP) / CELL).astype(int) + 1)
    heights = _height_map(top, corner, shape)
    roof = _height_map((_upper_surface(others, outward) - axis_point) @ R, corner, shape)
    heights[roof > heights] = -np.inf
    cells = np.argwhere(np.isfinite(heights))
    scores = np.array([_support(heights, row, column) for row, column in cells])
    if not len(cells) or scores.max() < ENOUGH:
        return None
    spots = corner + (cells + 0.5) * CELL
    levels = heights[cells[:, 0], cells[:, 1]]
    worth = scores + HEIGHT_WORTH * levels - CENTRE_WORTH * np.linalg.norm(spots, axis=1)
    best = int(np.argmax(np.where(scores >= ENOUGH, worth, -np.inf)))
    return np.asarray(axis_point + R @ np.array([*spots[best], levels[best]]))


def _upper_surface(meshes: tuple[Mesh, ...], outward: Array) -> Array:
    """Points on the triangles that do not stand upright; imported meshes may face either way."""
    whole = merged(meshes)
    a, b, c = (whole.vertices[whole.faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    lying = np.abs(normals @ outward) > UPRIGHT * np.linalg.norm(normals, axis=1)
    return dense(Mesh(whole.vertices, whole.faces[lying]), 0.8 * CELL, most=128)


def _height_map(cloud: Array, corner: Array, shape: tuple[int, ...]) -> Array:
    cells = np.floor((cloud[:, :2] - corner) / CELL).astype(int)
    within = ((cells >= 0) & (cells < np.array(shape))).all(axis=1)
    heights = np.full(shape, -np.inf)
    np.maximum.at(heights, (cells[within, 0], cells[within, 1]), cloud[within, 2])
    return heights


def _support(heights: Array, row: int, column: int) -> float:
    """Share of the fingertip's cells around one cell that carry it: level with it; 0 where one stands above."""
    reach = round(FINGERTIP / CELL)
    window = heights[row - reach : row + reach + 1, column - reach : column + reach + 1] - heights[row, column]
    return 0.0 if window.max() > LEVEL else float((window > -LEVEL).mean())
