"""Where an asset's collision geometry is, in its body frame."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pinocchio as pin

from robots.spatial import Array, frozen, points
from worlds.assets.asset import Asset
from worlds.assets.solids import hull

REMEMBERED = 8
"""Objects whose pieces and surface a process remembers: an episode asks for them several times."""


def collision_vertices(asset: Asset) -> dict[str, Array]:
    """Vertices ``(k, 3)`` of every link's collision geometry at the joints' start, in the body frame [m]."""
    return {link: frozen(np.concatenate(pieces)) for link, pieces in collision_pieces(asset).items()}


def collision_pieces(asset: Asset) -> dict[str, list[Array]]:
    """Vertices ``(k, 3)`` of every convex piece, by link, at the joints' start, in the body frame [m]."""
    return {link: list(pieces) for link, pieces in _pieces(_Known(asset)).items()}


class _Known:
    """An asset as a key: two with the same content have the same shape."""

    def __init__(self, asset: Asset) -> None:
        self.asset = asset

    def __hash__(self) -> int:
        return hash(self.asset.content_hash)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Known) and self.asset.content_hash == other.asset.content_hash


@lru_cache(maxsize=REMEMBERED)
def _pieces(known: _Known) -> dict[str, tuple[Array, ...]]:
    asset = known.asset
    model = pin.buildModelFromUrdf(str(asset.urdf))
    geometry = pin.buildGeomFromUrdf(model, str(asset.urdf), pin.GeometryType.COLLISION)
    q = pin.neutral(model)
    for name, joint in asset.joints.items():
        _set_joint(model, q, name, joint.start)
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    found: dict[str, tuple[Array, ...]] = {}
    for shape in geometry.geometryObjects:
        link = str(model.frames[shape.parentFrame].name)
        moved = points(data.oMi[shape.parentJoint] * shape.placement, _corners(shape.geometry))
        found[link] = (*found.get(link, ()), frozen(moved))
    return found


def surface(asset: Asset, spacing: float = 0.003) -> dict[str, tuple[Array, Array]]:
    """Points ``(n, 3)`` [m] on the surfaces of all convex pieces and their normals ``(n, 3)``, by link.

    In the body frame with the joints at their start, about ``spacing`` [m] apart. Faces between touching pieces are
    included.
    """
    return dict(_surface(_Known(asset), spacing))


@lru_cache(maxsize=REMEMBERED)
def _surface(known: _Known, spacing: float) -> dict[str, tuple[Array, Array]]:
    rng = np.random.default_rng(0)
    found: dict[str, tuple[Array, Array]] = {}
    for link, pieces in _pieces(known).items():
        spots, normals = [], []
        for vertices in pieces:
            mesh = hull(vertices)
            a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
            cross = np.cross(b - a, c - a)
            area = 0.5 * np.linalg.norm(cross, axis=1)
            counts = rng.poisson(area / spacing**2)
            face = np.repeat(np.arange(len(area)), counts)
            u, v = np.sqrt(rng.random(len(face))), rng.random(len(face))
            spots.append((1 - u)[:, None] * a[face] + (u * (1 - v))[:, None] * b[face] + (u * v)[:, None] * c[face])
            normals.append(cross[face] / (2.0 * area[face])[:, None])
        found[link] = frozen(np.concatenate(spots)), frozen(np.concatenate(normals))
    return found


def _set_joint(model: pin.Model, q: Array, name: str, value: float) -> None:
    joint = model.joints[model.getJointId(name)]
    if joint.nq == 2:  # Pinocchio holds an unlimited turning joint as cosine and sine
        q[joint.idx_q : joint.idx_q + 2] = np.cos(value), np.sin(value)
    else:
        q[joint.idx_q] = value


def _corners(geometry: object) -> Array:
    """Vertices of a mesh or hull; for primitives the corners of their bounding box."""
    if hasattr(geometry, "vertices"):
        return np.asarray(geometry.vertices())
    geometry.computeLocalAABB()  # type: ignore[attr-defined]
    box = geometry.aabb_local  # type: ignore[attr-defined]
    grid = np.stack(np.meshgrid(*zip(np.asarray(box.min_), np.asarray(box.max_), strict=True)), axis=-1)
    return grid.reshape(-1, 3)
