"""How a free joint path is made shorter and rounder, and when a straight joint edge counts as free."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from robots.spatial import Array

RESOLUTION = 1.0 / 32.0
"""Distance between checked states of an edge while searching, L2 [rad]; what is returned is checked at half of it."""

SHORTCUTS = 60
"""Attempts to replace a part of the path by a straight line."""

ROUNDS = 4
"""Times that corners are cut; every time halves the turn at them."""

Free = Callable[[Array], bool]
"""Whether joint positions ``(7,)`` [rad] of the moving arm are free."""


def edge_free(free: Free, a: Array, b: Array, resolution: float = RESOLUTION) -> bool:
    """Whether the straight line between two configurations ``(7,)`` [rad] is free, coarse to fine, ends excluded."""
    steps = max(1, int(np.ceil(np.linalg.norm(b - a) / resolution)))
    return all(free(a + (b - a) * (k / steps)) for k in _coarse_to_fine(steps))


def _coarse_to_fine(steps: int) -> list[int]:
    """1..steps-1, halving the gaps: a collision is found early wherever it is."""
    order: list[int] = []
    stride = 1 << max(0, (steps - 1).bit_length() - 1)
    while stride:
        order += range(stride, steps, 2 * stride)
        stride //= 2
    return order


def path_free(free: Free, path: Array, resolution: float) -> bool:
    """Whether every edge of the path ``(n, 7)`` [rad] is free, its points excluded."""
    return all(edge_free(free, a, b, resolution) for a, b in pairwise(path))


def shortened(free: Free, path: Array, rng: np.random.Generator, resolution: float = RESOLUTION / 2) -> Array:
    """The path ``(n, 7)`` [rad] with detours cut: random pairs of points on it are joined where the line is free.

    Geraerts and Overmars, "Creating High-quality Paths for Motion Planning", IJRR 2007, section 3.1. Points that can be
    left out without a contact are left out at the end.
    """
    points = list(path)
    for _ in range(SHORTCUTS):
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        ends = np.concatenate([[0.0], np.cumsum(lengths)])
        s, t = np.sort(rng.uniform(0.0, ends[-1], 2))
        i, j = (min(int(np.searchsorted(ends, x, "right")) - 1, len(points) - 2) for x in (s, t))
        if i == j:
            continue
        a = points[i] + (points[i + 1] - points[i]) * ((s - ends[i]) / lengths[i])
        b = points[j] + (points[j + 1] - points[j]) * ((t - ends[j]) / lengths[j])
        if edge_free(free, a, b, resolution):
            points = [*points[: i + 1], a, b, *points[j + 1 :]]
    k = 1
    while k < len(points) - 1:
        if edge_free(free, points[k - 1], points[k + 1], resolution):
            del points[k]
        else:
            k += 1
    return np.array(points)


def rounded(free: Free, path: Array, resolution: float = RESOLUTION / 2) -> Array:
    """The path ``(n, 7)`` [rad] with its corners cut again and again, so that it can be followed without stopping.

    Chaikin, "An Algorithm for High-Speed Curve Generation", 1974, with a smaller cut at a corner where the full one
    touches something. All points stay in the convex hull of the path's, hence within joint limits.
    """
    for _ in range(ROUNDS):
        points = [path[0]]
        for a, corner, b in zip(path[:-2], path[1:-1], path[2:], strict=True):
            points += _cut(free, a, corner, b, resolution)
        path = np.array([*points, path[-1]])
    return path


def _cut(free: Free, a: Array, corner: Array, b: Array, resolution: float) -> list[Array]:
    """What stands in place of a corner: two points on its edges whose connection is free, or the corner itself."""
    for share in (0.25, 0.125, 0.0625):
        first, second = corner + share * (a - corner), corner + share * (b - corner)
        if free(first) and free(second) and edge_free(free, first, second, resolution):
            return [first, second]
    return [corner]
