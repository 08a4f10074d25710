"""What outlines do containers have, and which convex rings fill one?"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from robots.spatial import Array
from worlds.assets.solids import Mesh, hull

PROFILES = ("cylinder", "shouldered", "tapered", "waisted", "square", "oval")
"""Body profiles of the containers."""

SEGMENTS = 32
"""Corners of a ring; a multiple of 8 keeps the corners and flats of square outlines."""

ROUND, SQUARE = 2.0, 6.0
"""Superellipse exponents: a circle, a square with corners rounded at about a quarter of its side."""


@dataclass(frozen=True, slots=True)
class Ring:
    """One horizontal outline.

    Attributes:
        z: Height [m].
        x: Half width along x [m].
        y: Half width along y [m].
        exponent: Superellipse exponent.
    """

    z: float
    x: float
    y: float
    exponent: float = ROUND


def disc(z: float, radius: float) -> Ring:
    """A round ring of ``radius`` at height ``z`` [m]."""
    return Ring(z, radius, radius)


def barrel(*rings: Ring) -> Mesh:
    """One convex solid around all ``rings``."""
    return hull(np.concatenate([_corners(ring) for ring in rings]))


def stack(rings: tuple[Ring, ...]) -> tuple[Mesh, ...]:
    """Convex solids, bottom to top, that fill a possibly concave outline of ``rings``."""
    return tuple(barrel(low, high) for low, high in pairwise(rings) if high.z > low.z)


def cylinder(bottom: float, top: float, radius: float) -> Mesh:
    """An upright cylinder between the heights ``bottom`` and ``top`` [m]."""
    return barrel(disc(bottom, radius), disc(top, radius))


def _corners(ring: Ring) -> Array:
    angle = np.linspace(0.0, 2.0 * np.pi, SEGMENTS, endpoint=False)
    x, y = np.cos(angle), np.sin(angle)
    n = ring.exponent
    reach = (np.abs(x / ring.x) ** n + np.abs(y / ring.y) ** n) ** (-1.0 / n)
    return np.column_stack([reach * x, reach * y, np.full(SEGMENTS, ring.z)])


def container(profile: str, rng: np.random.Generator, width: float, height: float, neck: float) -> tuple[Ring, ...]:
    """The outline of a container with a round neck, from the floor to the rim.

    Args:
        profile: One of ``PROFILES``.
        rng: Draws the proportions.
        width: Largest width of the body [m]; an oval body is narrower along y.
        height: Floor to rim [m].
        neck: Radius of the neck [m].

    Returns:
        Rings centred on half the height, so that z is 0 in the middle.
    """
    r = 0.5 * width
    throat = rng.uniform(0.010, 0.016)
    shoulder = rng.uniform(0.06, 0.12) if profile != "shouldered" else rng.uniform(0.22, 0.32)
    rim, eaves = height - throat, height - throat - shoulder * height
    exponent = SQUARE if profile == "square" else ROUND
    depth = r * rng.uniform(0.68, 0.8) if profile == "oval" else r
    sides = _sides(profile, rng, eaves)
    body = [Ring(z, share * r, share * depth, exponent) for z, share in sides]
    return tuple(
        Ring(ring.z - 0.5 * height, ring.x, ring.y, ring.exponent)
        for ring in (*body, disc(rim, neck), disc(height, neck))
    )


def _sides(profile: str, rng: np.random.Generator, eaves: float) -> list[tuple[float, float]]:
    """Height [m] and share of the full radius, from the floor to where the shoulder begins."""
    if profile == "tapered":
        return [(0.0, 1.0), (0.25 * eaves, 1.0), (eaves, rng.uniform(0.72, 0.85))]
    if profile == "waisted":
        waist, middle = rng.uniform(0.76, 0.88), rng.uniform(0.4, 0.6)
        return [(0.0, 0.97), (0.15 * eaves, 1.0), (middle * eaves, waist), (0.88 * eaves, 1.0), (eaves, 0.97)]
    return [(0.0, 0.94), (0.06 * eaves, 1.0), (eaves, 1.0)]
