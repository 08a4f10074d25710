"""What does one asset look like, alone on a white ground?"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from robots.spatial import Array, unit
from worlds.assets.asset import Asset
from worlds.assets.shape import collision_vertices
from worlds.bullet.client import Client, joint_numbers

Picture = np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]
"""Colours ``(h, w, 3)``, 0-255."""

VIEW = unit([0.45, -1.0, 0.62])
"""From the object to the camera: the broad side of flat tools, the inside of dishes and the front of a button show."""

FIELD = 20.0
"""Vertical field of view [deg]: narrow, so that parallel edges look it."""

ROOM = 1.06
"""How much farther away than needed the camera stands."""

GROUND = 255
"""Grey value of the background."""


def portrait(asset: Asset, size: int) -> Picture:
    """The asset with its joints at their start, ``size`` by ``size`` pixels, by PyBullet's software renderer."""
    vertices = np.concatenate(list(collision_vertices(asset).values()))
    centre = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    radius = float(np.linalg.norm(vertices - centre, axis=1).max())
    client = Client()
    try:
        body = client.load_urdf(asset.urdf, pin.SE3.Identity(), fixed=True)
        joints, _ = joint_numbers(client, body)
        for name, joint in asset.joints.items():
            client.resetJointState(body, joints[name], joint.start)
        return _seen(client, centre, ROOM * radius, size)
    finally:
        client.close()


def _seen(client: Client, centre: Array, radius: float, size: int) -> Picture:
    """What a camera sees that has a ball around the objects in its whole picture."""
    away = radius / float(np.sin(np.radians(0.5 * FIELD)))
    eye = centre + away * VIEW
    _, _, rgba, _, bodies = client.getCameraImage(
        size,
        size,
        client.computeViewMatrix(eye.tolist(), centre.tolist(), [0.0, 0.0, 1.0]),
        client.computeProjectionMatrixFOV(FIELD, 1.0, away - radius, away + radius),
        renderer=client.ER_TINY_RENDERER,
        shadow=0,
        lightDirection=[0.3, -1.0, 1.2],
    )
    picture = np.asarray(rgba, dtype=np.uint8).reshape(size, size, 4)[..., :3].copy()
    picture[np.asarray(bodies).reshape(size, size) < 0] = GROUND
    return picture
