"""Which lighters can be generated? Pocket ones with a button or lever, candle lighters, and metal ones with a flip lid.

Seen from the side, x is the width, z the height; the part that is pressed stands off by its whole travel. A flip lid
is hinged along its narrow side at -x and gripped on its broad faces.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robots.spatial import Array
from worlds.assets.asset import Asset, FunctionalPart, JointPhysics
from worlds.assets.build import Design, Joint, Link, realise
from worlds.assets.solids import BULLET_MARGIN, Mesh, box, merged, moved
from worlds.assets.synthetic.hinge import STANDOFF, flip_part, hinge
from worlds.assets.synthetic.outline import SQUARE, Ring, barrel, stack
from worlds.assets.synthetic.series import Series, mixed, pastel

SERIES = Series("Lighter", count=15, seed=20_260_106)
"""As many as in the paper's table; the seed starts every instance's own generator."""

KINDS = ("push-button", "lever", "side-button", "flip-lid")
"""Three instances are unseen, so one of the four kinds is only seen: side-button."""

DENSITY = (900.0, 1200.0)
"""A plastic shell around liquid gas (560 kg/m^3) and a metal head [kg/m^3]; a full pocket lighter weighs about 20 g."""

PART_DENSITY = 1000.0

METAL_DENSITY = (1700.0, 2200.0)
"""A brass or steel case around wadding and insert [kg/m^3]; the well-known one weighs 55 g at 38 by 13 by 57 mm."""

FLIP_LID = (0.018, 0.022)
"""Height of a flip lid [m], about a third of the whole."""

PRESS_FORCE = (6.0, 12.0)
"""Force at the pressed spot [N]; child-resistant lighters ask for 38 N and more, ordinary piezo ones for less."""

GAP = 2.0 * BULLET_MARGIN + 0.0005
"""Least distance between body and part [m]: the simulator's margins leave half a millimetre."""


@dataclass(frozen=True, slots=True, eq=False)
class _Button:
    """What moves: its solids and look in its own frame, and how it moves, in the body frame.

    Attributes:
        solids: Convex solids in the part frame.
        shown: What cameras see, in the part frame.
        origin: Part frame ``(3,)`` [m].
        joint_axis: ``(3,)``; operating increases the joint position.
        axis: Direction ``(3,)`` in which the pressed spot moves.
        point: The pressed spot ``(3,)`` [m].
        travel: [m] or [rad].
        lever: As in ``FunctionalPart``.
    """

    solids: tuple[Mesh, ...]
    shown: Mesh
    origin: Array
    joint_axis: Array
    axis: Array
    point: Array
    travel: float
    lever: float = 0.0


def make(instance: str) -> Asset:
    """The lighter called ``instance``; ``UnknownName`` when there is none."""
    index = SERIES.index(instance)
    rng = SERIES.rng(index)
    kind = KINDS[mixed(index, len(KINDS))]
    if kind == "flip-lid":
        return _flip_lighter(index, rng)
    tall = rng.uniform(0.120, 0.160) if kind == "side-button" else rng.uniform(0.066, 0.085)
    x, y = 0.5 * rng.uniform(0.022, 0.030), 0.5 * rng.uniform(0.011, 0.014)
    button = {"push-button": _top_button, "lever": _lever, "side-button": _side_button}[kind](rng, x, y, tall)
    force = rng.uniform(*PRESS_FORCE)
    joint = Joint(
        name="button_joint",
        type="revolute" if button.lever else "prismatic",
        parent="body",
        child="button",
        origin=button.origin,
        axis=button.joint_axis,
        lower=0.0,
        upper=button.travel,
        physics=JointPhysics(start=0.0, friction=force * (button.lever or 1.0)),
    )
    rings = (Ring(-0.5 * tall, 0.92 * x, 0.92 * y, SQUARE), Ring(0.004 - 0.5 * tall, x, y, SQUARE))
    body = stack((*rings, Ring(0.5 * tall, x, y, SQUARE)))
    return realise(
        Design(
            source="synthetic",
            category=SERIES.category,
            instance=instance,
            topology=kind,
            split=SERIES.split(index),
            links=(
                Link("body", (*body, *_fixed(kind, x, y, tall)), rng.uniform(*DENSITY), pastel(rng)),
                Link("button", button.solids, PART_DENSITY, pastel(rng, dark=True), button.shown),
            ),
            joints=(joint,),
            part=FunctionalPart(
                kind="press",
                link="button",
                joint=joint.name,
                axis=button.axis,
                point=button.point,
                sense=1.0,
                start=0.0,
                travel=button.travel,
                threshold=0.5 * button.travel,
                lever=button.lever,
            ),
            long_axis=np.array([0.0, 0.0, 1.0]),
        )
    )


