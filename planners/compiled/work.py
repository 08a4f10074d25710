"""Scratch memory of the kernels: made once per call, so that calls may run side by side."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from planners.compiled.jit import kernel
from planners.compiled.layout import BOUND, CENTRE, LANES
from robots.spatial import Array

DEEPEST = 4096
"""Most intervals of one edge that may wait for a proof."""

Singles = np.ndarray[Any, np.dtype[np.float32]]
Bytes = np.ndarray[Any, np.dtype[np.uint8]]
Longs = np.ndarray[Any, np.dtype[np.int64]]
Integers = np.ndarray[Any, np.dtype[np.int32]]


class Work(NamedTuple):
    """Scratch of one call; the last axis of all but the last few is the lane.

    Attributes:
        q: ``(slots, 16)`` joint positions.
        e: ``(slots, 16)`` how far each joint may be from them.
        rot, pos: ``(joints, 9 or 3, 16)`` poses of joints.
        centre: ``(shapes, 3, 16)`` centres of bounding spheres.
        grown: ``(shapes, 16)`` radii of bounding spheres, grown by what the shapes may move in the world.
        sway: ``(shapes, depth + 1, 16)`` how far a point of a shape may move by the joints from a depth on.
        fine: ``(spheres, 3, 16)`` centres of fine spheres.
        known: ``(shapes, 2)`` whether centre and sway, and whether the fine spheres are up to date.
            Shapes of the world always are.
        drift: ``(16,)`` how far the two shapes of a pair may come closer.
        gap: ``(16,)`` gap between bounds.
        deep: ``(16,)`` gap between spheres inside the shapes.
        axis: ``(pairs, 3)`` last separating direction, in the frame of the first shape's joint.
        narrow: ``(16, 3)`` scratch of ``separate``, then a rotation and a position.
        order: ``(pairs,)`` the pairs in the order in which they are looked at.
        open: ``(pairs,)`` which pairs left something unproven.
        verdict: ``(16,)``.
        mids, halves: ``(2, DEEPEST)`` intervals of an edge that wait.
        rakes: ``(1,)`` how many so far.
        shape_s: ``shape_f`` in single precision.
    """

    q: Array
    e: Array
    rot: Array
    pos: Array
    centre: Singles
    grown: Singles
    sway: Singles
    fine: Singles
    known: Bytes
    drift: Singles
    gap: Singles
    deep: Singles
    axis: Array
    narrow: Array
    order: Integers
    open: Bytes
    verdict: Integers
    mids: Array
    halves: Array
    rakes: Longs
    shape_s: Singles


@kernel
def scratch(tables, slots):
    """A fresh ``Work`` for these tables and a number of joint positions."""
    joints, shapes, pairs = tables.joint_i.shape[0], tables.shape_i.shape[0], tables.pair_i.shape[0]
    rot = np.empty((joints, 9, LANES))
    pos = np.zeros((joints, 3, LANES))
    rot[0] = 0.0
    rot[0, 0], rot[0, 4], rot[0, 8] = 1.0, 1.0, 1.0
    centre, grown = np.empty((shapes, 3, LANES), dtype=np.float32), np.empty((shapes, LANES), dtype=np.float32)
    known = np.ones((shapes, 2), dtype=np.uint8)
    for s in range(shapes):
        for i in range(3):
            centre[s, i, :] = tables.shape_f[s, CENTRE + i]
        grown[s, :] = tables.shape_f[s, BOUND]
    order = np.empty(pairs, dtype=np.int32)
    for k in range(pairs):
        order[k] = k
    return Work(
        np.zeros((slots, LANES)),
        np.zeros((slots, LANES)),
        rot,
        pos,
        centre,
        grown,
        np.empty((shapes, tables.chain.shape[1] + 1, LANES), dtype=np.float32),
        np.empty((tables.fine.shape[1], 3, LANES), dtype=np.float32),
        known,
        np.zeros(LANES, dtype=np.float32),
        np.empty(LANES, dtype=np.float32),
        np.empty(LANES, dtype=np.float32),
        np.zeros((pairs, 3)),
        np.empty((16, 3)),
        order,
        np.zeros(pairs, dtype=np.uint8),
        np.zeros(LANES, dtype=np.int32),
        np.empty((2, DEEPEST)),
        np.empty((2, DEEPEST)),
        np.zeros(1, dtype=np.int64),
        tables.shape_f.astype(np.float32),
    )
