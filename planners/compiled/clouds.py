"""How an observed point cloud stands in the way: small groups of neighbouring points, each a hull grown by a radius."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from planners.compiled import layout as at
from planners.compiled.tables import Shape
from robots.spatial import Array

GROUP = 12
"""Most points of a group: their hull fills at most a few spacings of the cloud."""


def cloud_shapes(name: str, cloud_world: Array, radius: float, *, group: int = GROUP) -> list[Shape]:
    """Shapes of the world that contain a sphere of ``radius`` [m] about every point ``(n, 3)`` of a cloud.

    The cloud is halved at the median of its longest extent until no part has more than ``group`` points; with
    ``group=1`` the shapes are the spheres themselves.
    """
    parts, found = [np.asarray(cloud_world, dtype=np.float64)], []
    while parts:
        part = parts.pop()
        if len(part) <= max(1, group):
            found.append(_shape(name, part, radius))
            continue
        axis = int(np.argmax(np.ptp(part, axis=0)))
        order = np.argsort(part[:, axis], kind="stable")
        parts += [part[order[: len(part) // 2]], part[order[len(part) // 2 :]]]
    return found


def _shape(name: str, part: Array, radius: float) -> Shape:
    if len(part) == 1:
        return Shape(name, 0, at.POINT, pin.SE3(np.eye(3), part[0]), np.zeros(3), radius)
    return Shape(name, 0, at.HULL, pin.SE3.Identity(), part, radius)
