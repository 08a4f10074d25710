"""The verifier passes what the planner made and names every fault that is planted into it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robots.model import DualArm
from robots.workcell import Workcell, other
from tamp import plan as plan_file
from tamp.episode import Report
from tamp.plan import Plan
from tamp.verify import Verification, Violation, verify

Raw = dict[str, Any]


@pytest.fixture(scope="module")
def saved(bottle: tuple[Report, Path]) -> bytes:
    return (bottle[1] / plan_file.PLAN_FILE).read_bytes()


def changed(saved: bytes, change: Callable[[Raw], None]) -> Plan:
    """The saved plan after a change to its JSON."""
    raw = json.loads(saved)
    change(raw)
    return plan_file.decode(json.dumps(raw).encode(), "a changed plan")


def step(raw: Raw, stage: str, template: str) -> Raw:
    """A motion of a stage."""
    steps = next(s for s in raw["stages"] if s["name"] == stage)["steps"]
    return dict_of(next(s for s in steps if s.get("template") == template))


def dict_of(value: Any) -> Raw:
    assert isinstance(value, dict)
    return value


def stage(raw: Raw, name: str) -> Raw:
    """A stage of a plan."""
    return dict_of(next(s for s in raw["stages"] if s["name"] == name))


def closing(raw: Raw, name: str) -> Raw:
    """The step of a stage that closes the fingers on the object."""
    return dict_of([s for s in stage(raw, name)["steps"] if s["type"] == "grip"][-1])


def renamed(raw: Raw) -> None:
    """Make the skeleton agree with the stages."""
    raw["skeleton"] = [f"{s['name']}({s['arm']})" for s in raw["stages"]]


def found(result: Verification, kind: str) -> list[Violation]:
    assert not result.ok
    return [violation for violation in result.violations if violation.kind == kind]


@pytest.mark.parametrize("task", ["bottle", "dispenser", "phone", "plate", "handover"])
def test_a_fresh_plan_is_right(task: str, request: pytest.FixtureRequest) -> None:
    report, folder = request.getfixturevalue(task)
    assert report.stages, report.failure
    result = verify(plan_file.load(folder))
    assert result.violations == []
    assert result.ok
    assert result.checked_states > 1000
    assert 0.0 < result.max_velocity_ratio <= 1.0
    assert 0.0 < result.max_acceleration_ratio <= 1.0
    assert result.min_clearance > -0.001


def test_a_waypoint_through_the_table_is_found(saved: bytes, workcell: Workcell) -> None:
    def plant(raw: Raw) -> None:
        move = step(raw, "pregrasp", "free")
        low = [0.4, 0.9, 0.0, -1.2, 0.0, 2.1, 0.78]
        ends = np.array([move["positions"][0], low, move["positions"][-1]])
        if raw["assistant"] == "right":
            ends[1] *= [-1, 1, -1, 1, -1, 1, 1]
        move["times"], move["positions"] = [0.0, 6.0, 12.0], ends.tolist()
        move["velocities"] = np.zeros((3, 7)).tolist()

    hits = found(verify(changed(saved, plant)), "contact")
    assert any("table" in hit.detail and "mm inside" in hit.detail for hit in hits)
    assert {(hit.stage, hit.step) for hit in hits if "table" in hit.detail} == {("pregrasp", 0)}


@pytest.mark.parametrize(("quantity", "order"), [("velocity", 1), ("acceleration", 2)])
def test_one_percent_over_a_limit_is_found(saved: bytes, workcell: Workcell, quantity: str, order: int) -> None:
    """Time is squeezed until exactly one quantity peaks at 1.01 of its limit."""
    plan = plan_file.decode(saved, "plan")
    alone = verify_motion_ratios(plan)

    def plant(raw: Raw) -> None:
        move = step(raw, "pregrasp", "free")
        squeeze = (alone[order - 1] / 1.01) ** (1.0 / order)
        move["times"] = (np.array(move["times"]) * squeeze).tolist()
        move["velocities"] = (np.array(move["velocities"]) / squeeze).tolist()

    hits = found(verify(changed(saved, plant)), f"{quantity}_limit")
    assert hits
    assert all(hit.stage == "pregrasp" and hit.step == 0 for hit in hits)
    assert any("1.0100 of its limit" in hit.detail for hit in hits)


def verify_motion_ratios(plan: Plan) -> tuple[float, float]:
    """Peak velocity and acceleration of the first motion over their limits, by dense sampling at the knots."""
    move = plan.stages[0].steps[0]
    assert isinstance(move, plan_file.Motion)
    model, curve = plan.workcell.arm(plan.stages[0].arm), move.trajectory()
    times = np.unique(np.concatenate([np.linspace(0, curve.duration, 40001), curve.times, curve.times[1:] - 1e-9]))
    _, speed, rate = curve.sample(times)
    return (
        float((np.abs(speed) / np.array(model.velocity)).max()),
        float((np.abs(rate) / np.array(model.acceleration)).max()),
    )


def test_a_jump_between_motions_is_found(saved: bytes) -> None:
    def plant(raw: Raw) -> None:
        move = step(raw, "lift", "lift")
        move["positions"] = (np.array(move["positions"]) + 0.01).tolist()

    hits = found(verify(changed(saved, plant)), "jump")
    assert [(hit.stage, hit.step) for hit in hits if hit.stage == "lift"] == [("lift", 0)]
    assert "0.010000 rad" in hits[0].detail


def test_a_jump_inside_a_motion_is_found(saved: bytes) -> None:
    def plant(raw: Raw) -> None:
        move = step(raw, "pregrasp", "free")
        middle = len(move["positions"]) // 2
        for row in move["positions"][middle:]:
            row[0] += 0.05
        move["positions"][-1][0] -= 0.05

    hits = found(verify(changed(saved, plant)), "velocity_limit")
    assert hits[0].stage == "pregrasp"


def test_a_motion_that_does_not_begin_at_rest_is_found(saved: bytes) -> None:
    def plant(raw: Raw) -> None:
        step(raw, "lift", "lift")["velocities"][0][2] = 0.05

    hits = found(verify(changed(saved, plant)), "not_at_rest")
    assert hits[0].stage == "lift"


def test_a_swapped_arm_is_found(saved: bytes) -> None:
    def plant(raw: Raw) -> None:
        stage = next(s for s in raw["stages"] if s["name"] == "reorient")
        stage["arm"] = other(stage["arm"])

    result = verify(changed(saved, plant))
    assert found(result, "structure")

    def plant_consistently(raw: Raw) -> None:
        plant(raw)
        raw["skeleton"] = [f"{s['name']}({s['arm']})" for s in raw["stages"]]

    result = verify(changed(saved, plant_consistently))
    assert [hit.stage for hit in found(result, "roles")] == ["reorient"]
    assert next(hit.stage for hit in found(result, "jump")) == "reorient"


def test_swapped_roles_throughout_are_found(saved: bytes) -> None:
    def plant(raw: Raw) -> None:
        for stage in raw["stages"]:
            stage["arm"] = other(stage["arm"])
        raw["assistant"], raw["primary"] = raw["primary"], raw["assistant"]
        raw["skeleton"] = [f"{s['name']}({s['arm']})" for s in raw["stages"]]

    assert found(verify(changed(saved, plant)), "jump")


def test_a_grasp_contact_outside_its_stage_is_found(saved: bytes) -> None:
    """The fingers close around the object one step early: before the approach is over they may not touch it."""

    def plant(raw: Raw) -> None:
        steps = next(s for s in raw["stages"] if s["name"] == "pregrasp")["steps"]
        close = next(s for s in steps if s["type"] == "grip")
        assert any("object" in pair and "finger" in pair[0] for pair in close["allowed"])
        close["allowed"] = [pair for pair in close["allowed"] if "table" in pair]

    hits = found(verify(changed(saved, plant)), "contact")
    assert any(hit.stage == "pregrasp" and "finger" in hit.detail and "object" in hit.detail for hit in hits)


def test_a_plan_that_allows_more_than_its_stage_may_is_found(saved: bytes) -> None:
    def plant(raw: Raw) -> None:
        primary = raw["primary"]
        step(raw, "reorient", "free")["allowed"].append([f"{primary}/panda_leftfinger", "object"])
        step(raw, "pregrasp", "free")["allowed"].append(["left/panda_link5", "right/panda_link5"])

    hits = found(verify(changed(saved, plant)), "allows_too_much")
    assert {hit.stage for hit in hits} == {"pregrasp", "reorient"}
    assert any("panda_link5" in hit.detail for hit in hits)


def test_an_allowed_contact_is_not_excused_by_the_plan_alone(saved: bytes) -> None:
    """A hand through the table stays a violation when the plan claims that hand and table may touch."""

    def plant(raw: Raw) -> None:
        move = step(raw, "pregrasp", "free")
        low = np.array([0.4, 0.9, 0.0, -1.2, 0.0, 2.1, 0.78])
        if raw["assistant"] == "right":
            low *= [-1, 1, -1, 1, -1, 1, 1]
        move["times"] = [0.0, 6.0, 12.0]
        move["positions"] = [move["positions"][0], low.tolist(), move["positions"][-1]]
        move["velocities"] = np.zeros((3, 7)).tolist()
        move["allowed"] += [[f"{raw['assistant']}/panda_hand", "table"]]

    result = verify(changed(saved, plant))
    assert found(result, "allows_too_much")
    assert any("panda_hand" in hit.detail and "table" in hit.detail for hit in found(result, "contact"))


def test_fingers_that_close_beside_the_object_are_found(saved: bytes, arms: DualArm) -> None:
    def plant(raw: Raw) -> None:
        steps = next(s for s in raw["stages"] if s["name"] == "pregrasp")["steps"]
        close = next(s for s in steps if s["type"] == "grip")
        steps[:] = [close]

    assert found(verify(changed(saved, plant)), "closes_on_nothing")


def test_a_hand_that_opens_while_it_holds_is_found(saved: bytes) -> None:
    def plant(raw: Raw) -> None:
        stages = {s["name"]: s for s in raw["stages"]}
        opened = dict(next(s for s in stages["pregrasp"]["steps"] if s["type"] == "grip"), opening=0.04)
        stages["lift"]["steps"].append(opened)

    hits = found(verify(changed(saved, plant)), "drops_object")
    assert [hit.stage for hit in hits] == ["lift"]


def test_a_false_object_frame_is_found(saved: bytes) -> None:
    def plant(raw: Raw) -> None:
        stage = next(s for s in raw["stages"] if s["name"] == "reorient")
        stage["T_world_object"][2][3] += 0.002

    hits = found(verify(changed(saved, plant)), "object_frame")
    assert [hit.stage for hit in hits] == ["reorient"]
    assert "2.00 mm" in hits[0].detail


def test_a_start_away_from_home_and_a_finger_force_over_the_limit_are_found(saved: bytes) -> None:
    def plant(raw: Raw) -> None:
        raw["start"]["left"][6] += 0.01
        steps = next(s for s in raw["stages"] if s["name"] == "pregrasp")["steps"]
        next(s for s in steps if s["type"] == "grip")["force"] = 71.0

    result = verify(changed(saved, plant))
    assert "left arm starts 0.010000 rad" in found(result, "start")[0].detail
    assert "71.0 N" in found(result, "force_limit")[0].detail


def test_another_object_than_planned_for_is_found(saved: bytes) -> None:
    def plant(raw: Raw) -> None:
        raw["asset"]["instance"] = "bottle-000" if raw["asset"]["instance"] != "bottle-000" else "bottle-001"

    assert found(verify(changed(saved, plant)), "asset_changed")


def test_a_stage_left_out_is_found(saved: bytes) -> None:
    def plant(raw: Raw) -> None:
        raw["stages"] = [s for s in raw["stages"] if s["name"] != "release"]
        raw["skeleton"] = [f"{s['name']}({s['arm']})" for s in raw["stages"]]

    assert "are not those of articulated" in found(verify(changed(saved, plant)), "structure")[0].detail


def test_a_joint_past_its_position_limit_is_found(saved: bytes) -> None:
    def plant(raw: Raw) -> None:
        move = step(raw, "pregrasp", "free")
        past = list(move["positions"][0])
        past[5] = -0.1
        move["times"] = [0.0, 6.0, 12.0]
        move["positions"] = [move["positions"][0], past, move["positions"][-1]]
        move["velocities"] = np.zeros((3, 7)).tolist()

    hits = found(verify(changed(saved, plant)), "position_limit")
    assert "panda_joint6" in hits[0].detail
