"""Which triangles bound a convex solid, and what are its volume, centre of mass and inertia?

Every collision shape of an object is one convex hull. PyBullet turns a URDF cylinder into a hull anyway and
grows both by ``BULLET_MARGIN`` (measured), so one kind of solid loses nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from robots.spatial import Array, frozen

BULLET_MARGIN = 0.001
"""How far PyBullet 3.2.7 grows a convex mesh on every side [m] (measured between two hulls: 10 mm become 8)."""

Faces = np.ndarray[Any, np.dtype[np.int64]]
"""Triangles ``(n, 3)``: vertex indices, counter-clockwise seen from outside."""


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """A triangle mesh.

    Attributes:
        vertices: ``(n, 3)`` [m].
        faces: ``(m, 3)`` vertex indices.
    """

    vertices: Array
    faces: Faces

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices", frozen(self.vertices))


@dataclass(frozen=True, slots=True, eq=False)
class MassProperties:
    """Mass, centre and inertia of a link.

    Attributes:
        mass: [kg].
        centre: Centre of mass ``(3,)`` in the link frame [m].
        inertia: ``(3, 3)`` about the centre of mass, in link axes [kg m^2].
    """

    mass: float
    centre: Array
    inertia: Array


def hull(points: Array) -> Mesh:
    """The convex hull of ``points`` ``(n, 3)`` [m]; ``ValueError`` when they span no volume."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        found = ConvexHull(np.asarray(points, dtype=np.float64))
    except QhullError as error:
        raise ValueError("the points span no volume") from error
    kept = np.unique(found.simplices)
    vertices = found.points[kept]
    faces = np.searchsorted(kept, found.simplices)
    return Mesh(vertices, _facing_outwards(vertices, faces))


def _facing_outwards(vertices: Array, faces: Faces) -> Faces:
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), a - vertices.mean(axis=0)) < 0.0
    return np.where(inwards[:, None], faces[:, ::-1], faces)


def box(size: tuple[float, float, float], centre: tuple[float, float, float]) -> Mesh:
    """A box of ``size`` around ``centre`` [m]."""
    corners = np.array(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5])).reshape(3, -1).T
    return hull(corners * np.asarray(size) + np.asarray(centre))


def merged(meshes: tuple[Mesh, ...]) -> Mesh:
    """All triangles of ``meshes`` as one mesh."""
    offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + offset for mesh, offset in zip(meshes, offsets, strict=True)]),
    )


def moved(mesh: Mesh, offset: Array) -> Mesh:
    """``mesh`` shifted by ``offset`` ``(3,)`` [m]."""
    return Mesh(mesh.vertices + np.asarray(offset), mesh.faces)


def volume(mesh: Mesh) -> float:
    """The volume inside a closed mesh [m^3]."""
    return float(_signed_volumes(mesh).sum())


def mass_properties(solids: tuple[Mesh, ...], density: float) -> MassProperties:
    """Mass properties of closed ``solids`` filled with ``density`` [kg/m^3]; an overlap counts twice.

    Sums over tetrahedra from the origin to each triangle (Tonon, "Explicit Exact Formulas for the 3-D
    Tetrahedron Inertia Tensor in Terms of its Vertex Coordinates", 2004).
    """
    whole = merged(solids)
    masses = density * _signed_volumes(whole)
    corners = whole.vertices[whole.faces]
    sums = corners.sum(axis=1)
    mass = float(masses.sum())
    centre = np.einsum("i,ij->j", masses, sums) / (4.0 * mass)
    second = np.einsum("i,ikj,ikl->jl", masses, corners, corners) + np.einsum("i,ij,il->jl", masses, sums, sums)
    second = second / 20.0 - mass * np.outer(centre, centre)
    return MassProperties(mass, centre, np.trace(second) * np.eye(3) - second)


def _signed_volumes(mesh: Mesh) -> Array:
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return np.asarray(np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0)
