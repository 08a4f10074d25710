"""How the corners of a proven joint path are cut, so that it can be followed without stopping."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from robots.spatial import Array

RESOLUTION = 1.0 / 32.0
"""Distance between checked states along a Cartesian line, L2 [rad]."""

SHORTCUTS = 60
"""Attempts to replace a part of the path by a straight line."""

ROUNDS = 4
"""Times that corners are cut; every time halves the turn at them."""

Free = Callable[[Array], bool]
"""Whether joint positions ``(7,)`` [rad] of the moving arm are free."""

Edge = Callable[[Array, Array], bool]
"""Whether a straight line between joint positions ``(7,)`` [rad] of the moving arm is free."""


def rounded(edge: Edge, path: Array) -> Array:
    """The path ``(n, 7)`` [rad], whose edges are free, with its corners cut again and again.

    Chaikin, "An Algorithm for High-Speed Curve Generation", 1974, with a smaller cut at a corner where the full one
    touches something. All points stay in the convex hull of the path's, hence within joint limits.
    """
    for _ in range(ROUNDS):
        points = [path[0]]
        for a, corner, b in zip(path[:-2], path[1:-1], path[2:], strict=True):
            points += _cut(edge, a, corner, b)
        path = np.array([*points, path[-1]])
    return path


def _cut(edge: Edge, a: Array, corner: Array, b: Array) -> list[Array]:
    """What stands in place of a corner: two points on its edges whose connection is free, or the corner itself."""
    for share in (0.25, 0.125, 0.0625):
        first, second = corner + share * (a - corner), corner + share * (b - corner)
        if edge(first, second):
            return [first, second]
    return [corner]
