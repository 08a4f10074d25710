"""Laws of following a hand motion from several postures: exact on every waypoint, no jump, the roomiest of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

from planners import cartesian, ik
from planners.collision import CollisionWorld
from planners.motion import JointPath
from robots.model import ArmKinematics, DualArm
from robots.spatial import Array, angle_between, hand_rotation, interpolate, pose, turned_about
from robots.workcell import Workcell

STEPS = 40


@pytest.fixture(scope="module")
def world(workcell: Workcell) -> CollisionWorld:
    return CollisionWorld(workcell)


def downward(x: float, y: float, z: float) -> pin.SE3:
    """A hand that points down."""
    return pin.SE3(hand_rotation([0.0, 0.0, -1.0], [0.0, 1.0, 0.0]), np.array([x, y, z]))


def motions() -> list[Callable[[float], pin.SE3]]:
    """A long line, a quarter of a circle, and a turn on the spot with some travel."""
    begin, end = downward(-0.25, -0.1, 0.25), downward(0.05, 0.25, 0.35)
    tipped = pin.SE3(
        end.rotation @ pose((0, 0, 0), (0.5, 0.3, -0.6)).rotation, begin.translation + np.array([0.05, 0.0, 0.0])
    )
    return [
        lambda s: interpolate(begin, end, s),
        lambda s: turned_about(begin, np.array([-0.1, 0.0, 0.0]), [0.0, 0.0, 1.0], -1.57 * s),
        lambda s: interpolate(begin, tipped, s),
    ]


def postures(arm: ArmKinematics, T_world_hand: pin.SE3) -> Array:
    found = ik.solve(arm, T_world_hand, rng=np.random.default_rng(4), seeds=[arm.home], wanted=6)
    assert isinstance(found, ik.Reached)
    return found.solutions


def least_room(world: CollisionWorld, arm: ArmKinematics, points: Array, q_other: Array) -> float:
    """Our own measure of the room, at every waypoint."""
    joints = np.minimum(points - arm.lower, arm.upper - points).min() / cartesian.ROOM
    bodies = min(world.clearance(np.concatenate([q, q_other]))[0] for q in points) / cartesian.CLEAR
    return float(np.clip(min(joints, bodies), 0.0, 1.0))


@pytest.mark.parametrize("which", range(3))
def test_every_waypoint_is_exact_and_no_step_jumps(world: CollisionWorld, arms: DualArm, which: int) -> None:
    arm, pose_at = arms["left"], motions()[which]
    solutions = postures(arm, pose_at(0.0))
    path = cartesian.follow_best(world, arm, solutions, pose_at, STEPS, arms["right"].home)
    assert isinstance(path, JointPath), str(path)
    assert len(path.points) == STEPS + 1
    for k, q in enumerate(path.points):
        T, wanted = arm.hand(q), pose_at(k / STEPS)
        assert np.linalg.norm(T.translation - wanted.translation) <= 1e-6
        assert angle_between(T.rotation, wanted.rotation) <= 1e-6
        assert arm.within_limits(q)
        assert world.free(np.concatenate([q, arms["right"].home]))
    assert np.abs(np.diff(path.points, axis=0)).max() <= cartesian.JUMP
    assert np.abs(solutions - path.points[0]).max(axis=1).min() < 5e-3
    again = cartesian.follow_best(world, arm, solutions, pose_at, STEPS, arms["right"].home)
    assert isinstance(again, JointPath)
    assert np.array_equal(path.points, again.points)


def test_the_best_of_all_is_no_worse_than_any_alone(world: CollisionWorld, arms: DualArm) -> None:
    arm, still = arms["left"], arms["right"].home
    rooms: list[float] = []
    for pose_at in motions():
        solutions = postures(arm, pose_at(0.0))
        together = cartesian.follow_best(world, arm, solutions, pose_at, STEPS, still)
        assert isinstance(together, JointPath)
        for q in solutions:
            alone = cartesian.follow_best(world, arm, q[None], pose_at, STEPS, still)
            if isinstance(alone, JointPath):
                rooms.append(least_room(world, arm, alone.points, still))
                best = least_room(world, arm, together.points, still)
                assert best > rooms[-1] - 0.1  # clearance is looked at only every few waypoints
    assert max(rooms) > min(rooms) + 0.2


def test_a_start_that_is_already_exact_is_kept_bit_for_bit(arms: DualArm) -> None:
    arm = arms["left"]
    start = np.array([0.2, 0.0, 0.1, -2.0, 0.0, 2.0, 0.8])
    begin = arm.hand(start)
    goal = pin.SE3(begin.rotation, begin.translation + np.array([0.0, 0.1, 0.05]))
    path = cartesian.follow_best(
        None, arm, start[None], lambda s: interpolate(begin, goal, s), STEPS, arms["right"].home
    )
    assert isinstance(path, JointPath)
    assert np.array_equal(path.points[0], start)


def test_when_none_is_complete_the_one_that_got_furthest_is_told(world: CollisionWorld, arms: DualArm) -> None:
    arm = arms["left"]
    begin, end = downward(-0.1, 0.0, 0.3), downward(-0.1, 0.0, 0.0)

    def pose_at(s: float) -> pin.SE3:
        return interpolate(begin, end, s)

    solutions = postures(arm, begin)
    broken = cartesian.follow_best(world, arm, solutions, pose_at, STEPS, arms["right"].home)
    assert isinstance(broken, cartesian.Broken)
    assert 0.3 < broken.fraction < 1.0
    alone = [cartesian.follow_best(world, arm, q[None], pose_at, STEPS, arms["right"].home) for q in solutions]
    assert broken.fraction == max(b.fraction for b in alone if isinstance(b, cartesian.Broken))
