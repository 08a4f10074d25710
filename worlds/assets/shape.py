"""Where an asset's collision geometry is, in its body frame."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from robots.spatial import Array, frozen, points
from worlds.assets.asset import Asset


def collision_vertices(asset: Asset) -> dict[str, Array]:
    """Vertices ``(k, 3)`` of every link's collision geometry at the joints' start, in the body frame [m]."""
    model = pin.buildModelFromUrdf(str(asset.urdf))
    geometry = pin.buildGeomFromUrdf(model, str(asset.urdf), pin.GeometryType.COLLISION)
    q = pin.neutral(model)
    for name, joint in asset.joints.items():
        _set_joint(model, q, name, joint.start)
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    found: dict[str, list[Array]] = {}
    for shape in geometry.geometryObjects:
        link = str(model.frames[shape.parentFrame].name)
        found.setdefault(link, []).append(
            points(data.oMi[shape.parentJoint] * shape.placement, _corners(shape.geometry))
        )
    return {link: frozen(np.concatenate(parts)) for link, parts in found.items()}


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
