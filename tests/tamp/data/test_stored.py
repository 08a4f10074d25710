"""The data set in ``tests/data/episodes``, made by ``bipre collect``: real episodes of every task type.

Made by ``bipre collect --categories Bottle,Cap,Plate,Handover-Bottle --successes 2 --failures 1 --max-attempts 9
--workers 1``; whatever reads data sets is tested on it, without playing episodes.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from tamp.data.check import examine
from tamp.data.shards import Entry, read_shard, shard_paths
from tamp.record import MOMENTS, Recorded, outcome_of
from tamp.recording import MOST_POINTS
from worlds.tasks import TASK_TYPES, task_of

pytest.importorskip("h5py", reason="the extra `data` is not installed")

STORED = Path(__file__).parents[2] / "data" / "episodes"
MOST_BYTES = 3_000_000


@pytest.fixture(scope="module")
def entries() -> list[Entry]:
    return [entry for path in shard_paths(STORED) for entry in read_shard(path)]


@pytest.fixture(scope="module")
def episodes(entries: list[Entry]) -> list[Recorded]:
    return [entry.recorded for entry in entries]


def test_nothing_is_wrong_with_it(tmp_path: Path) -> None:
    found = examine(Path(shutil.copytree(STORED, tmp_path / "copy")))
    assert found.problems == []
    assert found.ok
    assert {task_of(column.category).type for column in found.columns} == set(TASK_TYPES)
    assert all(column.successes == 2 for column in found.columns)
    assert sum(column.failures for column in found.columns) >= 2


def test_it_is_small() -> None:
    assert sum(path.stat().st_size for path in STORED.rglob("*") if path.is_file()) <= MOST_BYTES


def test_what_happened_is_told_the_same_way_everywhere(episodes: list[Recorded]) -> None:
    for one in episodes:
        assert one.outcome == outcome_of(one.failure)
        assert (one.task_type, one.instruction) == (task_of(one.category).type, task_of(one.category).instruction)
        assert set(one.clouds) <= set(one.link_poses) <= set(MOMENTS)
        assert ("final" in one.link_poses) == bool(one.actions)
        if one.success:
            assert {"initial", "prepared"} <= set(one.clouds)


def test_roles_are_played_by_different_arms(episodes: list[Recorded]) -> None:
    for one in episodes:
        arms = {role: {a.arm for a in one.actions if a.role == role} for role in ("assistant", "primary")}
        assert all(len(played) <= 1 for played in arms.values())
        assert not arms["assistant"] & arms["primary"]


def test_actions_are_rigid_poses_with_unit_directions(episodes: list[Recorded]) -> None:
    for action in (action for one in episodes for action in one.actions):
        R, length = action.T_world_hand[:3, :3], np.linalg.norm(action.direction)
        assert np.allclose(R.T @ R, np.eye(3), atol=1e-6)
        moves = action.amount > 0.0 or action.stage == "receive"
        assert np.isclose(length, 1.0) if moves else length == 0.0
        assert 0.0 <= action.opening <= 0.0401


def test_contacts_are_near_the_object_that_was_seen(episodes: list[Recorded]) -> None:
    for one in episodes:
        start = one.clouds["initial"].points
        for action in one.actions[:1]:
            assert np.linalg.norm(start - action.contact, axis=1).min() < 0.04


def test_clouds_are_bounded_labelled_and_on_the_objects_links(episodes: list[Recorded]) -> None:
    for one in episodes:
        for moment, cloud in one.clouds.items():
            assert 0 < len(cloud.points) <= MOST_POINTS
            assert np.allclose(np.linalg.norm(cloud.normals, axis=1), 1.0, atol=1e-5)
            assert set(cloud.link_names) - {"-"} <= set(one.link_poses[moment])


def test_the_object_is_higher_when_it_is_lifted(episodes: list[Recorded]) -> None:
    for one in episodes:
        if one.success:
            poses = one.link_poses
            assert poses["final"]["body"][2, 3] > poses["initial"]["body"][2, 3] + 0.05
