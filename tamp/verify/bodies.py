"""Where the true object is while hands move: at rest, held, dragged along, pressed down, or its part operated."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from robots.spatial import Array, points
from robots.workcell import Side, Table
from tamp.verify.found import Kind
from worlds.assets.asset import Asset
from worlds.bullet.ghost import GhostCell

SLIDE = (1e-3, 1e-2)
"""How far a dragging hand may rise or sink [m] and turn [rad]: what it drags stays flat on the table."""

SUNK = 0.003
"""How far a tilted object may be below the table top [m]."""

FOOT = 0.003
"""A point of the object this close to the table [m] before and after a tilt, and moved no further, is its foot."""

UPRIGHT = np.radians(0.5)
"""Largest turn about the vertical that is still a tilt [rad]."""

TILT_SAMPLES = 11
"""States of a tilt in which the object's height above the table is checked."""


class Body:
    """The object's body: where it rests, or in which hand it is.

    Attributes:
        holder: The hand that carries it; ``None`` while it rests.
    """

    def __init__(self, cell: GhostCell, T_world_body: pin.SE3) -> None:
        self.cell = cell
        self.holder: Side | None = None
        self._T_world_body, self._T_hand_body = T_world_body, pin.SE3.Identity()
        cell.place_object(T_world_body)

    def pose(self) -> pin.SE3:
        """``T_world_body``."""
        return self._T_world_body if self.holder is None else self.cell.hand(self.holder) * self._T_hand_body

    def take(self, side: Side) -> None:
        """From now on it moves with a hand."""
        self._T_hand_body = self.cell.hand(side).inverse() * self.pose()
        self.holder = side

    def leave(self) -> None:
        """From now on it stays where it is."""
        self._T_world_body, self.holder = self.pose(), None

    def put(self, T_world_body: pin.SE3) -> None:
        """It rests elsewhere."""
        self._T_world_body, self.holder = T_world_body, None

    def show(self) -> None:
        """Place it in the cell."""
        self.cell.place_object(self.pose())


class Carried:
    """The body during a motion that does no more than carry it, or leaves it alone."""

    def __init__(self, body: Body) -> None:
        self.body = body

    def follow(self) -> None:
        """Put the object where the hands have it by now."""
        if self.body.holder is not None:
            self.body.show()

    def end(self) -> list[tuple[Kind, str]]:
        """What was wrong, once the motion is over."""
        return []


class Operated(Carried):
    """The functional joint while a hand moves it: it follows the hand's motion relative to the body."""

    def __init__(self, body: Body, asset: Asset, side: Side, template: str) -> None:
        super().__init__(body)
        self.part, self.side, self.template = asset.part, side, template
        gripper = body.cell.workcell.arm(side).gripper
        self.T_hand_tcp = pin.SE3(np.eye(3), np.array([0.0, 0.0, gripper.tcp_offset]))
        self.slack = max(0.0, finger_gap(body.cell, side)) if template == "press" else 0.0
        self.before: pin.SE3 | None = None
        self.moved = 0.0

    def follow(self) -> None:
        """Put the joint where the hand has brought it by now."""
        super().follow()
        T_body_tcp = self.body.pose().inverse() * self.body.cell.hand(self.side) * self.T_hand_tcp
        if self.before is not None:
            if self.template in ("twist", "flip"):
                turned = pin.log3(T_body_tcp.rotation @ self.before.rotation.T)
                self.moved += float(turned @ self.part.axis)
            else:
                self.moved += float((T_body_tcp.translation - self.before.translation) @ self.part.axis)
        self.before = T_body_tcp
        driven = (self.moved - self.slack) / (self.part.lever or 1.0)
        driven = self.part.sense * float(np.clip(driven, 0.0, self.part.travel))
        self.body.cell.place_part(self.part.start + driven)


