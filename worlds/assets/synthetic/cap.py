"""Which caps can be generated? Baseball caps, bucket hats, beanies and flat caps, worn side up on z = 0.

A hat is a stiff open shell here: cloth that keeps its shape, as a crown with lining and a brim with its board do.
The brim of a baseball or flat cap points to +x.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from worlds.assets.asset import Asset
from worlds.assets.build import Design, Link, realise
from worlds.assets.solids import Mesh, hull
from worlds.assets.synthetic.outline import Ring, barrel
from worlds.assets.synthetic.series import Series, mixed, pastel
from worlds.assets.synthetic.slab import density, shell, wall

SERIES = Series("Cap", count=56, seed=20_260_202)
"""As many as in the paper's table; the seed starts every instance's own generator."""

KINDS = ("baseball", "bucket", "beanie", "flat")

LENGTHS = {"baseball": (0.215, 0.240), "bucket": (0.195, 0.235), "beanie": (0.170, 0.195), "flat": (0.200, 0.235)}
"""Whole length with the brim [m]; children's sizes: a head of 500 mm around is 170 mm long, a peak 45 to 70 mm."""

MASS = {"baseball": (0.055, 0.090), "bucket": (0.060, 0.100), "beanie": (0.050, 0.090), "flat": (0.060, 0.110)}
"""[kg]; catalogue caps weigh 50 to 110 g."""

CLOTH = (0.0028, 0.0040)
"""Thickness of the wall [m]; two layers of cotton twill with a lining 2 to 4 mm, knitted wool more."""

LIFT = 0.0012
"""How far the rim stays above the table on which brim or cuff lie [m]."""

SWEEP = 1.05
"""Half angle of a peak seen from above [rad]."""


def make(instance: str) -> Asset:
    """The cap called ``instance``; ``UnknownName`` when there is none."""
    index = SERIES.index(instance)
    rng = SERIES.rng(index)
    kind = KINDS[mixed(index, len(KINDS))]
    length = rng.uniform(*LENGTHS[kind])
    body = {"baseball": _baseball, "bucket": _bucket, "beanie": _beanie, "flat": _flat}[kind](rng, length)
    return realise(
        Design(
            source="synthetic",
            category=SERIES.category,
            instance=instance,
            topology=kind,
            split=SERIES.split(index),
            links=(Link("body", body, density(body, rng.uniform(*MASS[kind])), pastel(rng, dark=rng.random() < 0.5)),),
            joints=(),
            part=None,
            long_axis=np.array([1.0, 0.0, 0.0]),
        )
    )


def _baseball(rng: np.random.Generator, length: float) -> tuple[Mesh, ...]:
    peak = rng.uniform(0.050, 0.062)
    radius, height = 0.5 * (length - peak), rng.uniform(0.085, 0.105)
    depth, cloth = rng.uniform(0.84, 0.92), rng.uniform(*CLOTH)
    crown = _dome(radius, depth, height, cloth, bulge=rng.uniform(2.0, 2.6))
    knob = barrel(Ring(height - 0.001, 0.007, 0.007), Ring(height + 0.004, 0.004, 0.004))
    return (*crown, *_peak(radius, depth, peak, cloth, arch=rng.uniform(0.004, 0.014)), knob)


def _flat(rng: np.random.Generator, length: float) -> tuple[Mesh, ...]:
    peak = rng.uniform(0.028, 0.040)
    radius, height = 0.5 * (length - peak), rng.uniform(0.055, 0.075)
    depth, cloth = rng.uniform(0.84, 0.95), rng.uniform(*CLOTH)
    crown = _dome(radius, depth, height, cloth, bulge=rng.uniform(3.0, 4.5))
    return (*crown, *_peak(radius, depth, peak, cloth, arch=rng.uniform(0.002, 0.006)))


