"""Which way up does an imported object lie on a table?"""

from __future__ import annotations

import numpy as np

from robots.spatial import Array
from worlds.assets.convex import dense
from worlds.assets.solids import Mesh

SKIN = 0.06
"""Share of the height counted to the lower or upper face when the two are compared."""

FLATTER = 1.15
"""The upper face must be this much fuller than the lower one before an object is turned over."""


def flat_rotation(vertices: Array, front: Array) -> Array:
    """The rotation ``(3, 3)`` that lays an object on its broad side.

    Args:
        vertices: ``(n, 3)`` in a z-up frame.
        front: Which way its front faces ``(3,)`` where it stands upright, as a remote control in a rack does.

    Returns:
        The identity when its thinnest side is vertical already; else its front or, where the thinnest side is not the
        one from front to back, some broad side faces up, and its longest side lies along x.
    """
    extent = np.ptp(vertices, axis=0)
    thin = int(np.argmin(extent))
    if thin == 2:
        return np.eye(3)
    up = np.eye(3)[thin] * (-1.0 if front[thin] < 0.0 else 1.0)
    along = np.eye(3)[int(np.argmax(extent))]
    return np.vstack([along, np.cross(up, along), up])


def fuller_side_down(mesh: Mesh) -> Array:
    """The rotation ``(3, 3)`` about x, none or half a turn, after which the fuller of the lower and upper face is down.

    A wall switch lies on its flat back, not on its rocker.
    """
    points = _surface(mesh)
    z, low, high = points[:, 2], points[:, 2].min(), points[:, 2].max()
    cell = float(np.ptp(points[:, :2], axis=0).max()) / 40.0
    skin = SKIN * (high - low)
    lower, upper = (_covered(points[near], cell) for near in (z < low + skin, z > high - skin))
    return np.diag([1.0, -1.0, -1.0]) if upper > FLATTER * lower else np.eye(3)


def wider_end_up(mesh: Mesh, *, up: bool) -> Array:
    """The rotation ``(3, 3)`` about x, none or half a turn, after which the wider end of a shell is up, or down.

    Bowls and plates are widest at their rim; a cap lies on its rim.
    """
    points = _surface(mesh)
    z, low, high = points[:, 2], points[:, 2].min(), points[:, 2].max()
    third = (high - low) / 3.0
    bottom, top = (np.linalg.norm(np.ptp(points[near, :2], axis=0)) for near in (z < low + third, z > high - third))
    return np.eye(3) if (top >= bottom) == up else np.diag([1.0, -1.0, -1.0])


def _surface(mesh: Mesh) -> Array:
    return dense(mesh, float(np.ptp(mesh.vertices, axis=0).max()) / 100.0)


def _covered(points: Array, cell: float) -> int:
    """Cells of a grid that points fall into, seen from above."""
    return len(np.unique(np.floor(points[:, :2] / cell).astype(int), axis=0))
