"""Which pens can be generated? Capped pens in four profiles and push-button pens in four, numbers drawn from the index.

The two families share no instance. A cap's collision shape begins where the barrel's ends, as a bottle's lid does.
"""

from __future__ import annotations

import numpy as np

from robots.spatial import Array
from worlds.assets.asset import Asset, FunctionalPart, JointPhysics
from worlds.assets.build import Design, Joint, Link, realise
from worlds.assets.solids import BULLET_MARGIN, Mesh, box, merged
from worlds.assets.synthetic.outline import ROUND, SQUARE, Ring, cylinder, stack
from worlds.assets.synthetic.series import Series, mixed, pastel

CAP = Series("Pen-Cap", count=24, seed=20_260_103)
"""Half of the paper's 48 pens; the seed starts every instance's own generator."""

BUTTON = Series("Pen-Button", count=24, seed=20_260_104)
"""The other half."""

CAPPED = ("marker", "felt-tip", "fountain", "highlighter")
CLICKED = ("ballpoint", "hexagonal", "multi-colour", "tapered")

LENGTH = (0.125, 0.150)
"""Whole length [m]; catalogue pens are 125 to 150 mm long."""

DENSITY = (800.0, 1100.0)
"""Mass over outer volume [kg/m^3]: polypropylene with ink and some air; an ordinary pen weighs 8 to 20 g."""

PART_DENSITY = 700.0
"""A cap or button is mostly wall."""

CAP_FRICTION = (3.0, 7.0)
"""Force to pull a cap off [N]; EN 71 and marker makers' data ask for less than 15."""

CLICK_FORCE = (2.0, 5.0)
"""Force at the button [N]; ball pen springs are 2 to 5 N at the end of the stroke."""

GAP = 2.0 * BULLET_MARGIN + 0.0005
"""Least distance between the parts [m]: the simulator's margins leave half a millimetre."""


def make_cap(instance: str) -> Asset:
    """The capped pen called ``instance``; ``UnknownName`` when there is none."""
    index = CAP.index(instance)
    rng = CAP.rng(index)
    profile = CAPPED[mixed(index, len(CAPPED))]
    x, y, exponent = _section(profile, rng)
    length, height = rng.uniform(*LENGTH), rng.uniform(0.032, 0.045)
    rings = _barrel(profile, length - height, x, y, exponent)
    seat = np.array([0.0, 0.0, 0.5 * (length - height) + GAP])
    joint = _joint("cap", seat, np.array([0.0, 0.0, 1.0]), rng.uniform(0.025, 0.035), rng.uniform(*CAP_FRICTION))
    solids = _cap(profile, height, x + 0.0006, y + 0.0006, exponent)
    travel = joint.upper
    part = FunctionalPart(
        kind="pull",
        link="cap",
        joint=joint.name,
        axis=joint.axis,
        point=seat + np.array([0.0, 0.0, 0.5 * height]),
        sense=1.0,
        start=0.0,
        travel=travel,
        threshold=max(0.5 * travel, min(0.010, 0.8 * travel)),
    )
    return _realised(CAP, index, profile, rng, (stack(rings), solids, merged(solids)), joint, part)


def make_button(instance: str) -> Asset:
    """The push-button pen called ``instance``; ``UnknownName`` when there is none."""
    index = BUTTON.index(instance)
    rng = BUTTON.rng(index)
    profile = CLICKED[mixed(index, len(CLICKED))]
    x, y, exponent = _section(profile, rng)
    travel, thick = rng.uniform(0.003, 0.006), rng.uniform(0.006, 0.009)
    length = rng.uniform(*LENGTH) - travel - thick
    rings = _barrel(profile, length, x, y, exponent)
    origin = np.array([0.0, 0.0, 0.5 * length + travel + GAP])
    joint = _joint("button", origin, np.array([0.0, 0.0, -1.0]), travel, rng.uniform(*CLICK_FORCE))
    radius = min(rng.uniform(0.0028, 0.0045), 0.8 * x)
    knob = cylinder(0.0, thick, radius)
    stem = cylinder(-travel - GAP, 0.0, 0.7 * radius)
    part = FunctionalPart(
        kind="press",
        link="button",
        joint=joint.name,
        axis=joint.axis,
        point=origin + np.array([0.0, 0.0, thick]),
        sense=1.0,
        start=0.0,
        travel=travel,
        threshold=0.5 * travel,
    )
    return _realised(BUTTON, index, profile, rng, (stack(rings), (knob,), merged((knob, stem))), joint, part)


def _realised(
    series: Series,
    index: int,
    profile: str,
    rng: np.random.Generator,
    shapes: tuple[tuple[Mesh, ...], tuple[Mesh, ...], Mesh],
    joint: Joint,
    part: FunctionalPart,
) -> Asset:
    """The asset of a barrel, a part's solids and what is seen of the part."""
    barrel, solids, shown = shapes
    return realise(
        Design(
            source="synthetic",
            category=series.category,
            instance=series.names()[index],
            topology=profile,
            split=series.split(index),
            links=(
                Link("body", barrel, rng.uniform(*DENSITY), pastel(rng)),
                Link(part.link, solids, PART_DENSITY, pastel(rng, dark=True), shown),
            ),
            joints=(joint,),
            part=part,
            long_axis=np.array([0.0, 0.0, 1.0]),
        )
    )


def _section(profile: str, rng: np.random.Generator) -> tuple[float, float, float]:
    """Half widths along x and y [m] and the superellipse exponent of a barrel."""
    if profile == "highlighter":
        return rng.uniform(0.0085, 0.011), rng.uniform(0.005, 0.0065), SQUARE
    r = rng.uniform(0.006, 0.008) if profile in ("multi-colour", "marker") else rng.uniform(0.0048, 0.006)
    return r, r, 3.0 if profile in ("hexagonal", "felt-tip") else ROUND


def _barrel(profile: str, length: float, x: float, y: float, exponent: float) -> tuple[Ring, ...]:
    """The barrel's outline from its closed end at -length / 2 to its rim."""
    low, high = -0.5 * length, 0.5 * length
    if profile in ("fountain", "tapered"):
        shares = [(low, 0.55), (low + 0.25 * length, 0.9), (low + 0.55 * length, 1.0), (high, 0.9)]
    elif profile in CLICKED:
        shares = [(low, 0.25), (low + 0.020, 0.9), (low + 0.030, 1.0), (high, 1.0)]
    else:
        shares = [(low, 0.85), (low + 0.004, 1.0), (high, 1.0)]
    return tuple(Ring(z, share * x, share * y, exponent) for z, share in shares)


def _cap(profile: str, height: float, x: float, y: float, exponent: float) -> tuple[Mesh, ...]:
    """The cap's solids with its rim at z = 0; some have a clip."""
    crown = 0.8 if profile == "fountain" else 0.95
    rings = (
        Ring(0.0, x, y, exponent),
        Ring(0.9 * height, x, y, exponent),
        Ring(height, crown * x, crown * y, exponent),
    )
    if profile in ("marker", "fountain"):
        clip = box((0.0018, 0.004, 0.7 * height), (x + 0.0012, 0.0, 0.6 * height))
        return (*stack(rings), clip)
    return stack(rings)


def _joint(child: str, origin: Array, axis: Array, travel: float, friction: float) -> Joint:
    return Joint(
        name=f"{child}_joint",
        type="prismatic",
        parent="body",
        child=child,
        origin=origin,
        axis=axis,
        lower=0.0,
        upper=travel,
        physics=JointPhysics(start=0.0, friction=friction),
    )
