"""How fast a joint path can be followed: TOPP-RA within velocity and acceleration limits."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from planners.given import numbers
from planners.motion import JointPath
from planners.smoothing import smoothed
from robots.spatial import Array
from robots.trajectory import Trajectory
from robots.workcell import ArmModel

SCALE = 0.9
"""Share of the limits given to TOPP-RA, which keeps them only at its grid points."""

DENSE = 0.1
"""Longest step between support points of the spline [rad]: a spline through bare waypoints would leave the path."""

THIN = 0.03
"""Support points closer than this to the last one are left out [rad], as long as the spline still meets them."""

STRAY = 1e-4
"""How far the spline may pass from a point left out [rad]."""

STRAY_TOGETHER = 1e-5
"""The same where both arms hold one object [rad]: errors of joints open the loop between the hands."""

GRID = 0.03
"""Longest path between TOPP-RA's grid points [rad]: finer than the corners of the spline, which it would miss."""

FEWEST = 25
"""Fewest stretches between grid points."""

KNOT = 0.008
"""Longest time between stored knots at full speed [s]; the knots stay with the path when the motion is slower."""

TINY = 1e-3
"""Paths shorter than this are too short for a time-optimal schedule to mean anything [rad]."""


@dataclass(frozen=True, slots=True)
class NotTimeable:
    """Why a path cannot be timed."""

    reason: str

    def __str__(self) -> str:
        return self.reason


def retime(
    path: JointPath, model: ArmModel, *, speed: float = 1.0, scale: float = SCALE, jerk: Array | None = None
) -> Trajectory | NotTimeable:
    """The fastest rest-to-rest trajectory along a path, slowed by ``speed``.

    TOPP-RA: Pham and Pham, "A New Approach to Time-Optimal Path Parameterization Based on Reachability Analysis",
    T-RO 2018. The stored curve itself is measured afterwards and stretched in time if it exceeds a limit. It begins and
    ends exactly where the path does. A path shorter than ``TINY``, even of no length, becomes one smooth step from its
    first to its last point.

    Args:
        path: Joint positions ``(n, 7)`` [rad].
        model: Whose limits hold.
        speed: In ``(0, 1]``; limits of velocity scale with it, those of acceleration with its square.
        scale: In ``(0, 1]``; share of the limits that is planned with.
        jerk: Limits ``(7,)`` [rad/s^3] that ``speed`` does not scale; the acceleration is then continuous. ``None`` for
            none: the acceleration may jump.
    """
    if not (0.0 < speed <= 1.0 and 0.0 < scale <= 1.0):
        raise ValueError(f"speed and scale must lie in (0, 1], not {speed} and {scale}")
    timed = _timed(path.points, (model,), speed, scale, STRAY, _jerk_limit(jerk, 7))
    return timed if isinstance(timed, NotTimeable) else timed[0]


@dataclass(frozen=True, slots=True, eq=False)
class Together:
    """Both arms on one schedule.

    Attributes:
        left, right: Their curves, with the same times.
    """

    left: Trajectory
    right: Trajectory

    def __post_init__(self) -> None:
        if not np.array_equal(self.left.times, self.right.times):
            raise ValueError("both arms need the same times")

    @property
    def times(self) -> Array:
        """Times of the knots ``(n,)`` [s]."""
        return self.left.times

    @property
    def duration(self) -> float:
        """Time of the last knot [s]."""
        return self.left.duration

    def sample(self, t: Any) -> tuple[Array, Array, Array]:
        """Positions [rad], velocities [rad/s] and accelerations [rad/s^2] ``(m, 14)`` at times ``t`` ``(m,)`` [s]."""
        pairs = zip(self.left.sample(t), self.right.sample(t), strict=True)
        q, qd, qdd = (np.concatenate(pair, axis=1) for pair in pairs)
        return q, qd, qdd