def _beanie(rng: np.random.Generator, length: float) -> tuple[Mesh, ...]:
    """A tall dome with a turned-up cuff and, on some, a bobble."""
    radius, height = 0.5 * length, rng.uniform(0.095, 0.125)
    depth, cloth = rng.uniform(0.82, 0.92), rng.uniform(*CLOTH)
    fold, cuff = rng.uniform(0.003, 0.005), rng.uniform(0.025, 0.040)
    inner = radius - fold
    hem = shell((_level(radius, inner - cloth, 0.0, depth), _level(radius, inner - cloth, cuff, depth)))
    crown = _dome(inner, depth, height, cloth, bulge=rng.uniform(1.8, 2.3), low=cuff)
    if rng.random() < 0.5:
        return (*hem, *crown)
    ball = rng.uniform(0.012, 0.020)
    rings = [(-0.8, 0.6), (-0.3, 0.95), (0.3, 0.95), (0.8, 0.6)]
    bobble = barrel(*(Ring(height + (0.7 + z) * ball, r * ball, r * ball) for z, r in rings))
    return (*hem, *crown, bobble)


def _bucket(rng: np.random.Generator, length: float) -> tuple[Mesh, ...]:
    """A truncated cone under a flat top, with a brim all round that slopes down."""
    brim, height, cloth = rng.uniform(0.026, 0.036), rng.uniform(0.075, 0.095), rng.uniform(*CLOTH)
    drop, depth = rng.uniform(0.018, 0.032), rng.uniform(0.86, 0.96)
    edge = 0.5 * length
    head = edge - brim
    top = head * rng.uniform(0.80, 0.90)
    lower = _level(edge, edge - 0.004, 0.0, depth)
    waist = (Ring(drop, head, depth * head), Ring(drop - cloth, head - cloth, depth * head - cloth))
    skirt = shell((lower, waist))
    crown = shell((_level(head, head - cloth, drop, depth), _level(top, top - cloth, height, depth)))
    lid = barrel(Ring(height - cloth, 0.99 * top, 0.99 * depth * top), Ring(height, top - 0.002, depth * top - 0.002))
    return (*skirt, *crown, lid)


def _level(outer: float, inner: float, z: float, depth: float) -> tuple[Ring, Ring]:
    return Ring(z, outer, depth * outer), Ring(z, inner, depth * outer - (outer - inner))


def _dome(
    radius: float, depth: float, height: float, cloth: float, *, bulge: float, low: float = LIFT
) -> tuple[Mesh, ...]:
    """An open dome of sectors and the round piece of cloth at its top."""
    rise = np.array([0.0, 0.40, 0.74, 0.94])
    share = (1.0 - rise**bulge) ** (1.0 / 2.0)
    profile = np.column_stack([share * radius, low + rise * (height - low)])
    levels = wall(profile, cloth, depth)
    last = levels[-1][0]
    rings = ((last.z - cloth, 1.0), (last.z, 1.0), (height, 0.55))
    return (*shell(levels), barrel(*(Ring(z, share * last.x, share * last.y) for z, share in rings)))


def _peak(radius: float, depth: float, reach: float, thick: float, *, arch: float) -> tuple[Mesh, ...]:
    """A peak in strips side by side: highest in the middle, ``arch`` above its corners, which lie on the table."""
    angles = np.linspace(-SWEEP, SWEEP, 7)
    inner = [_on_peak(radius - thick, depth, 0.0, angle, arch) for angle in angles]
    outer = [_on_peak(radius, depth, reach, angle, arch) for angle in angles]
    up = np.array([0.0, 0.0, thick])
    return tuple(
        hull(np.array([p + s * up for p in (*a, *b) for s in (0.0, 1.0)]))
        for a, b in pairwise(zip(inner, outer, strict=True))
    )


def _on_peak(radius: float, depth: float, reach: float, angle: float, arch: float) -> np.ndarray:
    """A point of the peak's underside, ``reach`` out from the crown in its middle and little at its corners."""
    out = reach * np.cos(0.5 * np.pi * angle / SWEEP) ** 0.6 if abs(angle) < SWEEP else 0.0
    z = arch * (1.0 - (angle / SWEEP) ** 2)
    return np.array([radius * np.cos(angle) + out, depth * radius * np.sin(angle), z])
