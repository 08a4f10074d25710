"""What the kernels read: joints, convex shapes and pairs as flat arrays, made from a Pinocchio model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from planners.compiled import layout as at
from planners.compiled.covers import bounding_sphere, inner_radii, oriented_box, sphere_cover
from robots.errors import BadWorkcell
from robots.spatial import Array, points

Flags = np.ndarray[Any, np.dtype[np.bool_]]
Singles = np.ndarray[Any, np.dtype[np.float32]]
Integers = np.ndarray[Any, np.dtype[np.int32]]


class Tables(NamedTuple):
    """Everything a kernel needs to know about a cell; columns as in ``layout``.

    Attributes:
        joint_i: ``(joints, 4)``.
        joint_f: ``(joints, 12)`` rotation and position of a joint in its parent's frame [m].
        chain: ``(joints, depth)`` the movable joints up to a joint, from the root; padded with 0.
        reach: ``(shapes, depth)`` furthest that a point of a shape ever is from each joint of its chain [m].
        shape_i: ``(shapes, 6)``.
        shape_f: ``(shapes, 35)``.
        verts: ``(3, vertices)`` in joint frames [m].
        fine: ``(5, spheres)`` centres in joint frames, radii that cover and radii that lie inside [m].
        pair_i: ``(pairs, 4)``.
        grid_i: ``(grids, 5)`` tables of distances over two joints.
        grid_f: ``(grids, 4)`` lowest value and cells per radian of both joints.
        grid: ``(values,)`` lower bounds of distances, valid in a whole cell of a table [m].
    """

    joint_i: Integers
    joint_f: Array
    chain: Integers
    reach: Array
    shape_i: Integers
    shape_f: Array
    verts: Array
    fine: Array
    pair_i: Integers
    grid_i: Integers
    grid_f: Array
    grid: Singles


NO_GRIDS = (np.zeros((0, 5), dtype=np.int32), np.zeros((0, 4)), np.zeros(0, dtype=np.float32))
"""No distance tables."""


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A convex solid that rides on a joint; joint 0 is the world.

    Attributes:
        name: Who touches, in a contact.
        joint: Pinocchio's number of the joint.
        kind: ``HULL``, ``BOX``, ``CYLINDER`` or ``POINT`` of ``layout``.
        T_joint_shape: Pose on the joint; vertices of a hull are in the shape's frame.
        size: Half extents ``(3,)`` of a box; radius and half length of a cylinder; vertices ``(n, 3)`` of a hull [m].
        radius: The core is grown by this [m]: the radius of a sphere.
        cover: Its bounds, where they are known already.
    """

    name: str
    joint: int
    kind: int
    T_joint_shape: pin.SE3
    size: Array
    radius: float = 0.0
    cover: Cover | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Cover:
    """What contains a shape, in the shape's own frame.

    Attributes:
        corners: ``(n, 3)`` vertices whose hull contains the core [m].
        centre, bound: A sphere that contains the core [m].
        axes, middle, half: An oriented box that contains the core [m].
        spheres: ``(k, 5)`` centres, radii that cover the core and radii that lie inside it [m].
    """

    corners: Array
    centre: Array
    bound: float
    axes: Array
    middle: Array
    half: Array
    spheres: Array


def cover_of(shape: Shape, spheres: int) -> Cover:
    """The bounds of a shape, with at most so many fine spheres."""
    corners = _corners(shape)
    fine = np.zeros((0, 5))
    if spheres:
        centres, radii = sphere_cover(corners, spheres)
        fine = np.column_stack([centres, radii, _inside(shape, corners, centres)])
    if shape.kind == at.HULL:
        return Cover(corners, *bounding_sphere(corners), *oriented_box(corners), fine)
    half = np.abs(corners[0])
    return Cover(corners, np.zeros(3), float(np.linalg.norm(half)), np.eye(3), np.zeros(3), half, fine)


def _inside(shape: Shape, corners: Array, centres: Array) -> Array:
    """Radii ``(k,)`` [m] of spheres about the centres that lie inside the core."""
    if shape.kind != at.CYLINDER:
        return inner_radii(corners, centres)
    radius, half = np.ravel(shape.size)[:2]
    radii = np.minimum(radius - np.hypot(centres[:, 0], centres[:, 1]), half - np.abs(centres[:, 2]))
    return np.where(radii > 0.0, radii, -np.inf)


