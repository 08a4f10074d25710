"""What the arms are to Pinocchio and to PyBullet: one URDF text per side, with world-unique names."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from robots.cache import cache_dir, content_hash, write_atomic
from robots.errors import BadWorkcell
from robots.spatial import Array, frozen
from robots.workcell import SIDES, Side, Workcell, urdf_file


def arm_urdf(workcell: Workcell, side: Side) -> str:
    """The URDF text of one arm: names prefixed ``side/``, rooted at ``world``, limits from the workcell."""
    arm, placement = workcell.arm(side), workcell.placement(side)
    source = urdf_file(arm)
    root = ET.parse(source).getroot()
    _resolve_meshes(root, source.parent)
    _set_limits(root, workcell, side)
    root.set("name", side)
    for link in root.iter("link"):
        link.set("name", f"{side}/{link.get('name')}")
    for joint in root.findall("joint"):
        joint.set("name", f"{side}/{joint.get('name')}")
        for end in ("parent", "child"):
            node = _child(joint, end)
            node.set("link", f"{side}/{node.get('link')}")
        for mimic in joint.findall("mimic"):
            joint.remove(mimic)  # both fingers are driven; the simulator couples them as the real hand does
    root.append(ET.Element("link", name=f"{side}/world"))
    fixed = ET.SubElement(root, "joint", name=f"{side}/mount", type="fixed")
    ET.SubElement(fixed, "parent", link=f"{side}/world")
    ET.SubElement(fixed, "child", link=f"{side}/{arm.base_link}")
    ET.SubElement(fixed, "origin", xyz=_numbers(placement.base_xyz), rpy=_numbers(placement.base_rpy))
    return ET.tostring(root, encoding="unicode")


def arm_urdf_file(workcell: Workcell, side: Side) -> Path:
    """``arm_urdf`` as a file in the cache, written once per content."""
    text = arm_urdf(workcell, side)
    path = cache_dir() / "robots" / f"{side}-{content_hash(text)}.urdf"
    return path if path.is_file() else write_atomic(path, text)


def _child(element: ET.Element, tag: str) -> ET.Element:
    node = element.find(tag)
    if node is None:
        raise BadWorkcell(f"The arm URDF has a {element.tag} {element.get('name')} without {tag}.")
    return node


def _numbers(values: tuple[float, ...]) -> str:
    return " ".join(repr(float(v)) for v in values)


def _resolve_meshes(root: ET.Element, folder: Path) -> None:
    """Make every mesh file name absolute."""
    for mesh in root.iter("mesh"):
        name = str(mesh.get("filename"))
        path = folder / name.removeprefix("package://")
        if not path.is_file():
            raise BadWorkcell(f"The arm URDF names a mesh that does not exist: {path}")
        mesh.set("filename", str(path))


def _set_limits(root: ET.Element, workcell: Workcell, side: Side) -> None:
    arm = workcell.arm(side)
    rows = {name: (arm.lower[i], arm.upper[i], arm.velocity[i], arm.torque[i]) for i, name in enumerate(arm.joints)}
    grip = arm.gripper
    rows |= {name: (0.0, grip.finger_travel, grip.finger_velocity, grip.force_limit) for name in grip.finger_joints}
    found = {str(joint.get("name")): joint for joint in root.findall("joint")}
    for name, (low, high, velocity, effort) in rows.items():
        if name not in found:
            raise BadWorkcell(f"The arm URDF has no joint {name}; it has: {', '.join(found)}.")
        joint = found[name]
        for old in joint.findall("limit") + joint.findall("safety_controller"):
            joint.remove(old)
        ET.SubElement(joint, "limit", lower=repr(low), upper=repr(high), velocity=repr(velocity), effort=repr(effort))


class ArmKinematics:
    """Forward kinematics of one arm: seven joints, a hand frame and a tool centre point.

    Attributes:
        side: Which arm.
        model: Pinocchio model of the seven arm joints alone, rooted at the world.
        lower, upper: Joint limits ``(7,)`` [rad].
        home: Waiting configuration ``(7,)`` [rad].
        T_hand_tcp: From the tool centre point to the hand frame.
    """

    def __init__(self, workcell: Workcell, side: Side) -> None:
        arm = workcell.arm(side)
        full = pin.buildModelFromXML(arm_urdf(workcell, side))
        fingers = [full.getJointId(f"{side}/{name}") for name in arm.gripper.finger_joints]
        self.side = side
        self.model = pin.buildReducedModel(full, fingers, pin.neutral(full))
        if self.model.nq != 7:
            raise BadWorkcell(f"The {side} arm has {self.model.nq} joints beside its fingers; 7 are needed.")
        self.data = self.model.createData()
        self.lower, self.upper = frozen(arm.lower), frozen(arm.upper)
        self.home = frozen(workcell.placement(side).home)
        self.T_hand_tcp = pin.SE3(np.eye(3), np.array([0.0, 0.0, arm.gripper.tcp_offset]))
        self.hand_frame = int(self.model.getFrameId(f"{side}/{arm.gripper.hand_link}"))
        self.hand_joint = int(self.model.frames[self.hand_frame].parentJoint)

    @cached_property
    def base(self) -> Array:
        """Position of the first joint in the world frame ``(3,)`` [m]."""
        return frozen(self.model.jointPlacements[1].translation)

    def hand(self, q: Any) -> pin.SE3:
        """``T_world_hand`` at joint positions ``q`` ``(7,)`` [rad]."""
        pin.forwardKinematics(self.model, self.data, np.asarray(q, dtype=np.float64))
        return pin.updateFramePlacement(self.model, self.data, self.hand_frame).copy()

    def tcp(self, q: Any) -> pin.SE3:
        """``T_world_tcp`` at joint positions ``q`` ``(7,)`` [rad]."""
        return self.hand(q) * self.T_hand_tcp

    def within_limits(self, q: Any, tolerance: float = 1e-9) -> bool:
        """Whether every joint of ``q`` ``(7,)`` [rad] lies inside its limits."""
        return bool(np.all(q >= self.lower - tolerance) and np.all(q <= self.upper + tolerance))


class DualArm:
    """Both arms of a workcell, by side."""

    def __init__(self, workcell: Workcell) -> None:
        self.workcell = workcell
        self.arms: dict[Side, ArmKinematics] = {side: ArmKinematics(workcell, side) for side in SIDES}

    def __getitem__(self, side: Side) -> ArmKinematics:
        return self.arms[side]

    @property
    def home(self) -> Array:
        """Both waiting configurations, left then right ``(14,)`` [rad]."""
        return frozen(np.concatenate([self.arms[side].home for side in SIDES]))
