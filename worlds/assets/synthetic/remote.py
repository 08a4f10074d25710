"""Which remote controls can be generated? Slabs, bowed, waisted and slim ones, keys up on z = 0; x runs along them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from robots.spatial import Array
from worlds.assets.asset import Asset
from worlds.assets.build import Design, Link, realise
from worlds.assets.solids import Mesh, hull, merged, moved
from worlds.assets.synthetic.outline import barrel, disc
from worlds.assets.synthetic.series import Series, mixed, pastel
from worlds.assets.synthetic.slab import density, slab

SERIES = Series("Remote", count=49, seed=20_260_206)
"""As many as in the paper's table; the seed starts every instance's own generator."""

SIZES = {
    "slab": ((0.150, 0.220), (0.042, 0.054), (0.015, 0.022)),
    "bowed": ((0.160, 0.210), (0.040, 0.050), (0.014, 0.019)),
    "waisted": ((0.170, 0.225), (0.044, 0.056), (0.016, 0.024)),
    "wand": ((0.135, 0.165), (0.031, 0.040), (0.012, 0.017)),
}
"""Length, width, thickness [m]; catalogues: television 150 to 225 by 42 to 56 by 15 to 25, streaming sticks 136 to 150
by 32 to 38 by 9 to 17 mm."""

MASS = {"slab": (0.080, 0.150), "bowed": (0.070, 0.130), "waisted": (0.090, 0.170), "wand": (0.045, 0.090)}
"""With two batteries of 12 (AAA) or 23 g (AA) [kg]."""

STATIONS = np.linspace(-0.5, 0.5, 7)
"""Where the body's sections are, in lengths."""

SECTIONS = {
    "bevelled": ((0.72, 0.0), (1.0, 0.28), (1.0, 0.90), (0.95, 1.0)),
    "round": ((0.35, 0.0), (0.78, 0.14), (1.0, 0.45), (0.98, 0.70), (0.72, 1.0)),
}
"""Half of a cross-section from the bottom up: half width in half widths, height in thicknesses."""

KEY = 0.0016
"""How far keys stand off the face [m]; rubber keys 1 to 2 mm."""


def make(instance: str) -> Asset:
    """The remote control called ``instance``; ``UnknownName`` when there is none."""
    index = SERIES.index(instance)
    rng = SERIES.rng(index)
    kind = list(SIZES)[mixed(index, len(SIZES))]
    length, width, thick = (rng.uniform(*limits) for limits in SIZES[kind])
    x = length * STATIONS
    half = 0.5 * width * _widths(kind, rng)
    lift = _lifts(kind, rng, length)
    section = "round" if kind == "wand" else "bevelled"
    case = _case(x, half, lift, np.array(SECTIONS[section]) * (1.0, thick), whole=kind in ("slab", "wand"))
    blocks, keys = _keys(rng, x, SECTIONS[section][-1][0] * half, lift + thick)
    mass = rng.uniform(*MASS[kind])
    body = Link(
        "body", (*case, *blocks), density((*case, *blocks), mass), pastel(rng, dark=True), merged((*case, *keys))
    )
    return realise(
        Design(
            source="synthetic",
            category=SERIES.category,
            instance=instance,
            topology=kind,
            split=SERIES.split(index),
            links=(body,),
            joints=(),
            part=None,
            long_axis=np.array([1.0, 0.0, 0.0]),
        )
    )


def _widths(kind: str, rng: np.random.Generator) -> Array:
    """Width at each station, the widest being one."""
    if kind == "waisted":
        waist = rng.uniform(0.68, 0.80)
        return np.array([0.62, 0.96, 0.90, waist, 0.86, 1.0, 0.70])
    if kind == "wand":
        tail = rng.uniform(0.72, 0.95)
        return np.asarray(np.linspace(tail, 1.0, 7) * np.array([0.80, 1.0, 1.0, 1.0, 1.0, 1.0, 0.80]))
    ends = rng.uniform(0.84, 0.98)
    return np.array([ends, 1.0, 1.0, 1.0, 1.0, 1.0, ends])


def _lifts(kind: str, rng: np.random.Generator, length: float) -> Array:
    """Height of the underside at each station [m]: a bowed one stands on its ends, or rocks on its middle."""
    if kind == "waisted":
        return np.array([0.002, 0.0, 0.001, 0.002, 0.001, 0.0, 0.002])
    if kind != "bowed":
        return np.zeros(7)
    bow = rng.uniform(0.020, 0.045) * length * (1.0 if rng.random() < 0.7 else -1.0)
    heights: Array = bow * (1.0 - (2.0 * STATIONS) ** 2)
    return np.asarray(heights - heights.min())


def _case(x: Array, half: Array, lift: Array, outline: Array, *, whole: bool) -> tuple[Mesh, ...]:
    """The hull of the sections at ``x`` when ``whole``, else convex pieces between neighbours.

    Args:
        x: Where the sections are ``(n,)`` [m].
        half: Their half widths ``(n,)`` [m].
        lift: Heights of their undersides ``(n,)`` [m].
        outline: Half of a cross-section ``(k, 2)``: half width in half widths, height [m].
        whole: Whether the case is convex.
    """
    sections = [
        np.array([(a, s * share * h, low + rise) for s in (-1.0, 1.0) for share, rise in outline])
        for a, h, low in zip(x, half, lift, strict=True)
    ]
    if whole:
        return (hull(np.concatenate(sections)),)
    return tuple(hull(np.concatenate(pair)) for pair in pairwise(sections))


def _keys(rng: np.random.Generator, x: Array, half: Array, top: Array) -> tuple[tuple[Mesh, ...], tuple[Mesh, ...]]:
    """A round pad at the far end and rows of three keys behind it, on a face of half widths ``half``.

    Returns:
        One solid a row, and what is seen: every key.
    """
    ahead = float(rng.uniform(0.12, 0.22)) * (x[-1] - x[0])
    radius = 0.64 * float(np.interp(ahead, x, half))
    base = np.array([ahead, 0.0, float(np.interp(ahead, x, top)) - 0.003])
    pad = moved(barrel(disc(0.0, radius), disc(0.003 + KEY, 0.9 * radius)), base)
    blocks, keys = [pad], [pad]
    count = int(rng.integers(2, 6))
    for row, at in enumerate(np.linspace(ahead - radius - 0.012, x[0] + 0.022, count)):
        place, high = 0.55 * float(np.interp(at, x, half)), float(np.interp(at, x, top))
        rise = (0.5 + 0.5 * ((count - row) % 2)) * KEY
        middle = high + 0.5 * (rise - 0.003)
        blocks.append(slab((0.0075, 2.68 * place, rise + 0.003), (float(at), 0.0, middle), 0.002))
        keys += [slab((0.0075, 0.68 * place, rise + 0.003), (float(at), k * place, middle), 0.002) for k in (-1, 0, 1)]
    return tuple(blocks), tuple(keys)
