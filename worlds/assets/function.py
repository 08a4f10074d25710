"""Which part of an imported model is operated, by which joint, and from where to where?"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from robots.errors import BadAsset
from robots.spatial import Array
from worlds.assets.asset import FunctionalPart
from worlds.assets.mobility import ROOT, Mobility, MovingJoint
from worlds.assets.touch import flat_spot, grip

LID_WORDS = ("lid", "cap", "cover")
"""Words in the annotated names of what closes a bottle or tops a dispenser."""

BUTTON_WORDS = ("button", "knob")
"""Words in the annotated names of what is pressed on a pen."""

HANDLE_WORDS = ("handle", "lever", "trigger")
"""Words in the annotated names of what is squeezed where nothing is pressed."""

LEAST_PULL = 0.010
"""A lid counts as pulled off after half its slide, and after this much where the slide allows it [m]."""

PULL_RANGE = 0.010
"""A lid that slides at least this far is pulled off, else it is screwed [m]."""

LEAST_RANGE = 0.002
"""A joint that slides less cannot be told to have moved [m]."""

LEAST_BAND = 0.005
"""Fingers need this much height of a lid [m]."""

WIDEST_LID = 0.075
"""The hand opens 80 mm; 5 mm are left to get around a lid [m]."""

TURN_RANGE = np.pi
"""Turn that counts as the whole of a screwed lid's opening [rad]; half of it, a quarter turn, is opened."""


