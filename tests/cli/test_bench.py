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
from tests.cli.test_cli import REPOSITORY, answer, bipre, refused

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
    done = bipre(
        "plan", "Bottle", "--split", "seen", "--seed", str(row["seed"]), "--json", "--out", str(tmp_path / "run")
    )
    report = answer(done)
    assert (report["status"], report["instance"]) == (row["status"], row["instance"])
    assert [f"{stage['name']}({stage['arm']})" for stage in report["stages"]] == row["stages"]


def test_other_settings_for_the_folder_are_one_message(folder: Path) -> None:
    words = [*SMALL, "--out", str(folder), "--timeout", "30"]
    assert "was begun with --timeout 60.0, not 30.0; a run keeps its settings" in refused("bench", *words)


def test_an_exception_in_an_episode_is_counted_named_and_exit_1(tmp_path: Path) -> None:
    """Assets that are gone once the run begins make every episode raise."""
    script = (
        "import sys\nimport tamp.bench.run\n"
        "from tests.cli.raising import raising\n"
        "tamp.bench.run.play = raising\n"
        "from tamp.cli import main\n"
        f"sys.exit(main(['bench', *{SMALL!r}, '--json', '--out', {str(tmp_path)!r}]))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=REPOSITORY, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 1, done.stderr
    told = answer(done)
    assert [fault["reason"] for fault in told["faults"]] == ["error", "error"]
    assert told["rows"][0]["failures"] == {"error": 2}
    seed = benchmark_seeds("Bottle", "seen")[0]
    assert f"error heuristic-E2-Bottle-seen-{seed}: RuntimeError: out of luck" in done.stderr
    assert "Traceback" not in done.stderr


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
def test_a_wrong_argument_is_one_message(words: tuple[str, ...], message: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert message in refused("bench", *words, cwd=tmp_path)
    assert [entry.name for entry in tmp_path.iterdir()] == ["file"]
