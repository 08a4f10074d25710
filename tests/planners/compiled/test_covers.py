"""Laws of covers: spheres and pieces contain what they stand for, inner spheres lie inside it."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls
from scipy.spatial import ConvexHull

from planners.compiled.covers import bounding_sphere, inner_radii, oriented_box, sphere_cover
from planners.compiled.pieces import surface_pieces


def cloud(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(rng.integers(5, 60), 3)) * rng.uniform(0.005, 0.2, 3)
    return np.asarray(points[ConvexHull(points).vertices])


def inside(points: np.ndarray, seed: int, count: int = 3000) -> np.ndarray:
    weights = np.random.default_rng(seed).exponential(size=(count, len(points))) ** 3
    return (weights / weights.sum(axis=1, keepdims=True)) @ points


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**31), count=st.integers(1, 12))
def test_every_point_of_a_hull_lies_in_a_sphere_of_its_cover(seed: int, count: int) -> None:
    hull = cloud(seed)
    centres, radii = sphere_cover(hull, count)
    assert 1 <= len(radii) <= count
    points = np.concatenate([inside(hull, seed), hull])
    gaps = np.linalg.norm(points[:, None] - centres[None], axis=2) - radii
    assert gaps.min(axis=1).max() <= 1e-9


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**31))
def test_bounds_contain_the_hull_and_inner_spheres_lie_in_it(seed: int) -> None:
    hull = cloud(seed)
    centre, radius = bounding_sphere(hull)
    assert np.linalg.norm(hull - centre, axis=1).max() <= radius + 1e-12
    axes, middle, half = oriented_box(hull)
    assert (np.abs((hull - middle) @ axes) <= half + 1e-9).all()
    centres, _ = sphere_cover(hull, 6)
    faces = ConvexHull(hull).equations
    for place, inner in zip(centres, inner_radii(hull, centres), strict=True):
        assert inner == -np.inf or (faces[:, :3] @ place + faces[:, 3]).max() <= -inner + 1e-12


def test_closer_pieces_contain_every_triangle_and_less_than_one_hull() -> None:
    """A bent bar: its one hull fills the bend."""
    bar = np.array([[x, y, z] for x in (0.0, 0.4) for y in (0.0, 0.05) for z in (0.0, 0.05)])
    arm = bar[:, [1, 0, 2]]
    vertices = np.concatenate([bar, arm])
    triangles = np.concatenate([ConvexHull(bar).simplices, ConvexHull(arm).simplices + len(bar)])
    pieces = surface_pieces(vertices, triangles, 4)
    assert len(pieces) == 4
    solid = [piece for piece in pieces if np.linalg.svd(piece - piece.mean(axis=0))[1][-1] > 1e-9]
    assert sum(ConvexHull(piece).volume for piece in solid) < 0.7 * ConvexHull(vertices).volume
    rng = np.random.default_rng(0)
    for triangle in vertices[triangles]:
        for point in rng.dirichlet(np.ones(3), 5) @ triangle:
            assert min(_miss(piece, point) for piece in pieces) < 1e-6


def _miss(piece: np.ndarray, point: np.ndarray) -> float:
    """How far a point is from the hull of a piece, flat or not: the weights that come closest."""
    rows = np.concatenate([piece.T, 1e3 * np.ones((1, len(piece)))])
    return float(nnls(rows, np.concatenate([point, [1e3]]))[1])