def retime_together(
    points: Array,
    models: tuple[ArmModel, ArmModel],
    *,
    speed: float = 1.0,
    scale: float = SCALE,
    jerk: Array | None = None,
) -> Together | NotTimeable:
    """As ``retime``, for both arms at once: one schedule, so that they stay where the path has them together.

    Args:
        points: Joint positions ``(n, 14)`` [rad], left then right, ``n >= 2``.
        models: Whose limits hold, left then right.
        speed: As in ``retime``.
        scale: As in ``retime``.
        jerk: As in ``retime``, ``(14,)``.
    """
    if not (0.0 < speed <= 1.0 and 0.0 < scale <= 1.0):
        raise ValueError(f"speed and scale must lie in (0, 1], not {speed} and {scale}")
    points = numbers(points, (-1, 14), "the points of a path of both arms")
    if len(points) < 2:
        raise ValueError("a path of both arms needs at least 2 points, not 1")
    timed = _timed(points, models, speed, scale, STRAY_TOGETHER, _jerk_limit(jerk, 14))
    return timed if isinstance(timed, NotTimeable) else Together(*timed)


def _timed(
    path: Array, models: Sequence[ArmModel], speed: float, scale: float, stray: float, jerk: Array
) -> tuple[Trajectory, ...] | NotTimeable:
    """The trajectory of each arm along a path ``(n, 7 * arms)`` [rad], all on one schedule."""
    points = _dense(path)
    velocity, acceleration = (
        np.concatenate([getattr(m, what) for m in models]) for what in ("velocity", "acceleration")
    )
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    if length < TINY:
        timed: _Knots | None = _step(points, velocity, acceleration, scale)
    else:
        timed = _toppra(points, scale * velocity, scale * acceleration, stray, scale * jerk / speed**3)
    if timed is None:
        return NotTimeable(f"TOPP-RA found no speed along {length:.3f} rad of path that keeps the limits")
    times, positions, velocities = timed
    positions, velocities = np.round(positions, 9) + 0.0, np.round(velocities * speed, 9) + 0.0
    positions[0], positions[-1] = path[0], path[-1]
    velocities[0] = velocities[-1] = 0.0
    return _within(times / speed, positions, velocities, models, speed, jerk)


def _jerk_limit(jerk: Array | None, size: int) -> Array:
    """The limits ``(size,)`` [rad/s^3], infinite for none; ``ValueError`` for limits that are not above 0."""
    if jerk is None:
        return np.full(size, np.inf)
    limit = numbers(jerk, (size,), "the limits of jerk")
    if (limit <= 0.0).any():
        raise ValueError(f"the limits of jerk must be above 0 rad/s^3, not {limit.tolist()}")
    return limit


_Knots = tuple[Array, Array, Array]
"""Times ``(k,)`` [s], positions ``(k, d)`` [rad], velocities ``(k, d)`` [rad/s]."""


def load() -> None:
    """Load TOPP-RA, which brings plotting libraries and takes a second the first time."""
    import toppra

    logging.getLogger(toppra.__name__).setLevel(logging.CRITICAL)


def _dense(points: Array) -> Array:
    """The points without repeated ones, and more of them wherever they are further apart than ``DENSE``."""
    out = [points[0]]
    for q in points[1:]:
        step, last = float(np.abs(q - out[-1]).max()), out[-1]
        count = int(np.ceil(step / DENSE)) if step > 1e-7 else 0
        out += [last + (q - last) * (k / count) for k in range(1, count + 1)]
    return np.array(out)


def _step(points: Array, velocity: Array, acceleration: Array, scale: float) -> _Knots:
    """One cubic from rest to rest: over a time T it peaks at 1.5 d / T and 6 d / T^2."""
    d = np.abs(points[-1] - points[0])
    by_velocity = float((1.5 * d / velocity).max()) / scale
    by_acceleration = float(np.sqrt((6.0 * d / acceleration).max() / scale))
    end = max(KNOT, by_velocity, by_acceleration)
    return np.array([0.0, end]), points[[0, -1]], np.zeros((2, points.shape[1]))


