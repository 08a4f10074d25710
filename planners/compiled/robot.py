"""What a robot is to the kernels: its convex shapes and the pairs of them that can meet, kept on disk by content."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.spatial import ConvexHull

from planners.compiled import layout as at
from planners.compiled.covers import SPHERES
from planners.compiled.jit import DIGEST
from planners.compiled.machine import GRID, run
from planners.compiled.tables import (
    NO_GRIDS,
    Chain,
    Integers,
    Shape,
    ShapeRows,
    Singles,
    Tables,
    pair_rows,
    shape_rows,
)
from robots.cache import cache_dir, content_hash, write_atomic
from robots.errors import BadWorkcell
from robots.spatial import Array

GRID_STEP = 0.03
"""Cells of a distance table [rad]: 0.4 MB for each pair of a wrist."""

GRID_RANGE = 6.4
"""Joints that turn further than this get no table [rad]."""


@dataclass(frozen=True, slots=True, eq=False)
class Robot:
    """A robot's part of the tables.

    Attributes:
        chain: Its joints.
        rows: Its shapes, in the order of Pinocchio's geometry objects.
        pair_i: Pairs of its shapes.
        grids: Distance tables of the pairs whose distance depends on two joints: ``grid_i``, ``grid_f``, ``grid``.
    """

    chain: Chain
    rows: ShapeRows
    pair_i: Integers
    grids: tuple[Integers, Array, Singles]


def robot(model: pin.Model, geometry: pin.GeometryModel, pairs: Sequence[tuple[int, int]]) -> Robot:
    """The tables of a Pinocchio model and its collision geometry, read from the cache where they were made before.

    Args:
        model: Every joint turns about or slides along one axis.
        geometry: Meshes count as their convex hulls; boxes, cylinders and spheres as they are.
        pairs: Numbers of geometry objects that can meet.
    """
    return robot_of_shapes(model, [shape_of(thing) for thing in geometry.geometryObjects], pairs)


def robot_of_shapes(
    model: pin.Model, shapes: Sequence[Shape], pairs: Sequence[tuple[int, int]], *, grids: bool = True
) -> Robot:
    """As ``robot``, of convex shapes; without ``grids`` no distance tables are made."""
    chain = Chain(model)
    digest = _digest(model, chain, shapes, pairs)
    path = cache_dir() / "robots" / f"tables-{digest}.npz"
    if path.is_file():
        with np.load(path) as kept:
            names = tuple(shape.name for shape in shapes)
            shape_i, shape_f, verts, fine, reach = (kept[key] for key in _ROWS)
            rows = ShapeRows(shape_i, shape_f, verts, fine, reach, names)
            return Robot(chain, rows, kept["pair_i"], (kept["grid_i"], kept["grid_f"], kept["grid"]))
    made = _made(model, chain, shapes, pairs, grids)
    arrays: dict[str, Any] = {key: getattr(made.rows, key) for key in _ROWS}
    arrays |= dict(zip(("grid_i", "grid_f", "grid"), made.grids, strict=True))
    packed = io.BytesIO()
    np.savez(packed, pair_i=made.pair_i, **arrays)
    write_atomic(path, packed.getvalue())
    return made


_ROWS = ("shape_i", "shape_f", "verts", "fine", "reach")


def shape_of(thing: Any) -> Shape:
    """A Pinocchio geometry object as a convex shape; a mesh becomes its hull."""
    geometry, kind = thing.geometry, type(thing.geometry).__name__
    name, joint, T = str(thing.name), int(thing.parentJoint), thing.placement.copy()
    if kind == "Box":
        return Shape(name, joint, at.BOX, T, np.array(geometry.halfSide))
    if kind == "Cylinder":
        return Shape(name, joint, at.CYLINDER, T, np.array([geometry.radius, geometry.halfLength, 0.0]))
    if kind == "Sphere":
        return Shape(name, joint, at.POINT, T, np.zeros(3), float(geometry.radius))
    if kind == "Capsule":
        ends = np.array([[0.0, 0.0, -geometry.halfLength], [0.0, 0.0, geometry.halfLength]])
        return Shape(name, joint, at.HULL, T, ends, float(geometry.radius))
    if kind == "Convex":
        return Shape(name, joint, at.HULL, T, np.array(geometry.points()))
    if kind.startswith("BVHModel"):
        vertices = np.array(geometry.vertices())
        return Shape(name, joint, at.HULL, T, vertices[ConvexHull(vertices).vertices])
    raise BadWorkcell(
        f"The collision shape {name} is a {kind}; meshes, boxes, cylinders, spheres and capsules are known."
    )


def _digest(model: pin.Model, chain: Chain, shapes: Sequence[Shape], pairs: Sequence[tuple[int, int]]) -> str:
    parts: list[bytes] = [DIGEST.encode(), chain.joint_i.tobytes(), chain.joint_f.tobytes(), repr(list(pairs)).encode()]
    parts += [np.asarray(model.lowerPositionLimit).tobytes(), np.asarray(model.upperPositionLimit).tobytes()]
    for shape in shapes:
        parts.append(f"{shape.name} {shape.joint} {shape.kind} {shape.radius!r}".encode())
        parts += [shape.T_joint_shape.homogeneous.tobytes(), np.ascontiguousarray(shape.size).tobytes()]
    return content_hash(*parts)


def _made(
    model: pin.Model, chain: Chain, shapes: Sequence[Shape], pairs: Sequence[tuple[int, int]], with_grids: bool
) -> Robot:
    rows = shape_rows(chain, shapes, SPHERES)
    pair_i = pair_rows(chain, rows, pairs)
    bare = Tables(
        chain.joint_i,
        chain.joint_f,
        chain.chain,
        rows.reach,
        rows.shape_i,
        rows.shape_f,
        rows.verts,
        rows.fine,
        pair_i,
        *NO_GRIDS,
    )
    grid_i: list[tuple[int, ...]] = []
    grid_f: list[tuple[float, ...]] = []
    grids, size = [np.zeros(0, dtype=np.float32)], 0
    for k in range(len(pair_i) if with_grids else 0):
        joints = _between(chain, rows, pair_i[k])
        if len(joints) != 2 or any(chain.joint_i[j, at.JOINT_KIND] != at.REVOLUTE for j in joints):
            continue
        slots = [int(chain.joint_i[j, at.JOINT_SLOT]) for j in joints]
        low, high = (np.asarray(limit)[slots] for limit in (model.lowerPositionLimit, model.upperPositionLimit))
        if np.any(high - low > GRID_RANGE):
            continue
        values, shape = _grid(bare, k, slots, low, high)
        pair_i[k, at.PAIR_TABLE] = len(grid_i)
        grid_i.append((size, *shape, *slots))
        grid_f.append((low[0], 1.0 / GRID_STEP, low[1], 1.0 / GRID_STEP))
        grids.append(values)
        size += len(values)
    grids_of = (
        np.array(grid_i, dtype=np.int32).reshape(-1, 5),
        np.array(grid_f, dtype=np.float64).reshape(-1, 4),
        np.concatenate(grids),
    )
    return Robot(chain, rows, pair_i, grids_of)


def _between(chain: Chain, rows: ShapeRows, pair: Integers) -> list[int]:
    """The joints that move one shape of a pair against the other."""
    ends = [set(chain.chain[rows.shape_i[s, at.SHAPE_JOINT]].tolist()) - {0} for s in pair[:2]]
    return sorted(ends[0] ^ ends[1])


def _grid(tables: Tables, pair: int, slots: list[int], low: Array, high: Array) -> tuple[Singles, tuple[int, int]]:
    """Values of a distance table and its size."""
    first, second = (np.arange(low[k], high[k], GRID_STEP) + GRID_STEP / 2 for k in range(2))
    centres = np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2)
    plays = np.full_like(centres, GRID_STEP / 2)
    rest = np.zeros(int(tables.joint_i[:, at.JOINT_SLOT].max()) + 1)
    found = run(GRID, tables, rest, np.array(slots, dtype=np.int32), centres, plays, 0.0, 0.0, 0.0, pair, 0)[0]
    return (found[:, 0] - 1e-6).astype(np.float32), (len(first), len(second))
