"""Which bowls can be generated? Deep, shallow, flared and square ones, with or without a foot.

A bowl stands upright on z = 0. Its wall is made of convex sectors, so that fingers and rims find the real hollow.
"""

from __future__ import annotations

import numpy as np

from robots.spatial import Array
from worlds.assets.asset import Asset
from worlds.assets.build import Design, Link, realise
from worlds.assets.solids import Mesh
from worlds.assets.synthetic.outline import ROUND, Ring, barrel
from worlds.assets.synthetic.series import Series, mixed, pastel
from worlds.assets.synthetic.slab import shell, wall

SERIES = Series("Bowl", count=186, seed=20_260_201)
"""As many as in the paper's table; the seed starts every instance's own generator."""

DIAMETERS, HEIGHTS = (0.100, 0.160), {"deep": (0.060, 0.080), "shallow": (0.040, 0.050), "flared": (0.048, 0.068)}
"""Rim and height [m]; catalogue rice, soup and cereal bowls are 100 to 160 mm wide and 40 to 80 mm high."""

KINDS = ("deep", "shallow", "flared", "square")

WALL = (0.003, 0.0045)
"""Thickness [m]; stoneware is 4 to 6 mm thick, porcelain 3 to 4, melamine 2.5 to 3."""

DENSITY = (1500.0, 2400.0)
"""From melamine (1500) to stoneware and porcelain (2300 to 2400) [kg/m^3]; such bowls weigh 100 to 450 g."""

SQUARISH = 4.5
"""Superellipse exponent of a square bowl: its corners are well rounded."""

BEVEL = 0.0012
"""How far the edge under the wall stays above the foot [m]."""


def make(instance: str) -> Asset:
    """The bowl called ``instance``; ``UnknownName`` when there is none."""
    index = SERIES.index(instance)
    rng = SERIES.rng(index)
    kind = KINDS[mixed(index, len(KINDS))]
    rim = 0.5 * rng.uniform(*DIAMETERS)
    height = min(rng.uniform(*HEIGHTS.get(kind, (0.045, 0.065))), 1.15 * rim)
    body = _body(kind, rng, rim, height)
    return realise(
        Design(
            source="synthetic",
            category=SERIES.category,
            instance=instance,
            topology=kind,
            split=SERIES.split(index),
            links=(Link("body", body, rng.uniform(*DENSITY), pastel(rng)),),
            joints=(),
            part=None,
            long_axis=np.array([1.0, 0.0, 0.0]),
        )
    )


def _body(kind: str, rng: np.random.Generator, rim: float, height: float) -> tuple[Mesh, ...]:
    """The wall's sectors, the floor, and the foot where there is one."""
    thickness, base = rng.uniform(*WALL), rim * rng.uniform(0.42, 0.55)
    exponent = SQUARISH if kind == "square" else ROUND
    foot = rng.uniform(0.003, 0.007) if rng.random() < 0.5 else 0.0
    levels = wall(_profile(kind, rng, rim, base, foot + BEVEL, height), thickness, exponent=exponent)
    reach = levels[0][1].x + 0.3 * thickness
    floor = barrel(Ring(foot, reach, reach, exponent), Ring(foot + thickness, reach, reach, exponent))
    if not foot:
        return (*shell(levels), floor)
    stand = 0.9 * base
    return (*shell(levels), floor, barrel(Ring(0.0, 0.94 * stand, 0.94 * stand), Ring(foot, stand, stand)))


def _profile(kind: str, rng: np.random.Generator, rim: float, base: float, low: float, height: float) -> Array:
    """Radius and height ``(4, 2)`` of the outer surface [m]."""
    rise = np.array([0.0, 0.22, 0.58, 1.0])
    if kind == "flared":
        share = np.array([0.0, 0.34, 0.55 + rng.uniform(0.0, 0.06), 1.0])
    elif kind == "shallow":
        share = rise ** rng.uniform(0.62, 0.8)
    else:
        share = np.sqrt(1.0 - (1.0 - rise) ** rng.uniform(2.0, 2.6))
    return np.column_stack([base + share * (rim - base), low + rise * (height - low)])
