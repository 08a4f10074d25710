"""The one door to privileged truth: what the simulator knows of the object and no camera does.

Only the heuristic proposer, training labels, success criteria and the verifier may import this module.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from robots.spatial import Array, frozen
from worlds.assets.asset import FunctionalPart
from worlds.assets.shape import collision_vertices, surface
from worlds.bullet.render import render
from worlds.bullet.world import BulletWorld
from worlds.observe import Observation


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """The object's true state and parts.

    Attributes:
        T_world_body: Pose of the body link.
        part: What to operate, in the body frame; ``None`` for an object without a functional part.
        centre: Centre of mass in the body frame ``(3,)`` [m].
        long_axis: Unit vector ``(3,)`` in the body frame, towards the functional end.
        part_vertices: ``(k, 3)`` vertices of the part's collision geometry at its start, in the body frame [m]; none
            without a part.
        surface: ``(m, 3)`` points on the whole object's surface in the body frame [m].
        normals: ``(m, 3)`` their outward normals.
        on_part: ``(m,)`` whether each of them lies on the functional part.
        movable: ``(n,)`` whether each point of the observed cloud lies on the functional part.
    """

    T_world_body: pin.SE3
    part: FunctionalPart | None
    centre: Array
    long_axis: Array
    part_vertices: Array
    surface: Array
    normals: Array
    on_part: np.ndarray[tuple[int], np.dtype[np.bool_]]
    movable: np.ndarray[tuple[int], np.dtype[np.bool_]]


def truth(world: BulletWorld, observation: Observation) -> Truth:
    """The truth about the object at the moment of the observation; the world must not have moved since."""
    part = world.asset.function
    sampled = surface(world.asset)
    on_part = [np.full(len(spots), part is not None and link == part.link) for link, (spots, _) in sampled.items()]
    none = np.zeros(len(observation.cloud), dtype=bool)
    return Truth(
        T_world_body=world.object_pose(),
        part=part,
        centre=frozen(centre_of_mass(world)),
        long_axis=world.asset.long_axis,
        part_vertices=frozen(np.zeros((0, 3))) if part is None else collision_vertices(world.asset)[part.link],
        surface=frozen(np.concatenate([spots for spots, _ in sampled.values()])),
        normals=frozen(np.concatenate([normals for _, normals in sampled.values()])),
        on_part=np.concatenate(on_part),
        movable=none if part is None else point_links(world, observation) == part.link,
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
