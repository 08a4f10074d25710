"""The one function that Python calls: everything compiled is linked into it once, which keeps compilation short."""

from __future__ import annotations

import numpy as np

from planners.compiled.bounds import drift_of
from planners.compiled.edges import begin, judge_cells, judge_path
from planners.compiled.jit import entry, part
from planners.compiled.kinematics import place_joints, place_sphere, place_sway
from planners.compiled.layout import BOUND, CENTRE, LANES, PAIR_A, PAIR_B, PAIR_COMMON, RADIUS, SHAPE_JOINT
from planners.compiled.narrow import separate
from planners.compiled.rake import relative, start_axis
from planners.compiled.shortcut import shorten
from planners.compiled.tables import Integers, Tables
from planners.compiled.tree import connect
from robots.spatial import Array

CELLS, STATES, PATH, CONNECT, SHORTEN, GRID = range(6)
"""Tasks of ``run``."""


@entry
def run(
    task: int,
    tables: Tables,
    rest: Array,
    slots: Integers,
    points: Array,
    more: Array,
    margin: float,
    slack: float,
    longest: float,
    count: int,
    seed: int,
) -> tuple[Array, Integers, int, int]:
    """Do one task; see the functions that it calls.

    Args:
        task: Which.
        tables: The cell.
        rest: ``(slots,)`` joint positions of everything that stays.
        slots: ``(d,)`` places of the joints that move.
        points: ``(n, d)`` states, centres of cells, path, or start and goals.
        more: ``(m, d)`` plays of cells, or bounds of samples.
        margin: Distance to keep [m].
        slack: How much of it may be lost between the centres of cells [m].
        longest: Longest extension of a tree, L2 [rad].
        count: Most samples, attempts to shorten, or the pair of a grid.
        seed: Makes searches repeatable.

    Returns:
        A path ``(k, d)``, verdicts ``(n,)``, two numbers: what the task gives of these.
    """
    work = begin(tables, rest)
    path, verdicts, first, second = np.empty((0, points.shape[1])), np.empty(0, dtype=np.int32), 0, 0
    if task == PATH:
        first, second = judge_path(tables, work, slots, points, margin, slack)
    elif task == CONNECT:
        path, first, second = connect(
            tables, work, slots, points[0], points[1:], more, margin, slack, longest, count, seed
        )
    elif task == SHORTEN:
        path = shorten(tables, work, slots, points, margin, slack, count, seed)
    elif task == GRID:
        path = _distances(tables, work, slots, points, more, count)
    else:
        verdicts = judge_cells(tables, work, slots, points, more, margin, task == STATES)
    return path, verdicts, first, second


@part
def _distances(tables, work, slots, points, plays, pair):
    """Lower bounds ``(n, 1)`` of the distance of a pair anywhere in cells [m]."""
    joint_i, shape_i, shape_f = tables.joint_i, tables.shape_i, tables.shape_f
    a, b = tables.pair_i[pair, PAIR_A], tables.pair_i[pair, PAIR_B]
    grown = shape_f[a, RADIUS] + shape_f[b, RADIUS]
    endless = np.inf + slots[0]
    found = np.empty((points.shape[0], 1))
    for first in range(0, points.shape[0], LANES):
        count = min(LANES, points.shape[0] - first)
        for l in range(LANES):
            k = first + (l if l < count else 0)
            for d in range(slots.shape[0]):
                work.q[slots[d], l], work.e[slots[d], l] = points[k, d], plays[k, d]
        place_joints(joint_i, tables.joint_f, work.q, work.rot, work.pos)
        for turn in range(2):
            s = a if turn == 0 else b
            j = shape_i[s, SHAPE_JOINT]
            x, y, z = shape_f[s, CENTRE], shape_f[s, CENTRE + 1], shape_f[s, CENTRE + 2]
            place_sphere(work.rot, work.pos, j, x, y, z, work.centre, s)
            bound = shape_f[s, BOUND]
            place_sway(
                joint_i,
                tables.chain,
                tables.reach,
                j,
                s,
                bound,
                work.e,
                work.rot,
                work.pos,
                work.centre,
                work.sway,
                work.gap,
            )
        drift_of(work.sway, a, b, False, tables.pair_i[pair, PAIR_COMMON], 0.0, work.drift)
        for l in range(count):
            relative(shape_i, shape_f, work.rot, work.pos, work.narrow, a, b, l)
            start_axis(work.axis, pair, work.narrow)
            lower, _ = separate(shape_i, shape_f, tables.verts, a, b, work.axis, pair, endless, -endless, work.narrow)
            found[first + l, 0] = lower - grown - work.drift[l]
    return found
