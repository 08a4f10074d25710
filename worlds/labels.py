"""The one door to privileged truth: what the simulator knows of the object and no camera does.

Only the heuristic proposer, training labels, success criteria and the verifier may import this module.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from robots.spatial import Array, frozen, points
from worlds.assets.asset import Asset, FunctionalPart
from worlds.bullet.render import render
from worlds.bullet.world import BulletWorld
from worlds.observe import Observation


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """The object's true state and parts.

    Attributes:
        T_world_body: Pose of the body link.
        part: What to operate, in the body frame.
        centre: Centre of mass in the body frame ``(3,)`` [m].
        long_axis: Unit vector ``(3,)`` in the body frame, towards the functional end.
        part_vertices: ``(k, 3)`` vertices of the part's collision geometry at its start, in the body frame [m].
        movable: ``(n,)`` whether each point of the observed cloud lies on the functional part.
    """

    T_world_body: pin.SE3
    part: FunctionalPart
    centre: Array
    long_axis: Array
    part_vertices: Array
    movable: np.ndarray[tuple[int], np.dtype[np.bool_]]


def truth(world: BulletWorld, observation: Observation) -> Truth:
    """The truth about the object at the moment of the observation; the world must not have moved since."""
    return Truth(
        T_world_body=world.object_pose(),
        part=world.asset.part,
        centre=frozen(centre_of_mass(world)),
        long_axis=world.asset.long_axis,
        part_vertices=frozen(part_vertices(world.asset)),
        movable=point_links(world, observation) == world.asset.part.link,
    )


def point_links(world: BulletWorld, observation: Observation) -> np.ndarray[tuple[int], np.dtype[np.str_]]:
    """The object link on which each observed point lies ``(n,)``; ``"-"`` for anything else."""
    links = np.full(len(observation.cloud), "-", dtype=np.dtype("U64"))
    for number, camera in enumerate(world.workcell.cameras):
        mine = observation.pixels[:, 0] == number
        packed = render(world, camera).bodies[observation.pixels[mine, 1], observation.pixels[mine, 2]]
        body, link = packed & ((1 << 24) - 1), (packed >> 24) - 1
        links[mine] = [
            world.object_links[int(k)] if b == world.object and p >= 0 else "-"
            for b, k, p in zip(body, link, packed, strict=True)
        ]
    return links


def centre_of_mass(world: BulletWorld) -> Array:
    """Centre of mass of the whole object in its body frame ``(3,)`` [m]."""
    client, total, moment = world.client, 0.0, np.zeros(3)
    inverse = world.object_pose().inverse()
    for link in range(-1, client.getNumJoints(world.object)):
        mass = float(client.getDynamicsInfo(world.object, link)[0])
        if link < 0:
            at = client.getBasePositionAndOrientation(world.object)[0]
        else:
            at = client.getLinkState(world.object, link, computeForwardKinematics=1)[0]
        total, moment = total + mass, moment + mass * inverse.act(np.asarray(at))
    return moment / total


def part_vertices(asset: Asset) -> Array:
    """Vertices ``(k, 3)`` of the functional part's collision geometry at its start, in the body frame [m]."""
    model = pin.buildModelFromUrdf(str(asset.urdf))
    geometry = pin.buildGeomFromUrdf(model, str(asset.urdf), pin.GeometryType.COLLISION)
    q = pin.neutral(model)
    for name, joint in asset.joints.items():
        _set_joint(model, q, name, joint.start)
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    frame = model.getFrameId(asset.part.link)
    found = [
        points(data.oMi[shape.parentJoint] * shape.placement, _corners(shape.geometry))
        for shape in geometry.geometryObjects
        if shape.parentFrame == frame
    ]
    return np.concatenate(found)


def _set_joint(model: pin.Model, q: Array, name: str, value: float) -> None:
    joint = model.joints[model.getJointId(name)]
    if joint.nq == 2:  # Pinocchio holds an unlimited turning joint as cosine and sine
        q[joint.idx_q : joint.idx_q + 2] = np.cos(value), np.sin(value)
    else:
        q[joint.idx_q] = value


def _corners(geometry: object) -> Array:
    """Vertices of a mesh or hull; for primitives the corners of their bounding box."""
    if hasattr(geometry, "vertices"):
        return np.asarray(geometry.vertices())
    geometry.computeLocalAABB()  # type: ignore[attr-defined]
    box = geometry.aabb_local  # type: ignore[attr-defined]
    low, high = np.asarray(box.min_), np.asarray(box.max_)
    grid = np.stack(np.meshgrid(*zip(low, high, strict=True)), axis=-1)
    return grid.reshape(-1, 3)
