"""While one arm acts the other already moves, on the same curves, and the plan gets shorter and stays right."""

from __future__ import annotations

import json
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from planners import ik
from planners.collision import CollisionWorld
from planners.motion import JointPath, both_arms
from planners.timing import retime
from robots.model import DualArm
from robots.spatial import Array, pose
from robots.trajectory import Trajectory
from robots.workcell import Side, Workcell, other
from tamp import plan as plan_file
from tamp.drafts import Setting
from tamp.episode import Request, plan_episode
from tamp.overlap import overlapped
from tamp.plan import Meanwhile, Motion, Plan, Stage, StageName
from tamp.stages.cell import Cell
from tamp.timeline import StagePlans
from tamp.verify import verify

Raw = dict[str, Any]


@pytest.fixture(scope="module")
def plans(tmp_path_factory: pytest.TempPathFactory) -> tuple[Plan, Plan]:
    """The same bottle with and without overlap."""
    folder = tmp_path_factory.mktemp("overlap")
    for name, overlap in (("with", True), ("without", False)):
        request = Request(category="Bottle", seed=1, execute=False, page=False, overlap=overlap, out=folder / name)
        assert plan_episode(request).status == "planned"
    return plan_file.load(folder / "with"), plan_file.load(folder / "without")


def parts(plan: Plan) -> list[Meanwhile]:
    return [step.meanwhile for stage in plan.stages for step in stage.steps if step.meanwhile is not None]


def test_the_plan_is_shorter_and_right(plans: tuple[Plan, Plan]) -> None:
    together, apart = plans
    assert together.duration < 0.95 * apart.duration
    assert not parts(apart)
    assert parts(together)
    assert verify(together).violations == []
    assert verify(apart).violations == []


def test_the_other_arm_follows_the_curve_it_had(plans: tuple[Plan, Plan]) -> None:
    together, apart = plans
    stage = next(stage for stage in apart.stages if stage.name == "operate")
    free = next(step for step in stage.steps if isinstance(step, Motion) and step.template == "free")
    found = parts(together)
    assert np.allclose(found[-1].positions[-1], free.positions[-1], atol=1e-9)
    assert np.allclose(found[0].positions[0], free.positions[0], atol=1e-9)
    assert sum(part.times[-1] for part in found) == pytest.approx(
        free.duration + sum(step.duration for step in stage.steps[:1] if not isinstance(step, Motion))
    )
    for before, after in pairwise(found):
        assert np.allclose(before.positions[-1], after.positions[0], atol=1e-9)
        assert np.allclose(before.velocities[-1], after.velocities[0], atol=1e-9)


def test_its_stage_no_longer_has_what_was_done_before(plans: tuple[Plan, Plan]) -> None:
    together, _ = plans
    operate = next(stage for stage in together.stages if stage.name == "operate")
    assert isinstance(operate.steps[0], Motion)
    assert operate.steps[0].template == "approach"
    assert operate.steps[0].positions[0] == pytest.approx(parts(together)[-1].positions[-1])


def last_part(raw: Raw) -> Raw:
    """The last step during which the other arm moves: there it moves for certain, its fingers have done so before."""
    return [step for stage in raw["stages"] for step in stage["steps"] if step.get("meanwhile")][-1]


def jump(raw: Raw) -> None:
    last_part(raw)["meanwhile"]["positions"][0][2] += 0.01


def race(raw: Raw) -> None:
    part = last_part(raw)["meanwhile"]
    part["times"] = [t / 4.0 for t in part["times"]]
    part["velocities"] = [[4.0 * v for v in row] for row in part["velocities"]]


def lose(raw: Raw) -> None:
    last_part(raw)["meanwhile"] = None


@pytest.mark.parametrize(("plant", "kind"), [(jump, "jump"), (race, "velocity_limit"), (lose, "jump")])
def test_a_fault_in_what_the_other_arm_does_is_found(
    plans: tuple[Plan, Plan], plant: Callable[[Raw], None], kind: str
) -> None:
    raw = json.loads(plan_file.encode(plans[0]))
    plant(raw)
    result = verify(plan_file.decode(json.dumps(raw).encode(), "a changed plan"))
    assert kind in {violation.kind for violation in result.violations}


