"""Laws of one arm that moves beside the other: free at every instant on one clock, never later than after it."""

from __future__ import annotations

import numpy as np
import pytest

from planners import ik, motion
from planners.beside import plan_beside
from planners.certify import Certificate, Uncertified, certify_beside
from planners.clock import Beside, Clock
from planners.collision import CollisionWorld
from planners.motion import GoalInCollision, JointPath, NoPath, OutOfLimits, StartInCollision, both_arms
from planners.reasons import OtherInTheWay
from planners.timing import retime
from robots.model import DualArm
from robots.spatial import Array, pose
from robots.trajectory import Trajectory
from robots.workcell import Side, Workcell, other

MIDDLE = pose((0.0, -0.1, 0.30), (np.pi, 0.0, 0.0))
"""A hand that points down at the middle of the table: both arms reach it, and not both at once."""


@pytest.fixture(scope="module")
def world(workcell: Workcell) -> CollisionWorld:
    return CollisionWorld(workcell)


def reaching(world: CollisionWorld, arms: DualArm, side: Side) -> Array:
    """Joint positions ``(7,)`` of an arm at ``MIDDLE`` while the other waits."""
    arm, still = arms[side], arms[other(side)].home
    found = ik.solve(arm, MIDDLE, rng=np.random.default_rng(0), seeds=[arm.home], restarts=20, wanted=8)
    assert isinstance(found, ik.Reached)
    return next(q for q in found.solutions if world.free(both_arms(arm, q, still)))


def visit(workcell: Workcell, world: CollisionWorld, arms: DualArm, *, stay: float = 0.0) -> Trajectory:
    """The right arm goes to the middle, stays there for a time [s] and comes back."""
    arm, there = arms["right"], reaching(world, arms, "right")
    way = motion.plan(world, arm, arm.home, there[None], arms["left"].home, seed=0)
    assert isinstance(way, JointPath)
    go, back = (retime(JointPath(p), workcell.arm("right"), speed=0.5) for p in (way.points, way.points[::-1]))
    assert isinstance(go, Trajectory)
    assert isinstance(back, Trajectory)
    return Trajectory(
        np.concatenate([go.times, back.times + go.duration + stay + 0.01]),
        np.concatenate([go.positions, back.positions]),
        np.concatenate([go.velocities, back.velocities]),
    )


def closest(world: CollisionWorld, clock: Clock, step: float = 0.001) -> float:
    """Smallest distance [m] at states so far apart in time [s], by Coal."""
    times = np.arange(0.0, clock.duration + step, step)
    return min(world.clearance(q)[0] for q in clock.sample(times)[0])


def test_an_arm_waits_for_its_place_and_not_longer(workcell: Workcell, world: CollisionWorld, arms: DualArm) -> None:
    left, goal, theirs = arms["left"], reaching(world, arms, "left"), visit(workcell, world, arms, stay=0.5)
    first, again = (plan_beside(world, left, left.home, goal[None], theirs, seed=1, speed=0.5) for _ in range(2))
    assert isinstance(first, Beside)
    assert isinstance(again, Beside)
    assert first.begin == again.begin
    assert np.array_equal(first.trajectory.positions, again.trajectory.positions)
    assert np.array_equal(first.trajectory.positions[[0, -1]], [left.home, goal])
    assert 0.0 < first.begin < theirs.duration
    assert first.end < theirs.duration + first.trajectory.duration
    assert closest(world, Clock("left", first, theirs, 0.0), 0.002) > 0.5 * world.margin - 1e-9
    at_once = certify_beside(world, left, Beside(0.0, first.trajectory), theirs, 0.0)
    assert isinstance(at_once, Uncertified)
    assert at_once.contact is not None
    assert {name.partition("/")[0] for name in (at_once.contact.a, at_once.contact.b)} == {"left", "right"}


