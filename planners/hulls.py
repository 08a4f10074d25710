"""Which solid the planner believes the object to be: convex hulls of the observed cloud, and what it may hide."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from robots.spatial import Array, frozen

SLICE = 0.012
"""Thickness of a slice across the object's longest horizontal extent [m]."""

STEP_HEIGHT = 0.012
"""A jump in height between neighbouring points of a slice larger than this ends a piece [m]."""

BIN = 0.004
"""Width of the bins across a slice in which its height is taken [m]."""

GAP = 0.009
"""A stretch of a slice without points longer than this ends a piece [m]."""

HOLLOW = 0.006
"""A hollow in the upper surface of a piece deeper than this is cut open [m]."""

MIN_POINTS = 6

THINNEST = 1e-4
"""Spread across its thinnest direction below which a piece is left out [m]: a row of points, no solid."""


def observed_hulls(cloud: Array, table_top: float) -> list[Array]:
    """Convex pieces ``(k, 3)`` [m] that contain every observed point and all that these may hide above the table.

    The cloud ``(n, 3)`` is seen from above, so whatever lies under an observed point is unknown and counts as solid.
    It is cut into slices across its longest horizontal extent, and each slice where its height jumps, where there is a
    gap and where it is hollow, so that a narrow lid does not grow to the width of the body beside it; each piece is
    extended straight down to the table and closed.
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
    found = []
    for low, high in _stretches(points[:, 2], across):
        inside = (across >= low - 1e-3) & (across <= high + 1e-3)
        piece = _closed(points[inside], table_top) if inside.sum() >= MIN_POINTS else None
        if piece is not None:
            found.append(piece)
    return found


def _stretches(heights: Array, across: Array) -> list[tuple[float, float]]:
    """Where, across the slice, a piece begins and ends: at gaps, at jumps in height, and inside hollows."""
    first = float(across.min())
    bins = np.floor((across - first) / BIN).astype(int)
    tops = np.full(bins.max() + 1, np.nan)
    np.fmax.at(tops, bins, heights)
    known = np.flatnonzero(np.isfinite(tops))
    breaks = (np.diff(known) * BIN > GAP) | (np.abs(np.diff(tops[known])) > STEP_HEIGHT)
    runs = [run for run in np.split(known, np.flatnonzero(breaks) + 1) if len(run)]
    parts = [part for run in runs for part in _convex_runs(run, tops)]
    ends = [(first + BIN * int(part[0]), first + BIN * (int(part[-1]) + 1)) for part in parts]
    return [(low, min(high, float(across.max()))) for low, high in ends]


def _convex_runs(run: np.ndarray[Any, np.dtype[np.intp]], tops: Array) -> list[np.ndarray[Any, np.dtype[np.intp]]]:
    """A run of bins cut where a straight line over it would fill a hollow deeper than ``HOLLOW``."""
    if len(run) < 3:
        return [run]
    x, z = run.astype(float), tops[run]
    chain: list[int] = []
    for k in range(len(run)):  # the upper hull by Andrew's monotone chain
        while len(chain) > 1 and _above(x, z, chain[-2], chain[-1], k):
            chain.pop()
        chain.append(k)
    excess = np.interp(x, x[chain], z[chain]) - z
    worst = int(np.argmax(excess))
    if excess[worst] <= HOLLOW:
        return [run]
    return _convex_runs(run[: worst + 1], tops) + _convex_runs(run[worst:], tops)


def _above(x: Array, z: Array, a: int, b: int, c: int) -> bool:
    """Whether point ``b`` lies on or below the line from ``a`` to ``c``."""
    return bool((x[b] - x[a]) * (z[c] - z[a]) >= (z[b] - z[a]) * (x[c] - x[a]))


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
