"""Why a motion of one arm under a constraint or beside the other, or of both with one object, does not exist."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planners.collision import Contact


@dataclass(frozen=True, slots=True)
class Tilted:
    """The start, or every goal, tilts the hand further than allowed.

    Attributes:
        which: ``start`` or ``goal``.
        tilt: Of the hand's axis from the vertical [rad].
        limit: The largest tilt [rad].
    """

    which: str
    tilt: float
    limit: float

    def __str__(self) -> str:
        return f"the {self.which} is tilted by {np.degrees(self.tilt):.1f} deg, limit {np.degrees(self.limit):.1f} deg"


@dataclass(frozen=True, slots=True)
class LoopOpen:
    """The hands are not where they would both hold the object.

    Attributes:
        which: ``start`` or ``goal``.
        gap: How far the right hand is from where the object would put it [m].
        angle: By how much it is turned [rad].
    """

    which: str
    gap: float
    angle: float

    def __str__(self) -> str:
        return (
            f"at the {self.which} the hands do not hold one rigid object: {1e3 * self.gap:.2f} mm and "
            f"{np.degrees(self.angle):.2f} deg apart"
        )


@dataclass(frozen=True, slots=True)
class GoalOutOfReach:
    """No joint positions within limits put a hand where the object at its goal needs it.

    Attributes:
        hand: ``left`` or ``right``.
        gap: Distance left by the best attempt [m].
        angle: Rotation left [rad].
    """

    hand: str
    gap: float
    angle: float

    def __str__(self) -> str:
        missed = f"{1e3 * self.gap:.1f} mm, {np.degrees(self.angle):.1f} deg"
        return f"with the object at its goal the {self.hand} hand is out of reach by {missed}"


@dataclass(frozen=True, slots=True)
class OtherInTheWay:
    """Every motion that was tried meets the other arm, which moves as well.

    Attributes:
        time: When the motion that stayed free for longest meets it, on the other arm's clock [s].
        contact: What meets then.
        tried: Paths that were tried, each from many begins.
    """

    time: float
    contact: Contact
    tried: int

    def __str__(self) -> str:
        return f"the other arm is in the way of all {self.tried} paths tried; at {self.time:.2f} s {self.contact}"
