"""Faults that only a push, a press or a handover can have are named as well."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from msgspec.structs import replace

from affordance.candidates import ContactCandidate
from affordance.heuristic import HeuristicProposer
from planners import cartesian
from planners.motion import JointPath
from robots.model import DualArm
from robots.spatial import rotation_about
from robots.workcell import Workcell, other
from tamp import plan as plan_file
from tamp.episode import Report, Request, plan_episode
from tamp.verify import verify
from tamp.verify.bodies import tilt_faults
from tamp.verify.rules import may_touch, meets_level
from tests.tamp.test_verify import Raw, changed, closing, found, renamed, stage, step
from worlds import scene
from worlds.assets import library


@pytest.fixture(scope="module")
def pushed(phone: tuple[Report, Path]) -> bytes:
    return (phone[1] / plan_file.PLAN_FILE).read_bytes()


@pytest.fixture(scope="module")
def pressed(plate: tuple[Report, Path]) -> bytes:
    return (plate[1] / plan_file.PLAN_FILE).read_bytes()


@pytest.fixture(scope="module")
def handed(handover: tuple[Report, Path]) -> bytes:
    return (handover[1] / plan_file.PLAN_FILE).read_bytes()


def prolonged(raw: Raw, arms: DualArm, offset: tuple[float, float, float]) -> None:
    """Let the hand go on in a straight line by ``offset`` [m] after its drag, slowly, with what it drags."""
    drag, side = step(raw, "push", "drag"), raw["assistant"]
    end, still = np.array(drag["positions"][-1]), np.array(raw["start"][raw["primary"]])
    T_end = arms[side].hand(end)
    T_further = pin.SE3(T_end.rotation, T_end.translation + np.array(offset))
    more = cartesian.straight(None, arms[side], end, T_further, still)
    assert isinstance(more, JointPath)
    ways = [*drag["positions"], *more.points[1:].tolist()]
    drag["positions"], drag["velocities"] = ways, np.zeros((len(ways), 7)).tolist()
    drag["times"] = [0.3 * k for k in range(len(ways))]
    stage(raw, "push")["T_world_object"][0][3] += offset[0]
    stage(raw, "push")["T_world_object"][1][3] += offset[1]


# -- push ------------------------------------------------------------------------------------------------------------


def test_an_object_pushed_off_the_table_is_found(pushed: bytes, arms: DualArm) -> None:
    result = verify(changed(pushed, lambda raw: prolonged(raw, arms, (0.0, -0.09, 0.0))))
    (hit,) = found(result, "off_table")
    assert hit.stage == "push"
    assert "beyond the table's edge" in hit.detail
    assert not [h for h in result.violations if h.kind in ("object_frame", "not_a_slide") and h.stage == "push"]


def test_a_drag_that_lifts_the_object_is_found(pushed: bytes, arms: DualArm) -> None:
    hits = found(verify(changed(pushed, lambda raw: prolonged(raw, arms, (0.0, 0.0, 0.012)))), "not_a_slide")
    assert [hit.stage for hit in hits] == ["push"]
    assert "12.0 mm" in hits[0].detail


def test_an_object_that_goes_where_no_hand_moved_it_is_found(pushed: bytes) -> None:
    def plant(raw: Raw) -> None:
        stage(raw, "push")["T_world_object"][1][3] -= 0.003

    hits = found(verify(changed(pushed, plant)), "object_frame")
    assert [hit.stage for hit in hits] == ["push"]
    assert "3.00 mm" in hits[0].detail


def test_a_descent_that_ends_above_the_object_is_found(pushed: bytes) -> None:
    def plant(raw: Raw) -> None:
        descend = step(raw, "push", "descend")
        for key in ("times", "positions", "velocities"):
            descend[key] = descend[key][:2]
        descend["velocities"] = np.zeros((2, 7)).tolist()

    result = verify(changed(pushed, plant))
    (hit,) = found(result, "misses_object")
    assert hit.stage == "push"
    assert "mm from the object" in hit.detail


@pytest.mark.parametrize(
    ("descend", "drag", "retreat", "kind", "stages"),
    [
        (None, None, None, "unguarded", ["push", "push"]),
        (61.0, 0.0, -1.0, "force_limit", ["push", "push", "retreat"]),
        (0.0, 300.0, 60.1, "force_limit", ["push", "push", "retreat"]),
    ],
)
def test_a_force_that_is_missing_or_out_of_range_is_found(
    pushed: bytes, descend: float | None, drag: float | None, retreat: float | None, kind: str, stages: list[str]
) -> None:
    def plant(raw: Raw) -> None:
        step(raw, "push", "descend")["guard"] = descend
        step(raw, "push", "drag")["force"] = drag
        step(raw, "retreat", "retreat")["guard"] = retreat

    assert [hit.stage for hit in found(verify(changed(pushed, plant)), kind)] == stages


def test_fingers_that_meet_the_object_on_the_way_to_the_grasp_are_found(pushed: bytes) -> None:
    """They close before they approach and so come in front of what they should go around."""

    def plant(raw: Raw) -> None:
        steps = stage(raw, "grasp")["steps"]
        shut = dict(closing(raw, "grasp"), allowed=[["object", "table"]], holder=None)
        steps.insert(next(k for k, s in enumerate(steps) if s.get("template") == "free"), shut)

    hits = found(verify(changed(pushed, plant)), "contact")
    assert any(hit.stage == "grasp" and "finger" in hit.detail and "object" in hit.detail for hit in hits)


def test_an_approach_that_claims_the_contact_is_not_believed(pushed: bytes) -> None:
    def plant(raw: Raw) -> None:
        step(raw, "grasp", "approach")["allowed"] += [[f"{raw['primary']}/panda_leftfinger", "object"]]

    assert [hit.stage for hit in found(verify(changed(pushed, plant)), "allows_too_much")] == ["grasp"]


def test_a_grasp_that_closes_on_nothing_is_found(pushed: bytes) -> None:
    """The object stood 40 mm further back than the plan was made for."""
    plan = plan_file.decode(pushed, "plan")
    asset = library.load(plan.asset.source, plan.asset.category, plan.asset.instance)
    with scene.build(plan.workcell, asset, plan.seed) as world:
        T_world_body = world.object_pose()

    def plant(raw: Raw) -> None:
        raw["T_world_body"] = plan_file.matrix(T_world_body)

    assert verify(changed(pushed, plant)).violations == []
    T_world_body.translation = T_world_body.translation + np.array([0.0, 0.06, 0.0])
    result = verify(changed(pushed, plant))
    assert [hit.stage for hit in found(result, "closes_on_nothing")] == ["grasp"]


def test_a_grasp_by_the_hand_that_pushed_is_found(pushed: bytes) -> None:
    def plant(raw: Raw) -> None:
        stage(raw, "grasp")["arm"] = other(raw["primary"])
        renamed(raw)

    assert [hit.stage for hit in found(verify(changed(pushed, plant)), "roles")] == ["grasp"]


def test_a_push_whose_hand_never_retreats_is_found(pushed: bytes) -> None:
    def plant(raw: Raw) -> None:
        raw["stages"] = [s for s in raw["stages"] if s["name"] != "retreat"]
        renamed(raw)

    assert "are not those of edge_push" in found(verify(changed(pushed, plant)), "structure")[0].detail


def test_a_lift_that_ends_on_the_table_is_found(pushed: bytes) -> None:
    def plant(raw: Raw) -> None:
        lift = step(raw, "lift", "lift")
        lift["positions"] = [lift["positions"][0]] * 2
        lift["times"], lift["velocities"] = [0.0, 1.0], np.zeros((2, 7)).tolist()

    result = verify(changed(pushed, plant))
    assert [hit.stage for hit in found(result, "on_table")] == ["lift"]
    assert found(result, "object_frame")


def test_a_false_holder_is_found(pushed: bytes) -> None:
    def plant(raw: Raw) -> None:
        step(raw, "push", "drag")["holder"] = None
        step(raw, "lift", "lift")["holder"] = raw["assistant"]

    hits = found(verify(changed(pushed, plant)), "holder")
    assert [hit.stage for hit in hits] == ["push", "lift"]
    assert "the plan says nothing holds the object here" in hits[0].detail


def test_another_task_than_the_category_has_is_found(pushed: bytes) -> None:
    def plant(raw: Raw) -> None:
        raw["category"] = "Handover-Bottle"

    assert "is no edge_push task with a Phone" in found(verify(changed(pushed, plant)), "structure")[0].detail


# -- push from behind --------------------------------------------------------------------------------------------------


def pushing(*templates: str, force: float | None = None) -> plan_file.Stage:
    """A push whose motions have these templates and nothing else of interest."""
    still = {"times": [0.0, 1.0], "positions": [[0.0] * 7] * 2, "velocities": [[0.0] * 7] * 2, "allowed": []}
    return plan_file.Stage(
        name="push",
        arm="left",
        role="assistant",
        steps=[plan_file.Motion(template=name, holder=None, force=force, **still) for name in templates],  # type: ignore[arg-type]
        candidates_tried=1,
        score=1.0,
        T_hand_object=None,
        T_world_object=plan_file.matrix(pin.SE3.Identity()),
    )


def test_only_a_hand_that_does_not_press_from_above_may_touch_while_it_approaches(pushed: bytes) -> None:
    plan = plan_file.decode(pushed, "plan")
    finger = ("left/panda_leftfinger", "object")
    plan = replace(plan, assistant="left", primary="right")
    above = pushing("free", "approach", "descend", "drag")
    behind = pushing("free", "approach", "approach", "drag")
    touching = [[finger in may_touch(plan, stage, k) for k in range(4)] for stage in (above, behind)]
    assert touching == [[False, False, True, True], [False, False, True, True]]
    assert [[meets_level(stage, k) for k in range(4)] for stage in (above, behind)] == [
        [False, False, False, False],
        [False, False, True, False],
    ]


@pytest.fixture(scope="module")
def forked(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A bowl that is pushed from behind: pushes from above are not proposed."""
    honest = HeuristicProposer.push

    def from_behind(*arguments: Any) -> list[ContactCandidate]:
        return [candidate for candidate in honest(*arguments) if candidate.start is not None]

    folder = tmp_path_factory.mktemp("runs") / "bowl"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(HeuristicProposer, "push", from_behind)
        report = plan_episode(Request(category="Bowl", seed=2, execute=False, page=False, out=folder))
    assert report.status == "planned", report.failure
    return (folder / plan_file.PLAN_FILE).read_bytes()


