"""An execution is a success only while nothing goes wrong: the same plans, with the world meddled with."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from robots.model import DualArm
from tamp import plan as plan_file
from tamp.drive import reversed_motion
from tamp.episode import Report
from tamp.execute import Outcome, execute
from tamp.plan import Motion, Plan
from worlds import physics, scene
from worlds.assets import library
from worlds.bullet.world import BulletWorld
from worlds.success import LiftVerdict, part_motion
from worlds.tasks import task_of


class Meddler:
    """Looks on like a camera, and does something to the world at each step after a stage has ended.

    Args:
        world: The world.
        after: The stage.
        act: Called before every step with the world and the time since that stage ended [s].
    """

    def __init__(self, world: BulletWorld, after: str, act: Callable[[BulletWorld, float], None]) -> None:
        self.world, self.after, self.act = world, after, act
        self.since: float | None = None

    def moment(self, stage: str) -> None:
        """A stage has ended."""
        if stage == self.after:
            self.since = self.world.time

    def due(self, time: float) -> bool:
        """Meddle; no frame is wanted."""
        if self.since is not None:
            self.act(self.world, time - self.since)
        return False

    def frame(self, caption: str) -> None:
        raise AssertionError("no frame is due")


def executed(
    plan: Plan, arms: DualArm, after: str = "", act: Callable[[BulletWorld, float], None] | None = None
) -> Outcome:
    """The outcome of a plan in a fresh world in which ``act`` meddles once the stage ``after`` has ended."""
    asset = library.load(plan.asset.source, plan.asset.category, plan.asset.instance)
    with scene.build(plan.workcell, asset, plan.seed) as world:
        meddler = Meddler(world, after, act or (lambda *_: None))
        return execute(plan, world, arms, task_of(plan.category), meddler, moment=meddler.moment)


@pytest.fixture(scope="module")
def phone_plan(phone: tuple[Report, Path]) -> Plan:
    assert phone[0].status == "success", phone[0].failure
    return plan_file.load(phone[1])


@pytest.fixture(scope="module")
def bottle_plan(bottle: tuple[Report, Path]) -> Plan:
    return plan_file.load(bottle[1])


SETTLED = task_of("Phone").settle
"""When the time begins for which the object must stay held [s]."""


def test_a_phone_that_is_left_alone_is_picked_up(phone: tuple[Report, Path]) -> None:
    report = phone[0]
    assert [check.fact for check in report.checked] == ["overhanging", "overhanging", "held", "lifted"]
    assert report.verdict is not None
    assert report.verdict["rise"] >= 0.10
    assert report.verdict["held"]
    assert report.verdict["alone"]


def test_a_phone_dropped_after_half_a_second_is_not_held_long_enough(phone_plan: Plan, arms: DualArm) -> None:
    def let_go(world: BulletWorld, time: float) -> None:
        if time > SETTLED + 0.5:
            world.command_fingers(phone_plan.primary, 0.04, physics.OPEN_FORCE)

    outcome = executed(phone_plan, arms, "lift", let_go)
    assert [check.true for check in outcome.checked] == [True] * 4
    assert not outcome.success
    assert outcome.failure is not None
    assert outcome.failure.reason == "dropped"


def test_a_phone_that_slips_in_the_hand_is_no_success(phone_plan: Plan, arms: DualArm) -> None:
    """The fingers slacken until the phone has slid some way, and grip again."""
    start: list[float] = []

    def slacken(world: BulletWorld, time: float) -> None:
        if time < SETTLED + 0.1:
            return
        height = float(world.object_pose().translation[2])
        start.append(height)
        slid = start[0] - height > 0.012
        world.command_fingers(phone_plan.primary, 0.0, physics.GRIP_FORCE if slid else 0.3)

    outcome = executed(phone_plan, arms, "lift", slacken)
    assert not outcome.success
    assert isinstance(outcome.verdict, LiftVerdict)
    assert outcome.verdict.slip > task_of("Phone").lift_slip
    assert "in the hand" in outcome.verdict.reason


def test_a_phone_lifted_by_half_is_not_high_enough(phone_plan: Plan, arms: DualArm) -> None:
    lift = phone_plan.stages[-1]
    (motion,) = lift.steps
    assert isinstance(motion, Motion)
    knots = len(motion.times) // 2
    half = replace(
        motion, times=motion.times[:knots], positions=motion.positions[:knots], velocities=motion.velocities[:knots]
    )
    shorter = replace(phone_plan, stages=[*phone_plan.stages[:-1], replace(lift, steps=[half])])
    outcome = executed(shorter, arms)
    assert isinstance(outcome.verdict, LiftVerdict)
    assert outcome.verdict.held
    assert 0.02 < outcome.verdict.rise < 0.10
    assert outcome.failure is not None
    assert outcome.failure.reason == "not_lifted"


def test_a_phone_that_is_gone_is_grasped_by_nobody(phone_plan: Plan, arms: DualArm) -> None:
    def take_away(world: BulletWorld, time: float) -> None:
        T = world.object_pose()
        T.translation = np.array([0.0, 0.3, 0.02])
        world.put_object(T)

    outcome = executed(phone_plan, arms, "retreat", take_away)
    assert outcome.failure is not None
    assert (outcome.failure.stage, outcome.failure.reason) == ("grasp", "not_held")
    assert "closed beside the object" in outcome.failure.detail


def test_a_lid_knocked_off_before_it_is_operated_does_not_count(bottle_plan: Plan, arms: DualArm) -> None:
    def knock(world: BulletWorld, time: float) -> None:
        part = world.asset.part
        if time < 2.0 * physics.STEP:
            joint = world.object_joints[part.joint]
            world.client.resetJointState(world.object, joint, part.start + part.sense * part.travel)
            assert part_motion(world) > part.threshold

    outcome = executed(bottle_plan, arms, "lift", knock)
    assert not outcome.success
    assert outcome.failure is not None
    assert outcome.failure.reason in ("not_moved", "not_exposed")


def test_a_bottle_that_the_assistant_drops_is_not_opened(bottle_plan: Plan, arms: DualArm) -> None:
    def let_go(world: BulletWorld, time: float) -> None:
        world.command_fingers(bottle_plan.assistant, 0.04, physics.OPEN_FORCE)

    outcome = executed(bottle_plan, arms, "operate", let_go)
    assert not outcome.success
    assert outcome.failure is not None
    assert outcome.failure.reason in ("not_held", "fell")


def test_only_so_many_stages_are_run_and_judged_by_their_monitors(phone_plan: Plan, arms: DualArm) -> None:
    asset = library.load(phone_plan.asset.source, phone_plan.asset.category, phone_plan.asset.instance)
    with scene.build(phone_plan.workcell, asset, phone_plan.seed) as world:
        outcome = execute(phone_plan, world, arms, task_of("Phone"), until=1)
    assert [check.stage for check in outcome.checked] == ["push"]
    assert outcome.success
    assert outcome.verdict is None


def test_a_motion_backwards_ends_where_it_began(phone_plan: Plan) -> None:
    motion = next(s for s in phone_plan.stages[0].steps if isinstance(s, Motion) and s.guard is not None)
    back = reversed_motion(motion)
    forth, turned = motion.trajectory(), back.trajectory()
    for share in (0.0, 0.3, 1.0):
        assert np.allclose(turned.at(share * back.duration), forth.at((1.0 - share) * motion.duration), atol=1e-9)
    assert (back.guard, back.force) == (None, None)
