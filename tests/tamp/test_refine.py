"""Where the search goes back to after a rejection, and what it remembers."""

from __future__ import annotations

import ast
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import pinocchio as pin
import pytest

from affordance.candidates import ContactCandidate, GoalCandidate, Roles
from affordance.heuristic import HeuristicProposer
from robots.workcell import Side
from tamp import refine
from tamp import trace as trace_file
from tamp.drafts import Reject
from tamp.episode import Request, plan_episode
from tamp.operators import OPERATORS
from tamp.plan import load
from tamp.refine import hands_clash, levels_of
from tamp.skeletons import skeletons
from tamp.verify import verify
from worlds.tasks import TASK_TYPES, TaskType

ROOT = Path(__file__).parents[2]
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


@pytest.mark.parametrize("task", TASK_TYPES)
def test_every_stage_belongs_to_one_level_that_begins_with_a_sampler(task: TaskType) -> None:
    for skeleton in skeletons(task, repeats=2):
        levels = levels_of(skeleton)
        assert tuple(stage for level in levels for stage in level.stages) == skeleton
        assert [skeleton[level.first] for level in levels] == [level.stages[0] for level in levels]
        for level in levels:
            assert [bool(stage.operator.sampler) for stage in level.stages] == [True] + [False] * (
                len(level.stages) - 1
            )
    assert OPERATORS[task][0].sampler


def search_with(
    monkeypatch: pytest.MonkeyPatch, folder: Path, check: str, reject: Reject, until: int
) -> trace_file.Trace:
    """The trace of a bottle for which the first answers of one check are rejections."""
    honest, asked = getattr(refine, check), Counter[str]()

    def answer(*arguments: Any) -> Any:
        asked[check] += 1
        return reject if asked[check] <= until else honest(*arguments)

    monkeypatch.setattr(refine, check, answer)
    plan_episode(Request(category="Bottle", seed=1, execute=False, page=False, out=folder))
    return trace_file.load(folder)


