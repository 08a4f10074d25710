"""Which USB sticks can be generated? Four bodies with a cap over the plug, numbers drawn from the index."""

from __future__ import annotations

import numpy as np

from worlds.assets.asset import Asset, FunctionalPart, JointPhysics
from worlds.assets.build import Design, Joint, Link, realise
from worlds.assets.solids import BULLET_MARGIN, merged
from worlds.assets.synthetic.outline import ROUND, SQUARE, Ring, stack
from worlds.assets.synthetic.series import Series, mixed, pastel

SERIES = Series("USB", count=30, seed=20_260_105)
"""As many as in the paper's table; the seed starts every instance's own generator."""

BODIES = ("block", "rounded", "waisted", "rugged")

WIDTH, THICKNESS = (0.015, 0.022), (0.009, 0.013)
"""Body width and thickness [m]; the plug inside is 12 by 4.5 mm, catalogue sticks are 15 to 22 by 8 to 13 mm."""

DENSITY = (1300.0, 1800.0)
"""Plastic around a circuit board and a steel plug [kg/m^3]."""

CAP_DENSITY = 900.0

CAP_FRICTION = (3.0, 7.0)
"""Force to pull the cap off [N]; like marker caps."""

GAP = 2.0 * BULLET_MARGIN + 0.0005
"""Least distance between body and cap [m]: the simulator's margins leave half a millimetre."""


def make(instance: str) -> Asset:
    """The stick called ``instance``; ``UnknownName`` when there is none."""
    index = SERIES.index(instance)
    rng = SERIES.rng(index)
    body = BODIES[mixed(index, len(BODIES))]
    x, y = 0.5 * rng.uniform(*WIDTH), 0.5 * rng.uniform(*THICKNESS)
    length, height = rng.uniform(0.042, 0.060), rng.uniform(0.017, 0.024)
    exponent = ROUND if body == "rounded" else SQUARE
    seat = np.array([0.0, 0.0, 0.5 * length + GAP])
    travel = rng.uniform(0.014, min(0.022, height))
    cap = stack(
        (Ring(0.0, x, y, exponent), Ring(0.9 * height, x, y, exponent), Ring(height, 0.9 * x, 0.9 * y, exponent))
    )
    joint = Joint(
        name="cap_joint",
        type="prismatic",
        parent="body",
        child="cap",
        origin=seat,
        axis=np.array([0.0, 0.0, 1.0]),
        lower=0.0,
        upper=travel,
        physics=JointPhysics(start=0.0, friction=rng.uniform(*CAP_FRICTION)),
    )
    return realise(
        Design(
            source="synthetic",
            category=SERIES.category,
            instance=instance,
            topology=body,
            split=SERIES.split(index),
            links=(
                Link("body", stack(_outline(body, length, x, y, exponent)), rng.uniform(*DENSITY), pastel(rng)),
                Link("cap", cap, CAP_DENSITY, pastel(rng, dark=True), merged(cap)),
            ),
            joints=(joint,),
            part=FunctionalPart(
                kind="pull",
                link="cap",
                joint=joint.name,
                axis=joint.axis,
                point=seat + np.array([0.0, 0.0, 0.5 * height]),
                sense=1.0,
                start=0.0,
                travel=travel,
                threshold=max(0.5 * travel, min(0.010, 0.8 * travel)),
            ),
            long_axis=np.array([0.0, 0.0, 1.0]),
        )
    )


def _outline(body: str, length: float, x: float, y: float, exponent: float) -> tuple[Ring, ...]:
    """Rings from the closed end to the rim."""
    low, high = -0.5 * length, 0.5 * length
    sides = {
        "block": [(low, 1.0), (high, 1.0)],
        "rounded": [(low, 0.5), (low + 0.15 * length, 1.0), (high, 1.0)],
        "waisted": [(low, 0.95), (low + 0.4 * length, 0.8), (low + 0.6 * length, 0.8), (high, 1.0)],
        "rugged": [(low, 0.85), (low + 0.005, 1.0), (high - 0.006, 1.0), (high, 0.9)],
    }[body]
    return tuple(Ring(z, share * x, share * y, exponent) for z, share in sides)
