"""How a time-optimal schedule is smoothed until its curve keeps a limit of jerk.

The position along the path is averaged over a window of time. That keeps the path, and makes the acceleration along it
continuous: it then changes no faster than by the jumps that it had, spread over the window. A wide window makes the
motion longer, a narrow one leaves jerk that only stretching in time removes; the best of several is taken.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline

from robots.spatial import Array

WINDOWS = np.geomspace(0.01, 1.28, 22)
"""Widths of the window that are tried [s]."""

KNOT = 0.008
"""Longest time between knots of the smoothed curve [s]."""

Curve = Callable[[Array], Array]
"""Joint positions ``(m, d)`` [rad] at places ``(m,)`` along a path."""

Knots = tuple[Array, Array, Array]
"""Times ``(k,)`` [s], positions ``(k, d)`` [rad], velocities ``(k, d)`` [rad/s]."""


def smoothed(curve: Curve, schedule: Knots, velocity: Array, acceleration: Array, jerk: Array) -> Knots:
    """Knots of a curve with continuous acceleration that needs least time once it is stretched to keep all limits.

    Args:
        curve: The path.
        schedule: Times, places along the path and rates, each ``(k,)``; between knots the rate is linear in time.
        velocity: Limits ``(d,)`` [rad/s].
        acceleration: Limits ``(d,)`` [rad/s^2].
        jerk: Limits ``(d,)`` [rad/s^3].

    Returns:
        Its knots before it is stretched.
    """
    best: tuple[float, Knots] | None = None
    for window in WINDOWS:
        knots = _splined(curve, *_averaged(schedule, float(window)))
        duration = float(knots[0][-1]) * _over(knots, velocity, acceleration, jerk)
        if best is None or duration < best[0]:
            best = duration, knots
    assert best is not None
    return best[1]


def _averaged(schedule: Knots, window: float) -> tuple[Array, Array]:
    """Equally spaced times [s] and the places along the path averaged over the window before each."""
    times, places, rates = schedule
    h = np.diff(times)
    slopes = np.diff(rates) / h
    areas = np.concatenate([[0.0], np.cumsum(h * (places[:-1] + h * (rates[:-1] / 2 + h * slopes / 6)))])

    def area(t: Array) -> Array:
        """Integral of the place from time 0 on; the path is at rest outside of the schedule."""
        inside = np.clip(t, 0.0, times[-1])
        k = np.clip(np.searchsorted(times, inside, side="right") - 1, 0, len(h) - 1)
        tau = inside - times[k]
        below: Array = areas[k] + tau * (places[k] + tau * (rates[k] / 2 + tau * slopes[k] / 6))
        beyond: Array = places[-1] * np.maximum(t - times[-1], 0.0)
        return below + beyond

    end = float(times[-1]) + window
    t = np.linspace(0.0, end, max(5, int(np.ceil(end / KNOT)) + 1))
    averaged: Array = (area(t) - area(t - window)) / window
    averaged[0], averaged[-1] = places[0], places[-1]
    return t, np.clip(averaged, places[0], places[-1])


def _splined(curve: Curve, times: Array, places: Array) -> Knots:
    """Knots of the cubic spline from rest to rest: velocities that make the acceleration continuous."""
    positions = curve(places)
    spline = CubicSpline(times, positions, bc_type="clamped")
    return times, positions, np.asarray(spline(times, 1))


def _over(knots: Knots, velocity: Array, acceleration: Array, jerk: Array) -> float:
    """By how much the curve must be stretched in time to keep the limits."""
    times, positions, velocities = knots
    h = np.diff(times)[:, None]
    step, v0, v1 = np.diff(positions, axis=0), velocities[:-1], velocities[1:]
    begin, end = (6.0 * step / h - 4.0 * v0 - 2.0 * v1) / h, (-6.0 * step / h + 2.0 * v0 + 4.0 * v1) / h
    strongest = np.maximum(np.abs(begin).max(axis=0), np.abs(end).max(axis=0))
    steepest = np.abs((end - begin) / h).max(axis=0)
    return max(
        float((np.abs(velocities).max(axis=0) / velocity).max()),
        float(np.sqrt((strongest / acceleration).max())),
        float(np.cbrt((steepest / jerk).max())),
    )
