"""The robot of MotionBenchMaker's Panda problems: PyBullet's URDF with that benchmark's limits and fixed fingers."""

from __future__ import annotations

import importlib.util
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from robots.errors import BadInput
from robots.spatial import frozen

JOINTS = tuple(f"panda_joint{k}" for k in range(1, 8))

LOWER = frozen([-2.9671, -1.8326, -2.9671, -3.1416, -2.9671, -0.0873, -2.9671])
UPPER = frozen([2.9671, 1.8326, 2.9671, 0.0873, 2.9671, 3.8223, 2.9671])
"""Joint limits [rad] of robowflex's panda, which the problems were made for."""

VELOCITY = frozen([2.1750, 2.1750, 2.1750, 2.1750, 2.6100, 2.6100, 2.6100])
ACCELERATION = frozen([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0])
"""Franka Control Interface documentation, "Limits for Panda" [rad/s] and [rad/s^2]."""

FINGERS = 0.065
"""Opening of one finger [m]; both are fixed there, beyond the real hand's 0.04 m."""

LINKS = tuple(f"panda_{name}" for name in (*(f"link{k}" for k in range(8)), "hand", "leftfinger", "rightfinger"))
_TIP = LINKS[5:]

SELF_PAIRS = tuple([(base, tip) for base in LINKS[:3] for tip in _TIP] + [("panda_link5", tip) for tip in LINKS[7:]])
"""Links of the robot that can meet, after the benchmark's semantic description."""


def urdf() -> str:
    """The URDF text: seven joints, meshes with absolute names."""
    package = importlib.util.find_spec("pybullet_data")
    if package is None or not package.submodule_search_locations:
        raise BadInput("The benchmark's robot needs the Python package pybullet_data (it comes with pybullet).")
    folder = Path(package.submodule_search_locations[0]) / "franka_panda"
    root = ET.parse(folder / "panda.urdf").getroot()
    for mesh in root.iter("mesh"):
        mesh.set("filename", str(folder / str(mesh.get("filename")).removeprefix("package://")))
    for joint in root.findall("joint"):
        name = str(joint.get("name"))
        if name in JOINTS:
            _limit(joint, JOINTS.index(name))
        elif name.startswith("panda_finger_joint"):
            _fix(joint)
    return ET.tostring(root, encoding="unicode")


def _limit(joint: ET.Element, k: int) -> None:
    for old in joint.findall("limit") + joint.findall("safety_controller"):
        joint.remove(old)
    low, high, speed = repr(float(LOWER[k])), repr(float(UPPER[k])), repr(float(VELOCITY[k]))
    ET.SubElement(joint, "limit", lower=low, upper=high, velocity=speed, effort="87")


def _fix(joint: ET.Element) -> None:
    """Turn a finger's slide into a fixed joint at ``FINGERS`` along its axis."""
    axis = np.array([float(value) for value in str(_child(joint, "axis").get("xyz")).split()])
    origin = _child(joint, "origin")
    moved = np.array([float(value) for value in str(origin.get("xyz")).split()]) + FINGERS * axis
    origin.set("xyz", " ".join(repr(float(value)) for value in moved))
    joint.set("type", "fixed")
    for tag in ("axis", "limit", "mimic", "safety_controller", "dynamics"):
        for old in joint.findall(tag):
            joint.remove(old)


def _child(element: ET.Element, tag: str) -> ET.Element:
    found = element.find(tag)
    if found is None:
        raise BadInput(f"The Panda URDF has a {element.tag} {element.get('name')} without {tag}.")
    return found