def _toppra(points: Array, velocity: Array, acceleration: Array, stray: float, jerk: Array) -> _Knots | None:
    """The time-optimal schedule: knots at TOPP-RA's grid points, where alone its acceleration along the path jumps."""
    logging.getLogger("toppra").setLevel(logging.CRITICAL)
    import toppra
    from toppra import algorithm, constraint

    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    kept = _thinned(points)
    curve = toppra.SplineInterpolator(s[kept], points[kept])
    if np.abs(curve(s) - points).max() > stray:
        curve = toppra.SplineInterpolator(s, points)
    limits = [
        constraint.JointVelocityConstraint(np.column_stack([-velocity, velocity])),
        constraint.JointAccelerationConstraint(
            np.column_stack([-acceleration, acceleration]),
            discretization_scheme=constraint.DiscretizationType.Interpolation,
        ),
    ]
    grid = np.linspace(0.0, s[-1], max(FEWEST, int(np.ceil(s[-1] / GRID))) + 1)
    instance = algorithm.TOPPRA(limits, curve, gridpoints=grid, solver_wrapper="seidel")
    accelerations, speeds, _ = instance.compute_parameterization(0.0, 0.0)
    if speeds is None or not np.isfinite(speeds).all() or np.any(speeds[1:-1] <= 0.0):
        return None
    times, at, rate = _schedule(grid, speeds, accelerations)
    if np.isfinite(jerk).all():
        return smoothed(curve, (times, at, rate), velocity, acceleration, jerk)
    return times, np.asarray(curve(at)), np.asarray(curve(at, 1)) * rate[:, None]


def _thinned(points: Array) -> list[int]:
    """Which points are at least ``THIN`` apart; first and last always."""
    kept = [0]
    for k in range(1, len(points) - 1):
        if np.abs(points[k] - points[kept[-1]]).max() >= THIN:
            kept.append(k)
    return [*kept, len(points) - 1]


def _schedule(grid: Array, speeds: Array, accelerations: Array) -> _Knots:
    """Times, path positions and path speeds at the grid points and, no further apart than ``KNOT``, between them."""
    spans = 2.0 * np.diff(grid) / (speeds[:-1] + speeds[1:])
    starts = np.concatenate([[0.0], np.cumsum(spans)])
    counts = np.maximum(1, np.ceil(spans / KNOT).astype(int))
    segment = np.repeat(np.arange(len(spans)), counts)
    number = np.concatenate([np.arange(count) for count in counts])
    tau = spans[segment] * number / counts[segment]
    s = grid[segment] + tau * (speeds[segment] + 0.5 * tau * accelerations[segment])
    rate = speeds[segment] + tau * accelerations[segment]
    return np.append(starts[segment] + tau, starts[-1]), np.append(s, grid[-1]), np.append(rate, speeds[-1])


def _within(
    times: Array, positions: Array, velocities: Array, models: Sequence[ArmModel], speed: float, jerk: Array
) -> tuple[Trajectory, ...] | NotTimeable:
    """The trajectory of each arm, all stretched alike until every stored curve keeps its limits."""
    over = 1.0
    for _ in range(12):
        rounded, stored = np.round(times, 9), np.round(velocities, 9) + 0.0
        columns = [slice(7 * k, 7 * k + 7) for k in range(len(models))]
        trajectories = tuple(Trajectory(rounded, positions[:, c], stored[:, c]) for c in columns)
        over = max(
            _over(trajectory, model, speed, jerk[c])
            for trajectory, model, c in zip(trajectories, models, columns, strict=True)
        )
        if over <= 1.0:
            return trajectories
        times, velocities = times * (1.002 * over), velocities / (1.002 * over)
    return NotTimeable(f"the stored curve stays {100 * (over - 1):.1f} % over a limit")


def _over(trajectory: Trajectory, model: ArmModel, speed: float, jerk: Array) -> float:
    """By how much a curve must be stretched in time to keep the limits."""
    v_limit, a_limit = speed * np.asarray(model.velocity), speed**2 * np.asarray(model.acceleration)
    v, a = peaks(trajectory)
    steepest = float(np.cbrt((jerks(trajectory) / jerk).max()))
    return max(float((v / v_limit).max()), float(np.sqrt((a / a_limit).max())), steepest)


def jerks(trajectory: Trajectory) -> Array:
    """Largest jerk of the stored curve by joint ``(7,)`` [rad/s^3]; between knots it is constant.

    Where the acceleration jumps at a knot the jerk has no value: only curves that ``retime`` made with a limit of jerk
    do not jump.
    """
    h = np.diff(trajectory.times)[:, None]
    cubic = (trajectory.velocities[:-1] + trajectory.velocities[1:]) * h - 2.0 * np.diff(trajectory.positions, axis=0)
    found: Array = np.abs(6.0 * cubic / h**3).max(axis=0)
    return found


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
