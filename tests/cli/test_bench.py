"""``bipre bench`` as scripts meet it, with real episodes: killed, resumed, and refused."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tamp.bench.seeds import benchmark_seeds
from tamp.cli import main
from tamp.cli.verbs import subverbs
from tests.cli.test_cli import INTERRUPTIBLE, REPOSITORY, answer, bipre, refused

SMALL = ("--methods", "heuristic", "--categories", "Bottle", "--split", "seen", "--episodes", "2", "--workers", "1")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A benchmark of two bottles that was killed after the first and then went on."""
    out = tmp_path_factory.mktemp("bench") / "out"
    command = [sys.executable, "-m", "tamp.cli", "bench", *SMALL, "--out", str(out)]
    lines = out / "episodes.jsonl"
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    with subprocess.Popen(command, cwd=REPOSITORY, env=environment, stderr=subprocess.PIPE) as process:
        while not (lines.is_file() and lines.read_bytes().count(b"\n")):
            assert process.poll() is None
            time.sleep(0.01)
        process.send_signal(signal.SIGKILL)
    first = lines.read_bytes()
    assert first.count(b"\n") == 1
    done = bipre("bench", *SMALL, "--out", str(out), "--json")
    assert done.returncode == 0, done.stderr
    assert "1 of 2 episodes are done already" in done.stderr
    assert lines.read_bytes().startswith(first)
    (row,) = answer(done)["rows"]
    assert (row["method"], row["mode"], row["category"], row["split"]) == ("heuristic", "E2", "Bottle", "seen")
    assert row["episodes"] == 2
    assert row["successes"] + sum(row["failures"].values()) == 2
    assert row["rate"] == row["successes"] / 2
    assert row["ci_low"] < row["rate"] <= row["ci_high"]
    assert row["plan_seconds_median"] > 0.0
    return out


def test_the_folder_holds_one_line_an_episode_and_the_reports(folder: Path) -> None:
    rows = [json.loads(line) for line in (folder / "episodes.jsonl").read_text().splitlines()]
    assert [row["seed"] for row in rows] == benchmark_seeds("Bottle", "seen")[:2]
    assert all(row["stages"][0].startswith("pregrasp(") for row in rows if row["status"] != "no_plan")
    for name in ("results.json", "results.csv", "report.html", "settings.json"):
        assert (folder / name).is_file()
    assert not (folder / "running").exists()


def test_a_finished_run_is_only_told_again(folder: Path) -> None:
    before = (folder / "episodes.jsonl").read_bytes()
    done = bipre("bench", *SMALL, "--out", str(folder), "--json")
    assert done.returncode == 0
    assert (folder / "episodes.jsonl").read_bytes() == before
    assert answer(done)["complete"] is True
    assert "open report.html in any browser" in done.stderr


def test_a_row_is_what_the_plan_command_gives(folder: Path, tmp_path: Path) -> None:
    row = json.loads((folder / "episodes.jsonl").read_text().splitlines()[0])
    words = ("--proposer", "heuristic", "--split", "seen", "--seed", str(row["seed"]), "--json")
    done = bipre("plan", "Bottle", *words, "--out", str(tmp_path / "run"))
    report = answer(done)
    assert (report["status"], report["instance"]) == (row["status"], row["instance"])
    assert [f"{stage['name']}({stage['arm']})" for stage in report["stages"]] == row["stages"]


def test_other_settings_for_the_folder_are_one_message(folder: Path) -> None:
    words = [*SMALL, "--out", str(folder), "--timeout", "30"]
    assert "was begun with --timeout 60.0, not 30.0; a run keeps its settings" in refused("bench", *words)


def played(name: str, *words: str) -> list[str]:
    """A command line of the benchmark with episodes of ``tests.cli.played``."""
    script = INTERRUPTIBLE + (
        f"import sys\nimport tamp.bench.run\nfrom tests.cli.played import {name}\n"
        f"tamp.bench.run.play = {name}\nfrom tamp.cli import main\nsys.exit(main({['bench', *words]!r}))\n"
    )
    return [sys.executable, "-c", script]