def test_an_arm_that_is_not_met_begins_at_once_and_not_before_it_may(
    workcell: Workcell, world: CollisionWorld, arms: DualArm
) -> None:
    left, theirs = arms["left"], visit(workcell, world, arms)
    near = left.home + np.array([-0.3, 0.1, 0.0, 0.1, 0.0, 0.2, 0.5])
    for begin in (0.0, 0.7, theirs.duration + 1.0):
        found = plan_beside(world, left, left.home, near[None], theirs, begin=begin, seed=0)
        assert isinstance(found, Beside)
        assert found.begin == begin


def test_what_is_proven_in_time_is_what_coal_finds_free(
    workcell: Workcell, world: CollisionWorld, arms: DualArm
) -> None:
    """The same curve begun at many times: some meet the other arm, some do not, and the proof says which."""
    left, theirs = arms["left"], visit(workcell, world, arms)
    goal = reaching(world, arms, "left")
    way = motion.plan(world, left, left.home, goal[None], arms["right"].home, seed=0)
    assert isinstance(way, JointPath)
    mine = retime(way, workcell.arm("left"), speed=0.5)
    assert isinstance(mine, Trajectory)
    said = set()
    for begin in np.linspace(0.0, theirs.duration, 8):
        beside = Beside(float(begin), mine)
        found = certify_beside(world, left, beside, theirs, 0.0)
        nearest = closest(world, Clock("left", beside, theirs, 0.0), 0.005)
        said.add(type(found))
        assert nearest > 0.5 * world.margin - 1e-9 if isinstance(found, Certificate) else nearest < 0.01
    assert said == {Certificate, Uncertified}


def test_why_there_is_no_way_has_a_name_and_a_time(workcell: Workcell, world: CollisionWorld, arms: DualArm) -> None:
    left, right, goal = arms["left"], arms["right"], reaching(world, arms, "left")
    theirs = visit(workcell, world, arms)
    half = int(np.argmax(theirs.times >= theirs.duration / 2))
    arriving = Trajectory(theirs.times[: half + 1], theirs.positions[: half + 1], theirs.velocities[: half + 1])
    refused = plan_beside(world, left, left.home, goal[None], arriving, seed=0)
    assert isinstance(refused, NoPath)
    assert isinstance(refused.reason, GoalInCollision)
    past = left.home.copy()
    past[3] = 0.5
    refused = plan_beside(world, left, left.home, past[None], theirs, seed=0)
    assert isinstance(refused, NoPath)
    assert isinstance(refused.reason, OutOfLimits)
    stuck = plan_beside(world, left, goal, goal[None] + 0.01, theirs, seed=0)
    assert isinstance(stuck, NoPath)
    assert isinstance(stuck.reason, OtherInTheWay)
    assert 0.0 < stuck.reason.time < theirs.duration
    assert "right/" in str(stuck)
    below = plan_beside(world, left, left.home + np.eye(7)[1] * 2.5, goal[None], theirs, seed=0)
    assert isinstance(below, NoPath)
    assert isinstance(below.reason, StartInCollision)
    with pytest.raises(ValueError, match="begin"):
        plan_beside(world, left, left.home, goal[None], theirs, begin=float("nan"), seed=0)
    assert world.free(both_arms(left, left.home, right.home))


def test_a_clock_has_both_arms_at_rest_outside_of_their_curves(
    workcell: Workcell, world: CollisionWorld, arms: DualArm
) -> None:
    theirs = visit(workcell, world, arms)
    mine = Trajectory(np.array([0.0, 1.0]), np.array([arms["left"].home, arms["left"].home + 0.1]), np.zeros((2, 7)))
    clock = Clock("left", Beside(theirs.duration + 0.5, mine), theirs, 0.25)
    assert clock.duration == pytest.approx(theirs.duration + 1.25)
    assert (np.diff(clock.times) > 0.0).all()
    q, qd, qdd = clock.sample([0.0, theirs.duration, clock.duration + 1.0])
    assert np.array_equal(q[0, :7], arms["left"].home)
    assert np.allclose(q[0, 7:], theirs.at(0.25))
    assert np.allclose(q[2], np.concatenate([mine.positions[-1], theirs.positions[-1]]))
    assert (qd[1:] == 0.0).all()
    assert (qdd[1:] == 0.0).all()
