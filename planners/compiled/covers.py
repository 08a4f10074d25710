"""Which few spheres certainly contain a convex solid: it is cut in two where it is longest, again and again."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from robots.spatial import Array

SPHERES = 8
"""Spheres of a link's cover: more spheres cost more than the exact pairs that they save."""

STEPS = 60
"""Steps of the search for the smallest sphere; the radius is that of the furthest vertex in any case."""


def bounding_sphere(vertices: Array) -> tuple[Array, float]:
    """Centre ``(3,)`` and radius [m] of a small sphere around vertices ``(n, 3)``.

    Badoiu and Clarkson, "Smaller Core-Sets for Balls", SODA 2003: step towards the furthest vertex, ever less.
    """
    centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    best, radius = centre, float(np.linalg.norm(vertices - centre, axis=1).max())
    for k in range(1, STEPS):
        far = vertices[int(np.argmax(((vertices - centre) ** 2).sum(axis=1)))]
        centre = centre + (far - centre) / (k + 1)
        reach = float(np.sqrt(((vertices - centre) ** 2).sum(axis=1).max()))
        if reach < radius:
            best, radius = centre, reach
    return best, radius


def oriented_box(vertices: Array) -> tuple[Array, Array, Array]:
    """Axes as columns ``(3, 3)``, centre ``(3,)`` and half extents ``(3,)`` [m] of a box around the vertices."""
    middle = vertices.mean(axis=0)
    axes = np.linalg.svd(vertices - middle, full_matrices=False)[2].T if len(vertices) > 3 else np.eye(3)
    if axes.shape != (3, 3) or abs(abs(np.linalg.det(axes)) - 1.0) > 1e-6:
        axes = np.eye(3)
    inside = vertices @ axes
    low, high = inside.min(axis=0), inside.max(axis=0)
    plain = np.ptp(vertices, axis=0)
    if np.prod(plain + 1e-4) <= np.prod(high - low + 1e-4):
        axes, low, high = np.eye(3), vertices.min(axis=0), vertices.max(axis=0)
    return axes, axes @ ((low + high) / 2), (high - low) / 2


def sphere_cover(vertices: Array, count: int = SPHERES) -> tuple[Array, Array]:
    """Centres ``(k, 3)`` and radii ``(k,)`` [m], ``k <= count``, of spheres that contain the hull of the vertices.

    The hull is cut by a plane across its longest extent; both parts are convex, their vertices are old ones and
    crossings of the plane with segments between old ones, and a sphere around the vertices contains a part.
    """
    parts = [(*bounding_sphere(vertices), vertices)]
    while len(parts) < count:
        widest = max(range(len(parts)), key=lambda k: parts[k][1])
        halves = _halves(parts[widest][2])
        grown = [(*bounding_sphere(half), half) for half in halves]
        if len(grown) < 2 or max(part[1] for part in grown) > 0.98 * parts[widest][1]:
            break
        parts[widest : widest + 1] = grown
    return np.array([part[0] for part in parts]), np.array([part[1] for part in parts])


def inner_radii(vertices: Array, centres: Array) -> Array:
    """Radii ``(k,)`` [m] of spheres about the centres inside the hull of the vertices; ``-inf`` for centres outside."""
    try:
        faces = ConvexHull(vertices).equations
    except QhullError:
        return np.full(len(centres), -np.inf)
    radii = -(centres @ faces[:, :3].T + faces[:, 3]).max(axis=1)
    return np.where(radii > 0.0, radii, -np.inf)


def _halves(vertices: Array) -> list[Array]:
    """The vertices of both parts of a convex solid, cut across its longest direction."""
    direction = np.linalg.svd(vertices - vertices.mean(axis=0), full_matrices=False)[2][0]
    along = vertices @ direction
    cut = (along.min() + along.max()) / 2
    low, high = along < cut, along >= cut
    if not low.any() or not high.any():
        return []
    below, above = vertices[low], vertices[high]
    share = (cut - along[low])[:, None] / (along[high][None, :] - along[low][:, None])
    crossing = (below[:, None] + share[..., None] * (above[None, :] - below[:, None])).reshape(-1, 3)
    return [_corners(np.concatenate([part, crossing])) for part in (below, above)]


def _corners(vertices: Array) -> Array:
    """The vertices that the hull needs; all of them where they lie in a plane."""
    try:
        return np.asarray(vertices[ConvexHull(vertices).vertices])
    except QhullError:
        return vertices
