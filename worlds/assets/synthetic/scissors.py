"""Which scissors can be generated? Office, kitchen and embroidery ones: two crossed halves that turn about a pivot.

They lie flat, blades to +x, the pivot at the origin. The halves lie one above the other at the pivot; their loops are
beside each other and as thick as both. A joint position of zero is shut.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from robots.spatial import Array
from worlds.assets.asset import Asset, JointPhysics
from worlds.assets.build import Design, Joint, Link, realise
from worlds.assets.solids import Mesh, hull
from worlds.assets.synthetic.outline import ROUND, cylinder
from worlds.assets.synthetic.series import Series, pastel
from worlds.assets.synthetic.slab import GAP, density, plan

SERIES = Series("Scissors", count=47, seed=20_260_207)
"""As many as in the paper's table; the seed starts every instance's own generator."""

LENGTHS = {"office": (0.140, 0.210), "kitchen": (0.195, 0.235), "embroidery": (0.090, 0.125)}
"""Whole length [m]; catalogues: office 130 to 210 mm, kitchen 200 to 230, embroidery 90 to 125."""

MASS = {"office": (0.035, 0.090), "kitchen": (0.085, 0.150), "embroidery": (0.018, 0.035)}
"""[kg], from the same catalogues."""

BLADE_SHARE = {"office": (0.46, 0.56), "kitchen": (0.42, 0.50), "embroidery": (0.36, 0.46)}
"""Pivot to tip, in whole lengths."""

PIVOT_TORQUE = {"office": (0.08, 0.14), "kitchen": (0.12, 0.20), "embroidery": (0.05, 0.08)}
"""Resistance of the pivot [N m]: a well set pair stays open at any angle - half of a kitchen pair weighs 70 g at 70 mm,
0.05 N m - and shuts with 1 to 3 N at a loop."""

AJAR = 0.22
"""Largest opening at the start [rad]; every third pair is shut."""

OPENS = 1.1
"""How far the halves open [rad]."""

STEEL = (0.0014, 0.0022)
"""Thickness of a blade [m]; 1.5 to 2.5 mm of steel."""

RIDGE = 0.0010
"""How far loops stand off the blades in their middle [m], a half more behind and nothing in front."""

SECTORS = 10
"""Convex pieces of a loop."""


@dataclass(frozen=True, slots=True)
class _Loop:
    """A finger ring.

    Attributes:
        x: Outer half length along its shank [m].
        y: Outer half width [m].
        band: How wide the ring itself is [m].
        exponent: Superellipse exponent of its outline.
    """

    x: float
    y: float
    band: float
    exponent: float


def make(instance: str) -> Asset:
    """The pair called ``instance``; ``UnknownName`` when there is none."""
    index = SERIES.index(instance)
    rng = SERIES.rng(index)
    kind = list(LENGTHS)[index % len(LENGTHS)]
    length, mass = rng.uniform(*LENGTHS[kind]), rng.uniform(*MASS[kind])
    reach = rng.uniform(*BLADE_SHARE[kind]) * length
    blade, steel = reach * rng.uniform(0.085, 0.125), rng.uniform(*STEEL)
    loops = _loops(kind, rng, length - reach)
    halves = [_half(side, loop, reach, length - reach, blade, steel) for side, loop in zip((-1, 1), loops, strict=True)]
    screw = cylinder(0.5 * GAP + steel - 0.0005, 0.5 * GAP + steel + 0.0012, min(0.004, 0.6 * blade))
    joint = Joint(
        name="pivot_joint",
        type="revolute",
        parent="body",
        child="half",
        origin=np.zeros(3),
        axis=np.array([0.0, 0.0, -1.0]),
        lower=0.0,
        upper=OPENS,
        physics=JointPhysics(
            start=0.0 if rng.random() < 0.33 else rng.uniform(0.04, AJAR), friction=rng.uniform(*PIVOT_TORQUE[kind])
        ),
    )
    body, half, colour = (*halves[0], screw), halves[1], pastel(rng, dark=True)
    return realise(
        Design(
            source="synthetic",
            category=SERIES.category,
            instance=instance,
            topology=kind,
            split=SERIES.split(index),
            links=(
                Link("body", body, density(body, 0.5 * mass), colour),
                Link("half", half, density(half, 0.5 * mass), colour),
            ),
            joints=(joint,),
            part=None,
            long_axis=np.array([1.0, 0.0, 0.0]),
        )
    )


def _loops(kind: str, rng: np.random.Generator, tail: float) -> tuple[_Loop, _Loop]:
    """The loop of the thumb and that of the fingers, for a handle ``tail`` long behind the pivot [m]."""
    if kind == "embroidery":
        x = tail * rng.uniform(0.22, 0.30)
        ring = _Loop(x, x * rng.uniform(0.72, 0.95), rng.uniform(0.0028, 0.0038), ROUND)
        return ring, ring
    band = rng.uniform(0.0065, 0.0095)
    x = tail * rng.uniform(0.30, 0.36)
    thumb = _Loop(x, min(x, 0.020) * rng.uniform(0.80, 0.95), band, rng.uniform(2.0, 2.6))
    grown = rng.uniform(1.15, 1.32) if kind == "kitchen" else rng.uniform(1.0, 1.12)
    return thumb, _Loop(grown * x, grown * thumb.y, band, thumb.exponent)


def _half(side: float, loop: _Loop, reach: float, tail: float, blade: float, steel: float) -> tuple[Mesh, ...]:
    """A blade, the shank behind it and its loop on the ``side`` (-1 or 1) along y; the half at -1 is the upper one."""
    low = 0.5 * GAP if side < 0.0 else -0.5 * GAP - steel
    edge = 0.30 * blade
    shape = [(-blade, 0.0), (0.0, -blade), (0.5 * reach, -0.75 * blade), (reach, -0.2 * edge), (reach, edge)]
    shape = [(x, side * y) for x, y in (*shape, (0.35 * reach, edge), (-0.3 * blade, blade))]
    centre = (loop.x - tail, side * (loop.y + 0.5 * GAP))
    away = np.arctan2(-centre[1], -centre[0])
    joint = (centre[0] + 0.88 * loop.x * np.cos(away), centre[1] + 0.88 * loop.y * np.sin(away))
    across = 0.5 * max(loop.band, 0.9 * blade) * np.array([-np.sin(away), np.cos(away)])
    shank = [(joint[0] + s * across[0], joint[1] + s * across[1]) for s in (-1.0, 1.0)]
    root = [(s * across[0], s * across[1]) for s in (1.0, -1.0)]
    return plan(shape, low, low + steel), plan([*shank, *root], low, low + steel), *_ring(loop, centre, steel)


def _ring(loop: _Loop, centre: tuple[float, float], steel: float) -> tuple[Mesh, ...]:
    """The sectors of a loop around ``centre``: a ridge above and below, which is highest behind, where it lies."""
    ridge = replace(loop, x=loop.x - 0.5 * loop.band, y=loop.y - 0.5 * loop.band)
    inner = replace(loop, x=loop.x - loop.band, y=loop.y - loop.band)
    angles = np.linspace(0.0, 2.0 * np.pi, SECTORS + 1)
    high = 0.5 * GAP + steel + RIDGE * (0.5 - np.cos(angles))
    layers = [(outline, s * share) for outline, share in ((loop, 0.3), (ridge, 1.0), (inner, 0.3)) for s in (-1.0, 1.0)]
    rims = [np.column_stack([_outline(outline, angles) + centre, share * high]) for outline, share in layers]
    return tuple(hull(np.concatenate([rim[k : k + 2] for rim in rims])) for k in range(SECTORS))


def _outline(loop: _Loop, angles: Array) -> Array:
    """Points ``(n, 2)`` of the outer outline of ``loop`` around its middle [m]."""
    x, y = np.cos(angles), np.sin(angles)
    reach = (np.abs(x) ** loop.exponent + np.abs(y) ** loop.exponent) ** (-1.0 / loop.exponent)
    return np.column_stack([reach * loop.x * x, reach * loop.y * y])
