"""Which staplers can be generated? Desk, mini and long-arm ones: a base, a hinge block, an arm pressed at its front.

The stapler lies along z with its front at +z; x points from the base to the arm, y across.
"""

from __future__ import annotations

import numpy as np

from worlds.assets.asset import Asset, FunctionalPart, JointPhysics
from worlds.assets.build import Design, Joint, Link, realise
from worlds.assets.solids import BULLET_MARGIN, Mesh, box, hull
from worlds.assets.synthetic.series import Series, pastel

SERIES = Series("Stapler", count=23, seed=20_260_107)
"""As many as in the paper's table; the seed starts every instance's own generator."""

KINDS = {"desk": (0.120, 0.150), "mini": (0.075, 0.095), "long-arm": (0.150, 0.175)}
"""Length of the base [m]; catalogue staplers: mini 60 to 95 mm, desk 120 to 160 mm, long arm from 150 mm."""

DENSITY = (1300.0, 1900.0)
"""Plastic with steel parts inside [kg/m^3]; a desk stapler weighs 150 to 250 g."""

ARM_DENSITY = 1200.0

PRESS_FORCE = (6.0, 10.0)
"""Force at the front of the empty arm [N]; driving a staple takes 30 to 50 N more and is not modelled."""

GAP = 2.0 * BULLET_MARGIN + 0.0005
"""Least distance between base and arm [m]: the simulator's margins leave half a millimetre."""


def make(instance: str) -> Asset:
    """The stapler called ``instance``; ``UnknownName`` when there is none."""
    index = SERIES.index(instance)
    rng = SERIES.rng(index)
    kind = list(KINDS)[index % len(KINDS)]
    length, width = rng.uniform(*KINDS[kind]), rng.uniform(0.026, 0.036)
    floor, thick = rng.uniform(0.008, 0.012), rng.uniform(0.012, 0.018)
    travel = rng.uniform(0.12, 0.18)
    rear = -0.5 * length
    hinge = np.array([floor + 0.5 * thick + length * np.tan(travel), 0.0, rear + 0.34 * length])
    reach = 0.5 * length - hinge[2]
    joint = Joint(
        name="arm_joint",
        type="revolute",
        parent="body",
        child="arm",
        origin=hinge,
        axis=np.array([0.0, -1.0, 0.0]),
        lower=0.0,
        upper=travel,
        physics=JointPhysics(start=0.0, friction=rng.uniform(*PRESS_FORCE) * (reach - 0.012)),
    )
    return realise(
        Design(
            source="synthetic",
            category=SERIES.category,
            instance=instance,
            topology=kind,
            split=SERIES.split(index),
            links=(
                Link("body", _base(length, width, floor, hinge, thick), rng.uniform(*DENSITY), pastel(rng)),
                Link("arm", _arm(rng, reach, width, thick), ARM_DENSITY, pastel(rng, dark=True)),
            ),
            joints=(joint,),
            part=FunctionalPart(
                kind="press",
                link="arm",
                joint=joint.name,
                axis=np.array([-1.0, 0.0, 0.0]),
                point=hinge + np.array([0.5 * thick, 0.0, reach - 0.012]),
                sense=1.0,
                start=0.0,
                travel=travel,
                threshold=0.5 * travel,
                lever=reach - 0.012,
            ),
            long_axis=np.array([0.0, 0.0, 1.0]),
        )
    )


def _base(length: float, width: float, floor: float, hinge: np.ndarray, thick: float) -> tuple[Mesh, ...]:
    """The plate on the desk and, from its rear end to just behind the hinge, the block that carries the arm."""
    plate = box((floor, width, length), (0.5 * floor, 0.0, 0.0))
    rear, front = -0.5 * length, float(hinge[2]) - GAP - 0.004
    top = float(hinge[0]) + 0.5 * thick
    corners = [
        (x, s * 0.5 * width, z)
        for s in (-1.0, 1.0)
        for x, z in ((floor, rear), (0.8 * top, rear), (top, rear + 0.01), (top, front), (floor, front))
    ]
    return plate, hull(np.array(corners))


def _arm(rng: np.random.Generator, reach: float, width: float, thick: float) -> tuple[Mesh, ...]:
    """A bar from just before the hinge to the front, rounded or square there."""
    half, nose = 0.42 * width, rng.uniform(0.5, 1.0)
    corners = [
        (x, s * share * half, z)
        for s in (-1.0, 1.0)
        for x in (-0.5 * thick, 0.5 * thick)
        for z, share in ((0.003, 1.0), (reach - 0.008, 1.0), (reach, nose))
    ]
    return (hull(np.array(corners)),)
