"""How is a PartNet-Mobility model made real: which size, which functional part, which masses and resistances?

The models are unit-normalised and carry neither inertia nor friction; everything supplied here is a named constant.
Nothing is copied from the source folder but into the user's cache.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from robots.cache import content_hash
from robots.errors import BadAsset, BadInput, UnknownName
from robots.spatial import Array
from worlds.assets.asset import Asset, JointPhysics, Split
from worlds.assets.build import Design, Joint, Link, realise
from worlds.assets.convex import convex_parts
from worlds.assets.function import Function, functional_part
from worlds.assets.mobility import ROOT, Mobility, MovingJoint, read
from worlds.assets.solids import merged, moved

TYPICAL_HEIGHT = {"Bottle": 0.22, "Dispenser": 0.19}
"""Height of an everyday instance [m]: drink bottles are 0.20 to 0.24, soap dispensers 0.18 to 0.20."""

CATEGORIES = tuple(TYPICAL_HEIGHT)
"""Categories that are read."""

WIDEST_GRIP = 0.070
"""The narrower horizontal extent may be no larger [m]: the hand opens 80 mm."""

SHORTEST = 0.090
"""An object shorter than this has no room for two hands [m]."""

BODY_DENSITY, MOVING_DENSITY = 250.0, 500.0
"""Mass over volume of the convex parts [kg/m^3]: a partly full container; half plastic, half air (as generated)."""

PULL_FRICTION = 5.0
"""Resistance of a push-on lid [N]."""

SCREW_FRICTION = 0.25
"""Resistance of a screwed lid [N m]."""

SPIN_FRICTION = 0.075
"""Resistance of a pulled or pressed part against turning [N m]: 5 N at a radius of 15 mm."""

PRESS_FRICTION = 8.0
"""Resistance of a pressed part where it is pressed [N]."""

HELD_OUT = 4
"""One in so many instances, picked by a hash of its name, is unseen."""

BODY_COLOUR, PART_COLOUR, OTHER_COLOUR = (0.72, 0.79, 0.87), (0.80, 0.25, 0.18), (0.93, 0.72, 0.25)
"""Red, green, blue of the body, the functional part and other parts."""

NOTES = (
    f"masses supplied: {BODY_DENSITY:g} kg/m^3 for the body, {MOVING_DENSITY:g} kg/m^3 for moving parts",
    "joint friction supplied",
)


def names(root: Path, category: str, split: Split | None = None) -> list[str]:
    """Sorted folder names of ``category`` under ``root``; of one split when given."""
    folder = root / category
    if not folder.is_dir():
        present = ", ".join(sorted(path.name for path in root.iterdir() if path.is_dir())) or "no folders"
        raise BadInput(f"The folder {root} has no {category}; it has: {present}.")
    listed = sorted(path.name for path in folder.iterdir() if path.is_dir())
    return [name for name in listed if split in (None, split_of(name))]


def split_of(instance: str) -> Split:
    """The split of an instance, from a hash of its name."""
    return "unseen" if int(content_hash("partnet-mobility", instance), 16) % HELD_OUT == 0 else "seen"


def make(root: Path, source: str, category: str, instance: str) -> Asset:
    """The asset of the folder ``root/category/instance``; ``BadAsset`` when it cannot be used."""
    listed = names(root, category)
    if instance not in listed:
        raise UnknownName(f"{category} instance", instance, listed)
    model = read(root / category / instance)
    factor, sized = _scale(model, category)
    metric = model.scaled(factor)
    function = functional_part(metric, pressed=category == "Dispenser")
    return realise(_design(metric, function, source, category, (sized, *NOTES, *function.notes)))


def _scale(model: Mobility, category: str) -> tuple[float, str]:
    """Metres per model unit, and how it was found."""
    extent = np.ptp(model.vertices(*model.meshes), axis=0)
    if extent.min() <= 0.0:
        raise BadAsset(model.instance, "it is flat")
    narrow, tall = float(extent[:2].min()), float(extent[2])
    factor = min(TYPICAL_HEIGHT[category] / tall, WIDEST_GRIP / narrow)
    height = factor * tall
    if factor * float(extent.max()) < SHORTEST:
        raise BadAsset(
            model.instance,
            f"at a width of {1000 * WIDEST_GRIP:.0f} mm it is {1000 * factor * extent.max():.0f} mm long, "
            f"less than {1000 * SHORTEST:.0f} mm",
        )
    return factor, f"size supplied: {1000 * height:.0f} mm tall and {1000 * factor * narrow:.0f} mm narrow"


def _design(model: Mobility, function: Function, source: str, category: str, notes: tuple[str, ...]) -> Design:
    body = model.vertices(ROOT)
    middle = 0.5 * (body.min(axis=0) + body.max(axis=0))
    origins = {ROOT: middle} | {child: joint.origin for child, joint in model.joints.items()}
    links = tuple(_link(model, name, origins[name], function) for name in (ROOT, *model.joints))
    if not links[0].solids:
        raise BadAsset(model.instance, "its body has no volume")
    return Design(
        source=source,
        category=category,
        instance=model.instance,
        topology="+".join(joint.type for joint in model.chain(function.part.link)),
        split=split_of(model.instance),
        links=links,
        joints=tuple(_joint(joint, origins[joint.parent], function) for joint in model.joints.values()),
        part=function.part_from(middle),
        long_axis=_long_axis(model, function),
        notes=notes,
    )


def _link(model: Mobility, name: str, origin: Array, function: Function) -> Link:
    meshes = tuple(moved(mesh, -origin) for mesh in model.meshes[name])
    fixed = name == ROOT
    colour = BODY_COLOUR if fixed else PART_COLOUR if name == function.part.link else OTHER_COLOUR
    return Link(
        name=_written(name),
        solids=convex_parts(meshes),
        density=BODY_DENSITY if fixed else MOVING_DENSITY,
        colour=colour,
        visual=merged(meshes) if meshes else None,
    )


def _joint(joint: MovingJoint, origin: Array, function: Function) -> Joint:
    lower, upper = function.limits.get(joint.name, (joint.lower, joint.upper))
    start = function.starts.get(joint.name, 0.0 if joint.type == "continuous" else float(np.clip(0.0, lower, upper)))
    match joint.type:
        case "prismatic" | "revolute" | "continuous" as kind:
            return Joint(
                name=joint.name,
                type=kind,
                parent=_written(joint.parent),
                child=joint.child,
                origin=joint.origin - origin,
                axis=joint.axis,
                lower=lower,
                upper=upper,
                physics=JointPhysics(start, _friction(joint, function)),
            )
        case other:
            raise ValueError(f"a movable joint of type {other}")


def _friction(joint: MovingJoint, function: Function) -> float:
    part = function.part
    if joint.type == "prismatic":
        return PRESS_FRICTION if part.kind == "press" else PULL_FRICTION
    if joint.name != part.joint:
        return SPIN_FRICTION
    return PRESS_FRICTION * part.lever if part.kind == "press" else SCREW_FRICTION


def _long_axis(model: Mobility, function: Function) -> Array:
    """The coordinate axis of the largest extent, towards the functional part."""
    everything = model.vertices(*model.meshes)
    extent = np.ptp(everything, axis=0)
    axis = np.eye(3)[int(np.argmax(extent))]
    towards = function.part.point - model.vertices(ROOT).mean(axis=0)
    return np.asarray(axis if axis @ towards >= 0.0 else -axis)


def _written(link: str) -> str:
    """The name in the rewritten URDF."""
    return "body" if link == ROOT else link
