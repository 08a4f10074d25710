"""Which phones can be generated? Slabs, flip phones that are shut, and tablets, screen up on z = 0; x is along them."""

from __future__ import annotations

import numpy as np

from worlds.assets.asset import Asset, JointPhysics
from worlds.assets.build import Design, Joint, Link, realise
from worlds.assets.solids import Mesh, moved
from worlds.assets.synthetic.series import Series, pastel
from worlds.assets.synthetic.slab import BEHIND, GAP, density, slab

SERIES = Series("Phone", count=18, seed=20_260_205)
"""As many as in the paper's table; the seed starts every instance's own generator."""

SIZES = {
    "slab": ((0.132, 0.165), (0.064, 0.078), (0.0072, 0.0095)),
    "flip": ((0.086, 0.104), (0.046, 0.072), (0.0165, 0.0200)),
    "tablet": ((0.198, 0.250), (0.125, 0.175), (0.0061, 0.0090)),
}
"""Length, width, thickness [m]. Catalogues: slabs 132 to 165 by 64 to 78 by 7 to 9.5 mm; flip phones shut 86 by 72 by
17 (folding screen) or 100 by 48 by 20 (keypad); tablets of 8 to 11 inch 195 to 250 by 125 to 178 by 6 to 9 mm."""

MASS = {"slab": (0.135, 0.240), "flip": (0.090, 0.190), "tablet": (0.290, 0.500)}
"""[kg], from the same catalogues."""

HINGE_TORQUE = (0.06, 0.15)
"""Resistance of a flip phone's hinge [N m]: it holds the 40 to 90 g half at 45 mm (0.02 to 0.04 N m) and is opened with
2 to 3 N at its edge."""

OPENS = 2.7
"""How far a flip phone opens [rad]; keypad phones stop at about 155 degrees."""


def make(instance: str) -> Asset:
    """The phone called ``instance``; ``UnknownName`` when there is none."""
    index = SERIES.index(instance)
    rng = SERIES.rng(index)
    kind = list(SIZES)[index % len(SIZES)]
    length, width, thick = (rng.uniform(*limits) for limits in SIZES[kind])
    mass = rng.uniform(*MASS[kind])
    radius = (0.06 if kind == "tablet" else 0.16) * width * rng.uniform(0.7, 1.3)
    if kind == "flip":
        links, joints = _flip(rng, (length, width, thick), radius, mass)
    else:
        body = _slab(rng, kind, (length, width, thick), radius)
        links, joints = (Link("body", body, density(body, mass), pastel(rng, dark=True)),), ()
    return realise(
        Design(
            source="synthetic",
            category=SERIES.category,
            instance=instance,
            topology=kind,
            split=SERIES.split(index),
            links=links,
            joints=joints,
            part=None,
            long_axis=np.array([1.0, 0.0, 0.0]),
        )
    )


def _slab(rng: np.random.Generator, kind: str, size: tuple[float, float, float], radius: float) -> tuple[Mesh, ...]:
    """A slab whose back carries the camera: a square, a strip across, or one lens; it lies on that."""
    length, width, thick = size
    out = rng.uniform(0.0012, 0.0022)
    side = {"square": (0.030, 0.030), "strip": (0.022, 0.86 * width), "lens": (0.014, 0.014)}
    camera = side[str(rng.choice(list(side)))] if kind == "slab" else side["lens"]
    reach = 0.5 * np.array([length - camera[0], width - camera[1]]) - 0.006
    place = (float(reach[0]), float(max(reach[1], 0.0)), 0.5 * (out + 0.002))
    back = slab((*camera, out + 0.002), place, 0.006)
    return slab(size, (0.0, 0.0, out + 0.5 * thick), radius, 0.0012), back


def _flip(
    rng: np.random.Generator, size: tuple[float, float, float], radius: float, mass: float
) -> tuple[tuple[Link, ...], tuple[Joint, ...]]:
    """Two halves on each other, hinged at their end at +x; the upper one opens."""
    length, width, thick = size
    half = 0.5 * (thick - GAP)
    lower = (slab((length, width, half), (0.0, 0.0, 0.5 * half), radius, 0.001),)
    hinge = np.array([0.5 * length + BEHIND, 0.0, half + 0.5 * GAP])
    cover = slab((length, width, half), (0.0, 0.0, 1.5 * half + GAP), radius, 0.001)
    window = slab((0.3 * length, 0.5 * width, 0.003), (0.22 * length, 0.0, thick - 0.0007), 0.004)
    upper = tuple(moved(solid, -hinge) for solid in (cover, window))
    joint = Joint(
        name="flip_joint",
        type="revolute",
        parent="body",
        child="cover",
        origin=hinge,
        axis=np.array([0.0, 1.0, 0.0]),
        lower=0.0,
        upper=OPENS,
        physics=JointPhysics(start=0.0, friction=rng.uniform(*HINGE_TORQUE)),
    )
    links = (
        Link("body", lower, density(lower, 0.55 * mass), pastel(rng, dark=True)),
        Link("cover", upper, density(upper, 0.45 * mass), pastel(rng)),
    )
    return links, (joint,)
