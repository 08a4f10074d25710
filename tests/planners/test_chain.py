"""Laws of both arms moving one object: the loop stays closed, nothing else is touched, one schedule, typed refusals."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from planners import chain, ik
from planners.certify import Uncertified
from planners.chain import ChainPath, carry, plan_chain
from planners.chain_timing import LOOK, LOOP_ANGLE, LOOP_GAP, ChainMotion, loop_errors, timed_chain
from planners.collision import CollisionWorld
from planners.loop import Loop, relative
from planners.motion import GoalInCollision, NoPath, OutOfLimits, StartInCollision
from planners.reasons import GoalOutOfReach, LoopOpen
from planners.timing import Together, retime_together
from robots.model import DualArm
from robots.spatial import Array, angle_between, hand_rotation, pose
from robots.workcell import SIDES, Workcell

SIGNS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
T_OBJECT_LEFT = pin.SE3(hand_rotation([1, 0, 0], [0, 1, 0]), np.array([-0.28, 0.0, 0.0]))
T_OBJECT_RIGHT = pin.SE3(hand_rotation([-1, 0, 0], [0, 1, 0]), np.array([0.28, 0.0, 0.0]))
T_START = pose((0.0, 0.0, 0.25))
LIFT = pose((0.0, 0.0, 0.35))
TURNED = [pose((0.0, 0.0, 0.35), tuple(np.radians(30.0) * np.eye(3)[k])) for k in range(3)]


@pytest.fixture(scope="module")
def world(workcell: Workcell) -> CollisionWorld:
    """A box of 0.4 x 0.05 x 0.06 m in both hands, 24 mm deep between the fingers."""
    world = CollisionWorld(workcell)
    world.set_object([SIGNS * np.array([0.2, 0.025, 0.03])])
    for side in SIDES:
        world.set_fingers(side, 0.026)
    carry(world, T_OBJECT_LEFT)
    return world


@pytest.fixture(scope="module")
def start(world: CollisionWorld, arms: DualArm) -> Array:
    """Both hands on the box, 0.25 m over the table; exactly on the loop."""
    rng, found = np.random.default_rng(3), {}
    for side, T in zip(SIDES, (T_OBJECT_LEFT, T_OBJECT_RIGHT), strict=True):
        found[side] = ik.solve(arms[side], T_START * T, rng=rng, seeds=[arms[side].home], wanted=6)
    left, right = found["left"], found["right"]
    assert isinstance(left, ik.Reached)
    assert isinstance(right, ik.Reached)
    loop = Loop.of(arms, T_OBJECT_LEFT.actInv(T_OBJECT_RIGHT), arms.home[None])
    pairs = [loop.project(np.concatenate([a, b])) for a in left.solutions for b in right.solutions]
    return next(q for q in pairs if q is not None and world.free(q))


def checked(world: CollisionWorld, arms: DualArm, path: ChainPath, start: Array) -> None:
    """Everything a path promises, by our own measure."""
    assert np.array_equal(path.points[0], start)
    for q in path.points:
        T = relative(arms, q)
        assert np.linalg.norm(T.translation - path.T_left_right.translation) <= 1e-5
        assert angle_between(T.rotation, path.T_left_right.rotation) <= 1e-5
        assert all(arms[side].within_limits(mine) for side, mine in zip(SIDES, (q[:7], q[7:]), strict=True))
    for a, b in zip(path.points[:-1], path.points[1:], strict=True):
        assert np.abs(b - a).max() < 0.2
        assert all(world.clearance(a + (b - a) * share)[0] > 0.4 * world.margin for share in (0.0, 0.5, 1.0))


@pytest.mark.parametrize("goal", [LIFT, *TURNED], ids=["lift", "roll", "pitch", "yaw"])
def test_both_arms_lift_and_turn_a_box(world: CollisionWorld, arms: DualArm, start: Array, goal: pin.SE3) -> None:
    path = plan_chain(world, arms, start, goal, T_OBJECT_LEFT, T_OBJECT_RIGHT, seed=1)
    assert isinstance(path, ChainPath), str(path)
    checked(world, arms, path, start)
    T_end = arms["left"].hand(path.points[-1, :7]) * T_OBJECT_LEFT.inverse()
    assert np.linalg.norm(T_end.translation - goal.translation) < 1e-5
    assert angle_between(T_end.rotation, goal.rotation) < 1e-5
    motion = timed_chain(world, arms, path)
    assert isinstance(motion, ChainMotion), str(motion)
    assert motion.certificate.min_clearance > 0.5 * world.margin
    gap = angle = 0.0
    for q in motion.curve.sample(np.arange(0.0, motion.curve.duration, LOOK))[0]:
        T = relative(arms, q)
        gap = max(gap, float(np.linalg.norm(T.translation - path.T_left_right.translation)))
        angle = max(angle, angle_between(T.rotation, path.T_left_right.rotation))
    assert gap <= LOOP_GAP
    assert angle <= LOOP_ANGLE
    assert gap == pytest.approx(motion.gap, rel=0.05)
    assert np.array_equal(motion.curve.left.times, motion.curve.right.times)
    assert np.array_equal(motion.curve.sample(0.0)[0][0], start)


def test_the_search_joins_joint_positions_and_is_repeatable(world: CollisionWorld, arms: DualArm, start: Array) -> None:
    away = plan_chain(world, arms, start, LIFT, T_OBJECT_LEFT, T_OBJECT_RIGHT, seed=1)
    assert isinstance(away, ChainPath)
    back = [plan_chain(world, arms, away.points[-1], start, T_OBJECT_LEFT, T_OBJECT_RIGHT, seed=2) for _ in range(2)]
    for path in back:
        assert isinstance(path, ChainPath)
        checked(world, arms, path, away.points[-1])
        assert np.abs(path.points[-1] - start).max() < 1e-5
        assert np.array_equal(path.points, back[0].points)


def test_without_the_straight_way_the_search_alone_keeps_the_loop_closed(
    workcell: Workcell, arms: DualArm, start: Array, monkeypatch: pytest.MonkeyPatch
) -> None:
    world = CollisionWorld(workcell)
    world.set_object([SIGNS * np.array([0.2, 0.025, 0.03])])
    carry(world, T_OBJECT_LEFT)
    monkeypatch.setattr(chain, "_straight", lambda *_: None)
    goal = pose((0.0, 0.1, 0.35), (0.0, 0.0, 0.4))
    path = plan_chain(world, arms, start, goal, T_OBJECT_LEFT, T_OBJECT_RIGHT, seed=0)
    assert isinstance(path, ChainPath), str(path)
    checked(world, arms, path, start)
    motion = timed_chain(world, arms, path)
    assert isinstance(motion, ChainMotion), str(motion)


def test_half_the_speed_takes_twice_as_long(world: CollisionWorld, arms: DualArm, start: Array) -> None:
    path = plan_chain(world, arms, start, LIFT, T_OBJECT_LEFT, T_OBJECT_RIGHT, seed=1)
    assert isinstance(path, ChainPath)
    fast, slow = (timed_chain(world, arms, path, speed=speed) for speed in (1.0, 0.5))
    assert isinstance(fast, ChainMotion)
    assert isinstance(slow, ChainMotion)
    assert slow.curve.duration == pytest.approx(2.0 * fast.curve.duration, rel=0.02)


def test_arms_timed_apart_would_open_the_loop(world: CollisionWorld, arms: DualArm, start: Array) -> None:
    """The measure of the loop sees a curve that lets go: straight joint motion instead of the path."""
    path = plan_chain(world, arms, start, TURNED[2], T_OBJECT_LEFT, T_OBJECT_RIGHT, seed=1)
    assert isinstance(path, ChainPath)
    models = world.workcell.arm("left"), world.workcell.arm("right")
    bare = retime_together(path.points[[0, -1]], models)
    assert isinstance(bare, Together)
    assert loop_errors(arms, bare, path.T_left_right)[1].max() > 5 * LOOP_GAP
    kinked = timed_chain(world, arms, ChainPath(path.points, path.T_left_right * pose((0.0, 0.0, 0.01))))
    assert isinstance(kinked, Uncertified)
    assert "drift apart by 10.00 mm" in str(kinked)


def test_refusals_are_typed_and_carry_numbers(world: CollisionWorld, arms: DualArm, start: Array) -> None:
    def refused(q: Array, goal: pin.SE3 | Array) -> NoPath:
        found = plan_chain(world, arms, q, goal, T_OBJECT_LEFT, T_OBJECT_RIGHT, seed=0)
        assert isinstance(found, NoPath)
        return found

    far = refused(start, pose((0.0, 0.0, 1.5)))
    assert isinstance(far.reason, GoalOutOfReach)
    assert "hand is out of reach" in str(far)
    in_table = refused(start, pose((0.0, 0.0, 0.02)))
    assert isinstance(in_table.reason, GoalInCollision)
    assert "table" in str(in_table)
    apart = refused(arms.home, LIFT)
    assert isinstance(apart.reason, LoopOpen)
    assert "at the start the hands do not hold one rigid object" in str(apart)
    open_goal = refused(start, start + np.eye(14)[3] * 0.05)
    assert isinstance(open_goal.reason, LoopOpen)
    past = start.copy()
    past[3] = 0.2
    assert isinstance(refused(past, LIFT).reason, OutOfLimits)
    assert isinstance(refused(start, past).reason, OutOfLimits)
    world.allow([])
    touching = refused(start, LIFT)
    carry(world, T_OBJECT_LEFT)
    assert isinstance(touching.reason, StartInCollision)
    assert "object" in str(touching)
