"""Laws of keeping a hand upright: no instant of the timed curve tilts further, ends are exact, refusals are typed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planners import ik, motion
from planners.certify import Certificate, Uncertified, certify
from planners.collision import CollisionWorld
from planners.level import FINEST, Level, Upright, certify_level, plan_level
from planners.motion import JointPath, NoPath
from planners.reasons import Tilted
from planners.timing import retime
from robots.model import DualArm
from robots.spatial import Array, hand_rotation, pose
from robots.trajectory import Trajectory
from robots.workcell import Workcell

TILT = float(np.radians(15.0))
UP = np.array([-1.0, 0.0, 0.0])
"""The hand's axis that points up when it reaches forward with its fingers opening sideways."""


@pytest.fixture(scope="module")
def world(workcell: Workcell) -> CollisionWorld:
    return CollisionWorld(workcell)


def reaching(world: CollisionWorld, arms: DualArm, xyz: tuple[float, float, float], yaw: float, roll: float) -> Array:
    """Free joint positions of the left arm with the hand horizontal, but for ``roll`` about its approach."""
    R = pose((0, 0, 0), (0.0, 0.0, yaw)).rotation @ pose((0, 0, 0), (roll, 0.0, 0.0)).rotation
    T = pose(xyz)
    T.rotation = R @ hand_rotation([1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    found = ik.solve(arms["left"], T, rng=np.random.default_rng(1), seeds=[arms["left"].home], wanted=6)
    assert isinstance(found, ik.Reached)
    return next(q for q in found.solutions if world.free(np.concatenate([q, arms["right"].home])))


@pytest.fixture(scope="module")
def ends(world: CollisionWorld, arms: DualArm) -> tuple[Array, Array]:
    """Low on one side and high on the other, each 5 deg off."""
    return (
        reaching(world, arms, (-0.2, -0.3, 0.2), -0.3, 0.09),
        reaching(world, arms, (-0.05, 0.25, 0.45), 0.7, -0.09),
    )


@pytest.mark.parametrize("seed", range(3))
def test_the_timed_curve_is_upright_and_free_at_every_instant(
    workcell: Workcell, world: CollisionWorld, arms: DualArm, ends: tuple[Array, Array], seed: int
) -> None:
    arm, still, (start, goal) = arms["left"], arms["right"].home, ends
    path = plan_level(world, arm, start, goal[None], still, axis_hand=UP, tilt=TILT, seed=seed)
    assert isinstance(path, JointPath), str(path)
    assert np.array_equal(path.points[0], start)
    assert np.array_equal(path.points[-1], goal)
    trajectory = retime(path, workcell.arm("left"))
    assert isinstance(trajectory, Trajectory)
    assert isinstance(certify(world, arm, workcell.arm("left"), trajectory, still), Certificate)
    level = certify_level(arm, trajectory, UP, TILT)
    assert isinstance(level, Level), str(level)
    # our own measure, on instants that no certificate looked at
    up = [arm.hand(q).rotation @ UP for q in trajectory.sample(np.arange(0.0, trajectory.duration, 0.00031))[0]]
    worst = float(np.arccos(np.clip(np.array(up)[:, 2], -1.0, 1.0)).max())
    assert worst <= level.bound + 1e-9
    assert level.bound <= TILT + FINEST
    again = plan_level(world, arm, start, goal[None], still, axis_hand=UP, tilt=TILT, seed=seed)
    assert isinstance(again, JointPath)
    assert np.array_equal(path.points, again.points)


def test_without_the_limit_the_hand_would_tilt(
    workcell: Workcell, world: CollisionWorld, arms: DualArm, ends: tuple[Array, Array]
) -> None:
    """The same query without the limit; the certificate refuses that curve and says when."""
    path = motion.plan(world, arms["left"], ends[0], ends[1][None], arms["right"].home, seed=0)
    assert isinstance(path, JointPath)
    trajectory = retime(path, workcell.arm("left"))
    assert isinstance(trajectory, Trajectory)
    refused = certify_level(arms["left"], trajectory, UP, TILT)
    assert isinstance(refused, Uncertified)
    assert "tilted by" in str(refused)
    upright = Upright(arms["left"], UP)
    assert upright.tilt(trajectory.at(refused.time)) > TILT


def test_a_peak_between_instants_is_not_missed(arms: DualArm) -> None:
    """A swing there and back within one millisecond-grid stretch cannot pass below its true peak."""
    arm = arms["left"]
    q = np.array([0.2, 0.0, 0.1, -2.0, 0.0, 2.0, 0.8])
    axis = arm.hand(q).rotation.T @ np.array([0.0, 0.0, 1.0])
    fast = np.eye(7)[5] * 600.0
    swing = Trajectory(np.array([0.0, 1e-3]), np.array([q, q]), np.array([fast, -fast]))
    peak = max(Upright(arm, axis).tilt(row) for row in swing.sample(np.linspace(0.0, 1e-3, 1001))[0])
    assert peak > 0.1
    assert isinstance(certify_level(arm, swing, axis, 0.9 * peak), Uncertified)
    level = certify_level(arm, swing, axis, 1.001 * peak)
    assert isinstance(level, Level)
    assert peak - 1e-6 <= level.bound <= 1.001 * peak + FINEST


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**31), limit=st.floats(0.02, 1.5))
def test_projection_obeys_the_limit_and_keeps_what_obeys_it(arms: DualArm, seed: int, limit: float) -> None:
    arm = arms["left"]
    q = np.random.default_rng(seed).uniform(arm.lower, arm.upper)
    upright = Upright(arm, UP)
    found = upright.project(q, limit, arm.lower, arm.upper)
    if upright.tilt(q) <= limit:
        assert found is q
    elif found is not None:
        assert upright.tilt(found) <= limit
        assert arm.within_limits(found)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**31))
def test_no_state_of_an_edge_tilts_more_than_its_bound(arms: DualArm, seed: int) -> None:
    arm, rng = arms["left"], np.random.default_rng(seed)
    a = rng.uniform(arm.lower, arm.upper)
    b = a + rng.normal(size=7) * 0.2
    upright = Upright(arm, UP)
    worst = max(upright.tilt(a + (b - a) * share) for share in np.linspace(0.0, 1.0, 60))
    assert worst <= upright.bound(a, b) + 1e-12
    assert not upright.keeps(a, b, worst - 1e-3) or worst < 1e-3
    between = float(np.abs(b - a).sum()) / 59 / 2  # what the samples may have missed
    assert upright.keeps(a, b, worst + between)


def test_a_tilted_start_or_goal_is_refused_with_its_angle(
    world: CollisionWorld, arms: DualArm, ends: tuple[Array, Array]
) -> None:
    arm, still = arms["left"], arms["right"].home
    for start, goal, which in ((arm.home, ends[0], "start"), (ends[0], arm.home, "goal")):
        refused = plan_level(world, arm, start, goal[None], still, axis_hand=UP, tilt=TILT, seed=0)
        assert isinstance(refused, NoPath)
        assert isinstance(refused.reason, Tilted)
        assert refused.reason.which == which
        assert refused.reason.tilt > TILT
        assert f"the {which} is tilted by" in str(refused)
        assert "limit 15.0 deg" in str(refused)