def _flip_lighter(index: int, rng: np.random.Generator) -> Asset:
    """A case 38 mm wide and 13 mm thick or nearly so, whose upper third is the lid."""
    x, y, tall = 0.5 * rng.uniform(0.035, 0.040), 0.5 * rng.uniform(0.0125, 0.0145), rng.uniform(0.034, 0.038)
    height, exponent = rng.uniform(*FLIP_LID), rng.uniform(SQUARE, 2.0 * SQUARE)
    joint = hinge(rng, np.array([-x - STANDOFF, 0.0, 0.5 * tall + GAP]), 2.0 * x + STANDOFF)
    lid_rings = ((0.0, 1.0), (height - 0.003, 1.0), (height, 0.94))
    lid = barrel(*(Ring(z, share * x, share * y, exponent) for z, share in lid_rings))
    lid = moved(lid, np.array([x + STANDOFF, 0.0, 0.0]))
    knuckle = box((0.003, 1.4 * y, 0.004), (0.0, 0.0, 0.0))
    body = barrel(*(Ring(z, x, y, exponent) for z in (-0.5 * tall, 0.5 * tall)))
    density, colour = rng.uniform(*METAL_DENSITY), pastel(rng)
    return realise(
        Design(
            source="synthetic",
            category=SERIES.category,
            instance=SERIES.names()[index],
            topology="flip-lid",
            split=SERIES.split(index),
            links=(
                Link("body", (body,), density, colour),
                Link("lid", (lid,), density, pastel(rng, dark=True), merged((lid, knuckle))),
            ),
            joints=(joint,),
            part=flip_part(joint),
            long_axis=np.array([0.0, 0.0, 1.0]),
        )
    )


def _fixed(kind: str, x: float, y: float, tall: float) -> tuple[Mesh, ...]:
    """The hood around the flame of a button lighter, the post that carries a lever, the neck of a candle lighter."""
    top = 0.5 * tall
    if kind == "push-button":
        return (box((0.7 * x, 1.7 * y, 0.005), (0.55 * x, 0.0, top + 0.0025)),)
    if kind == "lever":
        return (box((0.003, 1.6 * y, 0.006), (0.9 * x, 0.0, top + 0.003)),)
    return (box((0.9 * x, 0.9 * y, 0.030), (0.0, 0.0, top + 0.015)),)


def _top_button(rng: np.random.Generator, x: float, y: float, tall: float) -> _Button:
    travel, thick = rng.uniform(0.004, 0.006), rng.uniform(0.007, 0.009)
    base = 0.5 * tall + travel + GAP
    knob = box((0.9 * x, 1.7 * y, thick), (0.0, 0.0, 0.5 * thick))
    stem = box((0.5 * x, y, travel + GAP), (0.0, 0.0, -0.5 * (travel + GAP)))
    at = np.array([-0.50 * x, 0.0, base])
    down = np.array([0.0, 0.0, -1.0])
    return _Button((knob,), merged((knob, stem)), at, down, down, at + np.array([0.0, 0.0, thick]), travel)


def _lever(rng: np.random.Generator, x: float, y: float, tall: float) -> _Button:
    """A level paddle hinged at the post on the +x side, pressed down at its free end."""
    travel, thick, reach = rng.uniform(0.30, 0.38), 0.003, 1.75 * x
    hinge = np.array([0.85 * x, 0.0, 0.5 * tall + reach * np.tan(travel) + GAP + thick])
    paddle = box((reach - 0.004, 1.7 * y, thick), (-0.5 * (reach + 0.004), 0.0, -0.5 * thick))
    post = box((0.008, y, hinge[2] - 0.5 * tall), (-0.002, 0.0, -0.5 * (hinge[2] - 0.5 * tall)))
    lever = reach - 0.005
    point = hinge + np.array([-lever, 0.0, 0.0])
    down = np.array([0.0, 0.0, -1.0])
    return _Button((paddle,), merged((paddle, post)), hinge, np.array([0.0, -1.0, 0.0]), down, point, travel, lever)


def _side_button(rng: np.random.Generator, x: float, y: float, tall: float) -> _Button:
    travel, thick = rng.uniform(0.004, 0.006), rng.uniform(0.006, 0.008)
    base = x + travel + GAP
    knob = box((thick, 1.5 * y, 0.014), (0.5 * thick, 0.0, 0.0))
    stem = box((travel + GAP, y, 0.008), (-0.5 * (travel + GAP), 0.0, 0.0))
    at = np.array([base, 0.0, 0.30 * tall])
    inward = np.array([-1.0, 0.0, 0.0])
    return _Button((knob,), merged((knob, stem)), at, inward, inward, at + np.array([thick, 0.0, 0.0]), travel)
