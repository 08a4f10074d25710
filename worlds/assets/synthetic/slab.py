"""Which convex slabs, bars and sectors are flat and hollow things made of?"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from robots.spatial import Array
from worlds.assets.solids import BULLET_MARGIN, Mesh, box, hull, volume
from worlds.assets.synthetic.outline import ROUND, Ring

GAP = 2.0 * BULLET_MARGIN + 0.0005
"""Least distance between two parts [m]: the simulator's margins leave half a millimetre."""

BEHIND = 0.002
"""Hinge line behind the edges of two halves that lie on each other [m]: opened, one edge swings clear of the other."""

CORNER = np.array([0.0, np.pi / 6, np.pi / 3, np.pi / 2])
"""Where the corners of a rounded corner are [rad]."""

SEGMENTS = 16
"""Sectors of a shell: a ring of 75 mm radius is 1.4 mm flat between two of its corners."""


def slab(
    size: tuple[float, float, float], centre: tuple[float, float, float], radius: float, bevel: float = 0.0
) -> Mesh:
    """A slab of ``size`` around ``centre``, its upright edges rounded and its top and bottom edges bevelled [m]."""
    x, y, z = (0.5 * extent for extent in size)
    radius = min(radius, 0.98 * x, 0.98 * y)
    outline = rounded(x, y, radius)
    shrunk = outline * np.array([1.0 - bevel / x, 1.0 - bevel / y])
    layers = [(-z, shrunk), (bevel - z, outline), (z - bevel, outline), (z, shrunk)]
    corners = [np.column_stack([plan, np.full(len(plan), height)]) for height, plan in layers]
    return hull(np.concatenate(corners) + np.asarray(centre))


def rounded(x: float, y: float, radius: float) -> Array:
    """Corners ``(16, 2)`` of a rectangle of half widths ``x`` and ``y`` whose corners are arcs of ``radius`` [m]."""
    arc = radius * np.column_stack([np.cos(CORNER), np.sin(CORNER)]) + np.array([x - radius, y - radius])
    flips = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)]
    return np.concatenate([arc * np.array(flip) for flip in flips])


def prism(side: list[tuple[float, float]], width: float, x: float = 0.0) -> Mesh:
    """A solid whose section across x is the convex outline ``side`` of (y, z), ``width`` wide around ``x`` [m]."""
    return hull(np.array([(x + s * 0.5 * width, y, z) for s in (-1.0, 1.0) for y, z in side]))


def plan(outline: list[tuple[float, float]], low: float, high: float) -> Mesh:
    """An upright solid over the convex outline of (x, y) between the heights ``low`` and ``high`` [m]."""
    return hull(np.array([(x, y, z) for z in (low, high) for x, y in outline]))


def bars(outer: tuple[float, float], bar: float, low: float, high: float) -> tuple[Mesh, ...]:
    """Four bars around a rectangle of half widths ``outer``, each ``bar`` wide, between two heights [m]."""
    x, y = outer
    z, deep = 0.5 * (low + high), high - low
    long = [box((2.0 * x, bar, deep), (0.0, s * (y - 0.5 * bar), z)) for s in (-1.0, 1.0)]
    short = [box((bar, 2.0 * (y - bar), deep), (s * (x - 0.5 * bar), 0.0, z)) for s in (-1.0, 1.0)]
    return (*long, *short)


def shell(levels: tuple[tuple[Ring, Ring], ...], segments: int = SEGMENTS) -> tuple[Mesh, ...]:
    """Convex sectors that fill the wall between an outer and an inner outline.

    Args:
        levels: Outer and inner ring of each level, bottom to top.
        segments: Sectors of one turn.
    """
    angles = np.linspace(0.0, 2.0 * np.pi, segments + 1)
    rims = [[_at(ring, angles) for ring in level] for level in levels]
    return tuple(
        hull(np.concatenate([ring[k : k + 2] for level in (low, high) for ring in level]))
        for low, high in pairwise(rims)
        for k in range(segments)
    )


def _at(ring: Ring, angles: Array) -> Array:
    """Points ``(n, 3)`` of ``ring`` that ``angles`` [rad] would give on the unit circle, stretched to the ring."""
    x, y = np.cos(angles), np.sin(angles)
    reach = (np.abs(x) ** ring.exponent + np.abs(y) ** ring.exponent) ** (-1.0 / ring.exponent)
    return np.column_stack([reach * ring.x * x, reach * ring.y * y, np.full(len(angles), ring.z)])


def wall(
    profile: Array, thickness: float, depth: float = 1.0, exponent: float = ROUND
) -> tuple[tuple[Ring, Ring], ...]:
    """Outer and inner rings of a wall that is as thick everywhere.

    Args:
        profile: Radius and height ``(n, 2)`` of the outer surface, bottom to top [m].
        thickness: Measured across the wall [m].
        depth: Half width along y in radii.
        exponent: Superellipse exponent of the outline.

    Returns:
        Levels for ``shell``; the first and the last keep the outer surface's height, so both ends are flat.
    """
    tangent = np.gradient(profile, axis=0)
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]]) / np.linalg.norm(tangent, axis=1)[:, None]
    inner = profile + thickness * normal
    for end in (0, -1):
        inner[end] = profile[end] + np.array([thickness / min(normal[end, 0], -0.4), 0.0])
    return tuple(
        (Ring(z, r, depth * r, exponent), Ring(high, s, s - (1.0 - depth) * r, exponent))
        for (r, z), (s, high) in zip(profile, inner, strict=True)
    )


def turned(mesh: Mesh, angle: float, offset: tuple[float, float, float]) -> Mesh:
    """``mesh`` turned about z by ``angle`` [rad] and then shifted by ``offset`` [m]."""
    c, s = np.cos(angle), np.sin(angle)
    return Mesh(mesh.vertices @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + np.asarray(offset), mesh.faces)


def density(solids: tuple[Mesh, ...], mass: float) -> float:
    """The density at which ``solids`` weigh ``mass`` [kg/m^3]."""
    return mass / sum(volume(solid) for solid in solids)
