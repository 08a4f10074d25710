"""The motion benchmark: what it refuses, what it writes, and that its paths touch nothing in an independent oracle."""

from __future__ import annotations

import gzip
import json
import time
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from planners.compiled import layout as at
from robots.errors import BadInput, UnknownName
from tamp.cli.bench_motion import Arguments, run
from tamp.cli.output import Output
from tamp.motion_bench import panda
from tamp.motion_bench.bench import solve_all
from tamp.motion_bench.ours import Panda, plan
from tamp.motion_bench.peers import FOLDER, PEERS, run_peer
from tamp.motion_bench.problems import Problem, load_problems, spread
from tests.conftest import SHARED
from tests.planners.mesh_oracle import MeshOracle, read_problems

FILE = SHARED / "mbm" / "mbm_panda_odd.json.gz"

needs_problems = pytest.mark.skipif(not FILE.is_file(), reason=f"{FILE} is absent")

BOX = {
    "name": "block",
    "type": "box",
    "position": [0.5, 0.0, 0.6],
    "quat_xyzw": [0.0, 0.0, 0.0, 1.0],
    "half_extents": [0.05, 0.3, 0.1],
}
START = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]


def entry(**changes: Any) -> dict[str, Any]:
    goal = [1.4, *START[1:]]
    return {
        "scene": "own",
        "index": 1,
        "start": START,
        "goals": [goal],
        "fingers": [0.065, 0.065],
        "obstacles": [BOX],
        **changes,
    }


def write(path: Path, entries: list[dict[str, Any]], **changes: Any) -> Path:
    names = list(panda.JOINTS)
    text = json.dumps({"robot": "panda", "joints": names, "format": 1, "problems": entries, **changes})
    path.write_bytes(gzip.compress(text.encode()))
    return path


@pytest.fixture(scope="module")
def arm() -> Panda:
    """The benchmark's robot, its kernels compiled."""
    made = Panda()
    plan(made, problem(), seed=1)
    return made


def problem(**changes: Any) -> Problem:
    return msgspec.convert(entry(**changes), Problem)


def test_a_missing_truncated_or_wrong_file_is_one_readable_message(tmp_path: Path) -> None:
    good = write(tmp_path / "good.json.gz", [entry()])
    cut = tmp_path / "cut.json.gz"
    cut.write_bytes(good.read_bytes()[:-20])
    wrong = tmp_path / "wrong.json"
    wrong.write_text('{"robot": "panda"}')
    other = write(tmp_path / "other.json.gz", [entry()], robot="ur5")
    short = write(tmp_path / "short.json.gz", [entry(start=[0.0] * 6)])
    said = {tmp_path / "none.gz": "cannot be read", cut: "cannot be read", wrong: "not a motion problem file"}
    said |= {other: "only panda", short: "start has 6 joint positions"}
    for path, words in said.items():
        with pytest.raises(BadInput, match=words):
            load_problems(path)


def test_an_unknown_method_is_named_with_those_that_exist() -> None:
    with pytest.raises(UnknownName, match="ours-ompl"):
        solve_all([problem()], ["theirs"], seed=1, told=lambda _: None)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"start": [*START[:3], 1.0, *START[4:]]}, "the start is out of limits: panda_joint4 at 1.000 rad"),
        ({"goals": [[9.0, *START[1:]]]}, "the goal is out of limits: panda_joint1 at 9.000 rad"),
        ({"obstacles": [{**BOX, "position": [0.3, 0.0, 0.5]}]}, "the start is in collision: panda_"),
        ({"obstacles": [{**BOX, "position": [0.05, 0.4, 0.55]}]}, "the goal is in collision: panda_"),
        ({"obstacles": [{**BOX, "half_extents": [2.0, 2.0, 2.0]}]}, "the start is in collision: panda_"),
    ],
)
def test_a_hopeless_problem_is_refused_at_once_with_its_reason(arm: Panda, changes: dict[str, Any], words: str) -> None:
    hopeless = problem(**changes)
    began = time.thread_time()
    row = plan(arm, hopeless, seed=1)
    assert time.thread_time() - began < 0.05
    assert not row.solved
    assert words in row.reason


def test_a_value_that_is_no_number_is_refused(arm: Panda) -> None:
    row = plan(arm, msgspec.structs.replace(problem(), start=(float("nan"), *START[1:])), seed=1)
    assert (row.solved, row.reason) == (False, "the start holds a value that is not finite")


def test_no_obstacles_and_no_distance_are_no_special_cases(arm: Panda) -> None:
    row = plan(arm, problem(obstacles=[]), seed=1)
    assert row.solved
    assert row.length == pytest.approx(1.4)
    still = plan(arm, problem(goals=[START]), seed=1)
    assert still.solved
    assert still.length == 0.0


