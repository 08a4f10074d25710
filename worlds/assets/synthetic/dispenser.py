"""Which soap dispensers can be generated? Six body profiles times four heads, numbers drawn from the index.

A head keeps clear of the body over its whole travel. The stem under a pump head is seen but not touched:
pressed, it goes into the collar, whose collision shape is solid.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from robots.spatial import Array, rotation_about
from worlds.assets.asset import Asset, FunctionalPart, JointPhysics
from worlds.assets.build import Design, Joint, Link, realise
from worlds.assets.solids import BULLET_MARGIN, Mesh, box, hull, merged, moved
from worlds.assets.synthetic.outline import PROFILES, container, cylinder, stack
from worlds.assets.synthetic.series import Series, mixed, pastel

SERIES = Series("Dispenser", count=57, seed=20_260_102)
"""57 dispensers, as many as bottles; the seed starts every instance's own generator."""

HEADS = ("pump-nozzle", "push-button", "spray-lever", "trigger")

FILLED_DENSITY = (200.0, 300.0)
"""Mass over outer volume [kg/m^3]: a 40 g shell around 0.3 litres with about a sixth of it full."""

HEAD_DENSITY = 600.0
"""A moulded head is about two thirds polypropylene (900 kg/m^3), one third air."""

GAP = 2.0 * BULLET_MARGIN + 0.0005
"""Least distance between head and body [m]: the simulator's margins leave half a millimetre."""

PRESS_FORCE = (6.0, 10.0)
"""Force at the pressed point [N]; a lotion pump's spring asks for 10 to 20, most of it late in the stroke, and a
sprayer's trigger for more, but by two fingers."""

TRIGGER_SLANT = 0.30
"""How far a trigger's lower end stands out in front before it is pulled [rad]: past nozzle and shoulder."""

