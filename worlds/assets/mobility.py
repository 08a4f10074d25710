"""What does a PartNet-Mobility folder say: which links, which meshes, which joints, in one z-up frame?

The frame is that of the URDF's ``base`` link at joint positions zero; every link frame is taken parallel to it.
Links that a fixed joint holds are folded into what they are fixed to.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pinocchio as pin

from robots.errors import BadAsset
from robots.spatial import Array, points, pose, unit
from worlds.assets.solids import Mesh

ROOT = "base"


@dataclass(frozen=True, slots=True, eq=False)
class MovingJoint:
    """A movable joint.

    Attributes:
        name: URDF name.
        type: ``prismatic``, ``revolute`` or ``continuous``.
        parent: Carrier of the joint.
        child: What it moves.
        origin: A point on the axis ``(3,)``.
        axis: Unit vector ``(3,)``.
        lower: Lower limit; 0 for continuous.
        upper: Upper limit; 0 for continuous.
    """

    name: str
    type: str
    parent: str
    child: str
    origin: Array
    axis: Array
    lower: float
    upper: float


@dataclass(frozen=True, slots=True, eq=False)
class Mobility:
    """An articulated model in its own unit of length.

    Attributes:
        instance: Folder name.
        meshes: Meshes of each link by name, ``base`` being the fixed body.
        joints: Movable joints by the name of the link they move.
        semantics: ``(joint kind, part name)`` of each annotated link, by the link that carries it.
    """

    instance: str
    meshes: dict[str, tuple[Mesh, ...]]
    joints: dict[str, MovingJoint]
    semantics: dict[str, tuple[str, str]]

    def vertices(self, *links: str) -> Array:
        """All vertices ``(n, 3)`` of the named links."""
        return np.concatenate([np.zeros((0, 3)), *(mesh.vertices for link in links for mesh in self.meshes[link])])

    def chain(self, link: str) -> list[MovingJoint]:
        """The joints between the body and ``link``, body first."""
        joints: list[MovingJoint] = []
        while link in self.joints:
            joints.insert(0, self.joints[link])
            link = self.joints[link].parent
        return joints

    def scaled(self, factor: float) -> Mobility:
        """The model with every length times ``factor``, prismatic limits included."""
        joints = {}
        for child, joint in self.joints.items():
            reach = factor if joint.type == "prismatic" else 1.0
            joints[child] = replace(
                joint, origin=joint.origin * factor, lower=joint.lower * reach, upper=joint.upper * reach
            )
        meshes = {
            link: tuple(Mesh(mesh.vertices * factor, mesh.faces) for mesh in shapes)
            for link, shapes in self.meshes.items()
        }
        return replace(self, meshes=meshes, joints=joints)

    def turned(self, R: Array) -> Mobility:
        """The model turned by the rotation ``R`` ``(3, 3)`` about the origin."""
        joints = {
            child: replace(joint, origin=R @ joint.origin, axis=R @ joint.axis) for child, joint in self.joints.items()
        }
        meshes = {
            link: tuple(Mesh(mesh.vertices @ R.T, mesh.faces) for mesh in shapes)
            for link, shapes in self.meshes.items()
        }
        return replace(self, meshes=meshes, joints=joints)


def read(folder: Path) -> Mobility:
    """The model in ``folder``; ``BadAsset`` says what is wrong with it."""
    try:
        return _Reader(folder).read()
    except _Broken as broken:
        raise BadAsset(folder.name, str(broken)) from broken


class _Broken(Exception):
    """The reason, in one clause."""


class _Reader:
    """One pass over a folder; holds the URDF's joints while links are placed."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._robot = _parsed(folder / "mobility.urdf")
        self._above: dict[str, ET.Element] = {_name(joint, "child"): joint for joint in self._robot.iter("joint")}

    def read(self) -> Mobility:
        links = [link.get("name", "") for link in self._robot.iter("link")]
        for name in links:
            self._placed(name)
        carriers = {name: self._carrier(name) for name in links}
        meshes: dict[str, tuple[Mesh, ...]] = dict.fromkeys([ROOT, *carriers.values()], ())
        for link in self._robot.iter("link"):
            meshes[carriers[link.get("name", "")]] += self._meshes(link)
        joints = {child: self._joint(child, carriers) for child in meshes if child != ROOT}
        if not meshes[ROOT]:
            raise _Broken("it has no fixed body")
        return Mobility(self._folder.name, meshes, joints, self._semantics(carriers))

    def _carrier(self, link: str) -> str:
        """The link itself or, through fixed joints, what it is part of."""
        while link != ROOT and self._joint_above(link).get("type") == "fixed":
            link = _name(self._above[link], "parent")
        return link

    def _joint_above(self, link: str) -> ET.Element:
        if link not in self._above:
            raise _Broken(f"no joint holds the link {link}")
        return self._above[link]

    def _placed(self, link: str) -> pin.SE3:
        """``T_base_link`` at joint positions zero."""
        T_base_link = pin.SE3.Identity()
        for _ in range(len(self._above) + 1):
            if link == ROOT:
                return T_base_link
            joint = self._joint_above(link)
            T_base_link = _origin(joint) * T_base_link
            link = _name(joint, "parent")
        raise _Broken(f"its joints form a ring at the link {link}")

    def _meshes(self, link: ET.Element) -> tuple[Mesh, ...]:
        T_base_link = self._placed(link.get("name", ""))
        meshes = []
        for visual in link.findall("visual"):
            shape = visual.find("geometry/mesh")
            if shape is not None:
                mesh = _read_obj(self._folder / shape.get("filename", ""))
                meshes.append(Mesh(points(T_base_link * _origin(visual), mesh.vertices), mesh.faces))
        return tuple(meshes)

    def _joint(self, child: str, carriers: dict[str, str]) -> MovingJoint:
        joint = self._joint_above(child)
        kind, name = joint.get("type", ""), joint.get("name", "")
        if kind not in ("prismatic", "revolute", "continuous"):
            raise _Broken(f'its joint {name} has the type "{kind}"')
        T_base_child = self._placed(child)
        axis = _triple(joint.find("axis"), "xyz", (1.0, 0.0, 0.0))
        if not axis.any():
            raise _Broken(f"its joint {name} has no axis direction")
        lower, upper = _limits(joint) if kind != "continuous" else (0.0, 0.0)
        return MovingJoint(
            name=name,
            type=kind,
            parent=carriers[_name(joint, "parent")],
            child=child,
            origin=np.array(T_base_child.translation),
            axis=unit(T_base_child.rotation @ axis),
            lower=lower,
            upper=upper,
        )

    def _semantics(self, carriers: dict[str, str]) -> dict[str, tuple[str, str]]:
        path = self._folder / "semantics.txt"
        if not path.is_file():
            raise _Broken("its semantics.txt is missing")
        rows = [line.split() for line in path.read_text(errors="replace").splitlines()]
        return {carriers[row[0]]: (row[1], row[2]) for row in rows if len(row) == 3 and row[0] in carriers}


