"""Which chain of proven edges leads from a start to one of several goals: RRT-Connect, compiled as a whole.

Kuffner and LaValle, "RRT-Connect: An Efficient Approach to Single-Query Path Planning", ICRA 2000; samples too far
from a node that failed before are not spent on it: Yershova et al., "Dynamic-Domain RRTs", ICRA 2005.
"""

from __future__ import annotations

import numpy as np

from planners.compiled.edges import edge
from planners.compiled.jit import kernel, lanes, part
from planners.compiled.layout import FREE
from planners.compiled.random import uniform

DOMAIN = 4.0
"""Furthest sample that a node of seven joints which failed once is extended to, L2 [rad]; it grows with the root of
their number, as distances in a box do."""

NODES = 50_000
"""Most nodes of a tree."""

TURNS = 50
"""Failures after which the other tree grows."""


@lanes
def _distances(nodes, count, q, out):
    """Squared distances of the first nodes ``(d, capacity)`` from ``q``."""
    for k in range(count):
        out[k] = 0.0
    for d in range(q.shape[0]):
        for k in range(count):
            step = nodes[d, k] - q[d]
            out[k] += step * step


@kernel
def _nearest(nodes, count, q, out):
    _distances(nodes, count, q, out)
    at = 0
    for k in range(1, count):
        if out[k] < out[at]:
            at = k
    return at


@kernel
def _add(nodes, parents, domain, counts, side, q, parent):
    k = counts[side]
    for d in range(q.shape[0]):
        nodes[side, d, k] = q[d]
    parents[side, k] = parent
    domain[side, k] = np.inf
    counts[side] = k + 1
    return k


@kernel
def _towards(nodes, side, k, q, most, step):
    """Write to ``step`` the point at most ``most`` from a node towards ``q``; whether it is ``q``."""
    square = 0.0
    for d in range(q.shape[0]):
        square += (q[d] - nodes[side, d, k]) ** 2
    length = np.sqrt(square)
    share = 1.0 if length <= most else most / length
    for d in range(q.shape[0]):
        step[d] = q[d] if share == 1.0 else nodes[side, d, k] + share * (q[d] - nodes[side, d, k])
    return share == 1.0


@kernel
def _path(nodes, parents, ends):
    """The points from the root of the first tree to that of the second, through both ends, which coincide."""
    lengths = np.zeros(2, dtype=np.int64)
    for side in range(2):
        k = ends[side]
        while k >= 0:
            lengths[side] += 1
            k = parents[side, k]
    points = np.empty((lengths[0] + lengths[1] - 1, nodes.shape[1]))
    for side in range(2):
        k = ends[side]
        row = lengths[0] - 1
        while k >= 0:
            points[row, :] = nodes[side, :, k]
            row += -1 if side == 0 else 1
            k = parents[side, k]
    return points


@part
def connect(tables, work, slots, start, goals, bounds, margin, slack, longest, iterations, seed):
    """Search.

    Args:
        tables: The cell.
        work: Scratch in which everything that stays is where it is.
        slots: ``(d,)`` places of the joints that move.
        start: ``(d,)`` [rad].
        goals: ``(m, d)`` [rad], nearest first.
        bounds: ``(2, d)`` where samples are drawn [rad].
        margin: Distance to keep [m].
        slack: How much of it may be lost between the centres of cells [m].
        longest: Longest extension, L2 [rad].
        iterations: Most samples.
        seed: Makes the call repeatable.

    Returns:
        The points ``(n, d)`` of a path, none when there is none; samples drawn; configurations looked at.
    """
    for g in range(goals.shape[0]):
        if edge(tables, work, slots, start, goals[g], margin, slack) == FREE:
            points = np.empty((2, start.shape[0]))
            points[0, :] = start
            points[1, :] = goals[g]
            return points, 0, 16 * work.rakes[0]
    size, most = start.shape[0], min(NODES, 4 * iterations) + goals.shape[0] + 2
    nodes, parents = np.empty((2, size, most)), np.empty((2, most), dtype=np.int64)
    domain, counts = np.empty((2, most)), np.zeros(2, dtype=np.int64)
    far, sample, step, ends = np.empty(most), np.empty(size), np.empty(size), np.zeros(2, dtype=np.int64)
    _add(nodes, parents, domain, counts, 0, start, -1)
    for g in range(goals.shape[0]):
        _add(nodes, parents, domain, counts, 1, goals[g], -1)
    furthest = DOMAIN * np.sqrt(size / 7.0)
    state = np.full(1, seed, dtype=np.uint64)
    side, failures = 0, 0
    here, there = np.empty(size), np.empty(size)
    for n in range(iterations):
        if failures == TURNS:
            side, failures = 1 - side, 0
        failures += 1
        for d in range(size):
            sample[d] = bounds[0, d] + uniform(state) * (bounds[1, d] - bounds[0, d])
        near = _nearest(nodes[side], counts[side], sample, far)
        if far[near] > domain[side, near] ** 2:
            continue
        if max(counts[0], counts[1]) > most - 2:
            break
        _towards(nodes, side, near, sample, longest, step)
        here[:] = nodes[side, :, near]
        if edge(tables, work, slots, here, step, margin, slack) != FREE:
            domain[side, near] = furthest
            continue
        there[:] = step
        ends[side] = _add(nodes, parents, domain, counts, side, there, near)
        other = 1 - side
        near = _nearest(nodes[other], counts[other], there, far)
        while counts[other] < most - 1:
            reached = _towards(nodes, other, near, there, longest, step)
            here[:] = nodes[other, :, near]
            if edge(tables, work, slots, here, step, margin, slack) != FREE:
                break
            near = _add(nodes, parents, domain, counts, other, step, near)
            if reached:
                ends[other] = near
                return _path(nodes, parents, ends), n + 1, 16 * work.rakes[0]
        side, failures = other, 0
    return np.empty((0, size)), iterations, 16 * work.rakes[0]
