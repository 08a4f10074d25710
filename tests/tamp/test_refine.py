"""Where the search goes back to after a rejection, and what it remembers."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from affordance.candidates import Roles
from tamp import trace as trace_file
from tamp.episode import Request, plan_episode
from tamp.plan import load
from tamp.refine import hands_clash
from tamp.stages import Reject, StageChecker

ROLES = Roles(assistant="left", primary="right")


@pytest.mark.parametrize(
    ("bodies", "clash"),
    [
        (("left/panda_hand", "right/panda_hand"), True),
        (("left/panda_leftfinger", "right/panda_rightfinger"), True),
        (("left/panda_link5", "right/panda_hand"), False),
        (("right/panda_hand", "table"), False),
        (("right/panda_hand", "object"), False),
        (("right/panda_link5", "right/panda_hand"), False),
        (None, False),
    ],
)
def test_only_two_hands_blame_the_grasp(bodies: tuple[str, str] | None, clash: bool) -> None:
    assert hands_clash(Reject("collision", "", bodies), ROLES) is clash


def search_with(
    monkeypatch: pytest.MonkeyPatch, folder: Path, method: str, reject: Reject, until: int
) -> trace_file.Trace:
    """The trace of a bottle for which the first answers of one check are rejections."""
    honest, asked = getattr(StageChecker, method), Counter[str]()

    def answer(self: StageChecker, *arguments: Any) -> Any:
        asked[method] += 1
        return reject if asked[method] <= until else honest(self, *arguments)

    monkeypatch.setattr(StageChecker, method, answer)
    plan_episode(Request(category="Bottle", seed=1, execute=False, out=folder))
    return trace_file.load(folder)


def test_clashing_hands_send_the_search_to_the_next_grasp(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    honest = plan_episode(Request(category="Bottle", seed=1, execute=False, out=tmp_path / "honest"))
    clash = Reject("collision", "hands", ("left/panda_hand", "right/panda_leftfinger"), 0.01)
    trace = search_with(monkeypatch, tmp_path / "run", "act", clash, until=8)
    planted = [r for r in trace.rejections if r.detail == "hands"]
    assert planted
    assert {r.blame for r in planted} == {"pregrasp"}
    tried = next(s for s in load(tmp_path / "run").stages if s.name == "pregrasp").candidates_tried
    assert tried > honest.stages[0].candidates_tried


def test_a_primary_out_of_reach_sends_the_search_to_the_next_object_pose(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    far = Reject("unreachable", "far", None, 0.05)
    trace = search_with(monkeypatch, tmp_path / "run", "act", far, until=8)
    planted = [r for r in trace.rejections if r.detail == "far"]
    assert {r.blame for r in planted} == {"reorient"}
    plan = load(tmp_path / "run")
    counts = {stage.name: stage.candidates_tried for stage in plan.stages}
    assert counts["pregrasp"] == 1
    assert counts["reorient"] > 1


def test_when_one_assignment_of_roles_fails_the_other_is_tried(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    honest, first = StageChecker.hold, []

    def only_one_arm(self: StageChecker, roles: Roles, *arguments: Any) -> Any:
        first.append(roles.assistant)
        if roles.assistant == first[0]:
            return Reject("unreachable", "not with this arm", None, 0.2)
        return honest(self, roles, *arguments)

    monkeypatch.setattr(StageChecker, "hold", only_one_arm)
    report = plan_episode(Request(category="Bottle", seed=1, execute=False, out=tmp_path / "run"))
    assert report.status == "planned"
    trace = trace_file.load(tmp_path / "run")
    assert len(trace.skeletons) == 2
    assert trace.chosen == 1
    assert load(tmp_path / "run").assistant != first[0]


def test_without_any_way_the_failure_names_stage_and_reason(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(StageChecker, "expose", lambda *_: Reject("unreachable", "far by 30 mm", None, 0.03))
    report = plan_episode(Request(category="Bottle", seed=1, out=tmp_path / "run"))
    assert report.status == "no_plan"
    assert report.failure is not None
    assert (report.failure.stage, report.failure.reason) == ("reorient", "unreachable")
    assert "far by 30 mm" in report.failure.detail
    rejected = trace_file.load(tmp_path / "run").rejections
    assert all(r.approach is not None and len(r.approach) == 16 for r in rejected if r.stage == "reorient")


def test_the_planner_is_handed_no_privileged_geometry() -> None:
    """Besides the proposer, nothing on the road from observation to plan imports the door to the truth."""
    root = Path(__file__).parents[2]
    users = {
        str(path.relative_to(root))
        for package in ("robots", "planners", "affordance", "tamp")
        for path in (root / package).rglob("*.py")
        if "worlds.labels" in path.read_text("utf-8")
    }
    assert users == {"affordance/heuristic.py", "tamp/episode.py"}
