"""How does a described object become an ``Asset``: a URDF with meshes in the cache, and one digest of it all?

Load the URDF with PyBullet's ``URDF_USE_INERTIA_FROM_FILE``, else the inertia written here is replaced by a guess.
"""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from robots.cache import cache_dir, content_hash, write_atomic
from robots.spatial import Array
from worlds.assets.asset import Asset, FunctionalPart, JointPhysics, Split
from worlds.assets.solids import MassProperties, Mesh, mass_properties, merged

SPECK = MassProperties(0.001, np.zeros(3), 1e-7 * np.eye(3))
"""What a link without shapes weighs: one gram, as a 16 mm ball; Bullet needs every link to have inertia."""

LEAST_MOVING_MASS = 0.020
"""Least mass of a moving link with shapes [kg]: a pump's head with its stem, spring and piston weighs as much.

The solver passes friction on in small impulses, each at most the link's mass times its speed. Measured at 150
iterations: a 5 g head gave way at 0.7 of its resistance, a 20 g head between 0.9 and 1.1.
"""

ARMATURE = 3e-4
"""Inertia added to a turning link [kg m^2], for the same reason: a 12 g cap alone (2e-6) turned at a fifth of its
0.29 N m, with 3e-4 at 0.25 to 0.29 (0.3 to 0.7 rad/s). At 5 rad/s^2 it costs 1.5 mN m, far below any friction."""


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """One rigid part, in its own frame.

    Attributes:
        name: URDF link name.
        solids: Convex collision shapes; empty for a link that only carries a second joint.
        density: Effective density of the solids [kg/m^3].
        colour: Red, green, blue in 0..1.
        visual: What cameras see; the solids when None.
    """

    name: str
    solids: tuple[Mesh, ...]
    density: float
    colour: tuple[float, float, float]
    visual: Mesh | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """One joint; parent and child frames are parallel at position zero.

    Attributes:
        name: URDF joint name.
        type: URDF joint type.
        parent: Parent link.
        child: Child link.
        origin: Child frame ``(3,)`` in the parent frame [m].
        axis: Unit vector ``(3,)``.
        lower: Lower limit [m] or [rad]; unused for continuous.
        upper: Upper limit [m] or [rad]; unused for continuous.
        physics: Start position and resistance.
    """

    name: str
    type: Literal["prismatic", "revolute", "continuous"]
    parent: str
    child: str
    origin: Array
    axis: Array
    lower: float
    upper: float
    physics: JointPhysics


@dataclass(frozen=True, slots=True, eq=False)
class Design:
    """Everything needed to write an asset.

    Attributes:
        source: As in ``Asset``; so are category, instance, topology, split, part, long_axis and notes.
        links: Body first.
        joints: In any order.
    """

    source: str
    category: str
    instance: str
    topology: str
    split: Split
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    part: FunctionalPart | None
    long_axis: Array
    notes: tuple[str, ...] = ()


def realise(design: Design) -> Asset:
    """The asset of ``design``, its files written to the cache unless they are there already."""
    above = {joint.child: joint for joint in design.joints}
    masses = {link.name: _mass_of(link, above.get(link.name)) for link in design.links}
    meshes = {name: _obj(mesh) for link in design.links for name, mesh in _meshes_of(link)}
    relative = _urdf(design, masses, prefix="")
    digest = content_hash(relative, _physics_text(design), *(part for item in sorted(meshes.items()) for part in item))
    folder = cache_dir().absolute() / "assets" / digest
    for name, text in meshes.items():
        _put(folder / name, text)
    urdf = _put(folder / "model.urdf", _urdf(design, masses, prefix=f"{folder}/"))
    return Asset(
        source=design.source,
        category=design.category,
        instance=design.instance,
        topology=design.topology,
        split=design.split,
        urdf=urdf,
        function=design.part,
        joints={joint.name: joint.physics for joint in design.joints},
        long_axis=design.long_axis,
        mass=sum(properties.mass for properties in masses.values()),
        content_hash=digest,
        notes=design.notes,
    )