STEM_RADIUS = 0.004
"""Radius of a pump stem [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class _Head:
    """A head above a rim at height zero: what moves, what is fixed, and how.

    Attributes:
        moving: Convex solids of the head, in the head frame.
        shown: What cameras see of the head, in the head frame.
        fixed: Solids that belong to the body, with the rim at z = 0.
        origin: Head frame ``(3,)`` with the rim at z = 0 [m].
        axis: Joint axis ``(3,)``.
        point: Where to press, with the rim at z = 0 [m].
        travel: [m] or [rad].
        lever: As in ``FunctionalPart``.
        way: Direction ``(3,)`` in which the pressed point moves.
    """

    moving: tuple[Mesh, ...]
    shown: Mesh
    fixed: tuple[Mesh, ...]
    origin: Array
    axis: Array
    point: Array
    travel: float
    lever: float = 0.0
    way: Array = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))


def make(instance: str) -> Asset:
    """The dispenser called ``instance``; ``UnknownName`` when there is none."""
    index = SERIES.index(instance)
    rng = SERIES.rng(index)
    topology = HEADS[mixed(index, len(HEADS))]
    profile = PROFILES[index // len(HEADS) % len(PROFILES)]
    width, height = rng.uniform(0.050, 0.072), rng.uniform(0.100, 0.170)
    neck = min(rng.uniform(0.012, 0.018), 0.35 * width)
    rings = container(profile, rng, width, height, neck)
    rim = np.array([0.0, 0.0, 0.5 * height])
    makers = {"pump-nozzle": _pump, "push-button": _button, "spray-lever": _spray, "trigger": _trigger}
    head = makers[topology](rng, width, neck)
    joint = _joint(head, rim, force=rng.uniform(*PRESS_FORCE))
    body = (*stack(rings), *(moved(solid, rim) for solid in head.fixed))
    return realise(
        Design(
            source="synthetic",
            category=SERIES.category,
            instance=instance,
            topology=topology,
            split=SERIES.split(index),
            links=(
                Link("body", body, rng.uniform(*FILLED_DENSITY), pastel(rng)),
                Link("head", head.moving, HEAD_DENSITY, pastel(rng, dark=True), head.shown),
            ),
            joints=(joint,),
            part=_part(head, joint, rim),
            long_axis=np.array([0.0, 0.0, 1.0]),
        )
    )


def _pump(rng: np.random.Generator, width: float, neck: float) -> _Head:
    """A disc or block on a stem, with a nozzle to one side."""
    travel, collar = rng.uniform(0.010, 0.020), rng.uniform(0.010, 0.016)
    half, thick = rng.uniform(0.012, 0.016), rng.uniform(0.010, 0.014)
    length = rng.uniform(0.015, 0.030)
    block = cylinder(0.0, thick, half) if rng.random() < 0.5 else box((2 * half, 2 * half, thick), (0, 0, 0.5 * thick))
    nozzle = box((length, 0.009, 0.007), (half + 0.5 * length - 0.002, 0.0, thick - 0.0055))
    base = collar + travel + GAP
    stem = cylinder(collar - base, 0.0, STEM_RADIUS)
    return _Head(
        moving=(block, nozzle),
        shown=merged((block, nozzle, stem)),
        fixed=(cylinder(0.0, collar, neck + 0.003),),
        origin=np.array([0.0, 0.0, base]),
        axis=np.array([0.0, 0.0, -1.0]),
        point=np.array([0.0, 0.0, base + thick]),
        travel=travel,
    )


def _button(rng: np.random.Generator, width: float, neck: float) -> _Head:
    """A wide button over the neck."""
    travel, thick = rng.uniform(0.008, 0.012), rng.uniform(0.010, 0.018)
    button = cylinder(0.0, thick, min(rng.uniform(0.015, 0.025), 0.45 * width))
    base = travel + GAP
    return _Head(
        moving=(button,),
        shown=merged((button, cylinder(-base, 0.0, 0.6 * neck))),
        fixed=(),
        origin=np.array([0.0, 0.0, base]),
        axis=np.array([0.0, 0.0, -1.0]),
        point=np.array([0.0, 0.0, base + thick]),
        travel=travel,
    )


def _spray(rng: np.random.Generator, width: float, neck: float) -> _Head:
    """A level paddle hinged on a post behind the neck, pressed down at its free end."""
    travel, collar = rng.uniform(0.30, 0.42), rng.uniform(0.008, 0.012)
    half, thick = rng.uniform(0.011, 0.014), 0.005
    radius = neck + 0.002
    reach = radius + rng.uniform(0.018, 0.026)
    hinge = collar + (2.0 * radius + 0.002) * np.tan(travel) + GAP + thick
    paddle = box((reach + radius - 0.003, 2 * half, thick), (0.5 * (reach + radius + 0.003), 0.0, -0.5 * thick))
    pin = box((0.006, 2 * half, thick), (0.003, 0.0, -0.5 * thick))
    top = hinge - thick - 2.0 * GAP
    post = box((0.007, 0.016, top), (-radius - 0.0005, 0.0, 0.5 * top))
    lever = reach + radius - half
    return _Head(
        moving=(paddle,),
        shown=merged((paddle, pin)),
        fixed=(cylinder(0.0, collar, radius), post),
        origin=np.array([-radius, 0.0, hinge]),
        axis=np.array([0.0, 1.0, 0.0]),
        point=np.array([lever - radius, 0.0, hinge]),
        travel=travel,
        lever=lever,
    )


def _trigger(rng: np.random.Generator, width: float, neck: float) -> _Head:
    """A trigger that hangs from a hood, its lower end in front, and is pulled towards the column behind it."""
    travel, collar = rng.uniform(0.32, 0.42), rng.uniform(0.010, 0.014)
    length, half, thick = rng.uniform(0.036, 0.042), rng.uniform(0.010, 0.012), 0.006
    column, hood = 0.8 * neck, rng.uniform(0.013, 0.017)
    slant = rotation_about([0.0, 1.0, 0.0], -TRIGGER_SLANT)
    front = column + thick + length * np.sin(travel - TRIGGER_SLANT) + GAP + 0.001
    hinge = collar + length + GAP
    blade = box((thick, 2.0 * half, length - 0.003), (-0.5 * thick, 0.0, -0.5 * (length + 0.003)))
    blade = hull(blade.vertices @ slant.T)
    pin = box((0.004, half, 0.004 + GAP), (-0.5 * thick, 0.0, 0.5 * (GAP - 0.004)))
    roof, end = hinge + GAP, front + 0.002
    nozzle = box((0.004, 0.010, 0.010), (end + 0.002, 0.0, roof + 0.5 * hood))
    top = box((end + neck, 1.6 * column, hood), (0.5 * (end - neck), 0.0, roof + 0.5 * hood))
    stem = box((2.0 * column, 1.6 * column, roof), (0.0, 0.0, 0.5 * roof))
    lever = length - 0.008
    origin = np.array([front, 0.0, hinge])
    return _Head(
        moving=(blade,),
        shown=merged((blade, pin)),
        fixed=(cylinder(0.0, collar, neck + 0.002), stem, top, nozzle),
        origin=origin,
        axis=np.array([0.0, 1.0, 0.0]),
        point=origin + slant @ np.array([0.0, 0.0, -lever]),
        travel=travel,
        lever=lever,
        way=slant @ np.array([-1.0, 0.0, 0.0]),
    )


def _joint(head: _Head, rim: Array, force: float) -> Joint:
    return Joint(
        name="head_joint",
        type="revolute" if head.lever else "prismatic",
        parent="body",
        child="head",
        origin=rim + head.origin,
        axis=head.axis,
        lower=0.0,
        upper=head.travel,
        physics=JointPhysics(start=0.0, friction=force * (head.lever or 1.0)),
    )


def _part(head: _Head, joint: Joint, rim: Array) -> FunctionalPart:
    return FunctionalPart(
        kind="press",
        link=joint.child,
        joint=joint.name,
        axis=head.way,
        point=rim + head.point,
        sense=1.0,
        start=0.0,
        travel=head.travel,
        threshold=0.5 * head.travel,
        lever=head.lever,
    )
