"""Where a pinhole camera stands and which 3-D points its depth image holds. Camera frame: OpenCV, z forward, y down."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from robots.spatial import Array, points, unit
from robots.workcell import Camera


@dataclass(frozen=True, slots=True, eq=False)
class Image:
    """What one camera sees.

    Attributes:
        rgb: ``(h, w, 3)`` colours, 0-255.
        depth: ``(h, w)`` distance along the optical axis [m]; ``inf`` where nothing was hit.
        bodies: ``(h, w)`` simulator body number and link of each pixel (privileged), packed as PyBullet does.
    """

    rgb: np.ndarray[tuple[int, int, int], np.dtype[np.uint8]]
    depth: Array
    bodies: np.ndarray[tuple[int, int], np.dtype[np.int32]]


def camera_pose(camera: Camera) -> pin.SE3:
    """``T_world_camera`` of a camera that looks from ``eye`` to ``target``."""
    forward = unit(np.subtract(camera.target, camera.eye))
    right = unit(np.cross(forward, camera.up))
    return pin.SE3(np.column_stack([right, np.cross(forward, right), forward]), np.asarray(camera.eye))


def focal(camera: Camera) -> float:
    """Focal length [pixel] from the vertical field of view."""
    return 0.5 * camera.height / float(np.tan(np.radians(camera.fov_deg) / 2))


def unproject(camera: Camera, depth: Array) -> Array:
    """The world points ``(h, w, 3)`` [m] of a depth image ``(h, w)`` [m]; non-finite where depth is."""
    f = focal(camera)
    u, v = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    rays = np.stack([(u - camera.width / 2) / f, (v - camera.height / 2) / f, np.ones_like(u)], axis=-1)
    with np.errstate(invalid="ignore"):
        flat = points(camera_pose(camera), (rays * depth[..., None]).reshape(-1, 3))
    return flat.reshape(*depth.shape, 3)
