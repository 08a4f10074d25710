"""What may be asked about a cell of robots and obstacles: verdicts on states, cells and paths; paths between states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from planners.compiled import layout as at
from planners.compiled.machine import CELLS, CONNECT, PATH, SHORTEN, STATES, run
from planners.compiled.robot import Robot
from planners.compiled.tables import Flags, Integers, Shape, ShapeRows, Tables, joined_rows, pair_rows, shape_rows
from robots.spatial import Array

HELD_SPHERES = 3
"""Spheres of a held piece's cover: it is made anew for every object."""

_NOTHING = np.zeros((0, 0))


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """What a search returned.

    Attributes:
        points: ``(n, d)`` [rad]; ``n`` is 0 when there is no path.
        samples: Samples drawn.
        states: Configurations looked at.
    """

    points: Array
    samples: int
    states: int


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Some joints of a cell move while the others keep still.

    Attributes:
        tables: The cell, with the pairs whose distance changes.
        rest: ``(slots,)`` positions of all joints; those that move are ignored.
        slots: ``(d,)`` places of the joints that move.
    """

    tables: Tables
    rest: Array
    slots: Integers

    def states(self, q: Array, margin: float = 0.0) -> Integers:
        """Verdicts ``(n,)`` on configurations ``(n, d)`` [rad]: free, if every pair keeps more than the margin [m]."""
        return self._run(STATES, q, _NOTHING, margin)[1]

    def cells(self, centres: Array, plays: Array, margin: float = 0.0) -> Integers:
        """Verdicts ``(n,)`` on all configurations within ``plays`` ``(n, d)`` of ``centres`` ``(n, d)`` [rad]."""
        return self._run(CELLS, centres, np.array(plays, dtype=np.float64, order="C"), margin)[1]

    def path(self, points: Array, margin: float = 0.0, slack: float = 0.0) -> tuple[int, int]:
        """The first edge of a path ``(n, d)`` [rad] that is not proven free, and the verdict on it.

        ``(n - 1, FREE)`` when all are. Every configuration of a free edge keeps more than ``margin - slack`` [m].
        """
        _, _, first, verdict = self._run(PATH, points, _NOTHING, margin, slack)
        return int(first), int(verdict)

    def connect(
        self,
        start: Array,
        goals: Array,
        bounds: Array,
        *,
        seed: int,
        margin: float = 0.0,
        slack: float = 0.0,
        longest: float = 1.0,
        samples: int = 200_000,
    ) -> Found:
        """A path of proven edges from ``start`` ``(d,)`` to one of ``goals`` ``(m, d)``, nearest first [rad]."""
        ends = np.vstack([start, goals])
        box = np.array(bounds, dtype=np.float64, order="C")
        points, _, used, states = self._run(CONNECT, ends, box, margin, slack, longest, samples, seed)
        return Found(points, int(used), int(states))

    def shorten(self, path: Array, *, seed: int, margin: float = 0.0, slack: float = 0.0, attempts: int = 60) -> Array:
        """A path of proven edges with the same ends that is no longer than ``path`` ``(n, d)`` [rad]."""
        return self._run(SHORTEN, path, _NOTHING, margin, slack, 0.0, attempts, seed)[0]

    def _run(
        self,
        task: int,
        points: Array,
        more: Array,
        margin: float,
        slack: float = 0.0,
        longest: float = 0.0,
        count: int = 0,
        seed: int = 0,
    ) -> tuple[Array, Integers, int, int]:
        points = np.array(points, dtype=np.float64, order="C")  # numba compiles anew for a read-only array
        found: tuple[Array, Integers, int, int] = run(
            task, self.tables, self.rest, self.slots, points, more, margin, slack, longest, count, seed
        )
        return found


class Cell:
    """A robot among obstacles, with things in its hands.

    Attributes:
        names: Of all shapes: the robot's, then the others'.
        tables: With every pair.
    """

    def __init__(self, robot: Robot, others: Sequence[Shape], pairs: Sequence[tuple[int, int]]) -> None:
        """Join the robot's tables with other shapes.

        Args:
            robot: The robot.
            others: Obstacles, on joint 0, and held things, on the joint that carries them.
            pairs: Which shapes may meet beside the robot's own pairs, the others counted after the robot's shapes.
        """
        rows = joined_rows([robot.rows, shape_rows(robot.chain, others, HELD_SPHERES)]) if others else robot.rows
        added = pair_rows(robot.chain, rows, pairs)
        self.names = rows.names
        self.tables = _assembled(robot, rows, np.concatenate([robot.pair_i, added]))
        self._movers = _movers(self.tables)

    def motion(self, slots: Sequence[int], rest: Array, active: Flags | None = None) -> Motion:
        """The motion of the joints at ``slots`` while the others stay at ``rest`` ``(slots,)`` [rad].

        Args:
            slots: Places of the joints that move.
            rest: Positions of all joints.
            active: ``(pairs,)`` whether a pair counts; all without it.
        """
        chosen = np.array(slots, dtype=np.int32)
        moved = np.asarray(self._movers[:, chosen].any(axis=1))
        if active is not None:
            moved = moved & active
        tables = self.tables._replace(pair_i=np.ascontiguousarray(self.tables.pair_i[moved]))
        return Motion(tables, np.array(rest, dtype=np.float64), chosen)


def _assembled(robot: Robot, rows: ShapeRows, pair_i: Integers) -> Tables:
    chain = robot.chain
    return Tables(
        chain.joint_i,
        chain.joint_f,
        chain.chain,
        rows.reach,
        rows.shape_i,
        rows.shape_f,
        rows.verts,
        rows.fine,
        np.ascontiguousarray(pair_i),
        *robot.grids,
    )


def _movers(tables: Tables) -> Flags:
    """``(pairs, slots)`` which joint positions change the distance of a pair."""
    slots = tables.joint_i[:, at.JOINT_SLOT]
    on = np.zeros((len(slots), int(slots.max()) + 1), dtype=bool)
    for j in range(1, len(slots)):
        for k in range(int(tables.joint_i[j, at.JOINT_DEPTH])):
            on[j, slots[tables.chain[j, k]]] = True
    joints = tables.shape_i[:, at.SHAPE_JOINT]
    ends = on[joints[tables.pair_i[:, at.PAIR_A]]], on[joints[tables.pair_i[:, at.PAIR_B]]]
    return np.asarray(ends[0] ^ ends[1])
