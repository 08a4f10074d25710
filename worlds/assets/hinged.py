"""How is a hinged part of an imported model pressed, and where does a lid stand when it is shut?"""

from __future__ import annotations

import numpy as np

from robots.errors import BadAsset
from robots.spatial import Array, rotation_about
from worlds.assets.asset import FunctionalPart
from worlds.assets.function import Function, named, pressed_point
from worlds.assets.mobility import ROOT, Mobility, MovingJoint
from worlds.assets.weld import motion, posed, rest_position

ARM_WORDS = ("lid",)
"""What PartNet-Mobility calls the upper arm of a stapler."""

LEAST_STROKE = 0.008
"""A stapler whose arm's front moves less than this is opened further before it is pressed [m]."""

STROKE = 0.014
"""How far the front of such an arm then moves [m]: a desk stapler's front is 15 to 25 mm above its base."""

SPREAD = 0.25
"""How far pliers are open before they are squeezed [rad]: hand tools open 15 to 30 degrees in use."""

ALONG = 0.75
"""Handles are pressed at this share of their length from the hinge, as a hand does; arms at ``FRONT`` of theirs."""

FRONT = 0.92

SHUT = 0.35
"""A lid counts as shut when the whole is no thicker than this share of its longest side."""

STOPS = 61
"""Positions of a hinge that are tried, from one end to the other."""


def pressed_arm(model: Mobility) -> Function:
    """A stapler's arm, pressed down at its front; ``BadAsset`` when there is none."""
    arm = named(model, ARM_WORDS)
    if arm is None or model.joints[arm].type != "revolute":
        raise BadAsset(model.instance, "none of its parts is an arm (lid) on a hinge with end stops")
    hinge = model.joints[arm]
    reach = _reach(model.vertices(arm), hinge)
    sense = _sense(hinge, reach, np.array([0.0, 0.0, -1.0]))
    lever = FRONT * float(np.linalg.norm(reach))
    start = rest_position(hinge)
    if lever * _travel(hinge, start, sense) < LEAST_STROKE:
        start = float(np.clip(_end(hinge, sense) - sense * STROKE / lever, hinge.lower, hinge.upper))
    return _pressed(model, arm, FRONT * reach, sense, start)


def squeezed_handle(model: Mobility) -> Function:
    """One handle of pliers, pressed towards the other; ``BadAsset`` when they do not open."""
    leg = next((link for link, joint in sorted(model.joints.items()) if joint.type == "revolute"), None)
    if leg is None:
        raise BadAsset(model.instance, "neither of its legs has a hinge with end stops")
    hinge = model.joints[leg]
    away = _reach(np.concatenate([model.vertices(leg), model.vertices(ROOT)]), hinge)
    handle, other = _handle(model.vertices(leg), hinge, away), _handle(model.vertices(ROOT), hinge, away)
    sense = _sense(hinge, handle, other - handle)
    start = rest_position(hinge)
    if _travel(hinge, start, sense) < SPREAD:
        start = float(np.clip(_end(hinge, sense) - sense * SPREAD, hinge.lower, hinge.upper))
    length = float(np.linalg.norm(away))
    return _pressed(model, leg, ALONG * length * handle / np.linalg.norm(handle), sense, start)


def shut(model: Mobility) -> Function:
    """No functional part, and the largest hinged link where the whole is most compact: a lid on its base, a sash in its
    frame, not a laptop opened flat; ``BadAsset`` when it is not flat there.
    """
    hinges = [joint for joint in model.joints.values() if joint.type == "revolute"]
    if not hinges:
        return Function(None)
    lid = max(hinges, key=lambda joint: float(np.ptp(model.vertices(joint.child), axis=0).max(initial=0.0)))
    stops = [rest_position(lid), *np.linspace(lid.lower, lid.upper, STOPS)]
    extents = [np.ptp(posed(model, {lid.name: stop}), axis=0) for stop in stops]
    best = int(np.argmin([round(float(extent.sum()), 6) for extent in extents]))
    thin, longest = float(extents[best].min()), float(extents[best].max())
    if thin > SHUT * longest:
        reason = f"shut, it is still {100 * thin / longest:.0f} % as thick as long"
        raise BadAsset(model.instance, f"{reason}, more than {100 * SHUT:.0f} %")
    start = float(stops[best])
    return Function(None, {lid.name: start}, notes=(f"shut: {lid.name} starts at {np.degrees(start):.0f} deg",))


def _across(vectors: Array, hinge: MovingJoint) -> Array:
    """Positions ``(n, 3)`` from the hinge line, square to it."""
    arms = np.atleast_2d(vectors) - hinge.origin
    return np.asarray(arms - np.outer(arms @ hinge.axis, hinge.axis))


def _reach(vertices: Array, hinge: MovingJoint) -> Array:
    """From the hinge line to the vertex farthest from it, square to it ``(3,)``."""
    arms = _across(vertices, hinge)
    return np.asarray(arms[int(np.argmax(np.linalg.norm(arms, axis=1)))])


def _handle(vertices: Array, hinge: MovingJoint, away: Array) -> Array:
    """From the hinge line to the middle of what lies beyond half of ``away``."""
    arms = _across(vertices, hinge)
    beyond = arms[arms @ away > 0.5 * float(away @ away)]
    return np.asarray(beyond.mean(axis=0) if len(beyond) else away)


def _sense(hinge: MovingJoint, arm: Array, towards: Array) -> float:
    """Whether a positive (+1) or a negative (-1) turn moves the end of ``arm`` ``towards``."""
    return 1.0 if np.cross(hinge.axis, arm) @ towards > 0.0 else -1.0


def _end(hinge: MovingJoint, sense: float) -> float:
    return hinge.upper if sense > 0.0 else hinge.lower


def _travel(hinge: MovingJoint, start: float, sense: float) -> float:
    return sense * (_end(hinge, sense) - start)


def _pressed(model: Mobility, link: str, spot: Array, sense: float, start: float) -> Function:
    """``link`` pressed near ``spot``, a position from the hinge line at joint position zero."""
    hinge = model.joints[link]
    travel = _travel(hinge, start, sense)
    inward = sense * np.cross(hinge.axis, spot) / np.linalg.norm(spot)
    middle = float(np.mean((model.vertices(link) - hinge.origin) @ hinge.axis))
    near = hinge.origin + middle * hinge.axis + spot
    modelled = pressed_point(model, link, near, -inward)
    [arm] = _across(modelled, hinge)
    lever = float(np.linalg.norm(arm))
    if lever * travel < 0.5 * LEAST_STROKE:
        raise BadAsset(model.instance, f"its {link} moves only {1000 * lever * travel:.1f} mm where it is pressed")
    T = motion(hinge, start)
    part = FunctionalPart(
        kind="press",
        link=link,
        joint=hinge.name,
        axis=rotation_about(hinge.axis, start) @ (sense * np.cross(hinge.axis, arm) / lever),
        point=T.act(modelled),
        sense=sense,
        start=start,
        travel=travel,
        threshold=0.5 * travel,
        lever=lever,
    )
    opened = start - rest_position(hinge)
    notes = (f"opened by {np.degrees(abs(opened)):.0f} deg before it is pressed",) if abs(opened) > 1e-6 else ()
    return Function(part, {hinge.name: start}, notes=notes)
