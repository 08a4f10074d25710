"""The collision world as the kernels see it: the same hulls, placements and allowed pairs, kept in step with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from planners.compiled import layout as at
from planners.compiled.cell import HELD_SPHERES, Cell, Motion
from planners.compiled.robot import Robot, robot
from planners.compiled.tables import Flags, Shape, cover_of
from planners.pairs import public_name
from robots.spatial import Array


class Mirror:
    """Compiled tables of both arms, table, floor and an object; made anew, in a few milliseconds, when one moves."""

    def __init__(self, model: pin.Model, cell: pin.GeometryModel, pairs: Sequence[tuple[int, int]]) -> None:
        self._robot: Robot = robot(model, cell, pairs)
        self._names = [public_name(shape.name) for shape in cell.geometryObjects]
        self._pieces: tuple[Shape, ...] = ()
        self._place: tuple[int, pin.SE3] | None = None
        self._cell: Cell | None = None
        self._allowed: frozenset[frozenset[str]] = frozenset()
        self._active: Flags | None = None

    def set_object(self, name: str, hulls: Sequence[Array]) -> None:
        """Replace the object; it is absent until placed."""
        shapes = [Shape(name, 0, at.HULL, pin.SE3.Identity(), np.asarray(hull, dtype=np.float64)) for hull in hulls]
        self._pieces = tuple(replace(shape, cover=cover_of(shape, HELD_SPHERES)) for shape in shapes)
        self.place(None)

    def place(self, place: tuple[int, pin.SE3] | None) -> None:
        """Put the object on a joint, 0 being the world, or away."""
        self._place = None if place is None else (place[0], place[1].copy())
        self._cell = self._active = None

    def allow(self, pairs: frozenset[frozenset[str]]) -> None:
        """Replace the pairs that may touch."""
        self._allowed, self._active = pairs, None

    def motion(self, slots: Sequence[int], rest: Array) -> Motion:
        """The motion of the joints at ``slots`` while all others stay at ``rest`` ``(model.nq,)`` [rad] or [m]."""
        cell = self._present()
        if self._active is None:
            self._active = self._counted(cell)
        return cell.motion(slots, rest, self._active)

    def _present(self) -> Cell:
        if self._cell is None:
            joint, T = self._place or (0, pin.SE3.Identity())
            others = [] if self._place is None else [replace(s, joint=joint, T_joint_shape=T) for s in self._pieces]
            count = len(self._names)
            self._cell = Cell(self._robot, others, [(k, count + m) for m in range(len(others)) for k in range(count)])
        return self._cell

    def _counted(self, cell: Cell) -> Flags:
        """Which pairs of a cell may not touch."""
        names = [*self._names, *cell.names[len(self._names) :]]
        ends = cell.tables.pair_i[:, [at.PAIR_A, at.PAIR_B]].tolist()
        return np.array([frozenset((names[a], names[b])) not in self._allowed for a, b in ends], dtype=bool)
