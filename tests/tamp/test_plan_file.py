"""A plan file is read back as it was written, and a damaged one is refused with one readable sentence."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from robots.errors import BadRunFolder
from tamp import plan as plan_file
from tamp import trace as trace_file
from tamp.episode import Report


@pytest.fixture(scope="module")
def data(bottle: tuple[Report, Path]) -> bytes:
    return (bottle[1] / plan_file.PLAN_FILE).read_bytes()


def refused(data: bytes) -> str:
    with pytest.raises(BadRunFolder) as caught:
        plan_file.decode(data, "runs/x/plan.json")
    return str(caught.value)


def edited(data: bytes, change: Callable[[dict[str, Any]], None]) -> bytes:
    raw = json.loads(data)
    change(raw)
    return json.dumps(raw).encode()


@pytest.mark.parametrize("task", ["bottle", "phone", "plate", "handover"])
def test_decoding_and_encoding_gives_the_same_bytes(task: str, request: pytest.FixtureRequest) -> None:
    data = (request.getfixturevalue(task)[1] / plan_file.PLAN_FILE).read_bytes()
    assert plan_file.encode(plan_file.decode(data, "x")) == data


@pytest.mark.parametrize("keep", [0, 1, 100, 0.3, 0.999])
def test_a_truncated_file_is_refused(data: bytes, keep: float) -> None:
    cut = data[: int(keep if keep > 1 or keep in (0, 1) else keep * len(data))]
    text = refused(cut)
    assert text.startswith("runs/x/plan.json cannot be read as a plan: ")
    assert "Plan again" in text


def test_bytes_that_are_no_text_are_refused() -> None:
    assert "cannot be read as a plan" in refused(b"\xff\xfe\x00garbage")


def set_at(*path: Any, value: Any) -> Callable[[dict[str, Any]], None]:
    def change(raw: dict[str, Any]) -> None:
        place: Any = raw
        for key in path[:-1]:
            place = place[key]
        place[path[-1]] = value

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (set_at("format", value="other"), 'its format is "other", not "bipremanip-plan"'),
        (set_at("version", value=99), "has version 99; this program reads version 2"),
        (set_at("colour", value="red"), "unknown field `colour`"),
        (set_at("stages", 0, "steps", 0, "positions", 3, value=[0.0] * 6), "length"),
        (set_at("stages", 0, "steps", 0, "times", 1, value="soon"), "Expected `float`"),
        (set_at("stages", 0, "steps", 0, "times", 1, value=-1.0), "stage 0 (pregrasp): trajectory times must"),
        (set_at("stages", 0, "steps", 0, "times", value=[0.0]), "stage 0 (pregrasp): a trajectory needs"),
        (set_at("stages", 0, "T_world_object", 0, value=[2.0, 0.0, 0.0, 0.0]), "not orthonormal"),
        (set_at("stages", 0, "name", value="juggle"), "juggle"),
        (set_at("stages", value=[]), "0 stages"),
        (set_at("task", value="juggling"), "juggling"),
        (set_at("T_world_body", value=[[2.0, 0.0, 0.0, 0.0]] * 4), "start: the rotation part of a pose"),
        (set_at("stages", 0, "steps", 0, "guard", value="soft"), "Expected `float | null`"),
        (set_at("stages", 0, "steps", 0, "holder", value="both"), "both"),
        (set_at("stages", 0, "steps", 0, "type", value="teleport"), "teleport"),
        (set_at("assistant", value="middle"), "middle"),
    ],
)
def test_what_makes_no_sense_is_refused_with_its_place(
    data: bytes, change: Callable[[dict[str, Any]], None], words: str
) -> None:
    assert words in refused(edited(data, change))


def test_a_missing_folder_or_file_is_told(tmp_path: Path) -> None:
    with pytest.raises(BadRunFolder, match="does not exist"):
        plan_file.load(tmp_path / "none")
    (tmp_path / "notes.txt").write_text("hello")
    with pytest.raises(BadRunFolder, match=r"has no plan.json; it holds notes.txt"):
        plan_file.load(tmp_path)
    with pytest.raises(BadRunFolder, match=r"has no trace.json"):
        trace_file.load(tmp_path)


def test_a_damaged_trace_is_refused(bottle: tuple[Report, Path], tmp_path: Path) -> None:
    data = (bottle[1] / trace_file.TRACE_FILE).read_bytes()
    (tmp_path / trace_file.TRACE_FILE).write_bytes(data[:-20])
    with pytest.raises(BadRunFolder, match="cannot be read as a trace"):
        trace_file.load(tmp_path)
    (tmp_path / trace_file.TRACE_FILE).write_bytes(data.replace(b'"version": 1', b'"version": 7'))
    with pytest.raises(BadRunFolder, match="of version 7"):
        trace_file.load(tmp_path)
    (tmp_path / trace_file.TRACE_FILE).write_bytes(data)
    assert trace_file.load(tmp_path).status == "success"


def rejection(stage: str, cause: str, skeleton: int = 0) -> trace_file.Rejection:
    return trace_file.Rejection(
        skeleton=skeleton,
        stage=stage,
        arm="left",
        role="assistant",
        candidate=1,
        cause=cause,
        detail=cause,
        blame=stage,
    )  # type: ignore[arg-type]


def test_the_commonest_cause_of_the_furthest_stage_sums_up_a_search() -> None:
    failure = trace_file.dominant(
        [rejection("pregrasp", "collision")] * 5
        + [rejection("reorient", "unreachable")] * 2
        + [rejection("reorient", "collision")],
        [["pregrasp(left)", "lift(left)", "reorient(left)"]],
    )
    assert (failure.stage, failure.reason) == ("reorient", "unreachable")
    assert failure.detail == "2 of 3 candidates: unreachable"


def test_how_far_a_stage_is_goes_by_the_skeleton_that_was_tried() -> None:
    """The same name may come early in one task and late in another."""
    early, late = ["push(left)", "retreat(left)", "grasp(right)"], ["operate(left)", "release(left)", "retreat(left)"]
    found = trace_file.dominant([rejection("retreat", "collision"), rejection("grasp", "no_path")], [early])
    assert found.stage == "grasp"
    found = trace_file.dominant([rejection("retreat", "collision"), rejection("release", "no_path")], [late])
    assert found.stage == "retreat"
