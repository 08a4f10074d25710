"""Laws of the solid the planner believes in."""

from __future__ import annotations

import numpy as np
from scipy.spatial import Delaunay

from planners.hulls import observed_hulls


def _inside(hulls: list[np.ndarray], points: np.ndarray, grow: float = 1.02) -> np.ndarray:
    found = np.zeros(len(points), dtype=bool)
    for hull in hulls:
        middle = hull.mean(axis=0)
        found |= Delaunay(middle + grow * (hull - middle)).find_simplex(points) >= 0
    return found


def _upper_half_of_lying_cylinder(radius: float, length: float, x0: float) -> np.ndarray:
    x, angle = np.meshgrid(np.linspace(x0, x0 + length, 40), np.linspace(0.02, np.pi - 0.02, 40))
    return np.column_stack([x.ravel(), radius * np.cos(angle).ravel(), 0.03 + radius * np.sin(angle).ravel()])


def test_every_observed_point_lies_in_a_hull() -> None:
    cloud = _upper_half_of_lying_cylinder(0.03, 0.15, 0.0)
    assert _inside(observed_hulls(cloud, 0.0), cloud).mean() > 0.99


def test_what_a_point_hides_is_solid() -> None:
    cloud = _upper_half_of_lying_cylinder(0.03, 0.15, 0.0)
    below = cloud.copy()
    below[:, 2] *= 0.5
    assert _inside(observed_hulls(cloud, 0.0), below).mean() > 0.99


def test_a_narrow_lid_does_not_grow_to_the_width_of_the_body() -> None:
    body, lid = _upper_half_of_lying_cylinder(0.03, 0.15, 0.0), _upper_half_of_lying_cylinder(0.012, 0.03, 0.155)
    hulls = observed_hulls(np.concatenate([body, lid]), 0.0)
    beside_the_lid = np.array([[0.175, y, 0.03] for y in (-0.022, 0.022)])
    assert not _inside(hulls, beside_the_lid).any()


def test_a_lid_on_a_standing_body_leaves_room_around_it() -> None:
    grid = np.linspace(-0.03, 0.03, 41)
    x, y = (a.ravel() for a in np.meshgrid(grid, grid))
    radius = np.hypot(x, y)
    z = np.where(radius < 0.012, 0.18, 0.14)
    cloud = np.column_stack([x, y, z])[radius < 0.03]
    hulls = observed_hulls(cloud, 0.0)
    around_the_lid = np.array([[0.0, s * 0.022, 0.165] for s in (-1, 1)])
    assert not _inside(hulls, around_the_lid, grow=1.0).any()
    assert _inside(hulls, np.array([[0.0, 0.0, 0.17], [0.02, 0.0, 0.05]])).all()


def test_a_row_of_points_is_no_solid() -> None:
    """Four points of one image column make no piece; the collision checker would refuse it."""
    row = np.column_stack([np.full(30, 0.2), np.linspace(0.0, 0.05, 30), np.full(30, 0.04)])
    assert observed_hulls(row, 0.0) == []
