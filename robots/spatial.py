"""How poses, points and directions are combined, in SI units.

The pose type is ``pin.SE3``; ``T_a_b`` maps coordinates in frame ``b`` to frame ``a``. ``pin.SE3`` is
mutable, so anything that stores one stores a copy.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

Array = np.ndarray[Any, np.dtype[np.float64]]
"""A float64 array; the shape and unit stand in the docstring of whoever holds it."""


def frozen(values: Any) -> Array:
    """A read-only float64 copy of ``values``."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


def pose(xyz: Any, rpy: Any = (0.0, 0.0, 0.0)) -> pin.SE3:
    """The pose at ``xyz`` [m] turned by roll, pitch, yaw [rad] about fixed axes."""
    return pin.SE3(pin.rpy.rpyToMatrix(*(float(a) for a in rpy)), np.asarray(xyz, dtype=np.float64))


def points(T_a_b: pin.SE3, points_b: Array) -> Array:
    """``(n, 3)`` points [m] of frame ``b`` expressed in frame ``a``."""
    moved: Array = np.asarray(points_b) @ T_a_b.rotation.T + T_a_b.translation
    return moved


def unit(vector: Any) -> Array:
    """``vector`` scaled to length one; raises ``ValueError`` for a zero vector."""
    vector = np.asarray(vector, dtype=np.float64)
    length = float(np.linalg.norm(vector))
    if length < 1e-12:
        raise ValueError("a zero vector has no direction")
    return np.asarray(vector / length)


def hand_rotation(approach: Any, opening: Any) -> Array:
    """The ``(3, 3)`` rotation of a hand whose z is ``approach`` and whose y is closest to ``opening``.

    This is Gram-Schmidt in the order approach, opening (Zhou et al., "On the Continuity of Rotation
    Representations in Neural Networks", CVPR 2019, eq. 15). ``ValueError`` when the two are parallel.
    """
    z = unit(approach)
    opening = np.asarray(opening, dtype=np.float64)
    y = unit(opening - (opening @ z) * z)
    return np.column_stack([_cross(y, z), y, z])


def _cross(a: Array, b: Array) -> Array:
    """The cross product of two vectors ``(3,)``; ``np.cross`` is made for stacks of them and ten times slower."""
    ax, ay, az = a.tolist()
    bx, by, bz = b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def perpendicular(direction: Any) -> Array:
    """Some unit vector perpendicular to ``direction``: the one closest to horizontal."""
    direction = unit(direction)
    candidate = np.cross([0.0, 0.0, 1.0], direction)
    if np.linalg.norm(candidate) < 1e-6:
        candidate = np.cross([1.0, 0.0, 0.0], direction)
    return unit(candidate)


def rotation_about(axis: Any, angle: float) -> Array:
    """The ``(3, 3)`` rotation by ``angle`` [rad] about ``axis`` (Rodrigues)."""
    return np.asarray(pin.exp3(unit(axis) * angle))


def turned_about(T_world_frame: pin.SE3, point: Array, axis: Any, angle: float) -> pin.SE3:
    """``T_world_frame`` turned by ``angle`` [rad] about the line through ``point`` along ``axis``."""
    R = rotation_about(axis, angle)
    return pin.SE3(R @ T_world_frame.rotation, R @ (T_world_frame.translation - point) + point)


def angle_between(Ra: Array, Rb: Array) -> float:
    """Geodesic angle [rad] between two rotations, in ``[0, pi]``."""
    return float(np.linalg.norm(pin.log3(Ra.T @ Rb)))


def interpolate(T_a: pin.SE3, T_b: pin.SE3, fraction: float) -> pin.SE3:
    """Between two poses: straight-line translation and shortest-arc rotation."""
    R = T_a.rotation @ pin.exp3(fraction * pin.log3(T_a.rotation.T @ T_b.rotation))
    return pin.SE3(R, (1.0 - fraction) * T_a.translation + fraction * T_b.translation)


def to_list(T: pin.SE3) -> list[list[float]]:
    """The ``4 x 4`` homogeneous matrix as nested lists, for a file."""
    return [[float(v) for v in row] for row in T.homogeneous]


def from_list(rows: Any) -> pin.SE3:
    """The pose of a ``4 x 4`` homogeneous matrix; ``ValueError`` when it is not one."""
    matrix = np.asarray(rows, dtype=np.float64)
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise ValueError("a pose is a finite 4 x 4 matrix")
    if np.abs(matrix[:3, :3] @ matrix[:3, :3].T - np.eye(3)).max() > 1e-6:
        raise ValueError("the rotation part of a pose is not orthonormal")
    return pin.SE3(matrix[:3, :3], matrix[:3, 3])
