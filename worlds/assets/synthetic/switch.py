"""Which wall switches can be generated? Plates with a rocker, a toggle lever or two rockers, on a shallow or deep box.

The plate faces up; the box that would be in the wall is below it, on z = 0. x runs along the plate's longer side.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from robots.spatial import Array
from worlds.assets.asset import Asset, JointPhysics
from worlds.assets.build import Design, Joint, Link, realise
from worlds.assets.solids import Mesh, box, hull, moved
from worlds.assets.synthetic.outline import cylinder
from worlds.assets.synthetic.series import Series, pastel
from worlds.assets.synthetic.slab import GAP, density, slab

SERIES = Series("Switch", count=70, seed=20_260_208)
"""As many as in the paper's table; the seed starts every instance's own generator."""

SIZES = {
    "rocker": ((0.080, 0.120), (0.070, 0.086)),
    "toggle": ((0.080, 0.120), (0.070, 0.086)),
    "double": ((0.086, 0.150), (0.078, 0.090)),
}
"""Longer and shorter side of the plate [m]; European and Chinese plates are 80 to 86 mm square, American ones 114 to
124 by 70 to 79, two gangs 115 to 151 long."""

BOXES = {"none": (0.0, 0.0), "shallow": (0.008, 0.014), "deep": (0.022, 0.032)}
"""Depth of the mechanism behind the plate [m]; slim modules 8 to 15 mm, ordinary ones 20 to 35."""

BACK, FRAME = (0.0025, 0.0040), (0.0040, 0.0065)
"""Thickness of the plate under a rocker and of the frame around it [m]; faceplates are 7 to 11 mm thick at the edge."""

MASS = (0.050, 0.140)
"""Without the moving parts [kg]; catalogue switches weigh 60 to 180 g with their mechanism."""

PART_DENSITY = 1100.0
"""Polycarbonate or ABS [kg/m^3]."""

PRESS_FORCE = (3.0, 6.0)
"""Force at the end of a rocker or lever [N]; light switches are thrown with 2 to 8 N."""

TILT, THROW = (0.09, 0.14), (0.5, 0.8)
"""Turn of a rocker, and of a toggle lever, from one side to the other [rad]."""

ROCKER = 0.006
"""Thickness of a rocker [m]."""


def make(instance: str) -> Asset:
    """The switch called ``instance``; ``UnknownName`` when there is none."""
    index = SERIES.index(instance)
    rng = SERIES.rng(index)
    kind = list(SIZES)[index % len(SIZES)]
    x, y = (0.5 * rng.uniform(*limits) for limits in SIZES[kind])
    back = rng.uniform(*BOXES[str(rng.choice(list(BOXES)))])
    floor = back + rng.uniform(*BACK)
    heights = (back, floor, floor + rng.uniform(*FRAME))
    fixed, parts = (_toggle if kind == "toggle" else _rockers)(rng, kind, x, y, heights)
    behind = (slab((1.3 * x, 1.3 * y, back), (0.0, 0.0, 0.5 * back), 0.004),) if back else ()
    plate = (*fixed, *behind)
    return realise(
        Design(
            source="synthetic",
            category=SERIES.category,
            instance=instance,
            topology=kind,
            split=SERIES.split(index),
            links=(
                Link("body", plate, density(plate, rng.uniform(*MASS)), pastel(rng)),
                *(Link(joint.child, (solid,), PART_DENSITY, pastel(rng)) for solid, joint in parts),
            ),
            joints=tuple(joint for _, joint in parts),
            part=None,
            long_axis=np.array([1.0, 0.0, 0.0]),
        )
    )


def _rockers(
    rng: np.random.Generator, kind: str, x: float, y: float, heights: tuple[float, float, float]
) -> tuple[tuple[Mesh, ...], list[tuple[Mesh, Joint]]]:
    """The plate with its frame, and one rocker along x or two along y beside each other, each with its joint."""
    low, floor, top = heights
    margin, tilt = rng.uniform(0.009, 0.013), rng.uniform(*TILT)
    if kind == "double":
        middle = rng.uniform(0.006, 0.010)
        half = (0.5 * (x - margin) - 0.25 * middle, y - margin)
        centres = [-(half[0] + 0.5 * middle), half[0] + 0.5 * middle]
    else:
        half, centres = (x - margin, min(y - margin, rng.uniform(0.017, 0.030))), [0.0]
    across = kind == "double"
    lever = half[1] if across else half[0]
    friction = rng.uniform(*PRESS_FORCE) * 0.9 * lever
    parts = []
    for number, centre in enumerate(centres):
        solid, height = _rocker((half[0] - GAP - 0.0005, half[1] - GAP - 0.0005), tilt, across=across)
        start = tilt if rng.random() < 0.5 else 0.0
        at = np.array([centre, 0.0, floor + height])
        parts.append((solid, _joint(number, at, tilt, across=across, physics=JointPhysics(start, friction))))
    plate = box((2.0 * x, 2.0 * y, floor - low), (0.0, 0.0, 0.5 * (low + floor)))
    return (plate, *_frame(x, y, half, centres, floor, top)), parts


def _rocker(half: tuple[float, float], tilt: float, *, across: bool) -> tuple[Mesh, float]:
    """A rocker turned to one side about its own middle, and how far above the plate that middle must be [m]."""
    solid = box((2.0 * half[0], 2.0 * half[1], ROCKER), (0.0, 0.0, 0.0))
    c, s = np.cos(0.5 * tilt), np.sin(0.5 * tilt)
    turn = np.array([[1, 0, 0], [0, c, s], [0, -s, c]] if across else [[c, 0, -s], [0, 1, 0], [s, 0, c]])
    turned = Mesh(solid.vertices @ turn.T, solid.faces)
    return turned, GAP - float(turned.vertices[:, 2].min())


def _frame(
    x: float, y: float, half: tuple[float, float], centres: list[float], low: float, high: float
) -> tuple[Mesh, ...]:
    """The bars around openings of half widths ``half`` at ``centres`` along x."""
    z, deep = 0.5 * (low + high), high - low
    ends = [-x, *(centre + s * half[0] for centre in centres for s in (-1.0, 1.0)), x]
    sides = [box((2.0 * x, y - half[1], deep), (0.0, s * 0.5 * (y + half[1]), z)) for s in (-1.0, 1.0)]
    posts = [box((b - a, 2.0 * half[1], deep), (0.5 * (a + b), 0.0, z)) for a, b in list(pairwise(ends))[::2]]
    return (*sides, *posts)


def _toggle(
    rng: np.random.Generator, kind: str, x: float, y: float, heights: tuple[float, float, float]
) -> tuple[tuple[Mesh, ...], list[tuple[Mesh, Joint]]]:
    """A bevelled plate with two screws, and the lever that stands on it."""
    low, _, top = heights
    throw, length, wide = rng.uniform(*THROW), rng.uniform(0.013, 0.018), rng.uniform(0.0040, 0.0055)
    cover = slab((2.0 * x, 2.0 * y, top - low), (0.0, 0.0, 0.5 * (top + low)), 0.005, 0.0015)
    screws = tuple(moved(cylinder(top, top + 0.0008, 0.003), np.array([s * 0.6 * x, 0.0, 0.0])) for s in (-1.0, 1.0))
    tip = [(length * np.sin(a), length * np.cos(a)) for a in (-0.5 * throw - 0.14, -0.5 * throw + 0.14)]
    side = [(-0.003, 0.0), (0.003, 0.0), *tip]
    lever = hull(np.array([(p, s * wide, q) for s in (-1.0, 1.0) for p, q in side]))
    joint = _joint(
        0,
        np.array([0.0, 0.0, top + GAP + 0.003 * np.sin(throw)]),
        throw,
        across=False,
        physics=JointPhysics(throw if rng.random() < 0.5 else 0.0, rng.uniform(*PRESS_FORCE) * length),
    )
    return (cover, *screws), [(lever, joint)]


def _joint(number: int, at: Array, travel: float, *, across: bool, physics: JointPhysics) -> Joint:
    """The joint of one part that turns from one side to the other; its frame is turned with the first side."""
    axis = np.array([1.0, 0.0, 0.0]) if across else np.array([0.0, 1.0, 0.0])
    return Joint(
        name=f"part_{number}_joint",
        type="revolute",
        parent="body",
        child=f"part_{number}",
        origin=at,
        axis=axis,
        lower=0.0,
        upper=travel,
        physics=physics,
    )
