"""Which bottles can be generated? Six body profiles times four closures, every number drawn from the index.

The lid rides on its joint a hair (``GAP``) above the neck, since collision shapes are solid. A flip-top is hinged at
its back, on the -x side, and opens to the front.
"""

from __future__ import annotations

import numpy as np

from robots.spatial import Array
from worlds.assets.asset import Asset, FunctionalPart, JointPhysics, PartKind
from worlds.assets.build import Design, Joint, Link, realise
from worlds.assets.solids import BULLET_MARGIN, Mesh, box, merged, moved
from worlds.assets.synthetic.hinge import STANDOFF, flip_part, hinge
from worlds.assets.synthetic.outline import PROFILES, ROUND, SQUARE, Ring, barrel, container, cylinder, disc, stack
from worlds.assets.synthetic.series import Series, mixed, pastel

SERIES = Series("Bottle", count=57, seed=20_260_101)
"""57 bottles, as many as the paper's Bottle category; the seed starts every instance's own generator."""

CLOSURES = ("push-cap", "stopper", "screw-cap", "flip-top")

FILLED_DENSITY = (200.0, 300.0)
"""Mass over outer volume [kg/m^3]: a 30 g shell around half a litre with about a third of it full."""

LID_DENSITY = 500.0
"""A moulded cap is about half polypropylene (900 kg/m^3), half air."""

GAP = 2.0 * BULLET_MARGIN + 0.0005
"""Rim to lid [m]: the simulator's margins leave half a millimetre."""

PULL_FRICTION = (4.0, 10.0)
"""Force to slide a push-on lid [N]; child-safe and jar lids are stiffer."""

SCREW_FRICTION = (0.2, 0.4)
"""Torque to turn a hand-tight 28 mm closure [N m]; bottling guides ask for 0.3 to 0.9 on removal, fresh."""

SCREW_RANGE = np.pi
"""Turn until the joint stops [rad]; half of it, a quarter turn, counts as opened."""

FLIP_HEIGHT = (0.016, 0.022)
"""Height of a flip-top [m]: enough for finger pads, and laid back its rear edge stays above the shoulder."""


def make(instance: str) -> Asset:
    """The bottle called ``instance``; ``UnknownName`` when there is none."""
    index = SERIES.index(instance)
    rng = SERIES.rng(index)
    closure = CLOSURES[mixed(index, len(CLOSURES))]
    profile = PROFILES[index // len(CLOSURES) % len(PROFILES)]
    width = rng.uniform(0.045, 0.072)
    lid_radius = min(0.5 * rng.uniform(0.024, 0.050), 0.42 * width)
    lid_height = rng.uniform(*(FLIP_HEIGHT if closure == "flip-top" else (0.020, 0.035)))
    height = rng.uniform(0.120, 0.260) - lid_height
    rings = container(profile, rng, width, height, neck=lid_radius * rng.uniform(0.75, 0.95))
    seat = np.array([0.0, 0.0, 0.5 * height + GAP])
    flips = closure == "flip-top"
    back = seat - np.array([lid_radius + STANDOFF, 0.0, 0.0])
    joint = hinge(rng, back, 2.0 * lid_radius + STANDOFF) if flips else _joint(closure, rng, seat)
    density, colour = rng.uniform(*FILLED_DENSITY), pastel(rng)
    lid, shown = _flip_top(rng, lid_radius, lid_height) if flips else (_lid(closure, rng, lid_radius, lid_height), None)
    return realise(
        Design(
            source="synthetic",
            category=SERIES.category,
            instance=instance,
            topology=closure,
            split=SERIES.split(index),
            links=(
                Link("body", stack(rings), density, colour),
                Link("lid", lid, LID_DENSITY, pastel(rng, dark=True), shown),
            ),
            joints=(joint,),
            part=flip_part(joint) if flips else _part(joint, seat + np.array([0.0, 0.0, 0.5 * lid_height])),
            long_axis=np.array([0.0, 0.0, 1.0]),
        )
    )


def _lid(closure: str, rng: np.random.Generator, radius: float, height: float) -> tuple[Mesh, ...]:
    """The lid's solids with its underside at z = 0."""
    if closure == "stopper":
        radius = max(radius, 0.012)
        foot, brow = rng.uniform(0.6, 0.8) * radius, rng.uniform(0.7, 0.95) * radius
        return (barrel(disc(0.0, foot), disc(0.25 * height, radius), disc(0.8 * height, radius), disc(height, brow)),)
    if closure == "screw-cap" and rng.random() < 0.5:
        return (barrel(disc(0.0, radius), disc(height, rng.uniform(0.9, 0.97) * radius)),)
    return (cylinder(0.0, height, radius),)


def _flip_top(rng: np.random.Generator, radius: float, height: float) -> tuple[tuple[Mesh, ...], Mesh]:
    """A round or square lid in front of its hinge line with its underside at z = 0, and its look with the hinge."""
    exponent, crown = (SQUARE if rng.random() < 0.4 else ROUND), rng.uniform(0.9, 0.97)
    shares = ((0.0, 1.0), (0.8 * height, 1.0), (height, crown))
    lid = barrel(*(Ring(z, share * radius, share * radius, exponent) for z, share in shares))
    lid = moved(lid, np.array([radius + STANDOFF, 0.0, 0.0]))
    knuckle = box((0.004, 0.8 * radius, 0.005), (STANDOFF, 0.0, 0.001))
    return (lid,), merged((lid, knuckle))


def _joint(closure: str, rng: np.random.Generator, seat: Array) -> Joint:
    turns = closure == "screw-cap"
    reach = SCREW_RANGE if turns else rng.uniform(0.020, 0.040)
    friction = rng.uniform(*(SCREW_FRICTION if turns else PULL_FRICTION))
    return Joint(
        name="lid_joint",
        type="revolute" if turns else "prismatic",
        parent="body",
        child="lid",
        origin=seat,
        axis=np.array([0.0, 0.0, 1.0]),
        lower=0.0,
        upper=reach,
        physics=JointPhysics(start=0.0, friction=friction),
    )


def _part(joint: Joint, point: Array) -> FunctionalPart:
    kind: PartKind = "unscrew" if joint.type == "revolute" else "pull"
    return FunctionalPart(
        kind=kind,
        link=joint.child,
        joint=joint.name,
        axis=joint.axis,
        point=point,
        sense=1.0,
        start=0.0,
        travel=joint.upper,
        threshold=0.5 * joint.upper,
    )
