"""Laws of timing, looked at every millisecond: velocity, acceleration and, where it is limited, jerk."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planners.motion import JointPath
from planners.shorten import rounded
from planners.timing import Together, jerks, retime, retime_together
from robots.model import DualArm
from robots.spatial import Array
from robots.trajectory import Trajectory
from robots.workcell import Workcell

JERK = np.array([7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0])
"""Franka Control Interface documentation, "Limits for Panda" [rad/s^3]."""

MILLISECOND = 1e-3


def random_path(arms: DualArm, seed: int, count: int) -> JointPath:
    """Random corners, cut as those of planned paths are."""
    arm, rng = arms["left"], np.random.default_rng(seed)
    return JointPath(rounded(lambda a, b: True, rng.uniform(arm.lower, arm.upper, (count, 7))))


def series(curve: Trajectory) -> tuple[Array, Array, Array]:
    """Velocities, accelerations, and changes of acceleration over a millisecond, every millisecond."""
    times = np.linspace(0.0, curve.duration, int(np.ceil(curve.duration / MILLISECOND)) + 1)
    _, velocity, acceleration = curve.sample(times)
    return velocity, acceleration, np.diff(acceleration, axis=0) / (times[1] - times[0])


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    count=st.integers(2, 7),
    speed=st.floats(0.1, 1.0),
    share=st.one_of(st.none(), st.floats(0.02, 1.0)),
)
def test_no_limit_is_passed_at_any_millisecond(
    workcell: Workcell, arms: DualArm, seed: int, count: int, speed: float, share: float | None
) -> None:
    path, model = random_path(arms, seed, count), workcell.arm("left")
    curve = retime(path, model, speed=speed, jerk=None if share is None else share * JERK)
    assert isinstance(curve, Trajectory)
    assert np.array_equal(curve.positions[[0, -1]], path.points[[0, -1]])
    assert (curve.velocities[[0, -1]] == 0.0).all()
    velocity, acceleration, jerk = series(curve)
    assert (np.abs(velocity) <= speed * np.array(model.velocity) * (1 + 1e-9)).all()
    assert (np.abs(acceleration) <= speed**2 * np.array(model.acceleration) * (1 + 1e-9)).all()
    if share is not None:
        assert (jerks(curve) <= share * JERK).all()
        assert (np.abs(jerk) <= 1.01 * share * JERK).all()


def test_a_limit_of_jerk_is_kept_where_it_was_not_and_costs_little(workcell: Workcell, arms: DualArm) -> None:
    longer, steeper = [], []
    for seed in range(10):
        path = random_path(arms, seed, 4)
        plain, calm = (retime(path, workcell.arm("left"), jerk=limit) for limit in (None, JERK))
        assert isinstance(plain, Trajectory)
        assert isinstance(calm, Trajectory)
        longer.append(calm.duration / plain.duration)
        steeper.append((np.abs(series(plain)[2]) / JERK).max())
    assert min(steeper) > 1.0
    assert max(longer) < 1.1


def test_a_smoothed_curve_keeps_to_its_path(workcell: Workcell, arms: DualArm) -> None:
    for seed in range(4):
        path = random_path(arms, seed, 4)
        curve = retime(path, workcell.arm("left"), jerk=JERK / 10)
        assert isinstance(curve, Trajectory)
        a, b = path.points[:-1], path.points[1:]
        for q in curve.sample(np.linspace(0.0, curve.duration, 300))[0]:
            share = np.clip(((q - a) * (b - a)).sum(axis=1) / ((b - a) ** 2).sum(axis=1), 0.0, 1.0)[:, None]
            assert np.abs(a + share * (b - a) - q).max(axis=1).min() < 0.02


def test_both_arms_share_one_calm_schedule(workcell: Workcell, arms: DualArm) -> None:
    points = np.concatenate([random_path(arms, seed, 3).points for seed in (1, 2)], axis=1)
    limit = np.concatenate([JERK, JERK]) / 5
    both = retime_together(points, (workcell.arm("left"), workcell.arm("right")), jerk=limit)
    assert isinstance(both, Together)
    for curve in (both.left, both.right):
        assert (jerks(curve) <= JERK / 5).all()


def test_a_step_and_wrong_limits(workcell: Workcell, arms: DualArm) -> None:
    model, home = workcell.arm("left"), arms["left"].home
    step = retime(JointPath(np.array([home, home + 1e-4])), model, jerk=JERK / 100)
    assert isinstance(step, Trajectory)
    assert (jerks(step) <= JERK / 100).all()
    for wrong, said in ((JERK * 0.0, "above 0"), (JERK[:3], "shape"), (JERK * np.nan, "finite")):
        with pytest.raises(ValueError, match=said):
            retime(JointPath(np.array([home, home + 0.1])), model, jerk=wrong)
