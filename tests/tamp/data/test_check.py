"""What is wrong with a data set is named, and damaged files are set aside."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robots.errors import BadRunFolder
from tamp.bench.seeds import benchmark_seeds
from tamp.data.check import QUARANTINE, examine
from tamp.data.replay import replay
from tamp.data.shards import Entry, read_shard, shard_paths, write_shard
from tamp.episode import Request
from tamp.record import Recorded
from tests.tamp.data.stubs import episode
from tests.tamp.data.test_collect import collected, holdings, wanted

pytest.importorskip("h5py", reason="the extra `data` is not installed")


def recorded(seed: int, **changes: Any) -> Recorded:
    return dataclasses.replace(episode(Request(category="Bottle", seed=seed, split="seen")), **changes)


def written(folder: Path, *episodes: Recorded) -> Path:
    entries = [Entry(f"Bottle-{number:06d}", one) for number, one in enumerate(episodes)]
    return write_shard(folder, 0, entries, "{}")


def problems(folder: Path) -> list[tuple[str, str, str]]:
    found = examine(folder)
    assert found.ok == (not found.problems)
    return [(problem.kind, problem.where, problem.detail) for problem in found.problems]


@pytest.fixture(scope="module")
def collection(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A collected data set. Do not change the folder."""
    folder = tmp_path_factory.mktemp("data")
    collected(folder, wanted(4, 3))
    return folder


@pytest.fixture
def data_set(collection: Path, tmp_path: Path) -> Path:
    """A copy of it that may be changed."""
    return Path(shutil.copytree(collection, tmp_path / "data"))


def test_a_good_data_set_is_counted(collection: Path) -> None:
    found = examine(collection)
    assert found.ok
    assert found.problems == []
    assert found.episodes == 14
    assert [(c.category, c.successes, c.failures) for c in found.columns] == [("Bottle", 4, 3), ("USB", 4, 3)]
    assert found.columns[0].outcomes == {"ok": 4, "ik": 3}
    assert found.columns[0].failing_stages == {"pregrasp": 3}
    assert found.columns[0].splits == {"seen": 7}
    assert found.columns[0].rejections == 14


@pytest.mark.parametrize("damage", ["cut", "flipped", "empty", "text"])
def test_a_damaged_shard_is_named_and_set_aside(damage: str, data_set: Path) -> None:
    (path,) = shard_paths(data_set)
    data = path.read_bytes()
    middle = len(data) // 2
    path.write_bytes(
        {
            "cut": data[:middle],
            "flipped": data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :],
            "empty": b"",
            "text": b"not a shard",
        }[damage]
    )
    found = examine(data_set)
    assert not found.ok
    ((kind, where, detail),) = [(p.kind, p.where, p.detail) for p in found.problems]
    assert (kind, where) == ("damaged", path.name)
    assert "its checksum is not the one in its name" in detail
    assert found.quarantined == [str(data_set / QUARANTINE / path.name)]
    assert shard_paths(data_set) == []


def test_what_was_set_aside_is_collected_again(data_set: Path) -> None:
    (path,) = shard_paths(data_set)
    path.write_bytes(path.read_bytes()[:-1])
    assert not examine(data_set).ok
    collected(data_set, wanted(4, 3))
    assert len(holdings(data_set)) == 14
    assert examine(data_set).ok
    assert shard_paths(data_set)[0].name.startswith("shard-00001-")


def test_an_unreadable_shard_stops_a_collection_with_one_message(data_set: Path) -> None:
    (path,) = shard_paths(data_set)
    path.write_bytes(b"not a shard")
    with pytest.raises(BadRunFolder, match=r"cannot be read as a shard: .*`bipre data .*` sets damaged shards aside"):
        collected(data_set, wanted(5, 4))


def test_doubles_are_found(tmp_path: Path) -> None:
    written(tmp_path, recorded(1), recorded(2), recorded(1))
    assert problems(tmp_path) == [("duplicate", "Bottle-000002", "it has the seed of Bottle-000000, 1")]
    write_shard(tmp_path, 1, [Entry("Bottle-000001", recorded(4))], "{}")
    assert [kind for kind, *_ in problems(tmp_path)] == ["duplicate", "duplicate"]


def test_an_object_in_both_splits_is_found_by_its_hash(tmp_path: Path) -> None:
    written(tmp_path, recorded(1, content_hash="same"), recorded(2, content_hash="same", split="unseen", instance="x"))
    ((kind, where, detail),) = problems(tmp_path)
    assert (kind, where) == ("leakage", "same")
    assert detail == "the object with this content hash is seen in Bottle-000000, unseen in Bottle-000001"


def test_a_benchmark_seed_among_training_data_is_found(tmp_path: Path) -> None:
    seed = benchmark_seeds("USB", "unseen")[3]
    written(tmp_path, recorded(1), recorded(seed))
    assert problems(tmp_path) == [("leakage", "Bottle-000001", f"its seed {seed} is one of the benchmark's")]


def test_impossible_values_are_found(tmp_path: Path) -> None:
    good = recorded(1)
    cloud = good.clouds["initial"]
    bad = [
        recorded(1, clouds={}),
        recorded(2, clouds={"initial": dataclasses.replace(cloud, points=cloud.points * np.nan)}),
        recorded(4, clouds={"initial": dataclasses.replace(cloud, link_names=("body",))}),
        recorded(5, link_poses={"final": {"body": 2.0 * np.eye(4)}}),
        recorded(7, actions=()),
    ]
    written(tmp_path, *bad)
    assert [detail for _, _, detail in problems(tmp_path)] == [
        "it has no initial cloud",
        "its initial cloud has values that are not finite",
        "its initial cloud has a link number 1 but 1 link names",
        "the pose of body at final is no rigid motion",
        "it succeeded without an action",
    ]


def test_a_shard_of_another_version_is_damaged_for_us(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from tamp.data import shards

    monkeypatch.setattr(shards, "VERSION", 3)
    path = written(tmp_path, recorded(1))
    monkeypatch.undo()
    with pytest.raises(BadRunFolder, match="is a bipremanip-data of version 3; version 2 is read"):
        list(read_shard(path))


def test_no_data_set_is_one_message(tmp_path: Path) -> None:
    with pytest.raises(BadRunFolder, match="does not exist"):
        examine(tmp_path / "absent")
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(BadRunFolder, match=r"has no shards .* it holds thesis\.tex\."):
        examine(tmp_path)


def changed_outcome(request: Request) -> Recorded:
    """Never the outcome that was stored."""
    one = episode(request)
    other = episode(Request(category=request.category, seed=3 if one.success else 4, split="seen"))
    return dataclasses.replace(other, seed=request.seed, content_hash=one.content_hash)


def changed_object(request: Request) -> Recorded:
    """The seed gives another object now."""
    return dataclasses.replace(episode(request), content_hash="other")


def test_a_replay_confirms_the_outcome_or_tells_the_difference(collection: Path) -> None:
    names = sorted(holdings(collection))
    for name in names:
        again = replay(collection, name, episode)
        assert again.same
        assert again.stored == again.now
    failed = next(name for name in names if holdings(collection)[name][1] == "ik")
    told = replay(collection, failed, changed_outcome)
    assert not told.same
    assert told.differences == [
        "outcome ik, now ok",
        "failure unreachable at pregrasp, now none",
        "the actions are others",
    ]
    with pytest.raises(BadRunFolder, match="the objects have changed since"):
        replay(collection, failed, changed_object)
    with pytest.raises(BadRunFolder, match=r'has no episode "Bottle-9"; it has .*, 14 in all\.'):
        replay(collection, "Bottle-9", episode)