def _corners(shape: Shape) -> Array:
    """Vertices whose hull contains the core."""
    if shape.kind == at.HULL:
        return np.asarray(shape.size, dtype=np.float64)
    if shape.kind == at.POINT:
        return np.zeros((1, 3))
    half = np.ravel(shape.size)
    if shape.kind == at.CYLINDER:
        half = np.array([half[0], half[0], half[1]])
    return np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)]) * half


class Chain:
    """The joints of a model, their frames turned so that every axis is z.

    Attributes:
        joint_i, joint_f, chain: As in ``Tables``.
        ranges: ``(joints,)`` furthest that a prismatic joint moves [m].
    """

    def __init__(self, model: pin.Model) -> None:
        if model.nq != model.nv:
            raise BadWorkcell(f"The robot has joints without limits or with several axes: nq {model.nq}, nv {model.nv}")
        n = int(model.njoints)
        self.joint_i = np.zeros((n, 4), dtype=np.int32)
        self.joint_f = np.zeros((n, 12))
        self.ranges = np.zeros(n)
        self._turns = [np.eye(3) for _ in range(n)]
        self.joint_i[0] = 0, at.FIXED, 0, 0
        chains: list[list[int]] = [[]]
        for j in range(1, n):
            parent = int(model.parents[j])
            kind, axis = _axis(model, j)
            self._turns[j] = _turn_to(axis)
            chains.append([*chains[parent], j])
            self.joint_i[j] = parent, kind, int(model.joints[j].idx_q), len(chains[j])
            placement = model.jointPlacements[j]
            self.joint_f[j, :9] = (self._turns[parent].T @ placement.rotation @ self._turns[j]).ravel()
            self.joint_f[j, 9:] = self._turns[parent].T @ placement.translation
            if kind == at.PRISMATIC:
                k = int(model.joints[j].idx_q)
                self.ranges[j] = max(abs(model.lowerPositionLimit[k]), abs(model.upperPositionLimit[k]))
        depth = max(1, max(len(chain) for chain in chains))
        self.chain = np.zeros((n, depth), dtype=np.int32)
        for j, chain in enumerate(chains):
            self.chain[j, : len(chain)] = chain

    def placed(self, joint: int, T_joint_shape: pin.SE3) -> pin.SE3:
        """A placement on Pinocchio's joint as one in the turned frame of that joint."""
        R = self._turns[joint].T
        return pin.SE3(R @ T_joint_shape.rotation, R @ T_joint_shape.translation)

    def reaches(self, joint: int, radius: float) -> Array:
        """``(depth,)`` bound of the distance of points within ``radius`` of a joint's origin from each joint above."""
        found, total = np.zeros(self.chain.shape[1]), radius
        for k in range(int(self.joint_i[joint, at.JOINT_DEPTH]) - 1, -1, -1):
            j = self.chain[joint, k]
            total += self.ranges[j]
            found[k] = total
            total += float(np.linalg.norm(self.joint_f[j, 9:]))
        return found

    def common(self, a: int, b: int) -> int:
        """How many movable joints carry both of two joints."""
        count = 0
        for ja, jb in zip(self.chain[a].tolist(), self.chain[b].tolist(), strict=True):
            if ja != jb or ja == 0:
                break
            count += 1
        return count


def _axis(model: pin.Model, j: int) -> tuple[int, Array]:
    """The kind of a joint and its axis in its own frame."""
    subspace = np.zeros(6)
    data = model.createData()
    probe = pin.neutral(model)
    J = pin.computeJointJacobian(model, data, probe, j)
    subspace = np.asarray(J[:, int(model.joints[j].idx_v)])
    linear, angular = subspace[:3], subspace[3:]
    if np.linalg.norm(angular) > 0.5:
        return at.REVOLUTE, angular / np.linalg.norm(angular)
    return at.PRISMATIC, linear / np.linalg.norm(linear)


def _turn_to(axis: Array) -> Array:
    """A rotation whose third column is ``axis``."""
    z = np.asarray(axis)
    x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


@dataclass(frozen=True, slots=True, eq=False)
class ShapeRows:
    """The rows of some shapes, their vertices and spheres counted from 0.

    Attributes:
        shape_i, shape_f, verts, fine, reach: As in ``Tables``.
        names: By shape.
    """

    shape_i: Integers
    shape_f: Array
    verts: Array
    fine: Array
    reach: Array
    names: tuple[str, ...]


