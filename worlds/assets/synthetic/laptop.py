"""Which laptops can be generated? Small ones, shut: clamshells, wedges, and tablets on a keyboard.

x runs along the hinge, which is at the rear, +y; the lid lies on the base and opens about the hinge.
"""

from __future__ import annotations

import numpy as np

from robots.spatial import Array
from worlds.assets.asset import Asset, JointPhysics
from worlds.assets.build import Design, Joint, Link, realise
from worlds.assets.solids import Mesh, box, hull, moved
from worlds.assets.synthetic.series import Series, pastel
from worlds.assets.synthetic.slab import BEHIND, GAP, density, rounded, slab

SERIES = Series("Laptop", count=55, seed=20_260_204)
"""As many as in the paper's table; the seed starts every instance's own generator."""

KINDS = ("clamshell", "two-in-one", "wedge")

WIDTH, ASPECT = (0.190, 0.280), (0.62, 0.72)
"""Width [m] and depth over width; the 7 to 11 inch class: GPD Pocket 197 by 129, Surface Go 245 by 175, an 11.6 inch
Air 300 by 192 mm."""

MASS = (0.45, 0.90)
"""Least and most mass [kg] over the widths; GPD Pocket 0.48 to 0.75, Surface Go with cover 0.79, MacBook 12 0.92."""

LID_SHARE = {"clamshell": (0.28, 0.36), "two-in-one": (0.58, 0.66), "wedge": (0.26, 0.34)}
"""The lid's share of the mass; a tablet holds board and battery, a lid only the screen."""

LID = {"clamshell": (0.005, 0.007), "two-in-one": (0.0075, 0.0095), "wedge": (0.004, 0.0055)}
"""Thickness of the lid [m]; screens 4 to 7 mm, tablets 7 to 10."""

BASE = {"clamshell": (0.009, 0.014), "two-in-one": (0.005, 0.0065), "wedge": (0.010, 0.014)}
"""Thickness of the base, at the rear of a wedge [m]; a wedge narrows to ``TIP`` at its front."""

TIP = (0.0035, 0.0050)

HINGE_TORQUE = (0.5, 1.2)
"""Resistance of the hinge [N m]; friction hinges of small notebooks hold 0.3 to 0.8 N m each, and there are two."""

OPENS = 2.2
"""How far the lid opens [rad]; most stop at 125 to 140 degrees."""

CORNER = (0.006, 0.014)
"""Radius of the corners in plan [m]."""


def make(instance: str) -> Asset:
    """The laptop called ``instance``; ``UnknownName`` when there is none."""
    index = SERIES.index(instance)
    rng = SERIES.rng(index)
    kind = KINDS[index % len(KINDS)]
    width = rng.uniform(*WIDTH)
    x, y, corner = 0.5 * width, 0.5 * width * rng.uniform(*ASPECT), rng.uniform(*CORNER)
    rear, thick = rng.uniform(*BASE[kind]), rng.uniform(*LID[kind])
    front = rng.uniform(*TIP) if kind == "wedge" else rear
    hinge = np.array([0.0, y + BEHIND, rear + 0.5 * GAP])
    base = (_plate(x, y, corner, (0.0, 0.0), (front, rear)), *(_feet(x, y) if kind == "clamshell" else ()))
    low, high = (front + GAP, rear + GAP), (front + GAP + thick, rear + GAP + thick)
    bump = _camera(x, y, high[1]) if kind == "two-in-one" else ()
    lid = tuple(moved(solid, -hinge) for solid in (_plate(x, y, corner, low, high), *bump))
    share = (width - WIDTH[0]) / (WIDTH[1] - WIDTH[0])
    mass = MASS[0] + (MASS[1] - MASS[0]) * np.clip(share + rng.uniform(-0.15, 0.15), 0.0, 1.0)
    top = rng.uniform(*LID_SHARE[kind]) * mass
    return realise(
        Design(
            source="synthetic",
            category=SERIES.category,
            instance=instance,
            topology=kind,
            split=SERIES.split(index),
            links=(
                Link("body", base, density(base, mass - top), pastel(rng, dark=True)),
                Link("lid", lid, density(lid, top), pastel(rng)),
            ),
            joints=(_hinge(hinge, rng.uniform(*HINGE_TORQUE)),),
            part=None,
            long_axis=np.array([1.0, 0.0, 0.0]),
        )
    )


def _hinge(origin: Array, torque: float) -> Joint:
    """The lid's joint: it opens as the front of the lid rises."""
    return Joint(
        name="lid_joint",
        type="revolute",
        parent="body",
        child="lid",
        origin=origin,
        axis=np.array([-1.0, 0.0, 0.0]),
        lower=0.0,
        upper=OPENS,
        physics=JointPhysics(start=0.0, friction=torque),
    )


def _plate(x: float, y: float, corner: float, low: tuple[float, float], high: tuple[float, float]) -> Mesh:
    """A plate with rounded corners; ``low`` and ``high`` are its heights at front and rear [m]."""
    outline = rounded(x, y, corner)
    share = 0.5 + 0.5 * outline[:, 1] / y
    heights = [front + share * (rear - front) for front, rear in (low, high)]
    return hull(np.concatenate([np.column_stack([outline, height]) for height in heights]))


def _feet(x: float, y: float) -> tuple[Mesh, ...]:
    """Two strips of rubber along front and rear."""
    return tuple(box((1.4 * x, 0.008, 0.003), (0.0, s * 0.8 * y, 0.0)) for s in (-1.0, 1.0))


def _camera(x: float, y: float, top: float) -> tuple[Mesh, ...]:
    """What stands off the back of a tablet."""
    return (slab((0.030, 0.012, 0.003), (0.7 * x, -0.8 * y, top), 0.005),)
