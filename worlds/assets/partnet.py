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
from worlds.assets.convex import convex_parts, lumped
from worlds.assets.everyday import EVERYDAY, WIDEST_GRIP, density_for
from worlds.assets.function import Function
from worlds.assets.hinged import shut
from worlds.assets.mobility import ROOT, Mobility, MovingJoint, read
from worlds.assets.posture import flat_rotation
from worlds.assets.solids import merged, moved, volume
from worlds.assets.usage import operated, simplified
from worlds.assets.weld import posed, rest_position

FOLDERS = {
    "Bottle": "Bottle",
    "Dispenser": "Dispenser",
    "Keyboard": "Keyboard",
    "Laptop": "Laptop",
    "Pen-Button": "Pen",
    "Pen-Cap": "Pen",
    "Phone": "Phone",
    "Pliers": "Pliers",
    "Remote": "Remote",
    "Scissors": "Scissors",
    "Stapler": "Stapler",
    "Switch": "Switch",
    "USB": "USB",
    "Window": "Window",
}
"""The folder in which PartNet-Mobility keeps each category."""

CATEGORIES = tuple(FOLDERS)
"""Categories that are read."""

CONTAINERS = ("Bottle", "Dispenser")
"""Categories of known height, held around their side by the second hand."""

SHUT = ("Laptop", "Window")
"""Categories that are measured shut."""

STANDING = ("Laptop",)
"""Categories that rest on their base as modelled, whatever side is the thinnest while they are open."""

SHORTEST = 0.090
"""A container shorter than this has no room for two hands [m]."""

FRONT = np.array([-1.0, 0.0, 0.0])
"""Where the front of a model faces in the URDF's frame (ASSETS 4.2: the raw front +z becomes -x)."""

MOVING_DENSITY = 500.0
"""Mass over volume of the convex parts of lids and heads [kg/m^3]: half plastic, half air (as generated)."""

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

CONTAINER_NOTES = (
    f"masses supplied: {EVERYDAY['Bottle'].density:g} kg/m^3 for the body, {MOVING_DENSITY:g} kg/m^3 for moving parts",
    "joint friction supplied",
)


def present(root: Path) -> list[str]:
    """Categories that are read and have a folder under ``root``."""
    return [category for category, folder in FOLDERS.items() if (root / folder).is_dir()]


def names(root: Path, category: str, split: Split | None = None) -> list[str]:
    """Sorted folder names of ``category`` under ``root``; of one split when given."""
    folder = root / FOLDERS[category]
    if not folder.is_dir():
        have = ", ".join(sorted(path.name for path in root.iterdir() if path.is_dir())) or "no folders"
        raise BadInput(f"The folder {root} has no {FOLDERS[category]}; it has: {have}.")
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
    model, notes = simplified(read(root / FOLDERS[category] / instance), category)
    if EVERYDAY[category].lies and category not in STANDING:
        model = model.turned(flat_rotation(model.vertices(*model.meshes), FRONT))
    factor, sized = _scale(model, category)
    metric = model.scaled(factor)
    function = operated(metric, category)
    return realise(_design(metric, function, source, category, (sized, *notes, *function.notes)))


def _scale(model: Mobility, category: str) -> tuple[float, str]:
    """Metres per model unit, and how it was found."""
    container = category in CONTAINERS
    rest = {} if container else {joint.name: rest_position(joint) for joint in model.joints.values()}
    extent = np.ptp(posed(model, rest | (shut(model).starts if category in SHUT else {})), axis=0)
    if extent.min() <= 0.0:
        raise BadAsset(model.instance, "it is flat")
    narrow = float(extent[:2].min() if container else extent.min())
    long = float(extent[2] if container else extent.max())
    factor = min(EVERYDAY[category].size / long, WIDEST_GRIP / narrow)
    if container and factor * float(extent.max()) < SHORTEST:
        raise BadAsset(
            model.instance,
            f"at a width of {1000 * WIDEST_GRIP:.0f} mm it is {1000 * factor * extent.max():.0f} mm long, "
            f"less than {1000 * SHORTEST:.0f} mm",
        )
    side = "tall" if container else "long"
    return factor, f"size supplied: {1000 * factor * long:.0f} mm {side} and {1000 * factor * narrow:.0f} mm narrow"


