"""``bipre collect`` and ``bipre data`` as scripts meet them."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tamp.cli import main
from tests.cli.test_cli import REPOSITORY, answer, bipre, refused

COLLECT = ("collect", "--categories", "Bottle", "--successes", "2", "--failures", "1", "--workers", "1")


def stubbed(*words: str) -> subprocess.CompletedProcess[str]:
    """The command with episodes that take milliseconds."""
    script = (
        "import sys\nimport tamp.recording\nfrom tests.tamp.data.stubs import episode\n"
        "tamp.recording.record_episode = episode\nfrom tamp.cli import main\n"
        f"sys.exit(main({list(words)!r}))\n"
    )
    return subprocess.run(
        [sys.executable, "-c", script], cwd=REPOSITORY, capture_output=True, text=True, timeout=120, check=False
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A collected data set. Do not change it."""
    pytest.importorskip("h5py", reason="the extra `data` is not installed")
    out = tmp_path_factory.mktemp("data") / "set"
    done = stubbed(*COLLECT, "--out", str(out), "--json")
    assert done.returncode == 0, done.stderr
    told = answer(done)
    assert told["complete"] is True
    (column,) = told["columns"]
    assert (column["category"], column["successes"], column["failures"]) == ("Bottle", 2, 1)
    assert told["episodes"] == 3
    assert told["tried"] == column["attempts"] >= 3
    return out


def test_a_finished_collection_has_nothing_to_do(folder: Path) -> None:
    done = stubbed(*COLLECT, "--out", str(folder), "--json")
    assert done.returncode == 0
    assert answer(done)["tried"] == 0
    assert "3 of 3 episodes are there already" in done.stderr


def test_data_counts_and_finds_nothing_wrong(folder: Path) -> None:
    done = bipre("data", str(folder), "--json")
    assert done.returncode == 0, done.stderr
    told = answer(done)
    assert told["ok"] is True
    assert told["episodes"] == 3
    assert told["columns"][0]["outcomes"] == {"ok": 2, "ik": 1}
    assert "ok  3 episodes in 1 shards" in done.stderr


def test_data_of_a_damaged_set_is_exit_1_and_names_the_shard(folder: Path, tmp_path: Path) -> None:
    (shard,) = folder.glob("*.h5")
    (tmp_path / shard.name).write_bytes(shard.read_bytes()[:-100])
    done = bipre("data", str(tmp_path), "--json")
    assert done.returncode == 1
    assert answer(done)["problems"][0]["where"] == shard.name
    assert f"damaged {shard.name}" in done.stderr
    assert (tmp_path / "quarantine" / shard.name).is_file()


def test_a_replay_confirms_an_episode(folder: Path) -> None:
    done = stubbed("data", str(folder), "--replay", "Bottle-000000", "--json")
    assert done.returncode == 0, done.stderr
    told = answer(done)
    assert told["same"] is True
    assert told["stored"] == told["now"]
    assert 'has no episode "Bottle-999999"' in refused("data", str(folder), "--replay", "Bottle-999999")


def test_unmet_targets_are_exit_1_and_told(tmp_path: Path) -> None:
    pytest.importorskip("h5py", reason="the extra `data` is not installed")
    done = stubbed(*COLLECT[:-2], "--workers", "1", "--max-attempts", "1", "--out", str(tmp_path), "--json")
    assert done.returncode == 1
    assert answer(done)["complete"] is False
    assert "Bottle falls short: --max-attempts, 1 tried" in done.stderr


@pytest.mark.parametrize("words", [(*COLLECT, "--out", "x"), ("data", ".")])
def test_without_h5py_the_pip_line_is_told(words: tuple[str, ...], tmp_path: Path) -> None:
    script = f"import sys\nsys.modules['h5py'] = None\nfrom tamp.cli import main\nsys.exit(main({list(words)!r}))\n"
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=REPOSITORY, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 2
    assert (
        'needs the package h5py, which is not installed. Install it with: pip install "bipremanip[data]"' in done.stderr
    )
    assert not (REPOSITORY / "x").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("collect",), "--categories"),
        ((*COLLECT, "--out", "x", "--successes", "-1"), "--successes -1 is negative; give 0 or more."),
        ((*COLLECT, "--out", "x", "--successes", "0", "--failures", "0"), "nothing is wanted"),
        ((*COLLECT, "--out", "x", "--max-attempts", "0"), "--max-attempts 0: give 1 or more."),
        ((*COLLECT, "--out", "x", "--workers", "-2"), "--workers -2: give 1 or more."),
        ((*COLLECT, "--out", "x", "--categories", "Botle"), 'No category "Botle". Did you mean "Bottle"?'),
        ((*COLLECT, "--out", "x", "--timeout", "-1"), "--timeout -1.0 is not a time; give seconds above 0."),
        ((*COLLECT, "--out", "x", "--seed", "-1"), "--seed -1 is negative; give 0 or more."),
        ((*COLLECT, "--out", "x", "--proposer", "psychic"), 'No proposer "psychic".'),
        (("data",), "DIR"),
        (("data", "/no/such"), "Data set /no/such does not exist."),
        (("data", "."), "has no shards (shard-NUMBER-CHECKSUM.h5); it holds nothing."),
    ],
    ids=lambda value: " ".join(value)[-40:] if isinstance(value, tuple) else "",
)
def test_a_wrong_argument_is_one_message(
    words: tuple[str, ...],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    pytest.importorskip("h5py", reason="the extra `data` is not installed")
    monkeypatch.chdir(tmp_path)
    assert main(list(words)) == 2
    out, said = capsys.readouterr()
    assert (out, said.count("\n")) == ("", 1)
    assert said.startswith("error: ")
    assert message in said
    assert list(tmp_path.iterdir()) == []


def test_the_collected_settings_are_on_disk(folder: Path) -> None:
    settings = json.loads((folder / "settings.json").read_text())
    assert settings == {"asset": "synthetic", "split": "seen", "proposer": "heuristic", "seed": 0, "timeout": 60.0}
