"""Whole episodes: what a run folder holds, that a seed decides everything, and what an interruption keeps."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from robots.errors import BadInput, BadRunFolder
from robots.workcell import Workcell
from tamp import plan as plan_file
from tamp import trace as trace_file
from tamp.episode import OUTCOME_FILE, Report, Request, plan_episode, run_again
from tamp.refine import Search
from tamp.verify import verify
from worlds import observe


def test_an_executed_bottle_is_opened_by_one_arm_while_the_other_holds(bottle: tuple[Report, Path]) -> None:
    report, _ = bottle
    assert report.status == "success"
    assert report.failure is None
    assert [stage.name for stage in report.stages] == ["pregrasp", "lift", "reorient", "operate", "release", "retreat"]
    assert len({stage.arm for stage in report.stages if stage.role == "assistant"}) == 1
    assert {stage.arm for stage in report.stages} == {"left", "right"}
    assert all(check.true for check in report.checked)
    assert [check.fact for check in report.checked] == ["held", "lifted", "exposed", "operated", "disengaged", "held"]
    assert report.verdict is not None
    assert report.verdict["moved"] >= report.verdict["threshold"] > 0.0
    assert report.verdict["held"]


def test_the_run_folder_is_complete_and_readable(bottle: tuple[Report, Path]) -> None:
    report, folder = bottle
    names = {entry.name for entry in folder.iterdir()}
    assert names == {"plan.json", "trace.json", "observation.npz", "plan.html", OUTCOME_FILE}
    plan, trace = plan_file.load(folder), trace_file.load(folder)
    assert plan.observation_hash == observe.load(folder).digest or len(observe.load(folder).cloud) > 0
    assert trace.status == "success"
    assert trace.skeletons[trace.chosen or 0] == plan.skeleton
    assert json.loads((folder / OUTCOME_FILE).read_text())["success"] is report.success
    page = (folder / "plan.html").read_text("utf-8")
    assert len(page) < 8e6
    assert "pregrasp" in page
    assert "http://" not in page.split("<body>")[-1].split('id="bipre"')[-1]


def test_the_same_seed_gives_the_same_bytes(bottle: tuple[Report, Path], tmp_path: Path) -> None:
    again = tmp_path / "again"
    plan_episode(Request(category="Bottle", seed=1, execute=False, out=again))
    assert (again / "plan.json").read_bytes() == (bottle[1] / "plan.json").read_bytes()
    other = tmp_path / "other"
    plan_episode(Request(category="Bottle", seed=3, execute=False, out=other))
    assert (other / "plan.json").read_bytes() != (bottle[1] / "plan.json").read_bytes()


def test_a_saved_plan_runs_again_with_the_same_outcome(bottle: tuple[Report, Path]) -> None:
    report, folder = bottle
    again = run_again(folder)
    assert again.success
    assert again.verdict == report.verdict


def test_a_plan_for_an_object_that_has_changed_is_not_run(bottle: tuple[Report, Path], tmp_path: Path) -> None:
    raw = json.loads((bottle[1] / "plan.json").read_bytes())
    raw["asset"]["content_hash"] = "0" * 24
    (tmp_path / "plan.json").write_text(json.dumps(raw))
    with pytest.raises(BadRunFolder, match="has changed since the plan was made"):
        run_again(tmp_path)


def test_the_planner_starts_from_home_and_ends_holding(bottle: tuple[Report, Path], workcell: Workcell) -> None:
    plan = plan_file.load(bottle[1])
    for side in ("left", "right"):
        assert plan.start[side] == list(workcell.placement(side).home)  # type: ignore[index,arg-type]
    lifted = np.array(plan.stages[1].T_world_object)[2, 3] - np.array(plan.T_world_object)[2, 3]
    assert lifted > 0.1


def test_a_plan_without_execution_reports_planned(dispenser: tuple[Report, Path]) -> None:
    report, folder = dispenser
    assert report.status == "planned"
    assert not report.success
    assert report.execute_seconds is None
    assert plan_file.load(folder).operation.kind == "press"


def test_an_interrupted_search_keeps_its_trace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Search, "_refine", interrupted)
    with pytest.raises(KeyboardInterrupt):
        plan_episode(Request(category="Bottle", seed=1, out=tmp_path / "run"))
    trace = trace_file.load(tmp_path / "run")
    assert trace.status == "interrupted"
    assert trace.skeletons
    assert not (tmp_path / "run" / "plan.json").exists()


def test_a_search_out_of_time_says_so(tmp_path: Path) -> None:
    report = plan_episode(Request(category="Bottle", seed=1, timeout=1e-6, out=tmp_path / "run"))
    assert report.status == "no_plan"
    assert report.failure is not None
    assert report.failure.reason == "budget"
    assert not (tmp_path / "run" / "plan.json").exists()
    assert trace_file.load(tmp_path / "run").failure == report.failure


def test_a_folder_with_foreign_files_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(BadRunFolder, match=r"holds files of something else \(thesis.tex\)"):
        plan_episode(Request(category="Bottle", seed=1, out=tmp_path))
    assert [entry.name for entry in tmp_path.iterdir()] == ["thesis.tex"]


def test_an_unknown_proposer_writes_nothing(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="heuristic"):
        plan_episode(Request(category="Bottle", proposer="psychic", out=tmp_path / "run"))
    assert not (tmp_path / "run").exists()


def test_a_press_stops_when_the_part_is_at_its_end(tmp_path: Path) -> None:
    """This lever has turned a little in the assistant's hand and ends before the planned motion does."""
    request = Request(category="Dispenser", instance="dispenser-026", seed=108, out=tmp_path / "run")
    report = plan_episode(request)
    assert report.verdict is not None
    assert report.verdict["moved"] > report.verdict["threshold"]
    assert report.verdict["peak_force"] < 60.0
    assert report.status == "success"


@pytest.mark.parametrize(
    ("category", "seed"), [("Lighter", 0), ("Pen-Button", 0), ("Pen-Cap", 1), ("Stapler", 0), ("USB", 0)]
)
def test_the_other_columns_run_end_to_end_too(category: str, seed: int, tmp_path: Path) -> None:
    report = plan_episode(Request(category=category, seed=seed, page=False, out=tmp_path / "run"))
    assert report.status == "success", report.failure
    assert verify(plan_file.load(tmp_path / "run")).violations == []