class Dragged(Carried):
    """The object while a hand on top of it or behind it moves it along the table: it does what the hand does."""

    def __init__(self, body: Body, side: Side) -> None:
        super().__init__(body)
        self.first = body.cell.hand(side)
        self.side = side
        self.off, self.turn = 0.0, 0.0
        body.take(side)

    def follow(self) -> None:
        """Put the object where the hand has it, and note how far that is from a slide."""
        super().follow()
        T_move = self.body.cell.hand(self.side) * self.first.inverse()
        self.turn = max(self.turn, float(np.linalg.norm(pin.log3(T_move.rotation))))
        self.off = max(self.off, abs(float(self.body.cell.hand(self.side).translation[2] - self.first.translation[2])))

    def end(self) -> list[tuple[Kind, str]]:
        """Leave the object, and tell what was no slide."""
        self.body.leave()
        if self.off <= SLIDE[0] and self.turn <= SLIDE[1]:
            return []
        turn = np.degrees(self.turn)
        return [
            ("not_a_slide", f"the dragging hand rises or sinks by {1e3 * self.off:.1f} mm and turns by {turn:.1f} deg")
        ]


class Pressed(Carried):
    """The object while a hand presses it down on one side: it turns from one pose to another as the hand descends.

    It begins to turn when a finger meets it and is where it is expected when the hand is at its lowest.
    """

    def __init__(self, body: Body, side: Side, T_world_body: pin.SE3, lowest: float) -> None:
        super().__init__(body)
        self.side, self.lowest = side, lowest
        self.first, self.turn = body.pose(), pin.log6(T_world_body * body.pose().inverse())
        self.met: float | None = None

    def follow(self) -> None:
        """Turn the object as far as the hand has descended since it met it."""
        cell = self.body.cell
        height = float(cell.hand(self.side).translation[2])
        if self.met is None and finger_gap(cell, self.side) <= 0.0:
            self.met = height
        if self.met is not None:
            share = (self.met - height) / max(self.met - self.lowest, 1e-9)
            self.body.put(pin.exp6(float(np.clip(share, 0.0, 1.0)) * self.turn) * self.first)
            self.body.show()

    def end(self) -> list[tuple[Kind, str]]:
        """Tell when the hand met nothing."""
        return [] if self.met is not None else [missed(self.side, finger_gap(self.body.cell, self.side))]


def finger_gap(cell: GhostCell, side: Side) -> float:
    """Distance from the nearer finger of a hand to the object [m]."""
    return min(cell.finger_gap(side, finger) for finger in (0, 1))


def missed(side: Side, gap: float) -> tuple[Kind, str]:
    """That a hand ended without a contact, in words."""
    return "misses_object", f"the {side} fingers end {1e3 * gap:.1f} mm from the object that they should move"


def tilt_faults(table: Table, vertices: Array, T_before: pin.SE3, T_after: pin.SE3) -> list[tuple[Kind, str]]:
    """What keeps the way from one pose to another from being a tilt about a foot on the table.

    Args:
        table: The table.
        vertices: ``(n, 3)`` of the object's geometry in the body frame [m].
        T_before: ``T_world_body`` before.
        T_after: The same after.
    """
    turn = pin.log6(T_after * T_before.inverse())
    faults: list[tuple[Kind, str]] = []
    if (about := abs(float(turn.angular[2]))) > UPRIGHT:
        faults.append(("not_a_tilt", f"the pressed object turns by {np.degrees(about):.1f} deg about the vertical"))
    deepest = 0.0
    for share in np.linspace(0.0, 1.0, TILT_SAMPLES):
        deepest = max(deepest, _sunk(table, points(pin.exp6(float(share) * turn) * T_before, vertices)))
    if deepest > SUNK:
        faults.append(("not_a_tilt", f"the pressed object goes {1e3 * deepest:.1f} mm into the table"))
    before, after = points(T_before, vertices), points(T_after, vertices)
    low = (np.abs(before[:, 2] - table.top) < FOOT) & (np.abs(after[:, 2] - table.top) < FOOT)
    if not (low & (np.linalg.norm(after - before, axis=1) < FOOT)).any():
        faults.append(("not_a_tilt", "no point of the pressed object stays on the table as its foot"))
    return faults


def _sunk(table: Table, vertices: Array) -> float:
    """How far the lowest of some points above the table's area is below its top [m]."""
    over = (np.abs(vertices[:, :2] - np.asarray(table.centre)) <= np.asarray(table.size) / 2).all(axis=1)
    return float((table.top - vertices[over, 2]).max(initial=0.0))


def beyond_edge(table: Table, point: Array) -> float:
    """How far a point ``(3,)`` is beyond the table's edges [m]; negative inside."""
    return float((np.abs(point[:2] - np.asarray(table.centre)) - np.asarray(table.size) / 2).max())