def _mass_of(link: Link, above: Joint | None) -> MassProperties:
    if not link.solids:
        return SPECK
    found = mass_properties(link.solids, link.density)
    if above is None:
        return found
    heavier = max(1.0, LEAST_MOVING_MASS / found.mass)
    armature = 0.0 if above.type == "prismatic" else ARMATURE
    return MassProperties(heavier * found.mass, found.centre, heavier * found.inertia + armature * np.eye(3))


def _meshes_of(link: Link) -> Iterable[tuple[str, Mesh]]:
    if link.solids:
        yield f"{link.name}_visual.obj", link.visual or merged(link.solids)
    for index, solid in enumerate(link.solids):
        yield f"{link.name}_{index:02d}.obj", solid


def _put(path: Path, text: str) -> Path:
    """Write ``text`` unless the file already holds it."""
    if not path.is_file() or path.read_text() != text:
        write_atomic(path, text)
    return path


def _obj(mesh: Mesh) -> str:
    lines = [f"v {_number(x)} {_number(y)} {_number(z)}" for x, y, z in mesh.vertices]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.faces]
    return "\n".join(lines) + "\n"


def _physics_text(design: Design) -> str:
    """The numbers that act in simulation but do not stand in the URDF."""
    part = design.part
    numbers: dict[str, Any] = {
        "joints": {joint.name: [joint.physics.start, joint.physics.friction] for joint in design.joints},
        "long_axis": _vector(design.long_axis),
    }
    if part is not None:
        numbers["part"] = [part.kind, part.link, part.joint, _vector(part.axis), _vector(part.point)]
        numbers["motion"] = [part.sense, part.start, part.travel, part.threshold, part.lever]
    if part is not None and part.facing is not None:
        numbers["facing"] = _vector(part.facing)
    return json.dumps(numbers, sort_keys=True)


def _urdf(design: Design, masses: dict[str, MassProperties], prefix: str) -> str:
    robot = ET.Element("robot", name=f"{design.category}_{design.instance}")
    for link in design.links:
        _add_link(robot, link, masses[link.name], prefix)
    for joint in design.joints:
        _add_joint(robot, joint)
    ET.indent(robot)
    return ET.tostring(robot, encoding="unicode") + "\n"


def _add_link(robot: ET.Element, link: Link, properties: MassProperties, prefix: str) -> None:
    element = ET.SubElement(robot, "link", name=link.name)
    inertial = ET.SubElement(element, "inertial")
    ET.SubElement(inertial, "origin", xyz=_vector(properties.centre), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=_number(properties.mass))
    tensor = {f"i{'xyz'[i]}{'xyz'[j]}": _number(properties.inertia[i, j]) for i in range(3) for j in range(i, 3)}
    ET.SubElement(inertial, "inertia", tensor)
    for file, _ in _meshes_of(link):
        shown = file.endswith("_visual.obj")
        shape = ET.SubElement(element, "visual" if shown else "collision")
        ET.SubElement(ET.SubElement(shape, "geometry"), "mesh", filename=f"{prefix}{file}")
        if shown:
            material = ET.SubElement(shape, "material", name=f"{link.name}_colour")
            ET.SubElement(material, "color", rgba=f"{_vector(link.colour)} 1")


def _add_joint(robot: ET.Element, joint: Joint) -> None:
    element = ET.SubElement(robot, "joint", name=joint.name, type=joint.type)
    ET.SubElement(element, "origin", xyz=_vector(joint.origin), rpy="0 0 0")
    ET.SubElement(element, "parent", link=joint.parent)
    ET.SubElement(element, "child", link=joint.child)
    ET.SubElement(element, "axis", xyz=_vector(joint.axis))
    limit = {"effort": "100", "velocity": "10"}
    if joint.type != "continuous":
        limit |= {"lower": _number(joint.lower), "upper": _number(joint.upper)}
    ET.SubElement(element, "limit", limit)


def _vector(values: Iterable[float]) -> str:
    return " ".join(_number(value) for value in values)


def _number(value: float) -> str:
    """Nine significant digits, with dust below a picometre or its like swept to zero."""
    return f"{0.0 if abs(value) < 1e-12 else float(value):.9g}"
