"""How fast a joint path can be followed: TOPP-RA within velocity and acceleration limits."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np

from planners.motion import JointPath
from robots.spatial import Array
from robots.trajectory import Trajectory
from robots.workcell import ArmModel

SCALE = 0.9
"""Share of the limits given to TOPP-RA: its constant-acceleration output overshoots by a few percent."""

DENSE = 0.08
"""Spacing of the spline's support points, largest joint change [rad]; bare waypoints would let the spline leave the path."""

KNOT = 0.008
"""Spacing of the stored knots [s]."""


@dataclass(frozen=True, slots=True)
class NotTimeable:
    """Why a path cannot be timed."""

    reason: str

    def __str__(self) -> str:
        return self.reason


def retime(path: JointPath, model: ArmModel, *, speed: float = 1.0) -> Trajectory | NotTimeable:
    """The fastest rest-to-rest trajectory along a path, slowed by ``speed``.

    TOPP-RA: Pham and Pham, "A New Approach to Time-Optimal Path Parameterization Based on Reachability Analysis",
    T-RO 2018. The stored curve itself is measured afterwards and stretched in time if it exceeds a limit.

    Args:
        path: ``(n, 7)`` [rad].
        model: Whose limits hold.
        speed: In ``(0, 1]``; velocities scale with it, accelerations with its square.
    """
    if not 0.0 < speed <= 1.0:
        raise ValueError(f"speed must lie in (0, 1], not {speed}")
    points = _distinct(path.points)
    if len(points) < 2:
        return NotTimeable("the path has no length")
    support = densified(points)
    velocity = SCALE * np.asarray(model.velocity)
    acceleration = SCALE * np.asarray(model.acceleration)
    timed = _toppra(support, velocity, acceleration)
    if timed is None:
        return NotTimeable(f"TOPP-RA found no parameterization of {len(support)} support points")
    times, positions, velocities = timed
    positions[0], positions[-1] = path.points[0], path.points[-1]
    velocities[0] = velocities[-1] = 0.0
    return _within(times / speed, positions, velocities * speed, model, speed)


def _distinct(points: Array) -> Array:
    kept = [points[0]]
    for q in points[1:]:
        if np.abs(q - kept[-1]).max() > 1e-7:
            kept.append(q)
    return np.array(kept)


def densified(points: Array) -> Array:
    """Points no further apart than ``DENSE``; of a path that is denser, every corner and enough others are kept."""
    out = [points[0]]
    for a, b in zip(points[:-1], points[1:], strict=True):
        steps = max(1, int(np.ceil(np.abs(b - a).max() / DENSE)))
        out += [a + (b - a) * (k / steps) for k in range(1, steps + 1)]
    return np.array(out)


def _toppra(support: Array, velocity: Array, acceleration: Array) -> tuple[Array, Array, Array] | None:
    logging.getLogger("toppra").setLevel(logging.CRITICAL)
    import toppra
    from toppra import algorithm, constraint

    spacing = np.linalg.norm(np.diff(support, axis=0), axis=1)
    s = np.concatenate([[0.0], np.cumsum(spacing)]) / spacing.sum()
    s[-1] = 1.0
    grid = np.unique(np.concatenate([np.linspace(0.0, 1.0, 80), s if len(s) <= 60 else s[:: len(s) // 60 + 1], [1.0]]))
    grid = grid[np.concatenate([[True], np.diff(grid) > 1e-4])]
    grid[-1] = 1.0
    curve = toppra.SplineInterpolator(s, support)
    limits = [
        constraint.JointVelocityConstraint(np.column_stack([-velocity, velocity])),
        constraint.JointAccelerationConstraint(
            np.column_stack([-acceleration, acceleration]), discretization_scheme=constraint.DiscretizationType.Interpolation
        ),
    ]
    instance = algorithm.TOPPRA(limits, curve, gridpoints=grid, solver_wrapper="seidel", parametrizer="ParametrizeConstAccel")
    timed = instance.compute_trajectory(0, 0)
    if timed is None:
        return None
    count = max(8, int(np.ceil(timed.duration / KNOT)) + 1)
    times = np.linspace(0.0, timed.duration, count)
    return times, np.array(timed(times)), np.array(timed(times, 1))


def _within(times: Array, positions: Array, velocities: Array, model: ArmModel, speed: float) -> Trajectory | NotTimeable:
    """The trajectory stretched until the stored curve keeps the limits, values rounded so that they print alike."""
    v_limit, a_limit = speed * np.asarray(model.velocity), speed**2 * np.asarray(model.acceleration)
    for _ in range(12):
        trajectory = Trajectory(_ticks(times), np.round(positions, 9) + 0.0, np.round(velocities, 9) + 0.0)
        v, a = peaks(trajectory)
        over = max(float((v / v_limit).max()), float(np.sqrt((a / a_limit).max())))
        if over <= 1.0:
            return trajectory
        stretch = 1.002 * over
        times, velocities = times * stretch, velocities / stretch
    return NotTimeable(f"the stored curve stays {100 * (over - 1):.1f} % over a limit")


def _ticks(times: Array) -> Array:
    return np.round(times, 9)


def peaks(trajectory: Trajectory) -> tuple[Array, Array]:
    """Largest velocity [rad/s] and acceleration [rad/s^2] of the stored curve, by joint ``(7,)`` each.

    Between knots the curve is cubic: its acceleration is linear, so it peaks at a knot, seen from either side; its
    velocity is quadratic and may peak inside.
    """
    h = np.diff(trajectory.times)[:, None]
    p0, p1 = trajectory.positions[:-1], trajectory.positions[1:]
    v0, v1 = trajectory.velocities[:-1], trajectory.velocities[1:]
    a2, a3 = 3.0 * (p1 - p0) - h * (2.0 * v0 + v1), -2.0 * (p1 - p0) + h * (v0 + v1)
    begin, end = 2.0 * a2 / h**2, (2.0 * a2 + 6.0 * a3) / h**2
    u = np.clip(np.divide(-a2, 3.0 * a3, out=np.zeros_like(a2), where=np.abs(a3) > 1e-15), 0.0, 1.0)
    inside = np.abs(v0 + u * (2.0 * a2 + 3.0 * u * a3) / h)
    velocity = np.maximum(np.abs(trajectory.velocities).max(axis=0), inside.max(axis=0))
    return velocity, np.maximum(np.abs(begin).max(axis=0), np.abs(end).max(axis=0))
