"""Every planner on input that means nothing: a typed reason or a ``ValueError`` with numbers, at once."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from planners import cartesian, ik, motion
from planners.certify import Certificate, Uncertified, certify
from planners.chain import ChainPath, carry, plan_chain
from planners.chain_timing import ChainMotion, timed_chain
from planners.collision import CollisionWorld
from planners.level import Level, certify_level, plan_level
from planners.loop import Loop
from planners.motion import GoalInCollision, JointPath, NoPath, OutOfLimits, StartInCollision
from planners.reasons import GoalOutOfReach, LoopOpen, Tilted
from planners.timing import Together, retime, retime_together
from robots.errors import UnknownName
from robots.model import DualArm
from robots.spatial import Array, hand_rotation, pose
from robots.trajectory import Trajectory
from robots.workcell import SIDES, Workcell

SIGNS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
ENCLOSING = SIGNS * 1.2
"""A solid block in which a whole arm disappears [m]."""

OVERSIZED = SIGNS * 0.15
"""A held block that is far wider than the gripper opens [m]."""

IN_TABLE = np.array([0.4, 0.9, 0.0, -1.2, 0.0, 2.1, 0.78])
FREE = np.array([0.2, 0.0, 0.1, -2.0, 0.0, 2.0, 0.8])
NAN = np.full(7, np.nan)
T_OBJECT_LEFT = pin.SE3(hand_rotation([1, 0, 0], [0, 1, 0]), np.array([-0.28, 0.0, 0.0]))
T_OBJECT_RIGHT = pin.SE3(hand_rotation([-1, 0, 0], [0, 1, 0]), np.array([0.28, 0.0, 0.0]))


@dataclass(frozen=True)
class Setting:
    """The shipped cell without an object, and a start with both hands where they would hold a box."""

    world: CollisionWorld
    arms: DualArm
    holding: Array

    @property
    def still(self) -> Array:
        return self.arms["right"].home

    @property
    def home(self) -> Array:
        return self.arms["left"].home

    def moved(self, joint: int, to: float) -> Array:
        q = np.array(self.home)
        q[joint] = to
        return q

    def block(self, vertices: Array) -> CollisionWorld:
        self.world.set_object([vertices])
        self.world.place_object(pose((-0.5, 0.0, 0.3)))
        return self.world

    def held(self, vertices: Array) -> CollisionWorld:
        """In the left hand, which alone may touch it."""
        self.world.set_object([vertices])
        self.world.attach_object("left", pose((0.0, 0.0, 0.1)))
        self.world.allow([("object", f"left/panda_{part}") for part in ("hand", "leftfinger", "rightfinger")])
        return self.world

    def plan(self, start: Any, goals: Any, still: Any = None, **more: Any) -> Any:
        still = self.still if still is None else still
        return motion.plan(self.world, self.arms["left"], start, goals, still, seed=0, **more)

    def line(self, start: Any, goal: pin.SE3, **more: Any) -> Any:
        return cartesian.straight(self.world, self.arms["left"], start, goal, self.still, **more)

    def turn(self, start: Any, point: Any = (0.0, 0.0, 0.3), axis: Any = (0.0, 0.0, 1.0), angle: float = 0.3) -> Any:
        return cartesian.turned(
            self.world, self.arms["left"], start, np.array(point), np.array(axis), angle, self.still
        )

    def follow(self, solutions: Any, to: pin.SE3 | None = None, steps: int = 5) -> Any:
        T = self.arms["left"].hand(FREE) if to is None else to
        return cartesian.follow_best(self.world, self.arms["left"], solutions, lambda _: T, steps, self.still)

    def level(self, start: Any, goal: Any, axis: Any = (0.0, 0.0, -1.0), tilt: float = 3.1) -> Any:
        return plan_level(
            self.world, self.arms["left"], start, np.array([goal]), self.still, axis_hand=axis, tilt=tilt, seed=0
        )

    def chain(self, start: Any, goal: Any, left: pin.SE3 = T_OBJECT_LEFT) -> Any:
        return plan_chain(self.world, self.arms, start, goal, left, T_OBJECT_RIGHT, seed=0)

    def proof(self, curve: Trajectory, still: Any = None) -> Any:
        model = self.world.workcell.arm("left")
        return certify(self.world, self.arms["left"], model, curve, self.still if still is None else still)

    def timed(self, points: Any, **more: Any) -> Any:
        return retime(JointPath(np.asarray(points)), self.world.workcell.arm("left"), **more)


@pytest.fixture(scope="module")
def base(workcell: Workcell, arms: DualArm) -> Setting:
    world, rng, found = CollisionWorld(workcell), np.random.default_rng(3), []
    for side, T in zip(SIDES, (T_OBJECT_LEFT, T_OBJECT_RIGHT), strict=True):
        solved = ik.solve(arms[side], pose((0.0, 0.0, 0.25)) * T, rng=rng, seeds=[arms[side].home], wanted=6)
        assert isinstance(solved, ik.Reached)
        found.append(solved.solutions)
    loop = Loop.of(arms, T_OBJECT_LEFT.actInv(T_OBJECT_RIGHT), arms.home[None])
    pairs = [loop.project(np.concatenate([a, b])) for a in found[0] for b in found[1]]
    return Setting(world, arms, next(q for q in pairs if q is not None and world.free(q)))


@pytest.fixture
def setting(base: Setting) -> Setting:
    """The same with nothing in it."""
    base.world.set_object(())
    base.world.allow([])
    return base


def nan_pose(where: str) -> pin.SE3:
    T = pin.SE3.Identity()
    if where == "position":
        T.translation = np.array([0.0, np.nan, 0.0])
    else:
        T.rotation = np.full((3, 3), np.nan)
    return T


def scaled_pose() -> pin.SE3:
    T = pin.SE3.Identity()
    T.rotation = 1.1 * np.eye(3)
    return T


@dataclass(frozen=True)
class Case:
    """A call and what must come of it.

    Attributes:
        call: What is asked.
        gives: Type of the reason, or of the value itself; ``ValueError`` when it must be raised.
        text: Part of the message, with its number.
    """

    call: Callable[[Setting], Any]
    gives: type
    text: str = ""


def ready(s: Setting, vertices: Array) -> Setting:
    s.block(vertices)
    return s


def loaded(s: Setting, vertices: Array) -> Setting:
    s.held(vertices)
    return s


def both_loaded(s: Setting, vertices: Array) -> Setting:
    s.world.set_object([vertices])
    carry(s.world, T_OBJECT_LEFT)
    return s


REST = Trajectory(np.array([0.0, 1.0]), np.array([FREE, FREE]), np.zeros((2, 7)))
INTO_TABLE = Trajectory(np.array([0.0, 30.0]), np.array([IN_TABLE, IN_TABLE]), np.zeros((2, 7)))

CASES = {
    "plan: start in the table": Case(lambda s: s.plan(IN_TABLE, s.home), StartInCollision, "table"),
    "plan: goal in the table": Case(lambda s: s.plan(s.home, IN_TABLE), GoalInCollision, "table"),
    "plan: start past a limit": Case(lambda s: s.plan(s.moved(3, 0.5), s.home), OutOfLimits, "joint4 at 0.500 rad"),
    "plan: goal past a limit": Case(lambda s: s.plan(s.home, s.moved(3, 0.5)), OutOfLimits, "joint4 at 0.500 rad"),
    "plan: nowhere to go": Case(lambda s: s.plan(s.home, s.home), JointPath),
    "plan: start not a number": Case(lambda s: s.plan(NAN, s.home), ValueError, "the start must be finite"),
    "plan: goal not a number": Case(lambda s: s.plan(s.home, NAN), ValueError, "the goals must be finite"),
    "plan: infinite other arm": Case(lambda s: s.plan(s.home, FREE, NAN / 0.0 + 1), ValueError, "other arm"),
    "plan: other arm of six joints": Case(lambda s: s.plan(s.home, FREE, np.zeros(6)), ValueError, "not (6,)"),
    "plan: no goals": Case(lambda s: s.plan(s.home, np.zeros((0, 7))), ValueError, "not (0, 7)"),
    "plan: unknown planner": Case(lambda s: s.plan(s.home, FREE, planner="best"), UnknownName, "tree"),
    "plan: inside a block": Case(lambda s: ready(s, ENCLOSING).plan(s.home, FREE), StartInCollision, "object"),
    "plan: oversized in hand": Case(lambda s: loaded(s, OVERSIZED).plan(s.home, FREE), StartInCollision, "object"),
    "straight: start in the table": Case(lambda s: s.line(IN_TABLE, pose((0, 0, 0.3))), cartesian.Broken, "after 0 %"),
    "straight: start past a limit": Case(
        lambda s: s.line(s.moved(3, 0.5), pose((0, 0, 0.3))), cartesian.Broken, "joint4 past its limit (0.50"
    ),
    "straight: nowhere to go": Case(lambda s: s.line(FREE, s.arms["left"].hand(FREE)), JointPath),
    "straight: out of reach": Case(lambda s: s.line(FREE, pose((5.0, 0.0, 0.3))), cartesian.Broken, "%"),
    "straight: start not a number": Case(lambda s: s.line(NAN, pose((0, 0, 0.3))), ValueError, "entry 0 is nan"),
    "straight: goal not a number": Case(
        lambda s: s.line(FREE, nan_pose("position")), ValueError, "position of the goal"
    ),
    "straight: goal no rotation": Case(
        lambda s: s.line(FREE, nan_pose("rotation")), ValueError, "rotation of the goal"
    ),
    "straight: goal scaled": Case(lambda s: s.line(FREE, scaled_pose()), ValueError, "off an orthonormal"),
    "straight: no step": Case(lambda s: s.line(FREE, pose((0, 0, 0.3)), step=0.0), ValueError, "above 0 m, not 0.0 m"),
    "straight: inside a block": Case(
        lambda s: ready(s, ENCLOSING).line(FREE, pose((0, 0, 0.3))), cartesian.Broken, "object"
    ),
    "straight: oversized in hand": Case(
        lambda s: loaded(s, OVERSIZED).line(FREE, pose((0, 0, 0.3))), cartesian.Broken, "object"
    ),
    "turned: start in the table": Case(lambda s: s.turn(IN_TABLE), cartesian.Broken, "table"),
    "turned: start past a limit": Case(lambda s: s.turn(s.moved(3, 0.5)), cartesian.Broken, "past its limit"),
    "turned: by nothing": Case(lambda s: s.turn(FREE, angle=0.0), JointPath),
    "turned: start not a number": Case(lambda s: s.turn(NAN), ValueError, "the start must be finite"),
    "turned: angle not a number": Case(lambda s: s.turn(FREE, angle=np.nan), ValueError, "the angle must be finite"),
    "turned: point not a number": Case(lambda s: s.turn(FREE, point=NAN[:3]), ValueError, "point of the axis"),
    "turned: no axis": Case(lambda s: s.turn(FREE, axis=(0.0, 0.0, 0.0)), ValueError, "no direction"),
    "turned: inside a block": Case(lambda s: ready(s, ENCLOSING).turn(FREE), cartesian.Broken, "object"),
    "follow: nowhere to go": Case(lambda s: s.follow(FREE[None]), JointPath),
    "follow: no solutions": Case(lambda s: s.follow(np.zeros((0, 7))), ValueError, "not (0, 7)"),
    "follow: not a number": Case(lambda s: s.follow(NAN[None]), ValueError, "entry (0, 0) is nan"),
    "follow: no waypoints": Case(lambda s: s.follow(FREE[None], steps=0), ValueError, "not 0 waypoints"),
    "follow: elsewhere": Case(lambda s: s.follow(FREE[None], pose((5.0, 0, 0))), cartesian.Broken, "after 0 %"),
    "follow: pose not a number": Case(lambda s: s.follow(FREE[None], nan_pose("position")), ValueError, "at the start"),
    "level: start in the table": Case(lambda s: s.level(IN_TABLE, FREE), StartInCollision, "table"),
    "level: goal in the table": Case(lambda s: s.level(FREE, IN_TABLE), GoalInCollision, "table"),
    "level: start past a limit": Case(lambda s: s.level(s.moved(3, 0.5), FREE), OutOfLimits, "0.500 rad"),
    "level: goal past a limit": Case(lambda s: s.level(FREE, s.moved(3, 0.5)), OutOfLimits, "0.500 rad"),
    "level: start upside down": Case(lambda s: s.level(FREE, FREE, (0, 0, 1.0), 0.1), Tilted, "limit 5.7 deg"),
    "level: nowhere to go": Case(lambda s: s.level(FREE, FREE), JointPath),
    "level: not a number": Case(lambda s: s.level(NAN, FREE), ValueError, "the start must be finite"),
    "level: no axis": Case(lambda s: s.level(FREE, FREE, (0.0, 0.0, 0.0)), ValueError, "no direction"),
    "level: axis not a number": Case(lambda s: s.level(FREE, FREE, NAN[:3]), ValueError, "axis of the hand"),
    "level: no tilt": Case(lambda s: s.level(FREE, FREE, tilt=0.0), ValueError, "not 0.0 rad"),
    "level: tilt not a number": Case(lambda s: s.level(FREE, FREE, tilt=np.nan), ValueError, "not nan rad"),
    "level: inside a block": Case(lambda s: ready(s, ENCLOSING).level(FREE, s.home), StartInCollision, "object"),
    "level: oversized in hand": Case(lambda s: loaded(s, OVERSIZED).level(FREE, s.home), StartInCollision, "object"),
    "level proof: tilt not a number": Case(
        lambda s: certify_level(s.arms["left"], REST, np.eye(3)[0], np.nan), ValueError, "not nan rad"
    ),
    "level proof: at rest": Case(lambda s: certify_level(s.arms["left"], REST, -np.eye(3)[2], 0.1), Level),
    "chain: start in collision": Case(
        lambda s: ready(s, ENCLOSING).chain(s.holding, pose((0, 0, 0.35))), StartInCollision, "object"
    ),
    "chain: oversized in hand": Case(
        lambda s: both_loaded(s, SIGNS * [0.2, 0.2, 0.6]).chain(s.holding, pose((0, 0, 0.35))),
        StartInCollision,
        "object",
    ),
    "chain: goal in the table": Case(lambda s: s.chain(s.holding, pose((0, 0, 0.01))), GoalInCollision, "table"),
    "chain: goal out of reach": Case(lambda s: s.chain(s.holding, pose((0, 0, 3.0))), GoalOutOfReach, "mm"),
    "chain: start past a limit": Case(
        lambda s: s.chain(np.concatenate([s.moved(3, 0.5), s.still]), pose((0, 0, 0.35))), OutOfLimits, "0.500 rad"
    ),
    "chain: goal past a limit": Case(
        lambda s: s.chain(s.holding, np.concatenate([s.moved(3, 0.5), s.still])), OutOfLimits, "0.500 rad"
    ),
    "chain: hands apart": Case(lambda s: s.chain(s.arms.home, pose((0, 0, 0.35))), LoopOpen, "at the start"),
    "chain: goal with hands apart": Case(lambda s: s.chain(s.holding, s.arms.home), LoopOpen, "at the goal"),
    "chain: nowhere to go, nothing held": Case(lambda s: s.chain(s.holding, s.holding), ChainPath),
    "chain: already there": Case(
        lambda s: s.chain(s.holding, s.arms["left"].hand(s.holding[:7]) * T_OBJECT_LEFT.inverse()), ChainPath
    ),
    "chain: start of one arm": Case(lambda s: s.chain(FREE, pose((0, 0, 0.35))), ValueError, "(14,), not (7,)"),
    "chain: not a number": Case(
        lambda s: s.chain(np.full(14, np.nan), pose((0, 0, 0.35))), ValueError, "entry 0 is nan"
    ),
    "chain: goal not a number": Case(lambda s: s.chain(s.holding, nan_pose("position")), ValueError, "of the goal"),
    "chain: goal joints not numbers": Case(lambda s: s.chain(s.holding, np.full(14, np.nan)), ValueError, "the goal"),
    "chain: grasp not a number": Case(
        lambda s: s.chain(s.holding, pose((0, 0, 0.35)), nan_pose("rotation")), ValueError, "left hand on the object"
    ),
    "chain timing: no length": Case(lambda s: timed_chain(s.world, s.arms, s.chain(s.holding, s.holding)), ChainMotion),
    "retime: no length": Case(lambda s: s.timed([FREE, FREE]), Trajectory),
    "retime: one point": Case(lambda s: s.timed([FREE]), ValueError, "got (1, 7)"),
    "retime: not a number": Case(lambda s: s.timed([FREE, NAN]), ValueError, "entry (1, 0) is nan"),
    "retime: no speed": Case(lambda s: s.timed([FREE, s.home], speed=0.0), ValueError, "not 0.0 and"),
    "retime: speed not a number": Case(lambda s: s.timed([FREE, s.home], speed=np.nan), ValueError, "not nan and"),
    "retime together: no length": Case(
        lambda s: retime_together(np.stack([s.holding] * 2), tuple(s.world.workcell.arm(k) for k in SIDES)), Together
    ),
    "retime together: one point": Case(
        lambda s: retime_together(s.holding[None], tuple(s.world.workcell.arm(k) for k in SIDES)),
        ValueError,
        "2 points",
    ),
    "certify: at rest": Case(lambda s: s.proof(REST), Certificate),
    "certify: in the table": Case(lambda s: s.proof(INTO_TABLE), Uncertified, "table"),
    "certify: past a limit": Case(
        lambda s: s.proof(Trajectory(REST.times, np.stack([s.moved(3, 0.5)] * 2), REST.velocities)),
        Uncertified,
        "0.5000 rad",
    ),
    "certify: other arm not a number": Case(lambda s: s.proof(REST, NAN), ValueError, "other arm"),
    "certify: inside a block": Case(lambda s: ready(s, ENCLOSING).proof(REST), Uncertified, "object"),
    "certify: oversized in hand": Case(lambda s: loaded(s, OVERSIZED).proof(REST), Uncertified, "object"),
    "certify: curve not a number": Case(
        lambda s: s.proof(Trajectory(REST.times, np.stack([FREE, NAN]), REST.velocities)), ValueError, "not finite"
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_degenerate_input_is_answered_at_once(setting: Setting, name: str) -> None:
    case = CASES[name]
    begin = time.perf_counter()
    found: Any
    try:
        found = case.call(setting)
    except (ValueError, UnknownName) as error:
        found = error
    spent = 1e3 * (time.perf_counter() - begin)
    what = found.reason if isinstance(found, NoPath) else found
    assert isinstance(what, case.gives), f"after {spent:.1f} ms: {type(what).__name__}: {what}"
    assert case.text in str(found), f"after {spent:.1f} ms: {found}"


def test_a_path_to_where_it_already_is_has_no_length(setting: Setting) -> None:
    for found in (
        setting.plan(FREE, FREE),
        setting.level(FREE, FREE),
        setting.line(FREE, setting.arms["left"].hand(FREE)),
    ):
        assert isinstance(found, JointPath)
        assert np.abs(found.points - FREE).max() < 1e-9