def test_an_exception_in_an_episode_is_counted_named_and_exit_1(tmp_path: Path) -> None:
    command = played("raising", *SMALL, "--json", "--out", str(tmp_path))
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 1, done.stderr
    told = answer(done)
    assert [fault["reason"] for fault in told["faults"]] == ["error", "error"]
    assert told["rows"][0]["failures"] == {"error": 2}
    seed = benchmark_seeds("Bottle", "seen")[0]
    assert f"error heuristic-E2-Bottle-seen-{seed}: RuntimeError: out of luck" in done.stderr
    assert "Traceback" not in done.stderr


def test_ctrl_c_is_130_and_keeps_what_is_done(tmp_path: Path) -> None:
    lines = tmp_path / "episodes.jsonl"
    command = played(
        "steady", "--methods", "heuristic", "--categories", "Bottle,USB", "--workers", "1", "--out", str(tmp_path)
    )
    with subprocess.Popen(command, cwd=REPOSITORY, stderr=subprocess.PIPE, text=True) as process:
        while not (lines.is_file() and lines.read_bytes().count(b"\n") >= 5):
            assert process.poll() is None
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        said = process.communicate(timeout=60)[1]
    assert process.returncode == 130
    assert said.endswith("Interrupted. What was written so far is kept.\n")
    assert "Traceback" not in said
    results = json.loads((tmp_path / "results.json").read_text())
    assert results["complete"] is False
    assert 5 <= results["episodes"] == lines.read_bytes().count(b"\n") < results["wanted"] == 400
    assert "of 400 episodes so far" in (tmp_path / "report.html").read_text()


def test_sequences_are_measured_and_verified() -> None:
    done = bipre("bench", "sequence", "--categories", "Bottle", "--seeds", "1", "--json")
    assert done.returncode == 0, done.stderr
    (row,) = answer(done)["rows"]
    assert (row["category"], row["episodes"], row["planned"], row["verified"]) == ("Bottle", 1, 1, 1)
    assert row["plan_seconds_median"] == row["plan_seconds_p95"] > 0.0
    assert row["makespan_median"] > 5.0
    assert row["min_clearance"] > 0.0


def test_help_names_the_other_forms() -> None:
    said = bipre("bench", "--help").stderr
    assert "bipre bench sequence ..." in said
    assert "usage: bipre bench sequence" in bipre("bench", "sequence", "--help").stderr


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("sequnce",), 'No bench verb "sequnce". Did you mean "sequence"? Verbs: '),
        (("--methods", "heuristc"), 'No method "heuristc". Did you mean "heuristic"?'),
        (("--categories", "Botle"), 'No category "Botle". Did you mean "Bottle"?'),
        (("--categories", ","), '"," names no category. Valid: all, handover, Bowl,'),
        (("--mode", "E4"), 'No mode "E4".'),
        (("--split", "sen"), 'No split "sen". Did you mean "seen"?'),
        (("--episodes", "0"), "--episodes 0: each column and split has 100 seeds; give 1 to 100."),
        (("--episodes", "101"), "--episodes 101: each column and split has 100 seeds; give 1 to 100."),
        (("--workers", "0"), "--workers 0: give 1 or more."),
        (("--timeout", "nan"), "--timeout nan is not a time; give seconds above 0."),
        (("--asset", "partnet:/no/such"), "No folder /no/such"),
        (("--out", "file"), "--out file is a file; give a folder."),
        (("sequence", "--seeds", "0"), "--seeds 0: give 1 or more."),
        (("sequence", "--categories", "Botle"), 'No category "Botle". Did you mean "Bottle"?'),
    ],
    ids=lambda value: " ".join(value)[:40] if isinstance(value, tuple) else "",
)
def test_a_wrong_argument_is_one_message(
    words: tuple[str, ...],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.chdir(tmp_path)
    assert main(["bench", *words]) == 2
    out, said = capsys.readouterr()
    assert (out, said.count("\n")) == ("", 1)
    assert said.startswith("error: ")
    assert message in said
    assert [entry.name for entry in tmp_path.iterdir()] == ["file"]


def test_modules_of_a_verb_are_its_other_forms() -> None:
    assert "sequence" in subverbs("bench")
    assert subverbs("bench")["sequence"]().Arguments.__name__ == "Arguments"
    assert subverbs("plan") == {}
