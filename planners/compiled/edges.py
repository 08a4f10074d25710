"""Whether straight joint edges, paths and states are free: cells are proven, and cut smaller where they are not."""

from __future__ import annotations

import numpy as np

from planners.compiled.jit import kernel, part
from planners.compiled.layout import FREE, HIT, LANES, UNSURE
from planners.compiled.rake import rake
from planners.compiled.work import DEEPEST, scratch

CELL = 1.0 / 16.0
"""Longest first cell of an edge, L2 [rad]."""

FINEST = 1e-5
"""Cells shorter than this, L2 [rad], are not cut: what cannot be proven there is called unsure."""


@kernel
def all_pairs(work):
    """Number of pairs, none of them open."""
    work.open[:] = 0
    return work.order.shape[0]


@kernel
def _open_pairs(work, pairs):
    """Bring the open pairs to the front of the order; how many they are."""
    kept = 0
    for n in range(pairs):
        pair = work.order[n]
        if work.open[pair]:
            work.order[n], work.order[kept] = work.order[kept], pair
            kept += 1
    work.open[:] = 0
    return kept


@kernel
def _fill(work, slots, a, b, side, first, count):
    """Let the lanes stand for waiting intervals ``first ..``; lanes beyond ``count`` repeat the first."""
    for l in range(LANES):
        k = first + (l if l < count else 0)
        middle, half = work.mids[side, k], work.halves[side, k]
        for d in range(slots.shape[0]):
            change = b[d] - a[d]
            work.q[slots[d], l] = a[d] + middle * change
            work.e[slots[d], l] = abs(half * change)


@kernel
def edge(tables, work, slots, a, b, margin, slack):
    """The verdict on the straight line between two configurations, ends included.

    Args:
        tables: The cell.
        work: Scratch whose ``q`` already holds the joints that stay where they are, and whose ``e`` is 0 for them.
        slots: ``(d,)`` places in the joint positions that change.
        a: ``(d,)`` begin [rad].
        b: ``(d,)`` end [rad].
        margin: Distance to keep [m].
        slack: How much of it may be lost between the centres of cells [m].
    """
    square = 0.0
    for d in range(slots.shape[0]):
        square += (b[d] - a[d]) ** 2
    length = np.sqrt(square)
    rows = max(1, int(np.ceil(length / (CELL * LANES))))
    waiting = rows * LANES
    if waiting > DEEPEST:
        return UNSURE
    for r in range(rows):
        for l in range(LANES):
            work.mids[0, r * LANES + l] = (l * rows + r + 0.5) / waiting
            work.halves[0, r * LANES + l] = 0.5 / waiting
    side, pairs = 0, all_pairs(work)
    while waiting:
        left = 0
        for first in range(0, waiting, LANES):
            count = min(LANES, waiting - first)
            _fill(work, slots, a, b, side, first, count)
            if rake(tables, work, pairs, length == 0.0, margin, slack, waiting > 0):
                return HIT
            left = _keep_open(work, side, first, count, left)
        if left == 0:
            return FREE
        if length == 0.0 or work.halves[1 - side, 0] * length < FINEST:
            return UNSURE
        pairs = _open_pairs(work, pairs)
        waiting = _cut(work, side, left)
        if waiting > DEEPEST - LANES:
            return UNSURE
    return FREE


@kernel
def _keep_open(work, side, first, count, left):
    """Move the intervals of unproven lanes to the other side; how many lie there now."""
    for l in range(count):
        if work.verdict[l] != FREE:
            work.mids[1 - side, left] = work.mids[side, first + l]
            work.halves[1 - side, left] = work.halves[side, first + l]
            left += 1
    return left


@kernel
def _cut(work, side, left):
    """Cut every interval of the other side into equal parts, two to eight so as to fill the lanes; how many result."""
    parts = min(8, max(2, LANES // left))
    if left * parts > DEEPEST:
        return DEEPEST
    for k in range(left):
        middle, half = work.mids[1 - side, k], work.halves[1 - side, k]
        for i in range(parts):
            work.mids[side, k * parts + i] = middle + half * ((2 * i + 1) / parts - 1.0)
            work.halves[side, k * parts + i] = half / parts
    return left * parts


@kernel
def begin(tables, rest):
    """Scratch in which every joint is where ``rest`` ``(slots,)`` says, without play."""
    work = scratch(tables, rest.shape[0])
    for k in range(rest.shape[0]):
        work.q[k, :] = rest[k]
    return work


@part
def judge_path(tables, work, slots, points, margin, slack):
    """The first edge of a path ``(n, d)`` that is not proven free, and its verdict; ``n - 1`` and FREE when all are."""
    for k in range(points.shape[0] - 1):
        verdict = edge(tables, work, slots, points[k], points[k + 1], margin, slack)
        if verdict != FREE:
            return k, verdict
    return points.shape[0] - 1, FREE


@part
def judge_cells(tables, work, slots, centres, plays, margin, still):
    """The verdicts ``(n,)`` on cells: centres ``(n, d)`` and how far each joint may be from them ``(n, d)``.

    With ``still``, the plays are zero and not looked at.
    """
    verdicts = np.empty(centres.shape[0], dtype=np.int32)
    pairs = all_pairs(work)
    for first in range(0, centres.shape[0], LANES):
        count = min(LANES, centres.shape[0] - first)
        for l in range(LANES):
            k = first + (l if l < count else 0)
            for d in range(slots.shape[0]):
                work.q[slots[d], l] = centres[k, d]
                work.e[slots[d], l] = 0.0 if still else plays[k, d]
        rake(tables, work, pairs, still, margin, 0.0, count == 1)
        for l in range(count):
            verdicts[first + l] = work.verdict[l]
    return verdicts
