"""A data set holds what its settings and targets say, whatever happens while it is collected."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robots.errors import BadRunFolder
from tamp.bench.seeds import every_benchmark_seed
from tamp.data import collect as collecting
from tamp.data.attempts import EpisodeOf, Settings, attempt
from tamp.data.check import examine
from tamp.data.collect import PROGRESS_FILE, Column, Targets, collect
from tamp.data.pending import FOLDER as PENDING
from tamp.data.shards import Entry, read_shard, shard_paths
from tests.tamp.data.stubs import broken_episode, episode, slow_episode

pytest.importorskip("h5py", reason="the extra `data` is not installed")

SETTINGS = Settings(asset="synthetic", split="seen", proposer="heuristic", seed=7, timeout=60.0)


class Seen:
    """A watch that looks away."""

    def begin(self, columns: list[Column], targets: Targets) -> None:
        """Ignore it."""

    def ended(self, column: Column, seconds: float) -> None:
        """Ignore it."""


def wanted(
    successes: int = 9, failures: int = 6, limit: int = 200, categories: tuple[str, ...] = ("Bottle", "USB")
) -> Targets:
    return Targets(categories=list(categories), successes=successes, failures=failures, max_attempts=limit)


def collected(folder: Path, targets: Targets, workers: int = 2, play: EpisodeOf = episode) -> list[Column]:
    return collect(SETTINGS, targets, folder, workers=workers, watch=Seen(), episode=play)


def entries(folder: Path) -> list[Entry]:
    return [entry for path in shard_paths(folder) for entry in read_shard(path)]


def holdings(folder: Path) -> dict[str, tuple[int, str]]:
    """Seed and outcome by name; fails when a name is there twice."""
    found = entries(folder)
    assert len({entry.name for entry in found}) == len(found)
    return {entry.name: (entry.recorded.seed, entry.recorded.outcome) for entry in found}


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[int, str]]:
    """What an undisturbed collection with one worker holds."""
    folder = tmp_path_factory.mktemp("reference")
    assert all(column.met(wanted()) for column in collected(folder, wanted(), workers=1))
    return holdings(folder)


def test_the_targets_are_met_exactly(reference: dict[str, tuple[int, str]]) -> None:
    for category in ("Bottle", "USB"):
        outcomes = [outcome for name, (_, outcome) in reference.items() if name.startswith(category)]
        assert (outcomes.count("ok"), outcomes.count("ik")) == (9, 6)


def test_an_attempts_seed_follows_from_its_number_alone_and_is_no_test_seed(
    reference: dict[str, tuple[int, str]],
) -> None:
    for name, (seed, _) in reference.items():
        category, _, number = name.rpartition("-")
        assert attempt(SETTINGS, category, int(number)).seed == seed
        assert seed not in every_benchmark_seed()
    assert attempt(SETTINGS, "Bottle", 3).seed != attempt(SETTINGS, "USB", 3).seed


def test_more_workers_collect_the_same(reference: dict[str, tuple[int, str]], tmp_path: Path) -> None:
    collected(tmp_path, wanted(), workers=3, play=slow_episode)
    assert holdings(tmp_path) == reference


def test_kills_lose_and_double_nothing(reference: dict[str, tuple[int, str]], tmp_path: Path) -> None:
    """Killed twice, in different places; small shards so that some are written in between."""
    script = (
        "from pathlib import Path\nfrom tamp.data import collect as collecting\n"
        "from tests.tamp.data import test_collect as t\ncollecting.PER_SHARD = 3\n"
        f"t.collected(Path({str(tmp_path)!r}), t.wanted(), play=t.slow_episode)\n"
    )
    for shards in (1, 4):
        with subprocess.Popen([sys.executable, "-c", script]) as process:
            while not tmp_path.is_dir() or len(shard_paths(tmp_path)) < shards:
                assert process.poll() is None
                time.sleep(0.005)
            time.sleep(0.03)
            process.send_signal(signal.SIGKILL)
    assert len(holdings(tmp_path)) < len(reference)
    collected(tmp_path, wanted())
    assert holdings(tmp_path) == reference
    collected(tmp_path, wanted(), play=broken_episode)  # nothing is left to do
    assert holdings(tmp_path) == reference


def test_kills_faster_than_a_shard_make_progress(reference: dict[str, tuple[int, str]], tmp_path: Path) -> None:
    """Every call is killed after some episodes; none of them reaches a shard, and each goes on where the last ended."""
    script = (
        "import os, signal\nfrom pathlib import Path\nfrom tests.tamp.data import test_collect as t\n"
        "class Deadly(t.Seen):\n"
        "    left = 4\n"
        "    def ended(self, column, seconds):\n"
        "        self.left -= 1\n"
        "        if not self.left:\n"
        "            os.kill(os.getpid(), signal.SIGKILL)\n"
        f"t.collect(t.SETTINGS, t.wanted(), Path({str(tmp_path)!r}), workers=2, watch=Deadly(),"
        " episode=t.slow_episode)\n"
    )
    waiting = []
    for _ in range(4):
        assert subprocess.run([sys.executable, "-c", script], check=False).returncode == -signal.SIGKILL
        waiting.append(len(list((tmp_path / PENDING).iterdir())))
        found = examine(tmp_path)
        assert (found.ok, found.episodes, found.pending) == (True, 0, waiting[-1])
    assert waiting == [4, 8, 12, 16]
    assert not shard_paths(tmp_path)
    collected(tmp_path, wanted())
    assert holdings(tmp_path) == reference
    assert not list((tmp_path / PENDING).iterdir())


def test_a_damaged_pending_episode_is_named(tmp_path: Path) -> None:
    collected(tmp_path, wanted(1, 1))
    path = tmp_path / PENDING / "shard-00000-0123456789ab.h5"
    path.write_bytes(b"no shard")
    with pytest.raises(BadRunFolder, match="Remove it; its episode is played again"):
        collected(tmp_path, wanted())
    found = examine(tmp_path)
    assert [(problem.kind, problem.where) for problem in found.problems] == [("damaged", path.name)]
    assert (found.episodes, found.pending) == (4, 0)
    collected(tmp_path, wanted(2, 1))


def test_an_interruption_writes_what_is_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Impatient(Seen):
        def ended(self, column: Column, seconds: float) -> None:
            if column.attempts == 4:
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        collect(SETTINGS, wanted(), tmp_path, workers=1, watch=Impatient(), episode=episode)
    assert len(holdings(tmp_path)) >= 4


def test_larger_targets_and_further_columns_add_to_what_is_there(tmp_path: Path) -> None:
    collected(tmp_path, wanted(3, 2, categories=("Bottle",)))
    before = holdings(tmp_path)
    columns = collected(tmp_path, wanted(5, 4, categories=("USB", "Bottle")))
    assert [(c.category, c.successes, c.failures) for c in columns] == [("USB", 5, 4), ("Bottle", 5, 4)]
    assert before.items() <= holdings(tmp_path).items()
    assert len(holdings(tmp_path)) == 18


def test_other_settings_are_refused(tmp_path: Path) -> None:
    collected(tmp_path, wanted(1, 1))
    other = Settings(asset="synthetic", split="seen", proposer="heuristic", seed=8, timeout=60.0)
    with pytest.raises(BadRunFolder, match="was begun with --seed 7, not 8"):
        collect(other, wanted(2, 2), tmp_path, workers=1, watch=Seen(), episode=episode)


def test_attempts_are_limited_and_the_shortfall_is_told(tmp_path: Path) -> None:
    (column,) = collected(tmp_path, wanted(100, 100, limit=10, categories=("Bottle",)))
    assert column.attempts == 10
    assert column.successes + column.failures == 10
    assert not column.met(wanted(100, 100))
    (again,) = collected(tmp_path, wanted(100, 100, limit=10, categories=("Bottle",)), play=broken_episode)
    assert (again.attempts, again.faults) == (10, [])


def test_a_column_that_only_raises_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(collecting, "FAULT_STREAK", 4)
    (column,) = collected(tmp_path, wanted(categories=("Bottle",)), workers=1, play=broken_episode)
    assert column.attempts == 4
    assert [fault.number for fault in column.faults] == [0, 1, 2, 3]
    assert column.faults[0].detail == f"RuntimeError: no luck with {attempt(SETTINGS, 'Bottle', 0).seed}"
    assert json.loads((tmp_path / PROGRESS_FILE).read_text())["Bottle"]["attempts"] == 4


def test_a_shard_gives_back_what_was_recorded(tmp_path: Path) -> None:
    from tamp.episode import Request

    collected(tmp_path, wanted(2, 2, categories=("Bottle",)))
    for entry in entries(tmp_path):
        now = entry.recorded
        was = episode(Request(category="Bottle", seed=now.seed, split="seen"))
        for name in ("instance", "content_hash", "task_type", "instruction", "success", "failure", "versions"):
            assert getattr(now, name) == getattr(was, name)
        assert now.rejections == was.rejections
        assert list(now.clouds) == list(was.clouds)
        for moment, cloud in was.clouds.items():
            _same(now.clouds[moment], cloud, ("points", "normals", "links"))
            assert now.clouds[moment].link_names == cloud.link_names
        for moment, poses in was.link_poses.items():
            assert {link: T.tolist() for link, T in now.link_poses[moment].items()} == {
                link: T.tolist() for link, T in poses.items()
            }
        assert len(now.actions) == len(was.actions)
        for a, b in zip(now.actions, was.actions, strict=True):
            _same(a, b, ("T_world_hand", "contact", "direction", "amount", "opening", "score", "stage", "arm", "role"))


def _same(a: Any, b: Any, names: tuple[str, ...]) -> None:
    for name in names:
        assert np.array_equal(getattr(a, name), getattr(b, name)), name


def test_the_layout_is_the_documented_one(tmp_path: Path) -> None:
    """What a reader that knows only the documentation finds."""
    import h5py

    collected(tmp_path, wanted(2, 1, categories=("Bottle",)))
    (path,) = shard_paths(tmp_path)
    with h5py.File(path) as file:
        assert file.attrs["format"] == "bipremanip-data"
        assert json.loads(file.attrs["settings"])["seed"] == 7
        group = next(file[name] for name in file if file[name].attrs["success"])
        n = len(group["clouds/initial/points"])
        assert group["clouds/initial/points"].dtype == np.float32
        assert group["clouds/initial/normals"].shape == (n, 3)
        assert group["clouds/initial/links"].dtype == np.uint8
        assert list(group["clouds/initial"].attrs["link_names"]) == ["body", "lid"]
        assert group["poses/prepared"].shape == (2, 4, 4)
        assert group["actions/T_world_hand"].shape == (2, 4, 4)
        assert group["rejections/checks"][()].tolist() == [[0, -1, -1, -1, -1], [1, 0, -1, -1, -1]]
        assert np.isnan(group["rejections/T_world_hand"][0]).all()
        assert np.array_equal(group["rejections/T_world_hand"][1], np.eye(4))
