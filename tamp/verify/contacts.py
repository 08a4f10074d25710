"""What touches what while a plan is walked through, and how close the rest comes."""

from __future__ import annotations

from dataclasses import dataclass

from worlds.bullet.ghost import GhostCell, Names

PENETRATION = 0.001
"""Depth that counts as a collision [m]: PyBullet rounds each hull by a millimetre, so a touch shows as up to 2 mm."""

SHALLOW = 0.003
"""The same for bodies that are meant to touch but not to press [m]: a touch and a millimetre."""

CLEARANCE_EVERY = 25
"""Every how many states the distances of bodies that do not touch are measured."""

CLEARANCE_CAP = 0.20
"""Distances beyond this are not told apart [m]."""


@dataclass(frozen=True, slots=True)
class _Worst:
    """The deepest unintended contact of two bodies in one step, and from when to when there was one."""

    time: float
    depth: float
    first: float
    last: float


class Seen:
    """Unintended contacts met in one step.

    Attributes:
        allowed: Contacts that are intended.
        shallow: Those among them in which nothing may press.
    """

    def __init__(self, allowed: set[Names], shallow: set[Names] | None = None) -> None:
        self.allowed, self.shallow = allowed, allowed & (shallow or set())
        self._worst: dict[Names, _Worst] = {}

    def note(self, pair: Names, t: float, depth: float) -> None:
        """Two bodies are this deep [m] in each other at ``t`` [s]."""
        before = self._worst.get(pair)
        if before is None:
            self._worst[pair] = _Worst(t, depth, t, t)
        elif depth > before.depth:
            self._worst[pair] = _Worst(t, depth, before.first, t)
        else:
            self._worst[pair] = _Worst(before.time, before.depth, before.first, t)

    def told(self) -> list[tuple[str, float]]:
        """Each contact in words, and when it is deepest [s]."""
        return [
            (f"{a} is {1e3 * worst.depth:.1f} mm inside {b}, from {worst.first:.2f} to {worst.last:.2f} s", worst.time)
            for (a, b), worst in sorted(self._worst.items())
        ]


class Lookout:
    """Looks at one placed state after the other.

    Attributes:
        clearance: Smallest distance so far between bodies that may not touch [m].
        states: How many were looked at.
    """

    def __init__(self) -> None:
        self.clearance, self.states = CLEARANCE_CAP, 0

    def look(self, cell: GhostCell, t: float, seen: Seen) -> None:
        """Note what touches in the cell as it is placed, at ``t`` [s] of a step."""
        if self.states % CLEARANCE_EVERY == 0:
            wide = [distance for pair, distance in cell.around(CLEARANCE_CAP).items() if pair not in seen.allowed]
            self.clearance = min([self.clearance, *wide])
        self.states += 1
        for pair, distance in cell.near().items():
            if pair in seen.shallow and distance < -SHALLOW and (depth := -cell.distance(pair)) > SHALLOW:
                seen.note(pair, t, depth)
            if pair in seen.allowed or (distance >= self.clearance and distance >= -PENETRATION):
                continue
            fresh = cell.distance(pair)  # what the engine remembers of a contact may be stale
            self.clearance = min(self.clearance, fresh)
            if fresh < -PENETRATION:
                seen.note(pair, t, -fresh)
