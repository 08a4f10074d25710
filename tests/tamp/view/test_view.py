"""What the viewer shows is what the plan says, and a film is whole or absent."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from robots.errors import BadInput, MissingDependency
from robots.model import DualArm
from robots.workcell import Workcell
from tamp import plan as plan_file
from tamp.episode import Report
from tamp.plan import Motion
from tamp.view import html
from tamp.view.playback import Playback
from tamp.view.video import Recorder, require_video
from worlds import observe, scene
from worlds.assets import library

Made = tuple[Report, Path]


def played(made: Made) -> Playback:
    """The playback of a run folder's plan."""
    return Playback(plan_file.load(made[1]), observe.load(made[1]).cloud)


@pytest.fixture(scope="module")
def playback(bottle: Made) -> Playback:
    return played(bottle)


@pytest.fixture(scope="module", params=["bottle", "phone", "plate", "handover"])
def each(request: pytest.FixtureRequest) -> Playback:
    """One of every task type."""
    return played(request.getfixturevalue(request.param))


def span(playback: Playback, name: str, template: str) -> tuple[float, float]:
    """When a motion of a stage begins and ends [s]."""
    begin = 0.0
    for stage in playback.plan.stages:
        for step in stage.steps:
            if stage.name == name and isinstance(step, Motion) and step.template == template:
                return begin, begin + step.duration
            begin += step.duration
    raise AssertionError(f"no {template} in {name}")


def test_the_playback_follows_the_trajectories(playback: Playback) -> None:
    begin = 0.0
    for stage in playback.plan.stages:
        for step in stage.steps:
            if isinstance(step, Motion):
                for share in (0.0, 0.37, 0.99):
                    moment = playback.at(begin + share * step.duration)
                    assert np.allclose(moment.q[stage.arm], step.trajectory().at(share * step.duration))
            begin += step.duration
    assert playback.duration == pytest.approx(begin)
    assert playback.stage_times()[-1] == pytest.approx(begin)


def test_the_object_ends_every_stage_where_the_plan_expects_it(each: Playback) -> None:
    for stage, end in zip(each.plan.stages, each.stage_times()[1:], strict=True):
        shown = each.at(end - 1e-9).T_world_object.homogeneous
        assert np.allclose(shown, np.array(stage.T_world_object), atol=2e-4)


def test_the_object_never_jumps(each: Playback) -> None:
    times = np.arange(0.0, each.duration, 0.02)
    at = np.array([each.at(float(t)).T_world_object.translation for t in times])
    assert np.linalg.norm(np.diff(at, axis=0), axis=1).max() < 0.02


def test_the_object_is_dragged_by_one_hand_and_lifted_by_the_other(phone: Made, arms: DualArm) -> None:
    playback = played(phone)
    plan = playback.plan
    for name, template, side in (("push", "drag", plan.assistant), ("lift", "lift", plan.primary)):
        begin, end = span(playback, name, template)
        first, last = playback.at(begin + 1e-9), playback.at(end - 1e-9)
        T_hand_object = arms[side].hand(first.q[side]).inverse() * first.T_world_object
        assert np.allclose((arms[side].hand(last.q[side]) * T_hand_object).homogeneous, last.T_world_object.homogeneous)
        assert np.linalg.norm(last.T_world_object.translation - first.T_world_object.translation) > 0.02


def test_a_pressed_plate_turns_only_while_the_finger_sinks(plate: Made) -> None:
    playback = played(plate)
    begin, end = span(playback, "press", "descend")
    turns = [
        np.linalg.norm(pin.log3(playback.at(float(t)).T_world_object.rotation)) for t in np.linspace(begin, end - 1e-9)
    ]
    assert turns[0] == 0.0
    assert turns[-1] > 0.03
    assert np.all(np.diff(turns) > -1e-9)
    assert np.linalg.norm(pin.log3(playback.at(begin - 0.01).T_world_object.rotation)) == 0.0


def test_what_is_handed_over_stays_where_it_was_let_go(handover: Made) -> None:
    playback = played(handover)
    last, before = playback.at(playback.duration), playback.at(playback.stage_times()[-2])
    assert np.allclose(last.T_world_object.homogeneous, before.T_world_object.homogeneous, atol=1e-6)
    assert last.opening[playback.plan.assistant] > before.opening[playback.plan.assistant] + 0.005


def test_closing_fingers_stop_at_the_observed_object(playback: Playback) -> None:
    end = playback.at(playback.duration)
    assert 0.005 < end.opening[playback.plan.assistant] < 0.04


def test_hand_paths_end_where_the_hand_is(playback: Playback, arms: DualArm) -> None:
    stage = playback.plan.stages[0]
    way = playback.path(0)
    assert np.allclose(way[0], arms[stage.arm].tcp(np.array(playback.plan.start[stage.arm])).translation, atol=1e-6)
    assert np.linalg.norm(np.diff(way, axis=0), axis=1).max() < 0.2


@pytest.mark.parametrize(
    ("task", "words"), [("bottle", "acts"), ("phone", "over the edge"), ("handover", "human pulls")]
)
def test_the_page_names_every_stage_and_needs_no_other_file(
    task: str, words: str, request: pytest.FixtureRequest
) -> None:
    report, folder = request.getfixturevalue(task)
    page = (folder / "plan.html").read_text("utf-8")
    panel = page.split('id="bipre"')[1]
    assert f"{report.category} {report.instance}, seed {report.seed}, heuristic" in panel
    assert words in panel
    for stage in report.stages:
        assert f"<td>{stage.name}</td><td>{stage.arm} ({stage.role})</td>" in panel
    assert "<script src=" not in page
    assert '<link rel="stylesheet" href="http' not in page
    assert page.rstrip().endswith("</html>")


def test_a_taken_port_gives_way_to_the_next_and_an_impossible_one_is_refused() -> None:
    import socket

    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert html._free_port(port) > port
    with pytest.raises(BadInput, match="No free port from 65536"):
        html._free_port(65536)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # imageio's reader leaves its pipes open
def test_a_film_has_frames_from_two_sides(workcell: Workcell, tmp_path: Path) -> None:
    import imageio

    world = scene.build(workcell, library.load("synthetic", "Bottle", "bottle-000"), 5)
    with world, Recorder(world, tmp_path / "execution.mp4") as recorder:
        for _ in range(120):
            if recorder.due(world.time):
                recorder.frame("pregrasp  left arm, assistant")
            world.step()
    assert {entry.name for entry in tmp_path.iterdir()} == {"execution.mp4", "execution.png"}
    frames = imageio.mimread(tmp_path / "execution.mp4", memtest=False)
    assert len(frames) == 4
    left, right = np.split(np.asarray(frames[0]), 2, axis=1)
    assert np.abs(left.astype(int) - right.astype(int)).mean() > 5.0
    assert np.asarray(frames[0]).std() > 10.0


def test_a_failed_execution_leaves_no_half_film(workcell: Workcell, tmp_path: Path) -> None:
    world = scene.build(workcell, library.load("synthetic", "Bottle", "bottle-000"), 5)
    with world, pytest.raises(KeyboardInterrupt), Recorder(world, tmp_path / "execution.mp4") as recorder:
        recorder.frame("half way")
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def test_without_the_extra_the_pip_line_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(MissingDependency, match=r'pip install "bipremanip\[video\]"'):
        require_video()