def test_a_hand_behind_an_object_must_come_to_it_without_pressing(forked: bytes, arms: DualArm) -> None:
    """It is moved 8 mm back, so that it falls short, or 8 mm forward, so that it would be inside the bowl."""
    plan = plan_file.decode(forked, "plan")
    assert [s.template for s in plan.stages[0].steps if isinstance(s, plan_file.Motion)][-2:] == ["approach", "drag"]
    assert verify(plan).violations == []

    def shifted(raw: Raw, forward: float) -> None:
        side = raw["assistant"]
        closing_in = [s for s in stage(raw, "push")["steps"] if s.get("template") == "approach"][-1]
        end, still = np.array(closing_in["positions"][-1]), np.array(raw["start"][raw["primary"]])
        T_end = arms[side].hand(end)
        T_other = pin.SE3(T_end.rotation, T_end.translation + np.array([0.0, -forward, 0.0]))
        way = cartesian.straight(None, arms[side], end, T_other, still)
        assert isinstance(way, JointPath)
        ways = [closing_in["positions"][0], way.points[-1].tolist()]
        closing_in.update(positions=ways, velocities=np.zeros((2, 7)).tolist(), times=[0.0, 4.0])

    short = verify(changed(forked, lambda raw: shifted(raw, -0.008)))
    assert [hit.stage for hit in found(short, "misses_object")] == ["push"]
    inside = verify(changed(forked, lambda raw: shifted(raw, 0.008)))
    assert any(hit.stage == "push" and "finger" in hit.detail for hit in found(inside, "contact"))