def shape_rows(chain: Chain, shapes: Sequence[Shape], spheres: int) -> ShapeRows:
    """The rows of shapes; each moving one is covered by at most ``spheres`` spheres."""
    shape_i = np.zeros((len(shapes), 6), dtype=np.int32)
    shape_f = np.zeros((len(shapes), at.SHAPE_WIDTH))
    reach = np.zeros((len(shapes), chain.chain.shape[1]))
    verts, fine, count, covered = [np.zeros((0, 3))], [np.zeros((0, 5))], 0, 0
    for k, shape in enumerate(shapes):
        T = chain.placed(shape.joint, shape.T_joint_shape)
        cover = shape.cover or cover_of(shape, spheres if shape.joint else 0)
        shape_f[k] = _row(shape, cover, T)
        placed = points(T, cover.corners)
        first = count
        if shape.kind == at.HULL:
            verts.append(placed)
            count += len(placed)
        few = cover.spheres if shape.joint else cover.spheres[:0]
        shape_i[k] = shape.joint, shape.kind, first, count, covered, covered + len(few)
        fine.append(np.column_stack([points(T, few[:, :3]), few[:, 3:] + shape.radius]))
        covered += len(few)
        if shape.joint:
            reach[k] = chain.reaches(shape.joint, float(np.linalg.norm(placed, axis=1).max()) + shape.radius)
    names = tuple(shape.name for shape in shapes)
    vertices, covering = (np.ascontiguousarray(np.concatenate(rows).T) for rows in (verts, fine))
    return ShapeRows(shape_i, shape_f, vertices, covering, reach, names)


def _row(shape: Shape, cover: Cover, T: pin.SE3) -> Array:
    """The row of ``shape_f`` of a shape at ``T`` in the turned frame of its joint."""
    row = np.zeros(at.SHAPE_WIDTH)
    if shape.kind == at.HULL:
        row[at.ROTATION : at.POSITION] = np.eye(3).ravel()
    else:
        row[at.ROTATION : at.POSITION] = T.rotation.ravel()
        row[at.POSITION : at.PARAM] = T.translation
        row[at.PARAM : at.RADIUS] = np.ravel(shape.size)
    row[at.RADIUS] = shape.radius
    row[at.CENTRE : at.BOUND] = T.act(cover.centre)
    row[at.BOUND] = cover.bound + shape.radius
    row[at.BOX_ROTATION : at.BOX_POSITION] = (T.rotation @ cover.axes).ravel()
    row[at.BOX_POSITION : at.BOX_HALF] = T.act(cover.middle)
    row[at.BOX_HALF :] = cover.half + shape.radius
    return row


def joined_rows(parts: Sequence[ShapeRows]) -> ShapeRows:
    """Several groups of shapes as one."""
    shape_i = [part.shape_i.copy() for part in parts]
    vertices = spheres = 0
    for rows, part in zip(shape_i, parts, strict=True):
        rows[:, at.SHAPE_FIRST : at.SHAPE_LAST + 1] += vertices
        rows[:, at.FINE_FIRST : at.FINE_LAST + 1] += spheres
        vertices += part.verts.shape[1]
        spheres += part.fine.shape[1]
    return ShapeRows(
        np.concatenate(shape_i),
        np.concatenate([part.shape_f for part in parts]),
        np.ascontiguousarray(np.concatenate([part.verts for part in parts], axis=1)),
        np.ascontiguousarray(np.concatenate([part.fine for part in parts], axis=1)),
        np.concatenate([part.reach for part in parts]),
        tuple(name for part in parts for name in part.names),
    )


def pair_rows(chain: Chain, rows: ShapeRows, pairs: Sequence[tuple[int, int]]) -> Integers:
    """Pairs of shapes; a shape of the world always comes second, and two of the world are left out."""
    joints = rows.shape_i[:, at.SHAPE_JOINT]
    made = []
    for a, b in pairs:
        if joints[a] == joints[b] == 0:
            continue
        first, second = (b, a) if joints[a] == 0 else (a, b)
        made.append((first, second, chain.common(int(joints[first]), int(joints[second])), -1))
    return np.array(made, dtype=np.int32).reshape(-1, 4)
