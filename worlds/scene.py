"""How an episode begins: the object at rest on the table in a random pose, both arms waiting."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from robots.errors import BadAsset
from robots.spatial import Array
from robots.workcell import Workcell
from worlds import physics
from worlds.assets.asset import Asset
from worlds.assets.shape import collision_vertices
from worlds.bullet.world import BulletWorld

SPREAD = 0.08
"""Half width of the square in which objects are dropped, about the middle of the shared space [m]."""

REGION = 0.14
"""Where the object must come to rest: its bounding box centre this close to that middle [m]."""

ATTEMPTS = 30

SERVED = frozenset({"Plate"})
"""Categories that begin the right way up, only turned about the vertical and tilted a little: the paper takes its plate
task from PerAct2, where plates are served so; a plate on its face has no rim to press."""

SERVED_TILT = 0.15
"""Spread of that tilt about both horizontal axes before the object is dropped [rad]."""


def build(workcell: Workcell, asset: Asset, seed: int) -> BulletWorld:
    """The world of one episode, decided by workcell, asset and seed alone.

    The object is dropped in a random orientation (uniform on SO(3), but for ``SERVED`` ones) from just above the table
    and comes to rest by itself. Poses that roll out of the region or do not come to rest are drawn again.

    Raises:
        BadAsset: No draw came to rest on the table.
    """
    world = BulletWorld(workcell, asset)
    rng = np.random.default_rng([seed, 0x5CE])
    vertices = np.concatenate(list(collision_vertices(asset).values()))
    try:
        for _ in range(ATTEMPTS):
            _drop(world, vertices, rng)
            if world.settle_object() and _inside(world):
                world.time = 0.0
                return world
    except BaseException:
        world.close()
        raise
    world.close()
    raise BadAsset(asset.instance, f"it did not come to rest on the table in any of {ATTEMPTS} drops")


def _drop(world: BulletWorld, vertices: Array, rng: np.random.Generator) -> None:
    middle = np.asarray(world.workcell.shared[:2])
    R = Rotation.random(random_state=rng).as_matrix()
    if world.asset.category in SERVED:
        tilt, yaw = rng.normal(0.0, SERVED_TILT, 2), rng.uniform(0.0, 2 * np.pi)
        R = Rotation.from_euler("xyz", [*tilt, yaw]).as_matrix()
    xy = middle + rng.uniform(-SPREAD, SPREAD, 2)
    lowest = float((vertices @ R[2]).min())
    world.put_object(pin.SE3(R, np.array([*xy, world.workcell.table.top + physics.DROP_HEIGHT - lowest])))


def _inside(world: BulletWorld) -> bool:
    vertices = world.object_vertices()
    off = (vertices.min(axis=0) + vertices.max(axis=0))[:2] / 2 - np.asarray(world.workcell.shared[:2])
    return bool(np.abs(off).max() < REGION and world.object_pose().translation[2] > world.workcell.table.top)
