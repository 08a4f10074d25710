"""Which plates can be generated? Four kinds, each a disc on the table with sloping rings around it, from the index.

A wall is cut into convex wedges, so that the hollow stays hollow. The foot ring and what it encloses are one solid
disc: no finger gets under a plate, and a disc rests on four contacts where a ring of wedges would need eighty.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from robots.spatial import Array
from worlds.assets.asset import Asset
from worlds.assets.build import Design, Link, realise
from worlds.assets.solids import Mesh, hull, volume
from worlds.assets.synthetic.outline import ROUND, SQUARE
from worlds.assets.synthetic.series import Series, mixed, pastel

SERIES = Series("Plate", count=22, seed=20_260_109)
"""As many as in the paper's table; the seed starts every instance's own generator."""

SEGMENTS = 20
"""Wedges of one ring; a multiple of 4 keeps the flats of a square plate."""

MELAMINE, STONEWARE = (1450.0, 1550.0), (2000.0, 2300.0)
"""Densities [kg/m^3] of melamine resin filled with cellulose, and of stoneware and porcelain with their pores."""

OVERSIZE = 1.2
"""Sheet area over the area seen from above: walls slope, and a foot ring is added."""


@dataclass(frozen=True, slots=True)
class _Kind:
    """Proportions of one kind of plate.

    Attributes:
        width: Diameter, or side of a square plate [m].
        height: Table to the top of the rim [m].
        sheet: Thickness [m].
        density: Of the material [kg/m^3].
        exponent: Superellipse exponent of the outline.
        wall: Where the wall ends: share of the way from the foot to the edge, share of the height.
    """

    width: tuple[float, float]
    height: tuple[float, float]
    sheet: tuple[float, float]
    density: tuple[float, float]
    exponent: float
    wall: tuple[tuple[float, float], tuple[float, float]]


KINDS = {
    "dinner": _Kind((0.220, 0.260), (0.020, 0.027), (0.0032, 0.0040), MELAMINE, ROUND, ((0.30, 0.42), (0.62, 0.75))),
    "salad": _Kind((0.165, 0.200), (0.016, 0.022), (0.0040, 0.0048), STONEWARE, ROUND, ((0.30, 0.45), (0.60, 0.75))),
    "coupe": _Kind((0.175, 0.220), (0.022, 0.030), (0.0036, 0.0044), STONEWARE, ROUND, ((0.50, 0.60), (0.28, 0.38))),
    "square": _Kind((0.190, 0.230), (0.018, 0.025), (0.0034, 0.0042), MELAMINE, SQUARE, ((0.60, 0.75), (0.30, 0.45))),
}
"""Dinner and salad plates rise steeply and end in a flat rim; a coupe curves up to its edge, a square plate's edge is
raised. Shops list 25 cm porcelain plates at 450 to 700 g, melamine ones of the size at about half of it."""

FOOT = (0.52, 0.63)
"""Radius of the foot ring as a share of the rim's."""

BEVEL = 0.3
"""How far the upper edge of the rim is drawn in, as a share of the sheet: edges are rounded."""


def make(instance: str) -> Asset:
    """The plate called ``instance``; ``UnknownName`` when there is none."""
    index = SERIES.index(instance)
    rng = SERIES.rng(index)
    name = list(KINDS)[mixed(index, len(KINDS))]
    kind = KINDS[name]
    edge, height, sheet = 0.5 * rng.uniform(*kind.width), rng.uniform(*kind.height), rng.uniform(*kind.sheet)
    foot = edge * rng.uniform(*FOOT)
    solids = _shell(kind, foot, edge, height, sheet, tuple(rng.uniform(*span) for span in kind.wall))
    area = float(_outline(edge, kind.exponent)[:, 0].max()) ** 2 * (np.pi if kind.exponent == ROUND else 4.0)
    mass = OVERSIZE * area * sheet * rng.uniform(*kind.density)
    density = mass / sum(volume(solid) for solid in solids)
    return realise(
        Design(
            source="synthetic",
            category=SERIES.category,
            instance=instance,
            topology=name,
            split=SERIES.split(index),
            links=(Link("body", solids, density, pastel(rng)),),
            joints=(),
            part=None,
            long_axis=np.array([1.0, 0.0, 0.0]),
        )
    )


def _shell(
    kind: _Kind, foot: float, edge: float, height: float, sheet: float, wall: tuple[float, ...]
) -> tuple[Mesh, ...]:
    """A solid disc as wide as the foot, a wall around it and a rim around that; z is 0 on the table.

    Args:
        kind: The outline.
        foot: Half width at the foot [m].
        edge: Half width at the rim's edge [m].
        height: Table to the top of the rim [m].
        sheet: Thickness [m].
        wall: Where the wall ends, as in ``_Kind``.

    Returns:
        Convex solids.
    """
    floor = 0.6 * sheet
    knee = (foot + wall[0] * (edge - foot), floor + wall[1] * (height - sheet - floor))
    below = [(foot, floor), knee, (edge, height - sheet)]
    disc = [(0.97 * foot, 0.0), (foot, floor), (foot, floor + sheet)]
    rings = [np.column_stack([_outline(r, kind.exponent), np.full(SEGMENTS, z)]) for r, z in disc]
    solids = [hull(np.concatenate(rings))]
    for number, (inner, outer) in enumerate(pairwise(below)):
        drawn_in = BEVEL * sheet if number == len(below) - 2 else 0.0
        solids += _wedges(kind.exponent, inner, outer, sheet, drawn_in)
    return tuple(solids)


def _wedges(
    exponent: float, inner: tuple[float, float], outer: tuple[float, float], sheet: float, drawn_in: float
) -> list[Mesh]:
    """One ring of sheet between two outlines, given by half width and height of the underside [m]."""
    layers = [(inner[0], inner[1]), (outer[0], outer[1]), (inner[0], inner[1] + sheet)]
    layers += [(outer[0], outer[1] + 0.5 * sheet), (outer[0] - drawn_in, outer[1] + sheet)]
    rings = [np.column_stack([_outline(r, exponent), np.full(SEGMENTS, z)]) for r, z in layers]
    following = [np.roll(ring, -1, axis=0) for ring in rings]
    return [hull(np.array([r[k] for r in (*rings, *following)])) for k in range(SEGMENTS)]


def _outline(half: float, exponent: float) -> Array:
    """Corners ``(SEGMENTS, 2)`` [m] of a superellipse of half width ``half``, turned so that flats face x and y."""
    angle = 2.0 * np.pi * (np.arange(SEGMENTS) + 0.5) / SEGMENTS
    way = np.column_stack([np.cos(angle), np.sin(angle)])
    return np.asarray(half * way / np.linalg.norm(way, ord=exponent, axis=1)[:, None])
