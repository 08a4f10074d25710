"""Which windows can be generated? Small framed ones for cabinets and models: sliding, casement, and fixed with a grid.

A window lies flat with its inside up; its frame is on z = 0, x runs along the longer side. Panes are solid.
"""

from __future__ import annotations

import numpy as np

from worlds.assets.asset import Asset, JointPhysics
from worlds.assets.build import Design, Joint, Link, realise
from worlds.assets.solids import Mesh, box, moved
from worlds.assets.synthetic.series import Series, pastel
from worlds.assets.synthetic.slab import GAP, bars, density

SERIES = Series("Window", count=58, seed=20_260_209)
"""As many as in the paper's table; the seed starts every instance's own generator."""

KINDS = ("sliding", "casement", "grid")

LONG, ASPECT = (0.200, 0.300), (0.62, 0.92)
"""Longer side [m] and shorter over longer; cabinet doors, hatches and model windows of 150 to 300 mm."""

BAR = (0.014, 0.022)
"""Width of the frame's bars [m]; slim wooden and aluminium profiles 12 to 25 mm."""

PANE = 0.003
"""Thickness of a pane [m]; 2 to 4 mm glass or acrylic."""

SASH = (0.0060, 0.0080)
"""Thickness of a sash [m]."""

MASS = (0.25, 0.75)
"""Least and most mass over the sizes [kg]: 300 by 250 mm of 3 mm glass weigh 0.56 kg, of acrylic 0.27, a pine frame of
18 by 20 mm 0.18."""

SLIDE_FORCE = (4.0, 9.0)
"""Force to slide a sash [N]: its own 1 to 2 N must not move it when the window stands; brush seals give 3 to 10 N."""

HINGE_TORQUE = (0.35, 0.70)
"""Resistance of a casement's hinges with its stay [N m]; its sash of up to 0.3 kg weighs 0.3 N m at 110 mm."""

SWINGS = 1.5
"""How far a casement opens [rad]."""


def make(instance: str) -> Asset:
    """The window called ``instance``; ``UnknownName`` when there is none."""
    index = SERIES.index(instance)
    rng = SERIES.rng(index)
    kind = KINDS[index % len(KINDS)]
    x = 0.5 * rng.uniform(*LONG)
    y = x * rng.uniform(*ASPECT)
    share = np.clip((4.0 * x * y - 0.025) / 0.055 + rng.uniform(-0.2, 0.2), 0.0, 1.0)
    mass = MASS[0] + (MASS[1] - MASS[0]) * float(share)
    build = {"sliding": _sliding, "casement": _casement, "grid": _grid}[kind]
    fixed, sash, joints = build(rng, x, y, rng.uniform(*BAR))
    rho = density((*fixed, *sash), mass)
    frame, second = pastel(rng), pastel(rng, dark=True)
    moving = (Link("sash", sash, rho, second),) if sash else ()
    return realise(
        Design(
            source="synthetic",
            category=SERIES.category,
            instance=instance,
            topology=kind,
            split=SERIES.split(index),
            links=(Link("body", fixed, rho, frame), *moving),
            joints=joints,
            part=None,
            long_axis=np.array([1.0, 0.0, 0.0]),
        )
    )


Parts = tuple[tuple[Mesh, ...], tuple[Mesh, ...], tuple[Joint, ...]]
"""Solids of the frame, solids of the sash in its own frame, joints."""


def _sliding(rng: np.random.Generator, x: float, y: float, bar: float) -> Parts:
    """A fixed pane behind one half of the opening, and a sash before the other half that slides over it along x."""
    sash = rng.uniform(*SASH)
    low = 0.002
    track = low + PANE + GAP
    high = track + sash + rng.uniform(0.002, 0.005)
    inside = (x - bar, y - bar)
    pane = box((inside[0], 2.0 * inside[1], PANE), (0.5 * inside[0], 0.0, low + 0.5 * PANE))
    rail = box((0.010, 2.0 * inside[1], PANE + 0.002), (0.005, 0.0, 0.5 * (PANE + 0.002)))
    reach, half = 0.5 * inside[0] + 0.004, inside[1] - GAP
    centre = np.array([GAP + reach - inside[0], 0.0, track])
    travel = 2.0 * (inside[0] - reach - GAP)
    joint = Joint(
        name="sash_joint",
        type="prismatic",
        parent="body",
        child="sash",
        origin=centre,
        axis=np.array([1.0, 0.0, 0.0]),
        lower=0.0,
        upper=travel,
        physics=JointPhysics(
            start=0.0 if rng.random() < 0.5 else rng.uniform(0.1, 0.6) * travel, friction=rng.uniform(*SLIDE_FORCE)
        ),
    )
    fixed = (*bars((x, y), bar, 0.0, high), pane, rail)
    return fixed, _glazed(reach, half, 0.008, sash), (joint,)


def _casement(rng: np.random.Generator, x: float, y: float, bar: float) -> Parts:
    """A sash in the frame, hinged along the side at -x, that opens upwards; a handle stands at its other side."""
    sash = rng.uniform(*SASH)
    low = rng.uniform(0.003, 0.008)
    hinge = np.array([GAP + bar - x, 0.0, low + sash])
    reach, half = x - bar - GAP, y - bar - GAP
    offset = -hinge + np.array([0.0, 0.0, low])
    handle = box((0.008, 0.030, 0.008), (reach - 0.007, 0.0, sash + 0.003))
    joint = Joint(
        name="sash_joint",
        type="revolute",
        parent="body",
        child="sash",
        origin=hinge,
        axis=np.array([0.0, -1.0, 0.0]),
        lower=0.0,
        upper=SWINGS,
        physics=JointPhysics(start=0.0, friction=rng.uniform(*HINGE_TORQUE)),
    )
    frame = bars((x, y), bar, 0.0, low + sash)
    moving = tuple(moved(solid, offset) for solid in (*_glazed(reach, half, 0.014, sash), handle))
    return frame, moving, (joint,)


def _grid(rng: np.random.Generator, x: float, y: float, bar: float) -> Parts:
    """One pane behind glazing bars."""
    deep = rng.uniform(0.010, 0.020)
    middle = rng.uniform(0.35, 0.65) * deep
    inside = (x - bar, y - bar)
    pane = box((2.0 * inside[0], 2.0 * inside[1], PANE), (0.0, 0.0, middle))
    wide = rng.uniform(0.006, 0.010)
    columns, rows = int(rng.integers(1, 4)), int(rng.integers(0, 3))
    at = [
        np.linspace(-1.0, 1.0, count + 2)[1:-1] * extent for count, extent in zip((columns, rows), inside, strict=True)
    ]
    size = 0.8 * deep
    uprights = [box((wide, 2.0 * inside[1], size), (float(place), 0.0, 0.5 * deep)) for place in at[0]]
    levels = [box((2.0 * inside[0], wide, 0.9 * size), (0.0, float(place), 0.5 * deep)) for place in at[1]]
    return (*bars((x, y), bar, 0.0, deep), pane, *uprights, *levels), (), ()


def _glazed(x: float, y: float, bar: float, deep: float) -> tuple[Mesh, ...]:
    """A framed pane around the origin, its underside at z = 0."""
    pane = box((2.0 * (x - bar), 2.0 * (y - bar), PANE), (0.0, 0.0, 0.5 * deep))
    return (*bars((x, y), bar, 0.0, deep), pane)
