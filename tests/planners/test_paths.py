"""Laws of motion planning, straight lines, timing and certificates: what they return keeps every promise."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planners import cartesian, motion
from planners.certify import Certificate, Uncertified, certify
from planners.collision import CollisionWorld
from planners.motion import GoalInCollision, JointPath, NoPath, OutOfLimits
from planners.timing import retime
from robots.errors import UnknownName
from robots.model import DualArm
from robots.spatial import Array, angle_between, pose
from robots.trajectory import Trajectory
from robots.workcell import Workcell

OVER_TABLE = np.array([0.2, 0.0, 0.1, -2.0, 0.0, 2.0, 0.8])


@pytest.fixture(scope="module")
def world(workcell: Workcell) -> CollisionWorld:
    return CollisionWorld(workcell)


def free_states(world: CollisionWorld, arms: DualArm, seed: int, count: int) -> list[Array]:
    arm, rng, found = arms["left"], np.random.default_rng(seed), []
    while len(found) < count:
        q = rng.uniform(arm.lower + 0.05, arm.upper - 0.05)
        if world.free(np.concatenate([q, arms["right"].home])):
            found.append(q)
    return found


@pytest.mark.parametrize("seed", range(6))
def test_a_planned_path_joins_its_ends_and_is_free_everywhere(world: CollisionWorld, arms: DualArm, seed: int) -> None:
    start, goal = free_states(world, arms, seed, 2)
    path = motion.plan(world, arms["left"], start, goal[None, :], arms["right"].home, seed=seed)
    assert isinstance(path, JointPath)
    assert np.array_equal(path.points[0], start)
    assert np.array_equal(path.points[-1], goal)
    for a, b in zip(path.points[:-1], path.points[1:], strict=True):
        for share in np.linspace(0.0, 1.0, 12):
            assert world.clearance(np.concatenate([a + share * (b - a), arms["right"].home]))[0] > 0.0


def test_the_same_seed_gives_the_same_path(world: CollisionWorld, arms: DualArm) -> None:
    start, goal = free_states(world, arms, 11, 2)
    first, second = (
        motion.plan(world, arms["left"], start, goal[None, :], arms["right"].home, seed=3) for _ in range(2)
    )
    assert isinstance(first, JointPath)
    assert isinstance(second, JointPath)
    assert np.array_equal(first.points, second.points)


def test_a_goal_in_the_table_or_past_a_limit_is_refused_before_any_search(world: CollisionWorld, arms: DualArm) -> None:
    arm, home = arms["left"], arms["left"].home
    down = np.array([0.4, 0.9, 0.0, -1.2, 0.0, 2.1, 0.78])
    refused = motion.plan(world, arm, home, down[None, :], arms["right"].home, seed=0)
    assert isinstance(refused, NoPath)
    assert isinstance(refused.reason, GoalInCollision)
    assert "table" in str(refused)
    past = home.copy()
    past[3] = 0.5
    refused = motion.plan(world, arm, home, past[None, :], arms["right"].home, seed=0)
    assert isinstance(refused, NoPath)
    assert isinstance(refused.reason, OutOfLimits)
    assert "panda_joint4" in str(refused)


@settings(max_examples=25, deadline=None)
@given(
    step=st.tuples(*[st.floats(-0.06, 0.06) for _ in range(3)]),
    turn=st.tuples(*[st.floats(-0.3, 0.3) for _ in range(3)]),
)
def test_a_straight_line_is_straight(
    arms: DualArm, step: tuple[float, float, float], turn: tuple[float, float, float]
) -> None:
    arm = arms["left"]
    begin = arm.hand(OVER_TABLE)
    goal = pose(begin.translation + np.array(step), (0.0, 0.0, 0.0))
    goal.rotation = begin.rotation @ pose((0, 0, 0), turn).rotation
    line = cartesian.straight(None, arm, OVER_TABLE, goal, arms["right"].home)
    assert isinstance(line, JointPath)
    end = arm.hand(line.points[-1])
    assert np.linalg.norm(end.translation - goal.translation) < 1e-4
    assert angle_between(end.rotation, goal.rotation) < 1e-3
    length = float(np.linalg.norm(step))
    if length > 1e-3:
        along = np.array(step) / length
        for q in line.points:
            off = arm.hand(q).translation - begin.translation
            assert np.linalg.norm(off - (off @ along) * along) < 5e-4
    assert np.abs(np.diff(line.points, axis=0)).max() <= cartesian.JUMP


def test_a_line_into_the_table_ends_where_it_meets_it(world: CollisionWorld, arms: DualArm) -> None:
    arm = arms["left"]
    begin = arm.hand(OVER_TABLE)
    goal = pose(begin.translation - np.array([0.0, 0.0, begin.translation[2] - 0.02]))
    goal.rotation = begin.rotation
    broken = cartesian.straight(world, arm, OVER_TABLE, goal, arms["right"].home)
    assert isinstance(broken, cartesian.Broken)
    assert 0.0 < broken.fraction < 1.0
    assert "table" in str(broken)


def test_turning_about_an_axis_keeps_the_distance_to_it(arms: DualArm) -> None:
    arm = arms["left"]
    begin = arm.hand(OVER_TABLE)
    axis, centre = np.array([0.0, 0.0, 1.0]), begin.translation + np.array([0.05, 0.0, 0.0])
    path = cartesian.turned(None, arm, OVER_TABLE, centre, axis, 0.8, arms["right"].home)
    assert isinstance(path, JointPath)
    for q in path.points:
        off = arm.hand(q).translation - centre
        assert abs(np.linalg.norm(off - off[2] * axis) - 0.05) < 5e-4
    turned = angle_between(begin.rotation, arm.hand(path.points[-1]).rotation)
    assert abs(turned - 0.8) < 2e-3


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**31), count=st.integers(2, 8), speed=st.floats(0.05, 1.0))
def test_a_retimed_path_keeps_limits_ends_and_rest(
    workcell: Workcell, arms: DualArm, seed: int, count: int, speed: float
) -> None:
    arm, model = arms["left"], workcell.arm("left")
    rng = np.random.default_rng(seed)
    corners = rng.uniform(arm.lower, arm.upper, (count, 7))
    path = JointPath(np.concatenate([np.linspace(a, b, 12) for a, b in itertools.pairwise(corners)]))
    trajectory = retime(path, model, speed=speed)
    assert isinstance(trajectory, Trajectory)
    assert np.allclose(trajectory.positions[0], path.points[0], atol=1e-12)
    assert np.allclose(trajectory.positions[-1], path.points[-1], atol=1e-12)
    assert np.abs(trajectory.velocities[[0, -1]]).max() < 1e-9
    _, velocity, acceleration = trajectory.sample(np.linspace(0.0, trajectory.duration, 4000))
    assert (np.abs(velocity) <= speed * np.array(model.velocity) * (1 + 1e-9)).all()
    assert (np.abs(acceleration) <= speed**2 * np.array(model.acceleration) * (1 + 1e-9)).all()


def test_half_the_speed_takes_twice_as_long(workcell: Workcell, arms: DualArm) -> None:
    goal = arms["left"].home + np.array([0.5, 0.3, -0.2, 0.4, 0.1, -0.3, 0.2])
    path = JointPath(np.linspace(arms["left"].home, goal, 30))
    fast, slow = (retime(path, workcell.arm("left"), speed=speed) for speed in (1.0, 0.5))
    assert isinstance(fast, Trajectory)
    assert isinstance(slow, Trajectory)
    assert slow.duration == pytest.approx(2.0 * fast.duration, rel=0.02)


def straight_down(arms: DualArm, depth: float) -> Trajectory:
    """A slow joint motion that lowers the hand towards the table."""
    goal = OVER_TABLE + np.array([0.0, depth, 0.0, 0.0, 0.0, 0.0, 0.0])
    return Trajectory(np.array([0.0, 3.0]), np.array([OVER_TABLE, goal]), np.zeros((2, 7)))


def test_a_certificate_is_given_to_what_is_free_and_refused_to_what_is_not(
    workcell: Workcell, world: CollisionWorld, arms: DualArm
) -> None:
    model, other = workcell.arm("left"), arms["right"].home
    good = certify(world, arms["left"], model, straight_down(arms, 0.05), other)
    assert isinstance(good, Certificate)
    assert good.min_clearance > 0.0
    assert 0.0 < good.max_velocity_ratio < 1.0
    bad = certify(world, arms["left"], model, straight_down(arms, 1.2), other)
    assert isinstance(bad, Uncertified)
    assert bad.contact is not None
    assert "table" in (bad.contact.a, bad.contact.b)
    assert 0.0 < bad.time < 3.0


def test_a_curve_over_a_limit_is_not_certified(workcell: Workcell, world: CollisionWorld, arms: DualArm) -> None:
    model, other = workcell.arm("left"), arms["right"].home
    calm = straight_down(arms, 0.05)
    fastest = 1.5 * 0.05 / calm.duration / model.velocity[1]
    hurried = Trajectory(calm.times * fastest / 1.01, calm.positions, calm.velocities)
    refused = certify(world, arms["left"], model, hurried, other)
    assert isinstance(refused, Uncertified)
    assert "panda_joint2 reaches" in refused.reason
    assert "limit" in refused.reason


def test_no_certified_curve_comes_closer_than_it_may_between_samples(
    workcell: Workcell, world: CollisionWorld, arms: DualArm
) -> None:
    """Random slow curves, looked at 40 times finer than a planner would."""
    arm, model, other = arms["left"], workcell.arm("left"), arms["right"].home
    rng, said = np.random.default_rng(3), set()
    for state in free_states(world, arms, 21, 12):
        goal = np.clip(state + rng.normal(size=7) * 0.25, arm.lower, arm.upper)
        curve = Trajectory(np.array([0.0, 4.0]), np.array([state, goal]), np.zeros((2, 7)))
        found = certify(world, arm, model, curve, other)
        said.add(type(found))
        positions = curve.sample(np.linspace(0.0, 4.0, 400))[0]
        closest = min(world.clearance(np.concatenate([q, other]))[0] for q in positions)
        if isinstance(found, Certificate):
            assert closest > 0.5 * world.margin - 1e-9
            assert found.min_clearance >= closest - 1e-3
        else:
            assert found.contact is not None
            assert closest < 0.5 * world.margin + 1e-4
    assert said == {Certificate, Uncertified}


@pytest.mark.parametrize("planner", ["RRTConnect", "RRTstar"])
def test_other_planners_by_name_use_the_same_proofs(world: CollisionWorld, arms: DualArm, planner: str) -> None:
    start, goal = free_states(world, arms, 5, 2)
    path = motion.plan(world, arms["left"], start, goal[None, :], arms["right"].home, seed=1, planner=planner)
    assert isinstance(path, JointPath)
    proofs = world.motion(["left"], np.concatenate([start, arms["right"].home]))
    assert proofs.path(path.points, 0.6 * world.margin)[1] == 2
    with pytest.raises(UnknownName, match="tree"):
        motion.plan(world, arms["left"], start, goal[None, :], arms["right"].home, seed=1, planner="fastest")
