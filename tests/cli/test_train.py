"""``bipre train`` from the command line: what it says, writes, and refuses."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.test_cli import bipre

pytest.importorskip("torch", reason="torch is not installed")
pytest.importorskip("h5py", reason="the extra `data` is not installed")

STORED = str(Path(__file__).parents[1] / "data" / "episodes")
SMALL = ("train", "--data", STORED, "--profile", "test", "--batch", "2", "--threads", "1")


def test_it_trains_goes_on_and_refuses_other_settings(tmp_path: Path) -> None:
    out = tmp_path / "new"
    first = bipre(*SMALL, "--out", str(out), "--steps", "2", "--json")
    assert first.returncode == 0, first.stderr
    told = json.loads(first.stdout)
    assert told["steps"] == 2 and Path(told["weights"]).is_file()
    assert {path.name for path in out.iterdir()} >= {
        "checkpoint.safetensors",
        "log.jsonl",
        "curves.png",
        "settings.json",
    }
    again = bipre(*SMALL, "--out", str(out), "--steps", "3", "--json")
    assert json.loads(again.stdout)["steps"] == 3
    other = bipre(*SMALL, "--out", str(out), "--steps", "3", "--no-anticipation")
    assert other.returncode == 2
    assert "was begun with --no-anticipation False, not True" in other.stderr


def test_weights_to_begin_with_decide_what_is_built(tmp_path: Path) -> None:
    out = tmp_path / "first"
    assert bipre(*SMALL, "--out", str(out), "--steps", "1").returncode == 0
    weights = str(out / "weights.safetensors")
    refused = bipre("train", "--data", STORED, "--out", str(tmp_path / "on"), "--start", weights, "--profile", "cpu")
    assert refused.returncode == 2
    assert "was trained with another --profile than asked for" in refused.stderr
    assert "Traceback" not in refused.stderr
    assert not (tmp_path / "on").exists()


def test_a_dry_run_writes_nothing(tmp_path: Path) -> None:
    done = bipre(*SMALL, "--out", str(tmp_path / "no"), "--dry-run", "--json")
    told = json.loads(done.stdout)
    assert told["parameters"] > 3e6 and told["seconds_per_step"] > 0.0
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--data", "nowhere", "--out", "x"), "There is no data set nowhere."),
        (("--data", STORED, "--out", "x", "--profile", "huge"), 'No network profile "huge".'),
        (("--data", STORED, "--out", "x", "--preset", "sxi"), 'No loss preset "sxi". Did you mean "sxy"?'),
        (("--data", STORED, "--out", "x", "--steps", "0"), "--steps 0: give 1 or more."),
        (("--data", STORED, "--out", "x", "--steps", "5", "--epochs", "2"), "--steps and --epochs both say how long"),
        (("--data", STORED, "--out", "x", "--epochs", "nan"), "--epochs nan: give a number above 0."),
        (
            ("--data", STORED, "--out", "x", "--adapt", "none.safetensors"),
            "--adapt none.safetensors: there is no such file.",
        ),
        (("--data", STORED, "--out", "x", "--start", "none.safetensors"), "--start none.safetensors: there is no such"),
        (("--data", STORED, "--out", "x", "--rate", "0"), "--rate 0.0: give a number above 0."),
        (("--data", STORED, "--out", STORED + "/settings.json", "--steps", "1"), "is a file; give a folder."),
    ],
)
def test_wrong_words_are_one_message(words: tuple[str, ...], message: str) -> None:
    done = bipre("train", *words)
    assert done.returncode == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr
