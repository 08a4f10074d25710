"""Whether a timed curve is continuous and keeps its arm's limits, exactly between knots and densely at them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from robots.spatial import Array
from robots.workcell import ArmModel, Side
from tamp.plan import Meanwhile, Motion
from tamp.verify.found import Kind

SAMPLE = 0.002
"""Longest time between checked states [s]."""

JOINT = 1e-6
"""Largest step between the end of one motion and the start of the next [rad]."""

REST = 1e-6
"""Largest joint velocity at the ends of a motion [rad/s]."""

OVER = 1e-6
"""How much a ratio to a limit may exceed 1 before it counts."""

Fault = tuple[Kind, str, float]
"""What is wrong, in words, and when in the step [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """A curve that was looked at.

    Attributes:
        times: ``(n,)`` [s] at most ``SAMPLE`` apart.
        positions: ``(n, 7)`` [rad].
        velocity: Largest joint velocity over its limit.
        acceleration: Largest joint acceleration over its limit.
        faults: What is wrong with it.
    """

    times: Array
    positions: Array
    velocity: float
    acceleration: float
    faults: tuple[Fault, ...]


def examine(step: Motion, side: Side, arm: ArmModel, q: Array) -> Curve:
    """The curve of a motion that begins while the arm is at ``q`` ``(7,)`` [rad]."""
    knots, speed_limit, rate_limit = np.array(step.times), np.array(arm.velocity), np.array(arm.acceleration)
    spline = CubicHermiteSpline(knots, np.array(step.positions), np.array(step.velocities))
    speeds, rates = _peaks(spline)
    times = np.linspace(0.0, step.duration, int(np.ceil(step.duration / SAMPLE)) + 1)
    positions: Array = spline(times)
    faults = [
        *_ends(step, side, q),
        *_over("velocity_limit", arm.joints, speeds, speed_limit, knots, "rad/s"),
        *_over("acceleration_limit", arm.joints, rates, rate_limit, knots, "rad/s^2"),
        *_past(side, arm, times, positions),
    ]
    return Curve(
        times, positions, float((speeds / speed_limit).max()), float((rates / rate_limit).max()), tuple(faults)
    )


def examine_part(part: Meanwhile, arm: ArmModel, q: Array, speed: Array, last: bool) -> Curve:
    """The curve of an arm that moves while the other acts; it may go on in the next step.

    Args:
        part: What it does in this step.
        arm: Its limits.
        q: Where it is ``(7,)`` [rad].
        speed: How fast it moves already ``(7,)`` [rad/s].
        last: Whether it must be at rest at the end.
    """
    whole = Motion(
        template="free", times=part.times, positions=part.positions, velocities=part.velocities, allowed=[], holder=None
    )
    curve = examine(whole, part.arm, arm, q)
    faults = [fault for fault in curve.faults if fault[0] != "not_at_rest"]
    if (off := np.abs(np.array(part.velocities[0]) - speed).max()) > REST:
        faults.append(("jump", f"the {part.arm} arm would change its speed by {off:.6f} rad/s at once", part.begin))
    if last and (moving := np.abs(np.array(part.velocities[-1])).max()) > REST:
        faults.append(("not_at_rest", f"a joint of the {part.arm} arm moves at {moving:.6f} rad/s", part.end))
    return Curve(curve.times, curve.positions, curve.velocity, curve.acceleration, tuple(faults))


def _peaks(spline: CubicHermiteSpline) -> tuple[Array, Array]:
    """Largest speed and acceleration on every segment ``(n - 1, 7)``, exactly: a parabola and a line."""
    c3, c2, c1, _ = spline.c
    h = np.diff(spline.x)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        turning = np.where(np.abs(c3) > 0.0, -c2 / (3.0 * c3), 0.0)
    u = np.stack([np.zeros_like(c1), np.broadcast_to(h, c1.shape), np.clip(turning, 0.0, h)])
    speeds = np.abs(3.0 * c3 * u**2 + 2.0 * c2 * u + c1).max(axis=0)
    rates = np.abs(6.0 * c3 * u[:2] + 2.0 * c2).max(axis=0)
    return speeds, rates


def _ends(step: Motion, side: Side, q: Array) -> list[Fault]:
    faults: list[Fault] = []
    if (off := np.abs(np.array(step.positions[0]) - q).max()) > JOINT:
        faults.append(("jump", f"the {side} arm would jump by {off:.6f} rad to where the motion starts", 0.0))
    for end, speed in ((0.0, step.velocities[0]), (step.duration, step.velocities[-1])):
        if (moving := np.abs(speed).max()) > REST:
            faults.append(("not_at_rest", f"a joint of the {side} arm moves at {moving:.6f} rad/s", end))
    return faults


def _over(kind: Kind, joints: tuple[str, ...], peaks: Array, limit: Array, knots: Array, unit: str) -> list[Fault]:
    """Every joint whose peak ``(segments, 7)`` is over its limit."""
    faults: list[Fault] = []
    for joint in np.flatnonzero((peaks > limit * (1.0 + OVER)).any(axis=0)):
        segment = int(peaks[:, joint].argmax())
        peak = peaks[segment, joint]
        text = f"{joints[joint]} reaches {peak:.3f} {unit}, {peak / limit[joint]:.4f} of its limit {limit[joint]:g}"
        faults.append((kind, text, float(knots[segment])))
    return faults


def _past(side: Side, arm: ArmModel, times: Array, positions: Array) -> list[Fault]:
    past = np.maximum(positions - np.array(arm.upper), np.array(arm.lower) - positions)
    k, joint = np.unravel_index(int(past.argmax()), past.shape)
    if past[k, joint] <= JOINT:
        return []
    text = (
        f"{side}/{arm.joints[joint]} at {positions[k, joint]:.4f} rad, "
        f"limits {arm.lower[joint]} to {arm.upper[joint]} rad"
    )
    return [("position_limit", text, float(times[k]))]
