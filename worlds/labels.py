"""The one door to privileged truth: what the simulator knows of the object and no camera does.

Only the heuristic proposer, training labels, success criteria and the verifier may import this module.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from robots.spatial import Array, frozen
from robots.workcell import Side
from worlds.assets.asset import FunctionalPart
from worlds.assets.shape import collision_vertices, surface
from worlds.bullet.client import from_bullet
from worlds.bullet.render import render
from worlds.bullet.world import BulletWorld
from worlds.camera import unproject
from worlds.observe import Observation

NOTHING = "-"
"""The link of a point that lies on none of those asked for."""


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


def point_links(
    world: BulletWorld, observation: Observation, hand: Side | None = None
) -> np.ndarray[tuple[int], np.dtype[np.str_]]:
    """The link on which each observed point lies ``(n,)``: of the object, or of one arm's hand; else ``NOTHING``.

    The world must not have moved since the observation.
    """
    known = _link_codes(world, hand)
    names = np.array([*known.values(), NOTHING], dtype=np.dtype("U64"))
    links = np.full(len(observation.cloud), NOTHING, dtype=names.dtype)
    for number, camera in enumerate(world.workcell.cameras):
        mine = observation.pixels[:, 0] == number
        codes = render(world, camera).bodies[observation.pixels[mine, 1], observation.pixels[mine, 2]]
        matches = codes[:, None] == np.array(list(known))
        links[mine] = names[np.where(matches.any(axis=1), matches.argmax(axis=1), len(known))]
    return links


def labelled_view(world: BulletWorld, hand: Side) -> Observation:
    """What the cameras see of the object and of one arm's hand, wherever they are and whatever else is in view."""
    known = list(_link_codes(world, hand))
    parts = []
    for number, camera in enumerate(world.workcell.cameras):
        image = render(world, camera)
        keep = np.isin(image.bodies, known) & np.isfinite(image.depth)
        rows, columns = np.nonzero(keep)
        pixels = np.column_stack([np.full_like(rows, number), rows, columns]).astype(np.int32)
        parts.append((unproject(camera, image.depth)[keep], image.rgb[keep] / 255.0, pixels))
    return Observation(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def link_poses(world: BulletWorld) -> dict[str, Array]:
    """``(4, 4)`` poses in the world frame of every link of the object and of both hands, fingers included."""
    found = {}
    for body, numbers in ((world.object, world.object_links), *_hands(world).values()):
        for number, name in numbers.items():
            if number < 0:
                found[name] = frozen(world.object_pose().homogeneous)
            else:
                state = world.client.getLinkState(body, number, computeForwardKinematics=1)
                found[name] = frozen(from_bullet(state[4], state[5]).homogeneous)
    return found


def _hands(world: BulletWorld) -> dict[Side, tuple[int, dict[int, str]]]:
    """Body number of each arm, and the names of its hand's and fingers' links by number."""
    return {
        side: (arm.body, {number: arm.names[number] for number in (arm.hand, *arm.finger_links)})
        for side, arm in world.arms.items()
    }


def _link_codes(world: BulletWorld, hand: Side | None) -> dict[int, str]:
    """Names of the object's links, and of one arm's hand's, by the number with which an image marks them."""
    bodies = [(world.object, world.object_links)]
    if hand is not None:
        bodies.append(_hands(world)[hand])
    return {body + ((number + 1) << 24): name for body, numbers in bodies for number, name in numbers.items()}


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
