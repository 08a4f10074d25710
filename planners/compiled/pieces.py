"""Which convex pieces contain a concave mesh more closely than its one hull: hulls of patches of its triangles."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from robots.spatial import Array


def surface_pieces(vertices: Array, triangles: Array, count: int) -> list[Array]:
    """Vertices ``(k, 3)`` [m] of at most ``count`` convex pieces that together contain every triangle.

    The patch with the largest hull is cut in two across its longest direction, again and again.

    Args:
        vertices: ``(n, 3)`` [m].
        triangles: ``(m, 3)`` numbers of vertices.
        count: Most pieces.
    """
    patches = [np.asarray(triangles)]
    while len(patches) < count:
        sizes = [_volume(vertices[np.unique(patch)]) if len(patch) > 1 else 0.0 for patch in patches]
        widest = int(np.argmax(sizes))
        centres = vertices[patches[widest]].mean(axis=1)
        direction = np.linalg.svd(centres - centres.mean(axis=0), full_matrices=False)[2][0]
        along = centres @ direction
        low = along < np.median(along)
        if sizes[widest] == 0.0 or not low.any():
            break
        patches[widest : widest + 1] = [patches[widest][low], patches[widest][~low]]
    return [_corners(vertices[np.unique(patch)]) for patch in patches]


def _volume(points: Array) -> float:
    try:
        return float(ConvexHull(points).volume)
    except QhullError:
        return 0.0


def _corners(points: Array) -> Array:
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except QhullError:
        return points