def test_the_command_writes_rows_summary_and_paths(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = write(tmp_path / "p.json.gz", [entry(), entry(index=2, goals=[[-1.4, *START[1:]]])])
    with Output(json=False) as output:
        output.json = True
        code = run(Arguments(file, methods="ours,ours-ompl", paths=tmp_path / "paths.json", json=True), output)
    assert code == 0
    found = json.loads(capsys.readouterr().out)
    assert {"scene", "index", "solved", "plan_ms", "simplify_ms", "certify_ms", "length_raw", "length"} <= set(
        found["rows"][0]
    )
    assert [row["method"] for row in found["rows"]] == ["ours", "ours", "ours-ompl", "ours-ompl"]
    assert found["summary"]["methods"]["ours"]["solved"] == 2
    paths = json.loads((tmp_path / "paths.json").read_text())
    assert [set(entry) for entry in paths] == [{"scene", "index", "path", "method"}] * 4
    assert paths[0]["path"][0] == START


def test_a_problem_without_a_solution_ends_with_code_one(tmp_path: Path) -> None:
    file = write(tmp_path / "p.json.gz", [entry(obstacles=[{**BOX, "position": [0.3, 0.0, 0.5]}])])
    with Output(json=False) as output:
        assert run(Arguments(file), output) == 1


@needs_problems
def test_problems_of_every_scene_are_solved_and_touch_nothing_in_the_oracle(arm: Panda) -> None:
    raw = {(p["scene"], p["index"]): p for p in read_problems(FILE)}
    chosen = spread(load_problems(FILE), 14)
    assert len({p.scene for p in chosen}) == 7
    for one in chosen:
        row, again = plan(arm, one, seed=1), plan(arm, one, seed=1)
        assert row.solved, (one.scene, one.index, row.reason)
        assert np.array_equal(row.path, again.path)
        assert np.array_equal(row.path[[0, -1]], [one.start, one.goals[0]])
        assert not MeshOracle(raw[one.scene, one.index]).path_touches(row.path, 0.01)


@needs_problems
@pytest.mark.parametrize("seed", [0])
def test_what_is_called_free_never_touches_in_the_oracle(arm: Panda, seed: int) -> None:
    _random_edges(arm, seed, problems=7, edges=40, states=400, step=0.02)


@needs_problems
@pytest.mark.slow
def test_no_edge_of_ten_thousand_and_no_path_of_all_problems_touches_in_the_oracle(arm: Panda) -> None:
    _random_edges(arm, 1, problems=35, edges=300, states=2000, step=0.01)
    raw = {(p["scene"], p["index"]): p for p in read_problems(FILE)}
    for one in load_problems(FILE):
        row = plan(arm, one, seed=1)
        assert row.solved, (one.scene, one.index, row.reason)
        assert not MeshOracle(raw[one.scene, one.index]).path_touches(row.path, 0.002), (one.scene, one.index)


def _random_edges(arm: Panda, seed: int, *, problems: int, edges: int, states: int, step: float) -> None:
    rng, proven = np.random.default_rng(seed), 0
    raw = {(p["scene"], p["index"]): p for p in read_problems(FILE)}
    for one in spread(load_problems(FILE), problems):
        motion, oracle = arm.motion(one), MeshOracle(raw[one.scene, one.index])
        q = rng.uniform(panda.LOWER, panda.UPPER, (states, 7))
        free = q[motion.states(q) == at.FREE]
        assert not any(oracle.touches(row) for row in free)
        for a in free[rng.integers(len(free), size=edges)]:
            b = np.clip(a + rng.normal(size=7) * rng.choice([0.05, 0.3, 0.6]), panda.LOWER, panda.UPPER)
            if motion.path(np.stack([a, b]))[1] == at.FREE:
                proven += 1
                assert not oracle.edge_touches(a, b, step)
    assert proven > 0.2 * problems * edges


@needs_problems
def test_closer_pieces_prove_what_hulls_prove_and_nothing_that_touches(arm: Panda) -> None:
    raw = {(p["scene"], p["index"]): p for p in read_problems(FILE)}
    rng, more = np.random.default_rng(2), 0
    for one in spread(load_problems(FILE), 7):
        q = rng.uniform(panda.LOWER, panda.UPPER, (600, 7))
        hulls, closer = (arm.motion(one, closer=flag).states(q) == at.FREE for flag in (False, True))
        assert not (hulls & ~closer).any()
        oracle = MeshOracle(raw[one.scene, one.index])
        gained = q[closer & ~hulls]
        assert not any(oracle.touches(row) for row in gained)
        more += len(gained)
    assert more > 0


@pytest.mark.parametrize("name", PEERS)
def test_a_peer_that_is_not_installed_is_named_with_how_to_install_it(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BadInput, match=f"peer {name} is not installed.*make peers"):
        solve_all([problem()], [name], seed=1, told=lambda text: None)


@pytest.mark.parametrize("name", PEERS)
def test_a_peer_that_is_installed_solves_an_easy_problem(name: str) -> None:
    if not (FOLDER / name / ".ready").is_file():
        pytest.skip(f"{FOLDER / name} is absent: make peers")
    (row,) = run_peer(name, [problem()], seed=1)
    assert row.solved
    assert np.allclose(row.path[0], START)
    assert np.allclose(row.path[-1], [1.4, *START[1:]], atol=1e-6)
    assert row.plan_ms > 0.0
