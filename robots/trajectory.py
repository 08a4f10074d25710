"""What a timed joint motion of one arm is: knots joined by cubic Hermite curves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from robots.spatial import Array, frozen


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Joint positions and velocities at increasing times; between knots the curve is the cubic Hermite one.

    Attributes:
        times: ``(n,)`` [s], starting at 0, strictly increasing, ``n >= 2``.
        positions: ``(n, 7)`` [rad].
        velocities: ``(n, 7)`` [rad/s].
    """

    times: Array
    positions: Array
    velocities: Array

    def __post_init__(self) -> None:
        for name in ("times", "positions", "velocities"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        n = self.times.shape[0]
        if self.times.ndim != 1 or n < 2 or self.positions.shape != (n, 7) or self.velocities.shape != (n, 7):
            raise ValueError(
                f"a trajectory needs times (n,), positions and velocities (n, 7), n >= 2; got "
                f"{self.times.shape}, {self.positions.shape}, {self.velocities.shape}"
            )
        if not all(np.isfinite(a).all() for a in (self.times, self.positions, self.velocities)):
            raise ValueError("a trajectory holds a value that is not finite")
        if self.times[0] != 0.0 or np.any(np.diff(self.times) <= 0.0):
            raise ValueError("trajectory times must start at 0 and increase")

    @property
    def duration(self) -> float:
        """Time of the last knot [s]."""
        return float(self.times[-1])

    def sample(self, t: Any) -> tuple[Array, Array, Array]:
        """Positions [rad], velocities [rad/s] and accelerations [rad/s^2] ``(m, 7)`` at times ``t`` ``(m,)`` [s].

        Times outside the trajectory are clamped to its ends. At a knot the acceleration of the segment
        that begins there is given. Hermite basis: de Boor, "A Practical Guide to Splines", 2001, ch. IV.
        """
        t = np.clip(np.atleast_1d(np.asarray(t, dtype=np.float64)), 0.0, self.duration)
        k = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 2)
        h = (self.times[k + 1] - self.times[k])[:, None]
        u = ((t - self.times[k])[:, None]) / h
        p0, p1, v0, v1 = self.positions[k], self.positions[k + 1], self.velocities[k], self.velocities[k + 1]
        a2 = 3.0 * (p1 - p0) - h * (2.0 * v0 + v1)
        a3 = -2.0 * (p1 - p0) + h * (v0 + v1)
        q = p0 + u * (h * v0 + u * (a2 + u * a3))
        qd = v0 + u * (2.0 * a2 + 3.0 * u * a3) / h
        qdd = (2.0 * a2 + 6.0 * u * a3) / (h * h)
        return q, qd, qdd

    def at(self, t: float) -> Array:
        """Positions ``(7,)`` [rad] at time ``t`` [s]."""
        return np.asarray(self.sample(t)[0][0])