# -- press -----------------------------------------------------------------------------------------------------------


def test_a_release_before_the_other_hand_holds_is_found(pressed: bytes) -> None:
    def plant(raw: Raw) -> None:
        raw["stages"][1:3] = raw["stages"][2:0:-1]
        renamed(raw)

    assert "are not those of plate_lift" in found(verify(changed(pressed, plant)), "structure")[0].detail

    def plant_open_hand(raw: Raw) -> None:
        stage(raw, "grasp")["steps"].remove(closing(raw, "grasp"))

    hits = found(verify(changed(pressed, plant_open_hand)), "not_held")
    assert [hit.stage for hit in hits] == ["release"]
    assert "but nothing holds it" in hits[0].detail


def test_a_press_that_sinks_the_object_into_the_table_is_found(pressed: bytes) -> None:
    def plant(raw: Raw) -> None:
        stage(raw, "press")["T_world_object"][2][3] -= 0.02

    hits = found(verify(changed(pressed, plant)), "not_a_tilt")
    assert {hit.stage for hit in hits} == {"press"}
    assert any("mm into the table" in hit.detail for hit in hits)


BLOCK = np.array([[x, y, z] for x in (-0.1, 0.0, 0.1) for y in (-0.1, 0.1) for z in (0.0, 0.03)])
"""Corners and middle of a flat block, at rest with its middle at the world's origin."""


