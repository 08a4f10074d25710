"""Which path leads from a start to one of several goals on a constraint: RRT-Connect whose every step is projected.

Berenson, Srinivasa, Ferguson and Kuffner, "Manipulation Planning on Constraint Manifolds", ICRA 2009.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from robots.spatial import Array

STEP = 0.12
"""Length of one extension before projection, L2 [rad]."""

WANDER = 2.0
"""A projection may make a step this many times longer than ``STEP`` before it counts as lost."""

SMOOTHING = 12
"""Times that every waypoint is drawn towards the middle of its neighbours."""

SPACING = 0.04
"""Distance between waypoints of the final path, largest joint [rad]: a spline through them stays on the constraint."""


@dataclass(frozen=True, slots=True)
class Constraint:
    """What a search needs to know.

    Attributes:
        project: The configuration on the constraint and within limits near ``(d,)`` [rad], or ``None``; one that is
            there already comes back bit for bit.
        edge: Whether the straight line between two configurations on it, at most some steps apart, is allowed.
        lower: Where samples are drawn from ``(d,)`` [rad].
        upper: Where to ``(d,)`` [rad].
    """

    project: Callable[[Array], Array | None]
    edge: Callable[[Array, Array], bool]
    lower: Array
    upper: Array


@dataclass(frozen=True, slots=True)
class Spent:
    """What a search used without finding a path.

    Attributes:
        edges: Steps that were checked.
        samples: Samples drawn.
    """

    edges: int
    samples: int


class _Tree:
    """Configurations, and from which each was reached."""

    def __init__(self, roots: Array) -> None:
        self._nodes = np.empty((max(1024, len(roots)), roots.shape[1]))
        self._nodes[: len(roots)] = roots
        self.parents = [-1] * len(roots)

    def nearest(self, q: Array) -> int:
        return int(np.argmin(((self._nodes[: len(self.parents)] - q) ** 2).sum(axis=1)))

    def add(self, q: Array, parent: int) -> int:
        if len(self.parents) == len(self._nodes):
            self._nodes = np.concatenate([self._nodes, np.empty_like(self._nodes)])
        self._nodes[len(self.parents)] = q
        self.parents.append(parent)
        return len(self.parents) - 1

    def __getitem__(self, k: int) -> Array:
        return np.array(self._nodes[k])

    def branch(self, k: int) -> list[Array]:
        """From node ``k`` to its root."""
        out = []
        while k >= 0:
            out.append(self[k])
            k = self.parents[k]
        return out


def connect(
    constraint: Constraint, start: Array, goals: Array, *, rng: np.random.Generator, iterations: int
) -> Array | Spent:
    """A path on the constraint.

    Args:
        constraint: What may be.
        start: ``(d,)`` [rad], allowed.
        goals: ``(m, d)`` [rad], allowed, any of which will do; nearer ones first.
        rng: Draws the samples.
        iterations: Most samples.

    Returns:
        Waypoints ``(n, d)`` [rad] from exactly the start to exactly one of the goals, or what was spent in vain.
    """
    asked = 0

    def edge(a: Array, b: Array) -> bool:
        nonlocal asked
        asked += 1
        return constraint.edge(a, b)

    counted = replace(constraint, edge=edge)
    for goal in goals:
        direct = walk(counted, start, goal)
        if np.array_equal(direct[-1], goal):
            return np.array(direct if len(direct) > 1 else [start, goal])
    here, there, forward = _Tree(start[None]), _Tree(goals), True
    for _ in range(iterations):
        reached = _grow(counted, here, rng.uniform(constraint.lower, constraint.upper))
        met = _grow(counted, there, here[reached])
        if np.array_equal(here[reached], there[met]):
            first, second = here.branch(reached)[::-1], there.branch(met)[1:]
            joined = np.array([*first, *second])
            return joined if forward else joined[::-1]
        here, there, forward = there, here, not forward
    return Spent(asked, iterations)


def _grow(constraint: Constraint, tree: _Tree, target: Array) -> int:
    """Extend the nearest node as far towards the target as it goes; the last node."""
    at = tree.nearest(target)
    for q in walk(constraint, tree[at], target)[1:]:
        at = tree.add(q, at)
    return at


def walk(constraint: Constraint, a: Array, b: Array) -> list[Array]:
    """Allowed steps from ``a`` towards ``b``, ``a`` included; the last is exactly ``b`` when it was reached."""
    out, left = [a], float(np.linalg.norm(b - a))
    while left > 0.0:
        last = out[-1]
        q = constraint.project(b if left <= STEP else last + (b - last) * (STEP / left))
        if q is None or np.linalg.norm(q - last) > WANDER * STEP:
            break
        remaining = float(np.linalg.norm(b - q))
        if remaining > left - 0.1 * STEP and remaining > 0.0:
            break
        if not constraint.edge(last, q):
            break
        out.append(q)
        left = remaining
    return out


def shortened(constraint: Constraint, path: Array, *, rng: np.random.Generator, attempts: int) -> Array:
    """A path of allowed steps with the same ends that is no longer: parts of it replaced by direct walks."""
    points = list(path)
    for _ in range(attempts):
        if len(points) < 3:
            break
        i, j = sorted(int(k) for k in rng.integers(0, len(points), 2))
        if j - i < 2:
            continue
        direct = walk(constraint, points[i], points[j])
        if np.array_equal(direct[-1], points[j]) and _length(direct) < _length(points[i : j + 1]) - 1e-9:
            points[i : j + 1] = direct
    return np.array(points)


def _length(points: list[Array]) -> float:
    return float(np.linalg.norm(np.diff(np.array(points), axis=0), axis=1).sum())


def smoothed(constraint: Constraint, path: Array) -> Array:
    """The path, evenly spaced, with every waypoint drawn towards the middle of its neighbours where that is allowed."""
    points = list(spaced(constraint, path))
    for _ in range(SMOOTHING):
        for k in range(1, len(points) - 1):
            a, q, b = points[k - 1 : k + 2]
            moved = constraint.project(0.25 * a + 0.5 * q + 0.25 * b)
            if moved is not None and constraint.edge(a, moved) and constraint.edge(moved, b):
                points[k] = moved
    return np.array(points)


def spaced(constraint: Constraint, path: Array, spacing: float = SPACING) -> Array:
    """The path with projected waypoints between its own, at most ``spacing`` [rad] apart where that is allowed."""
    out = [path[0]]
    for a, b in itertools.pairwise(path):
        count = int(np.ceil(np.abs(b - a).max() / spacing))
        between = [constraint.project(a + (b - a) * (k / count)) for k in range(1, count)]
        line = [a, *(q for q in between if q is not None), b]
        allowed = all(constraint.edge(p, q) for p, q in itertools.pairwise(line))
        out += line[1:] if allowed else [b]
    return np.array(out)
