"""How a chain of proven edges is made shorter, every new edge proven like the old ones."""

from __future__ import annotations

import numpy as np

from planners.compiled.edges import edge
from planners.compiled.jit import kernel, part
from planners.compiled.layout import FREE
from planners.compiled.random import uniform

GAIN = 1e-3
"""Cuts that save a smaller share of the path are not tried."""


@kernel
def _length(points, first, last):
    """Length of the path between two of its points, L2 [rad]."""
    total = 0.0
    for k in range(first, last):
        square = 0.0
        for d in range(points.shape[1]):
            square += (points[k + 1, d] - points[k, d]) ** 2
        total += np.sqrt(square)
    return total


@kernel
def _skip(tables, work, slots, points, count, margin, slack):
    """Leave out points as far ahead as a straight edge is free; how many remain."""
    k = 0
    while k < count - 2:
        ahead = count - 1
        while ahead > k + 1:
            if edge(tables, work, slots, points[k], points[ahead], margin, slack) == FREE:
                for m in range(count - ahead):
                    points[k + 1 + m, :] = points[ahead + m, :]
                count -= ahead - k - 1
                break
            ahead -= 1
        k += 1
    return count


@kernel
def _at(points, count, place, out):
    """Write the point of the path at arc length ``place`` to ``out``; the number of the edge it is on."""
    k = 0
    while k < count - 2:
        step = _length(points, k, k + 1)
        if place < step:
            break
        place -= step
        k += 1
    step = _length(points, k, k + 1)
    share = min(1.0, place / step) if step > 0.0 else 0.0
    for d in range(points.shape[1]):
        out[d] = points[k, d] + share * (points[k + 1, d] - points[k, d])
    return k


@part
def shorten(tables, work, slots, path, margin, slack, attempts, seed):
    """The path ``(n, d)`` [rad] with detours cut: random pairs of its points are joined where the line is free.

    Geraerts and Overmars, "Creating High-quality Paths for Motion Planning", IJRR 2007, section 3.1. Points that can be
    left out are left out before and after.
    """
    count, size = path.shape
    points = np.empty((count + attempts + 2, size))
    points[:count, :] = path
    state = np.full(1, seed, dtype=np.uint64)
    a, b = np.empty(size), np.empty(size)
    for turn in range(-1, attempts + 1):
        if turn < 0 or turn == attempts:
            count = _skip(tables, work, slots, points, count, margin, slack)
            continue
        if count < 3:
            break
        total = _length(points, 0, count - 1)
        s, t = total * uniform(state), total * uniform(state)
        s, t = min(s, t), max(s, t)
        i, j = _at(points, count, s, a), _at(points, count, t, b)
        straight = 0.0
        for d in range(size):
            straight += (b[d] - a[d]) ** 2
        if i == j or (t - s) - np.sqrt(straight) < GAIN * total or count + 2 >= points.shape[0]:
            continue
        if edge(tables, work, slots, a, b, margin, slack) == FREE:
            count = _replace(points, count, i, j, a, b)
    return points[:count].copy()


@kernel
def _replace(points, count, i, j, a, b):
    """Put ``a``, ``b`` in place of points ``i + 1 .. j``; how many points there are then."""
    shift = i + 2 - j
    if shift > 0:
        for m in range(count - 1, j, -1):
            points[m + shift, :] = points[m, :]
    else:
        for m in range(j + 1, count):
            points[m + shift, :] = points[m, :]
    points[i + 1, :], points[i + 2, :] = a, b
    return count + shift