def about_foot(angle: float) -> pin.SE3:
    """A turn about the foot at +x."""
    pivot, R = np.array([0.04, 0.0, 0.0]), rotation_about([0.0, 1.0, 0.0], angle)
    return pin.SE3(R, pivot - R @ pivot)


def test_a_turn_about_a_foot_is_a_tilt(workcell: Workcell) -> None:
    dish = np.array([[x, y, z] for x, z in ((-0.1, 0.03), (-0.04, 0.0), (0.04, 0.0), (0.1, 0.03)) for y in (-0.1, 0.1)])
    assert tilt_faults(workcell.table, dish, pin.SE3.Identity(), about_foot(0.4)) == []


@pytest.mark.parametrize(
    ("T_move", "words"),
    [
        (pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.004])), "goes 4.0 mm into the table"),
        (pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.02])), "no point of the pressed object stays on the table"),
        (pin.SE3(np.eye(3), np.array([0.01, 0.0, 0.0])), "no point of the pressed object stays on the table"),
        (pin.SE3(rotation_about([0.0, 0.0, 1.0], 0.1), np.zeros(3)), "turns by 5.7 deg about the vertical"),
        (about_foot(0.2), "goes 11.9 mm into the table"),
    ],
    ids=["sinks", "rises", "slides", "turns", "through"],
)
def test_what_is_more_than_a_tilt_is_told(workcell: Workcell, T_move: pin.SE3, words: str) -> None:
    told = [text for _, text in tilt_faults(workcell.table, BLOCK, pin.SE3.Identity(), T_move)]
    assert any(words in text for text in told), told


# -- handover ----------------------------------------------------------------------------------------------------------


def test_a_hand_that_opens_before_the_human_pulls_is_found(handed: bytes) -> None:
    def plant(raw: Raw) -> None:
        steps = stage(raw, "release")["steps"]
        steps[:] = [s for s in steps if s["type"] != "await"]

    assert [hit.stage for hit in found(verify(changed(handed, plant)), "drops_object")] == ["release"]


def move_wait(raw: Raw) -> None:
    steps = stage(raw, "release")["steps"]
    wait = next(s for s in steps if s["type"] == "await")
    stage(raw, "present")["steps"].append(wait)


def pull_hard(raw: Raw) -> None:
    next(s for s in stage(raw, "release")["steps"] if s["type"] == "await")["force"] = 100.0


def keep_holding(raw: Raw) -> None:
    steps = stage(raw, "release")["steps"]
    steps[:] = [s for s in steps if s["type"] != "grip"]


@pytest.mark.parametrize(
    ("plant", "kind", "where"),
    [(move_wait, "structure", "present"), (pull_hard, "force_limit", "release"), (keep_holding, "not_held", "plan")],
)
def test_a_wait_in_the_wrong_place_too_strong_or_in_vain_is_found(
    handed: bytes, plant: Callable[[Raw], None], kind: str, where: str
) -> None:
    assert [hit.stage for hit in found(verify(changed(handed, plant)), kind)] == [where]


def test_a_false_place_in_the_hand_is_found(handed: bytes) -> None:
    def plant(raw: Raw) -> None:
        stage(raw, "present")["T_hand_object"][0][3] += 0.004

    hits = found(verify(changed(handed, plant)), "object_frame")
    assert [hit.stage for hit in hits] == ["present"]
    assert "4.00 mm" in hits[0].detail
