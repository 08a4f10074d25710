"""What a camera in the simulated cell sees."""

from __future__ import annotations

import numpy as np

from robots.workcell import Camera
from worlds import physics
from worlds.bullet.world import BulletWorld
from worlds.camera import Image


def render(world: BulletWorld, camera: Camera) -> Image:
    """What a camera sees now; asked again before anything has moved, the same image.

    By PyBullet's software renderer, so no display is needed, and without shadows: they double the time.
    """
    if camera not in world.images:
        world.images[camera] = _rendered(world, camera)
    return world.images[camera]


def _rendered(world: BulletWorld, camera: Camera) -> Image:
    client = world.client
    near, far = physics.CAMERA_NEAR, physics.CAMERA_FAR
    view = client.computeViewMatrix(camera.eye, camera.target, camera.up)
    projection = client.computeProjectionMatrixFOV(camera.fov_deg, camera.width / camera.height, near, far)
    width, height, rgba, buffer, bodies = client.getCameraImage(
        camera.width,
        camera.height,
        view,
        projection,
        renderer=client.ER_TINY_RENDERER,
        shadow=0,
        flags=client.ER_SEGMENTATION_MASK_OBJECT_AND_LINKINDEX,
        lightDirection=[0.4, -0.6, 1.5],
    )
    shape = (height, width)
    buffer = np.asarray(buffer, dtype=np.float64).reshape(shape)
    depth = far * near / (far - (far - near) * buffer)
    depth[buffer >= 1.0] = np.inf
    return Image(
        rgb=np.asarray(rgba, dtype=np.uint8).reshape(*shape, 4)[..., :3].copy(),
        depth=depth,
        bodies=np.asarray(bodies, dtype=np.int32).reshape(shape),
    )
