"""What is done with an articulated model of each category: which links stay movable, and which one is operated?"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from robots.errors import BadAsset
from worlds.assets.everyday import needs_part
from worlds.assets.function import (
    LID_WORDS,
    PULL_RANGE,
    Function,
    functional_part,
    named,
    opened,
    range_of,
    slide_of,
)
from worlds.assets.hinged import ARM_WORDS, pressed_arm, shut, squeezed_handle
from worlds.assets.mobility import Mobility
from worlds.assets.weld import minor, welded


def simplified(model: Mobility, category: str) -> tuple[Mobility, tuple[str, ...]]:
    """The model without the joints that ``category`` does not need, and notes on it."""
    if category == "Stapler":
        return welded(model, set(model.joints) - {named(model, ARM_WORDS) or ""})
    return (model, ()) if needs_part(category) else welded(model, minor(model))


def operated(model: Mobility, category: str) -> Function:
    """How a metric model is operated as a ``category``; ``BadAsset`` when it cannot be."""
    return FINDERS[category](model) if category in FINDERS else Function(None)


def _uncapped(model: Mobility, what: str) -> Function:
    lid = named(model, LID_WORDS)
    if lid is None:
        moving = ", ".join(sorted({name for link, (_, name) in model.semantics.items() if link in model.joints}))
        kinds = ", ".join(sorted({joint.type for joint in model.joints.values()}))
        reason = f"none of its moving parts is a {' or '.join(LID_WORDS)} that comes off the {what}"
        raise BadAsset(model.instance, f"{reason}; it has: {moving or 'none'} ({kinds or 'no joint'})")
    slide = slide_of(model, lid)
    if what == "pen" and (slide is None or range_of(slide) < PULL_RANGE):
        moved = 0.0 if slide is None else 1000 * range_of(slide)
        raise BadAsset(model.instance, f"its {lid} slides only {moved:.1f} mm: it is a button, see Pen-Button")
    return opened(model, lid)


def _clicked(model: Mobility) -> Function:
    lid = named(model, LID_WORDS)
    slide = None if lid is None else slide_of(model, lid)
    if slide is not None and range_of(slide) >= PULL_RANGE:
        reason = f"its cap slides off by {1000 * range_of(slide):.0f} mm: it is a pen with a cap, see Pen-Cap"
        raise BadAsset(model.instance, reason)
    return functional_part(model, pressed=True)


FINDERS: dict[str, Callable[[Mobility], Function]] = {
    "Bottle": partial(functional_part, pressed=False),
    "Dispenser": partial(functional_part, pressed=True),
    "Laptop": shut,
    "Pen-Button": _clicked,
    "Pen-Cap": partial(_uncapped, what="pen"),
    "Pliers": squeezed_handle,
    "Stapler": pressed_arm,
    "USB": partial(_uncapped, what="stick"),
    "Window": shut,
}
"""How the part is found, or where the joints start; other categories are neither operated nor shut."""