def _design(model: Mobility, function: Function, source: str, category: str, notes: tuple[str, ...]) -> Design:
    body = model.vertices(ROOT)
    middle = 0.5 * (body.min(axis=0) + body.max(axis=0))
    origins = {ROOT: middle} | {child: joint.origin for child, joint in model.joints.items()}
    links, weighed = _links(model, origins, function, category)
    if not links[0].solids:
        raise BadAsset(model.instance, "its body has no volume")
    return Design(
        source=source,
        category=category,
        instance=model.instance,
        topology=_topology(model, function),
        split=split_of(model.instance),
        links=links,
        joints=tuple(_joint(joint, origins[joint.parent], function, category) for joint in model.joints.values()),
        part=function.part_from(middle),
        long_axis=_long_axis(model, function),
        notes=(*notes[:1], *weighed, *notes[1:]),
    )


def _topology(model: Mobility, function: Function) -> str:
    joints = list(model.joints.values()) if function.part is None else model.chain(function.part.link)
    return "+".join(joint.type for joint in joints) or "rigid"


def _links(
    model: Mobility, origins: dict[str, Array], function: Function, category: str
) -> tuple[tuple[Link, ...], tuple[str, ...]]:
    """The links, body first, and how their masses were found."""
    meshes = {name: tuple(moved(mesh, -origins[name]) for mesh in model.meshes[name]) for name in origins}
    container = category in CONTAINERS
    solids = {name: convex_parts(shapes) if container else lumped(shapes) for name, shapes in meshes.items()}
    if container:
        density, notes = EVERYDAY[category].density, CONTAINER_NOTES
    else:
        density, supplied = density_for(category, sum(volume(part) for parts in solids.values() for part in parts))
        notes = (*supplied, *(("joint friction supplied",) if model.joints else ()))
    operated_link = "" if function.part is None else function.part.link
    return tuple(
        Link(
            name=_written(name),
            solids=solids[name],
            density=MOVING_DENSITY if container and name != ROOT else density,
            colour=BODY_COLOUR if name == ROOT else PART_COLOUR if name == operated_link else OTHER_COLOUR,
            visual=merged(meshes[name]) if meshes[name] else None,
        )
        for name in (ROOT, *model.joints)
    ), notes


def _joint(joint: MovingJoint, origin: Array, function: Function, category: str) -> Joint:
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
                physics=JointPhysics(start, _friction(joint, function, category)),
            )
        case other:
            raise ValueError(f"a movable joint of type {other}")


def _friction(joint: MovingJoint, function: Function, category: str) -> float:
    part = function.part
    if joint.type == "prismatic":
        return PRESS_FRICTION if part is not None and part.kind == "press" else PULL_FRICTION
    if part is None or joint.name != part.joint:
        return SPIN_FRICTION if category in CONTAINERS else EVERYDAY[category].hinge
    return PRESS_FRICTION * part.lever if part.kind == "press" else SCREW_FRICTION


def _long_axis(model: Mobility, function: Function) -> Array:
    """The coordinate axis of the largest extent, towards the functional part."""
    everything = posed(model, {} if function.part is not None else function.starts)
    extent = np.ptp(everything, axis=0)
    axis = np.eye(3)[int(np.argmax(extent))]
    if function.part is None:
        return np.asarray(axis)
    towards = function.part.point - model.vertices(ROOT).mean(axis=0)
    return np.asarray(axis if axis @ towards >= 0.0 else -axis)


def _written(link: str) -> str:
    """The name in the rewritten URDF."""
    return "body" if link == ROOT else link