@dataclass(frozen=True, slots=True, eq=False)
class Function:
    """What is operated, in the model frame.

    Attributes:
        part: The functional part, its point in the model frame; ``None`` when nothing is operated.
        starts: Start positions of the joints that have one other than the closest to zero.
        limits: Limits of the joints whose range was cut.
        notes: What was supplied or repaired.
    """

    part: FunctionalPart | None
    starts: dict[str, float] = field(default_factory=dict)
    limits: dict[str, tuple[float, float]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def part_from(self, origin: Array) -> FunctionalPart | None:
        """The part as seen from a frame at ``origin`` ``(3,)`` [m]."""
        return None if self.part is None else replace(self.part, point=self.part.point - origin)


def functional_part(model: Mobility, *, pressed: bool) -> Function:
    """The part to operate of a metric model; ``BadAsset`` when there is none.

    Args:
        model: In metres.
        pressed: Whether the category is pressed, else opened.
    """
    lid = named(model, LID_WORDS + BUTTON_WORDS if pressed else LID_WORDS)
    if not pressed:
        if lid is None:
            raise BadAsset(model.instance, f"none of its moving parts is called {' or '.join(LID_WORDS)}")
        return opened(model, lid)
    if lid is not None and (slide := slide_of(model, lid)) is not None and range_of(slide) >= LEAST_RANGE:
        return _pressed(model, lid, slide)
    handle = named(model, HANDLE_WORDS)
    if handle is not None and model.joints[handle].type == "revolute":
        return _squeezed(model, handle)
    raise BadAsset(model.instance, "it has neither a lid that slides by 2 mm nor a hinged handle")


def named(model: Mobility, words: tuple[str, ...]) -> str | None:
    """The first moving link with shapes whose annotated name holds one of ``words``."""
    for link, (_, name) in sorted(model.semantics.items()):
        if link in model.joints and model.meshes[link] and any(word in name for word in words):
            return link
    return None


def slide_of(model: Mobility, link: str) -> MovingJoint | None:
    """The longest slide between the body and ``link``."""
    slides = [joint for joint in model.chain(link) if joint.type == "prismatic"]
    return max(slides, key=range_of, default=None)


def range_of(joint: MovingJoint) -> float:
    """Distance between the limits [m] or [rad]."""
    return joint.upper - joint.lower


def _outward(model: Mobility, link: str, joint: MovingJoint) -> tuple[Array, float]:
    """Unit vector along the joint axis away from the body, and whether it is the axis (+1) or against it (-1)."""
    body, part = (0.5 * (v.min(axis=0) + v.max(axis=0)) for v in (model.vertices(ROOT), model.vertices(link)))
    sign = 1.0 if joint.axis @ (part - body) >= 0.0 else -1.0
    return sign * joint.axis, sign


def opened(model: Mobility, lid: str) -> Function:
    """A lid that is pulled off or unscrewed; ``BadAsset`` when it does neither."""
    slide = slide_of(model, lid)
    spin = next((joint for joint in model.chain(lid) if joint.type == "continuous"), None)
    if slide is None:
        raise BadAsset(model.instance, "its lid does not slide")
    if range_of(slide) >= PULL_RANGE or (spin is None and range_of(slide) >= LEAST_RANGE):
        return _pulled(model, lid, slide)
    if spin is None:
        raise BadAsset(model.instance, f"its lid slides only {1000 * range_of(slide):.1f} mm and does not turn")
    return _unscrewed(model, lid, slide, spin)


def _pulled(model: Mobility, lid: str, slide: MovingJoint) -> Function:
    outward, sign = _outward(model, lid, slide)
    closed, travel = _closed(slide, sign), range_of(slide)
    hold = _hold(model, lid, closed * slide.axis, outward)
    part = FunctionalPart(
        kind="pull",
        link=lid,
        joint=slide.name,
        axis=outward,
        point=_checked(model, hold),
        sense=sign,
        start=closed,
        travel=travel,
        threshold=max(0.5 * travel, min(LEAST_PULL, 0.8 * travel)),
    )
    notes = () if travel >= PULL_RANGE else (f"its lid slides only {1000 * travel:.1f} mm",)
    return Function(part, starts={slide.name: closed}, notes=notes)


def _unscrewed(model: Mobility, lid: str, slide: MovingJoint, spin: MovingJoint) -> Function:
    outward, sign = _outward(model, lid, slide)
    start = _closed(slide, sign)
    notes: tuple[str, ...] = ()
    hold = _hold(model, lid, start * slide.axis, outward)
    if hold.band < LEAST_BAND:
        modelled = float(np.clip(0.0, slide.lower, slide.upper))
        notes = (f"its lid starts {1000 * abs(modelled - start):.1f} mm higher than closed, where fingers reach it",)
        start = modelled
        hold = _hold(model, lid, start * slide.axis, outward)
    part = FunctionalPart(
        kind="unscrew",
        link=lid,
        joint=spin.name,
        axis=outward,
        point=_checked(model, hold),
        sense=1.0 if spin.axis @ outward > 0.0 else -1.0,
        start=0.0,
        travel=TURN_RANGE,
        threshold=0.5 * TURN_RANGE,
    )
    return Function(part, starts={slide.name: start}, notes=notes)


def _closed(slide: MovingJoint, sign: float) -> float:
    """The end of the slide at which the lid is closest to the body."""
    return slide.lower if sign > 0.0 else slide.upper


@dataclass(frozen=True, slots=True, eq=False)
class _Hold:
    """Where fingers get around a lid: middle ``(3,)``, height and width of the band they reach [m]."""

    point: Array
    band: float
    width: float


def _hold(model: Mobility, lid: str, shift: Array, outward: Array) -> _Hold:
    """The hold on the lid after it moved by ``shift`` ``(3,)`` [m]."""
    points, on_axis = model.vertices(lid) + shift, model.chain(lid)[-1].origin + shift
    others = [link for link in model.meshes if link != lid]
    band, width = grip(points, model.vertices(*others), on_axis, outward)
    top = float(((points - on_axis) @ outward).max())
    return _Hold(on_axis + (top - 0.5 * band) * outward, band, width)


def _checked(model: Mobility, hold: _Hold) -> Array:
    """The point of ``hold``; ``BadAsset`` when fingers cannot get around the lid."""
    width, band = 1000 * hold.width, 1000 * hold.band
    if hold.width > WIDEST_LID:
        raise BadAsset(model.instance, f"its lid is {width:.0f} mm wide, more than {1000 * WIDEST_LID:.0f} mm")
    if hold.band < LEAST_BAND:
        reason = f"fingers reach only {band:.1f} mm of its lid, less than {1000 * LEAST_BAND:.0f} mm"
        raise BadAsset(model.instance, reason)
    return hold.point


def _pressed(model: Mobility, head: str, slide: MovingJoint) -> Function:
    outward, sign = _outward(model, head, slide)
    low, high = sorted((sign * slide.lower, sign * slide.upper))
    engaged = _overlap(model, head, outward)
    raised = float(np.clip(engaged, low + LEAST_RANGE, high))
    travel = raised - low
    point = pressed_point(model, head, slide.origin, outward) + raised * outward
    part = FunctionalPart(
        kind="press",
        link=head,
        joint=slide.name,
        axis=-outward,
        point=point,
        sense=-sign,
        start=sign * raised,
        travel=travel,
        threshold=0.5 * travel,
    )
    first, last = sorted((sign * low, sign * raised))
    note = f"its head is raised {1000 * raised:.1f} mm, not {1000 * high:.1f} mm, to stay on the body"
    notes = (note,) if raised < high - 1e-9 else ()
    return Function(part, {slide.name: sign * raised}, {slide.name: (first, last)}, notes)


def _overlap(model: Mobility, head: str, outward: Array) -> float:
    """How far the head may rise before its lower end leaves the body [m]."""
    return float((model.vertices(ROOT) @ outward).max() - (model.vertices(head) @ outward).min())


def pressed_point(model: Mobility, part: str, near: Array, outward: Array) -> Array:
    """The best flat spot as modelled, close to the line through ``near`` along ``outward``."""
    others = tuple(mesh for link, meshes in model.meshes.items() if link != part for mesh in meshes)
    spot = flat_spot(model.meshes[part], others, near, outward)
    if spot is None:
        raise BadAsset(model.instance, "it has no flat spot of 12 x 12 mm to press")
    return spot


def _squeezed(model: Mobility, handle: str) -> Function:
    """A hinged handle, pressed at its far end in the direction of its longer way."""
    hinge = model.joints[handle]
    sense = 1.0 if hinge.upper >= -hinge.lower else -1.0
    start = float(np.clip(0.0, hinge.lower, hinge.upper))
    travel = (hinge.upper - start) if sense > 0.0 else (start - hinge.lower)
    arms = model.vertices(handle) - hinge.origin
    arms -= np.outer(arms @ hinge.axis, hinge.axis)
    reach = np.linalg.norm(arms, axis=1)
    tip = arms[int(np.argmax(reach))] / reach.max()
    inward = sense * np.cross(hinge.axis, tip)
    point = pressed_point(model, handle, hinge.origin + reach.max() * tip, -inward)
    arm = point - hinge.origin
    arm -= (arm @ hinge.axis) * hinge.axis
    lever = float(np.linalg.norm(arm))
    if lever * travel < LEAST_RANGE:
        raise BadAsset(model.instance, f"its handle moves only {1000 * lever * travel:.1f} mm")
    motion = sense * np.cross(hinge.axis, arm) / lever
    part = FunctionalPart(
        kind="press",
        link=handle,
        joint=hinge.name,
        axis=motion,
        point=point,
        sense=sense,
        start=start,
        travel=travel,
        threshold=0.5 * travel,
        lever=lever,
    )
    return Function(part)