def _parsed(path: Path) -> ET.Element:
    try:
        return ET.fromstring(path.read_text())
    except FileNotFoundError:
        raise _Broken("its mobility.urdf is missing") from None
    except (ET.ParseError, UnicodeDecodeError) as error:
        raise _Broken(f"its mobility.urdf is not valid XML ({error})") from error


def _name(joint: ET.Element, role: str) -> str:
    found = joint.find(role)
    if found is None:
        raise _Broken(f"its joint {joint.get('name')} has no {role}")
    return found.get("link", "")


def _triple(element: ET.Element | None, key: str, default: tuple[float, float, float]) -> Array:
    text = None if element is None else element.get(key)
    if text is None:
        return np.array(default)
    values = _floats(text.split(), f'the numbers "{text}" in its mobility.urdf')
    if values.shape != (3,):
        raise _Broken(f'"{text}" in its mobility.urdf is not three numbers')
    return values


def _origin(element: ET.Element) -> pin.SE3:
    origin = element.find("origin")
    return pose(_triple(origin, "xyz", (0.0, 0.0, 0.0)), _triple(origin, "rpy", (0.0, 0.0, 0.0)))


def _limits(joint: ET.Element) -> tuple[float, float]:
    limit = joint.find("limit")
    if limit is None:
        raise _Broken(f"its joint {joint.get('name')} has no limits")
    lower, upper = _floats([limit.get("lower", "0"), limit.get("upper", "0")], f"a limit of {joint.get('name')}")
    if lower > upper:
        raise _Broken(f"its joint {joint.get('name')} has limits in the wrong order ({lower:g} > {upper:g})")
    return float(lower), float(upper)


def _floats(words: list[str], what: str) -> Array:
    try:
        values = np.array([float(word) for word in words])
    except ValueError:
        raise _Broken(f"{what} cannot be read") from None
    if not np.isfinite(values).all():
        raise _Broken(f"{what} are not finite")
    return values


def _read_obj(path: Path) -> Mesh:
    """The triangles of an OBJ file, polygons fanned; texture and normals are not read."""
    name = f"{path.parent.name}/{path.name}"
    if not path.is_file():
        raise _Broken(f"its mesh {name} is missing")
    vertices: list[list[str]] = []
    faces: list[tuple[int, int, int]] = []
    for line in path.read_text(errors="replace").splitlines():
        match line.split():
            case ["v", x, y, z, *_]:
                vertices.append([x, y, z])
            case ["f", *corners]:
                ring = [_corner(corner, len(vertices), name) for corner in corners]
                faces += [(ring[0], b, c) for b, c in pairwise(ring[1:])]
    if not vertices or not faces:
        raise _Broken(f"its mesh {name} has no triangles")
    values = _floats([word for row in vertices for word in row], f"vertices of {name}")
    return Mesh(values.reshape(-1, 3), np.array(faces, dtype=np.int64))


def _corner(text: str, count: int, name: str) -> int:
    try:
        index = int(text.partition("/")[0])
    except ValueError:
        raise _Broken(f"a face of {name} cannot be read") from None
    index = index - 1 if index > 0 else count + index
    if not 0 <= index < count:
        raise _Broken(f"a face of {name} names vertex {index + 1} of {count}")
    return index
