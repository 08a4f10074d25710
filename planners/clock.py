"""Where both arms are when each follows a curve of its own, begun at a time of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from robots.spatial import Array
from robots.trajectory import Trajectory
from robots.workcell import Side


@dataclass(frozen=True, slots=True, eq=False)
class Beside:
    """A timed motion of one arm beside that of the other.

    Attributes:
        begin: When it begins, on the other arm's clock [s]; until then the arm stands where it starts.
        trajectory: The motion.
    """

    begin: float
    trajectory: Trajectory

    @property
    def end(self) -> float:
        """When it ends, on the other arm's clock [s]."""
        return self.begin + self.trajectory.duration


@dataclass(frozen=True, slots=True, eq=False)
class Clock:
    """Both arms from a time on until both rest; an arm stands before its curve and after it.

    Attributes:
        side: The arm that moves beside the other.
        beside: Its motion.
        other_curve: The other arm's, from time 0 of its clock.
        since: Time of the other's clock that is time 0 here [s].
    """

    side: Side
    beside: Beside
    other_curve: Trajectory
    since: float

    @property
    def duration(self) -> float:
        """When both rest [s]."""
        return max(self.beside.end, self.other_curve.duration) - self.since

    @property
    def times(self) -> Array:
        """Every time at which a curve has a knot, from 0 to the end ``(n,)`` [s]."""
        end = self.duration
        knots = np.concatenate(
            [self.beside.trajectory.times + (self.beside.begin - self.since), self.other_curve.times - self.since]
        )
        return np.unique(np.concatenate([[0.0, end], knots[(knots > 0.0) & (knots < end)]]))

    def sample(self, t: Any) -> tuple[Array, Array, Array]:
        """Positions [rad], velocities [rad/s] and accelerations [rad/s^2] ``(m, 14)`` at times ``t`` ``(m,)`` [s]."""
        t = np.atleast_1d(np.asarray(t, dtype=np.float64)) + self.since
        mine, theirs = _held(self.beside.trajectory, t - self.beside.begin), _held(self.other_curve, t)
        pairs = zip(mine, theirs, strict=True) if self.side == "left" else zip(theirs, mine, strict=True)
        q, qd, qdd = (np.concatenate(pair, axis=1) for pair in pairs)
        return q, qd, qdd


def _held(curve: Trajectory, t: Array) -> tuple[Array, Array, Array]:
    """A curve's states, at rest before its begin and after its end."""
    q, qd, qdd = curve.sample(t)
    moving = ((t >= 0.0) & (t <= curve.duration))[:, None]
    return q, qd * moving, qdd * moving