def test_clashing_hands_send_the_search_to_the_next_grasp(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    honest = plan_episode(Request(category="Bottle", seed=1, execute=False, page=False, out=tmp_path / "honest"))
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
    honest, first = refine.hold, []

    def only_one_arm(cell: Any, situation: Any, side: Side, *arguments: Any) -> Any:
        first.append(side)
        if side == first[0]:
            return Reject("unreachable", "not with this arm", None, 0.2)
        return honest(cell, situation, side, *arguments)

    monkeypatch.setattr(refine, "hold", only_one_arm)
    report = plan_episode(Request(category="Bottle", seed=1, execute=False, page=False, out=tmp_path / "run"))
    assert report.status == "planned"
    trace = trace_file.load(tmp_path / "run")
    assert len(trace.skeletons) == 2
    assert trace.chosen == 1
    assert load(tmp_path / "run").assistant != first[0]


def test_without_any_way_the_failure_names_stage_and_reason(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(refine, "bring", lambda *_: Reject("unreachable", "far by 30 mm", None, 0.03))
    report = plan_episode(Request(category="Bottle", seed=1, out=tmp_path / "run"))
    assert report.status == "no_plan"
    assert report.failure is not None
    assert (report.failure.stage, report.failure.reason) == ("reorient", "unreachable")
    assert "far by 30 mm" in report.failure.detail
    rejected = trace_file.load(tmp_path / "run").rejections
    assert all(r.approach is not None and len(r.approach) == 16 for r in rejected if r.stage == "reorient")


def short(candidate: ContactCandidate) -> ContactCandidate:
    """The same push, ended a third of the way."""
    travel = candidate.travel / 3.0
    return replace(candidate, travel=travel, T_move=pin.SE3(candidate.T_move.rotation, travel))


def test_a_second_push_appears_by_itself_when_one_does_not_reach(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The first push falls short, so that no grasp reaches under the object: a longer skeleton is tried and works."""
    honest = HeuristicProposer.push

    def timid(self: HeuristicProposer, view: Any, goal: Any, rng: Any) -> list[ContactCandidate]:
        found = honest(self, view, goal, rng)[:2]
        return [short(candidate) for candidate in found] if view.T_move.isIdentity(1e-9) else found

    monkeypatch.setattr(HeuristicProposer, "push", timid)
    once = plan_episode(
        Request(category="Phone", seed=0, max_pushes=1, execute=False, page=False, out=tmp_path / "once")
    )
    assert once.status == "no_plan"
    twice = plan_episode(Request(category="Phone", seed=0, execute=False, page=False, out=tmp_path / "twice"))
    assert twice.status == "planned", twice.failure
    assert [stage.name for stage in twice.stages] == ["push", "retreat", "push", "retreat", "grasp", "lift"]
    trace = trace_file.load(tmp_path / "twice")
    assert trace.chosen == len(trace.skeletons) - 1 > 0
    assert any(r.stage == "grasp" and r.blame == "push" for r in trace.rejections)
    assert verify(load(tmp_path / "twice")).violations == []


def test_the_best_candidate_alone_is_tried_when_resampling_is_off(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    asked: list[Side] = []

    def refuse(cell: Any, situation: Any, side: Side, *_: Any) -> Any:
        asked.append(side)
        return Reject("unreachable", "far", None, 0.1)

    monkeypatch.setattr(refine, "push", refuse)
    report = plan_episode(Request(category="Phone", seed=0, mode="E1", out=tmp_path / "run"))
    assert report.status == "no_plan"
    assert len(asked) == 1


def test_a_closed_loop_tries_another_kind_of_action_after_one_in_vain(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A proposer that takes a screw cap for one to be pulled off, or else unscrewed, as both look the same."""
    honest = HeuristicProposer.goal

    def undecided(self: HeuristicProposer, view: Any, rng: Any) -> list[GoalCandidate]:
        found = honest(self, view, rng)
        if view.T_move.isIdentity(1e-9):
            return found
        return [each for goal in found for each in (replace(goal, kind="pull", amount=0.03), goal)]

    monkeypatch.setattr(HeuristicProposer, "goal", undecided)
    once, looped = (
        plan_episode(
            Request(category="Bottle", instance="bottle-002", seed=1, mode=mode, page=False, out=tmp_path / mode)
        )
        for mode in ("E2", "E3")
    )
    assert not once.success and once.failure is not None and once.failure.reason == "not_moved"
    assert load(tmp_path / "E2").operation.kind == "pull"
    assert looped.success and looped.rounds == 2
    assert load(tmp_path / "E3").operation.kind == "unscrew"


# -- what the planner may know -----------------------------------------------------------------------------------------


def sources(*packages: str) -> dict[str, str]:
    """Text of every module by its path in the repository."""
    return {
        str(path.relative_to(ROOT)): path.read_text("utf-8")
        for package in packages
        for path in sorted((ROOT / package).rglob("*.py"))
    }


def imported(text: str) -> set[str]:
    """Modules of this repository that a module imports, wherever in it."""
    names = set[str]()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return {name for name in names if file_of(name) is not None}


def file_of(module: str) -> Path | None:
    """The file of a module of this repository."""
    path = ROOT / Path(*module.split("."))
    return next((p for p in (path.with_suffix(".py"), path / "__init__.py") if p.is_file()), None)


def reached(module: str) -> set[str]:
    """Every module of this repository that is loaded with one."""
    seen, waiting = set[str](), [module]
    while waiting:
        name = waiting.pop()
        path = file_of(name)
        if name not in seen and path is not None:
            seen.add(name)
            waiting += imported(path.read_text("utf-8"))
    return seen - {module}


def test_the_planner_is_handed_no_privileged_geometry() -> None:
    """Besides the proposer, nothing on the road from observation to plan imports the door to the truth."""
    texts = sources("robots", "planners", "affordance", "tamp")
    users = {path for path, text in texts.items() if "worlds.labels" in imported(text)}
    assert users == {"affordance/heuristic.py", "tamp/proposers.py", "tamp/recording.py", "tamp/verify/check.py"}


def test_only_execution_verifier_and_record_read_where_the_simulator_has_the_object() -> None:
    texts = sources("robots", "planners", "affordance", "tamp")
    readers = {
        path
        for path, text in texts.items()
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and len(node.args) < 2
        and node.func.attr in ("object_pose", "object_vertices", "object_bounds", "joint_position")
    }
    assert readers == {"tamp/monitors.py", "tamp/deploy.py", "tamp/verify/check.py"}


def test_the_uniform_proposer_reads_nothing_privileged() -> None:
    """It is loaded with these modules and no others: none of them knows a simulator or an object model."""
    assert reached("affordance.uniform") == {
        "affordance.candidates",
        "affordance.grip",
        "affordance.preparing",
        "robots.errors",
        "robots.spatial",
        "robots.workcell",
        "worlds.tasks",
    }


@pytest.mark.parametrize(
    "module", ["affordance.propose", "tamp.refine", "tamp.timeline", "tamp.skeletons", "tamp.drafts"]
)
def test_search_and_networks_cannot_reach_the_simulator(module: str) -> None:
    closed = {"worlds.labels", "worlds.success", "worlds.bullet.world", "worlds.scene", "worlds.observe"}
    assert not reached(module) & closed