def test_one_arm_cannot_do_two_things_at_once(plans: tuple[Plan, Plan]) -> None:
    raw = json.loads(plan_file.encode(plans[0]))
    step = last_part(raw)
    stage = next(stage for stage in raw["stages"] if step in stage["steps"])
    step["meanwhile"]["arm"] = stage["arm"]
    result = verify(plan_file.decode(json.dumps(raw).encode(), "a changed plan"))
    assert any("in two places at once" in violation.detail for violation in result.violations)


def test_what_lasts_longer_than_its_step_is_refused(plans: tuple[Plan, Plan]) -> None:
    raw = json.loads(plan_file.encode(plans[0]))
    last_part(raw)["meanwhile"]["begin"] = 100.0
    with pytest.raises(plan_file.BadRunFolder, match="lasts longer than the step"):
        plan_file.decode(json.dumps(raw).encode(), "a changed plan")


def test_both_ways_succeed(tmp_path: Path) -> None:
    for overlap in (True, False):
        request = Request(category="Dispenser", seed=1, page=False, overlap=overlap, out=tmp_path / str(overlap))
        assert plan_episode(request).success


MIDDLE = pose((0.0, -0.1, 0.30), (np.pi, 0.0, 0.0))
"""A hand that points down at the middle of the table, where there is room for one arm."""


def reaching(world: CollisionWorld, arms: DualArm, side: Side) -> Array:
    arm = arms[side]
    found = ik.solve(arm, MIDDLE, rng=np.random.default_rng(0), seeds=[arm.home], restarts=20, wanted=8)
    assert isinstance(found, ik.Reached)
    still = arms[other(side)].home
    return next(q for q in found.solutions if world.free(both_arms(arm, q, still)))


def stage(workcell: Workcell, side: Side, name: StageName, *points: Array, stay: float = 0.0) -> Stage:
    """A stage of one free motion through points, standing at its begin for a time first [s]."""
    curve = retime(JointPath(np.array(points)), workcell.arm(side), speed=0.5)
    assert isinstance(curve, Trajectory)
    times, positions, velocities = curve.times + stay, curve.positions, curve.velocities
    if stay:
        times, positions = np.append(0.0, times), np.concatenate([positions[:1], positions])
        velocities = np.concatenate([np.zeros((1, 7)), velocities])
    step = Motion(
        template="free",
        times=times.tolist(),
        positions=positions.tolist(),
        velocities=velocities.tolist(),
        allowed=[],
        holder=None,
    )
    return Stage(
        name=name,
        arm=side,
        role="primary",
        steps=[step],
        candidates_tried=1,
        score=1.0,
        T_hand_object=None,
        T_world_object=np.eye(4).tolist(),
    )


def test_where_no_time_is_free_another_curve_passes_the_acting_arm(workcell: Workcell, arms: DualArm) -> None:
    """The right arm stands in the middle until it leaves at last; the left arm's way leads through the middle."""
    world = CollisionWorld(workcell)
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    world.set_object([0.01 * signs])
    cell = Cell(workcell, arms, world, np.zeros((1, 3)), pin.SE3.Identity())
    left, right = arms["left"], arms["right"]
    there = reaching(world, arms, "right")
    away = left.home + np.array([-0.3, 0.2, 0.0, 0.2, 0.0, 0.2, 0.5])
    stages = [
        stage(workcell, "right", "retreat", there, right.home, stay=4.0),
        stage(workcell, "left", "grasp", left.home, reaching(world, arms, "left"), away),
    ]
    setting = Setting(None, pose((0.0, 0.3, 2.0)), {}, ())
    found = overlapped(cell, StagePlans(stages, 1.0, [[setting], [setting]]))
    again = overlapped(cell, StagePlans(stages, 1.0, [[setting], [setting]]))
    part, step = found[0].steps[0].meanwhile, found[0].steps[0]
    assert part is not None
    assert not found[1].steps
    assert again == found
    assert isinstance(step, Motion)
    assert np.allclose(part.positions[0], left.home, atol=1e-9)
    assert np.allclose(part.positions[-1], away, atol=1e-9)
    mine = Trajectory(np.array(part.times), np.array(part.positions), np.array(part.velocities))
    for t in np.arange(0.0, step.duration, 0.004):
        assert world.free(both_arms(left, mine.at(t - part.begin), step.trajectory().at(t)))
