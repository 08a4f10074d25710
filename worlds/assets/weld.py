"""Which links of an imported model move for nothing, and what is left when they are welded to what carries them?

A remote's 57 buttons and a keyboard's 115 keys cost the simulator a joint each and change nothing about how the whole
is pushed, gripped or lifted.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from robots.spatial import Array, points, rotation_about
from worlds.assets.mobility import ROOT, Mobility, MovingJoint
from worlds.assets.solids import Mesh

MINOR = 0.35
"""A moving link whose longest side is less than this share of the whole model's is a button, a key or a knob."""


def motion(joint: MovingJoint, position: float) -> pin.SE3:
    """How ``joint`` at ``position`` [m] or [rad] moves what it carries, in the model frame."""
    if joint.type == "prismatic":
        return pin.SE3(np.eye(3), position * joint.axis)
    R = rotation_about(joint.axis, position)
    return pin.SE3(R, joint.origin - R @ joint.origin)


def displacement(model: Mobility, link: str, positions: dict[str, float]) -> pin.SE3:
    """How ``link`` has moved when the named joints stand at ``positions`` and all others at zero."""
    T = pin.SE3.Identity()
    for joint in model.chain(link):
        T = T * motion(joint, positions.get(joint.name, 0.0))
    return T


def posed(model: Mobility, positions: dict[str, float]) -> Array:
    """All vertices ``(n, 3)`` of the model with the named joints at ``positions``."""
    return np.concatenate([points(displacement(model, link, positions), model.vertices(link)) for link in model.meshes])


def minor(model: Mobility) -> set[str]:
    """The moving links that are small against the whole and carry nothing that is not."""
    whole = float(np.ptp(model.vertices(*model.meshes), axis=0).max())
    small = {link for link in model.joints if _longest(model.vertices(link)) < MINOR * whole}
    carriers = {above.child for link in model.joints if link not in small for above in model.chain(link)}
    return small - carriers


def _longest(vertices: Array) -> float:
    return float(np.ptp(vertices, axis=0).max()) if len(vertices) else 0.0


def rest_position(joint: MovingJoint) -> float:
    """The position closest to zero within the limits."""
    return 0.0 if joint.type == "continuous" else float(np.clip(0.0, joint.lower, joint.upper))


def welded(model: Mobility, links: set[str]) -> tuple[Mobility, tuple[str, ...]]:
    """The model with ``links`` fixed where they rest and counted to what carries them, and notes on it."""
    if not links:
        return model, ()
    meshes = {name: shapes for name, shapes in model.meshes.items() if name not in links}
    for link in sorted(links):
        T, carrier = pin.SE3.Identity(), link
        while carrier in links:
            joint = model.joints[carrier]
            T = motion(joint, rest_position(joint)) * T
            carrier = joint.parent
        meshes[carrier] += tuple(Mesh(points(T, mesh.vertices), mesh.faces) for mesh in model.meshes[link])
    joints = {
        child: replace(joint, parent=_carrier(model, joint.parent, links))
        for child, joint in model.joints.items()
        if child not in links
    }
    kinds = sorted({model.semantics.get(link, ("", "link"))[1] for link in links})
    note = f"{len(links)} moving parts fixed in place ({', '.join(kinds)})"
    return replace(model, meshes=meshes, joints=joints), (note,)


def _carrier(model: Mobility, link: str, links: set[str]) -> str:
    while link in links:
        link = model.joints[link].parent
    return link if link in model.joints else ROOT
