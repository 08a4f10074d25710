"""Which mesh files make up an object that a URDF or MJCF file describes, and where is each of them placed?

Only what is seen is read; joints stay at zero. The frame is that of the first body with a mesh: poses above it say
where the object stands in its author's scene.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pinocchio as pin

from robots.spatial import Array, pose
from worlds.assets.meshfile import Unreadable

DEEPEST = 8
"""Includes in includes are followed no further than this."""


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """A mesh file, scaled by ``scale`` ``(3,)`` and then moved by ``T_object_mesh``."""

    path: Path
    scale: Array
    T_object_mesh: pin.SE3


@dataclass(frozen=True, slots=True, eq=False)
class Described:
    """The mesh files of one object and notes on what its description lacks."""

    meshes: tuple[Placed, ...]
    notes: tuple[str, ...] = field(default=())


def read_urdf(path: Path) -> Described:
    """What the URDF shows, else what it collides with; ``Unreadable`` when it names no mesh."""
    robot = _parsed(path)
    for kind in ("visual", "collision"):
        found = [placed for link, T in _urdf_links(robot) for placed in _urdf_meshes(link, T, kind, path.parent)]
        if found:
            return Described(tuple(found))
    raise Unreadable(f"its {path.name} names no mesh")


def _urdf_links(robot: ET.Element) -> Iterator[tuple[ET.Element, pin.SE3]]:
    above: dict[str, tuple[str, pin.SE3]] = {}
    for joint in robot.iter("joint"):
        parent, child = (
            element.get("link", "") if (element := joint.find(role)) is not None else "" for role in ("parent", "child")
        )
        above[child] = (parent, _urdf_origin(joint))
    for link in robot.iter("link"):
        T, name, steps = pin.SE3.Identity(), link.get("name", ""), 0
        while name in above and steps <= len(above):
            name, T = above[name][0], above[name][1] * T
            steps += 1
        if steps > len(above):
            raise Unreadable(f"its joints form a ring at the link {name}")
        yield link, T


def _urdf_meshes(link: ET.Element, T_object_link: pin.SE3, kind: str, folder: Path) -> Iterator[Placed]:
    for shape in link.findall(kind):
        mesh = shape.find("geometry/mesh")
        if mesh is not None:
            name = mesh.get("filename", "").removeprefix("file://")
            scale = _numbers(mesh.get("scale", "1 1 1"), 3)
            yield Placed(_inside(folder, name), scale, T_object_link * _urdf_origin(shape))


def _urdf_origin(element: ET.Element) -> pin.SE3:
    origin = element.find("origin")
    if origin is None:
        return pin.SE3.Identity()
    return pose(_numbers(origin.get("xyz", "0 0 0"), 3), _numbers(origin.get("rpy", "0 0 0"), 3))


def read_mjcf(path: Path) -> Described:
    """The meshes an MJCF file shows, else those it collides with; ``Unreadable`` when it names none."""
    missing: list[str] = []
    model = _included(_parsed(path), path.parent, missing, 0)
    scene = _Scene(model, path.parent)
    geoms = list(scene.geoms())
    shown = [placed for placed, seen in geoms if seen] or [placed for placed, _ in geoms]
    if not shown:
        raise Unreadable(f"its {path.name} names no mesh")
    return Described(tuple(shown), tuple(f"its include {name} is missing" for name in missing))


def _included(element: ET.Element, folder: Path, missing: list[str], depth: int) -> ET.Element:
    """``element`` with its includes replaced by what they hold."""
    whole = ET.Element(element.tag, element.attrib)
    for child in element:
        if child.tag != "include":
            whole.append(_included(child, folder, missing, depth))
            continue
        file = folder / child.get("file", "")
        if depth >= DEEPEST:
            raise Unreadable(f"its includes are nested more than {DEEPEST} deep")
        if file.is_file():
            whole.extend(_included(_parsed(file), folder, missing, depth + 1))
        else:
            missing.append(child.get("file", ""))
    return whole


class _Scene:
    """An MJCF model whose includes are resolved."""

    def __init__(self, model: ET.Element, folder: Path) -> None:
        compiler: dict[str, str] = {}
        for element in model.iter("compiler"):
            compiler |= element.attrib
        self._to_radians = 1.0 if compiler.get("angle") == "radian" else np.pi / 180.0
        self._folder = folder / compiler.get("meshdir", compiler.get("assetdir", ""))
        self._model = model
        self._files = {
            mesh.get("name") or Path(mesh.get("file", "")).stem: (mesh.get("file", ""), mesh.get("scale", "1 1 1"))
            for asset in model.iter("asset")
            for mesh in asset.iter("mesh")
        }

    def geoms(self) -> Iterator[tuple[Placed, bool]]:
        """Every geometry with a mesh, and whether it is only seen."""
        for world in self._model.iter("worldbody"):
            yield from self._below(world, None)

    def _below(self, body: ET.Element, T_object_body: pin.SE3 | None) -> Iterator[tuple[Placed, bool]]:
        geoms = [geom for geom in body.findall("geom") if geom.get("mesh")]
        if T_object_body is None and geoms:
            T_object_body = pin.SE3.Identity()
        for geom in geoms:
            yield self._placed(geom, T_object_body), _only_seen(geom)
        for child in body.findall("body"):
            yield from self._below(child, None if T_object_body is None else T_object_body * self._pose(child))

    def _placed(self, geom: ET.Element, T_object_body: pin.SE3 | None) -> Placed:
        name = geom.get("mesh", "")
        if name not in self._files:
            raise Unreadable(f'its geometry names the mesh "{name}", which is not among its assets')
        file, scale = self._files[name]
        base = T_object_body or pin.SE3.Identity()
        return Placed(_inside(self._folder, file), _numbers(scale, 3), base * self._pose(geom))

    def _pose(self, element: ET.Element) -> pin.SE3:
        from scipy.spatial.transform import Rotation

        R = np.eye(3)
        if quat := element.get("quat"):
            w, x, y, z = _numbers(quat, 4)
            if w * w + x * x + y * y + z * z < 1e-12:
                raise Unreadable(f'its quaternion "{quat}" is zero')
            R = Rotation.from_quat([x, y, z, w]).as_matrix()
        elif euler := element.get("euler"):
            R = Rotation.from_euler("XYZ", self._to_radians * _numbers(euler, 3)).as_matrix()
        elif turn := element.get("axisangle"):
            *axis, angle = _numbers(turn, 4)
            R = Rotation.from_rotvec(np.array(axis) * self._to_radians * angle).as_matrix()
        return pin.SE3(R, _numbers(element.get("pos", "0 0 0"), 3))


def _only_seen(geom: ET.Element) -> bool:
    """Whether a geometry is there for the eye, by its contact bits or, as authors do, by name."""
    if geom.get("contype") == "0":
        return True
    return any("visual" in (geom.get(key) or "").lower() for key in ("class", "name"))


def _inside(folder: Path, name: str) -> Path:
    """The file ``name`` seen from ``folder``."""
    if not name or name.startswith(("package://", "http:", "https:")):
        raise Unreadable(f'its mesh "{name}" is not a file beside its description')
    return folder / name


def _parsed(path: Path) -> ET.Element:
    try:
        text = path.read_text(errors="replace")
    except OSError as error:
        raise Unreadable(f"its {path.name} cannot be read ({error.strerror})") from error
    try:
        return ET.fromstring(_without_declaration(text))
    except ET.ParseError as error:
        raise Unreadable(f"its {path.name} is not valid XML ({error})") from error


def _without_declaration(text: str) -> str:
    """``text`` without its first line ``<?xml ...?>``: some models say ``version="0.0"``, which no parser knows."""
    text = text.lstrip("\ufeff \t\r\n")
    return text[text.find("?>") + 2 :] if text.startswith("<?xml") and "?>" in text else text


def _numbers(text: str, count: int) -> Array:
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        raise Unreadable(f'the numbers "{text}" in its description cannot be read') from None
    if values.shape != (count,) or not np.isfinite(values).all():
        raise Unreadable(f'"{text}" in its description is not {count} finite numbers')
    return values
