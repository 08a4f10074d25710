"""Whether the numbers that a planner is given can mean anything: the right shape, and finite."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from robots.spatial import Array


def numbers(values: Any, shape: tuple[int, ...], what: str) -> Array:
    """``values`` as an array of a shape, where ``-1`` stands for any size of at least one.

    Raises:
        ValueError: Another shape, or a number that is not finite; the message names ``what`` and the numbers.
    """
    array = np.asarray(values, dtype=np.float64)
    fits = array.ndim == len(shape) and all(
        n == m or (m == -1 and n > 0) for n, m in zip(array.shape, shape, strict=True)
    )
    if not fits:
        wanted = str(tuple("n" if m == -1 else m for m in shape)).replace("'", "")
        raise ValueError(f"{what} must have shape {wanted}, not {array.shape}")
    bad = np.argwhere(~np.isfinite(array))
    if len(bad):
        at = tuple(int(k) for k in bad[0])
        raise ValueError(f"{what} must be finite, but entry {at[0] if len(at) == 1 else at} is {array[at]}")
    return array


def finite_pose(T: pin.SE3, what: str) -> pin.SE3:
    """``T`` itself; ``ValueError`` that names ``what`` when it is no finite pose."""
    numbers(T.translation, (3,), f"the position of {what}")
    R = numbers(T.rotation, (3, 3), f"the rotation of {what}")
    off = float(np.abs(R @ R.T - np.eye(3)).max())
    if off > 1e-6 or np.linalg.det(R) < 0.0:
        raise ValueError(f"the rotation of {what} is none: it is off an orthonormal right-handed matrix by {off:.2g}")
    return T


def positive(value: float, what: str, unit: str) -> float:
    """``value`` itself; ``ValueError`` that names ``what`` when it is not a finite number above zero."""
    if not (np.isfinite(value) and value > 0.0):
        raise ValueError(f"{what} must be above 0 {unit}, not {value} {unit}")
    return float(value)
