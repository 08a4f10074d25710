"""Which solid the planner believes the object to be: convex hulls of the observed cloud, and what it may hide."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from robots.spatial import Array, frozen

SLICE = 0.012
"""Thickness of a slice across the object's longest horizontal extent [m]."""

STEP_HEIGHT = 0.012
"""A jump in height between neighbouring points of a slice larger than this ends a piece [m]."""

MIN_POINTS = 6

THINNEST = 1e-4
"""Spread across its thinnest direction below which a piece is left out [m]: a row of points, no solid."""


def observed_hulls(cloud: Array, table_top: float) -> list[Array]:
    """Convex pieces ``(k, 3)`` [m] that contain every observed point and all that these may hide above the table.

    The cloud ``(n, 3)`` is seen from above, so whatever lies under an observed point is unknown and counts as solid.
    It is cut into slices across its longest horizontal extent and each slice where its height jumps, so that a narrow
    lid does not grow to the width of the body beside it; each piece is extended straight down to the table and closed.
    """
    flat = cloud[:, :2] - cloud[:, :2].mean(axis=0)
    directions = np.linalg.svd(flat, full_matrices=False)[2]
    along, across = flat @ directions[0], flat @ directions[1]
    edges = np.linspace(along.min(), along.max(), max(1, int(np.ceil(np.ptp(along) / SLICE))) + 1)
    pieces: list[Array] = []
    for low, high in pairwise(edges):
        inside = (along >= low - 1e-3) & (along <= high + 1e-3)
        pieces += _pieces(cloud[inside], across[inside], table_top)
    return pieces


def _pieces(points: Array, across: Array, table_top: float) -> list[Array]:
    """The closed pieces of one slice."""
    if len(points) < MIN_POINTS:
        return []
    steps = _height_steps(points, across)
    found = []
    for low, high in pairwise(steps):
        inside = (across >= low - 1e-3) & (across <= high + 1e-3)
        piece = _closed(points[inside], table_top) if inside.sum() >= MIN_POINTS else None
        if piece is not None:
            found.append(piece)
    return found


def _height_steps(points: Array, across: Array) -> list[float]:
    """Where, across the slice, the upper surface jumps; with both ends."""
    bins = np.floor((across - across.min()) / 0.004).astype(int)
    tops = np.full(bins.max() + 1, np.nan)
    for number in np.unique(bins):
        tops[number] = points[bins == number, 2].max()
    known = np.flatnonzero(np.isfinite(tops))
    jumps = known[1:][np.abs(np.diff(tops[known])) > STEP_HEIGHT]
    return [float(across.min()), *(float(across.min() + 0.004 * k) for k in jumps), float(across.max())]


def _closed(points: Array, table_top: float) -> Array | None:
    """The hull's vertices of the points and their shadows on the table; ``None`` where they lie in one plane."""
    shadow = points.copy()
    shadow[:, 2] = table_top
    solid = np.concatenate([points, shadow])
    if np.linalg.svd(solid - solid.mean(axis=0), compute_uv=False)[-1] < THINNEST:
        return None
    try:
        return frozen(solid[ConvexHull(solid).vertices])
    except QhullError:
        return None
