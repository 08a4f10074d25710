"""Examples from the stored data set are what was planned, told where the object lay."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from affordance.examples import Example
from affordance.stations import STAGES, station, table_distance
from robots.errors import BadInput
from robots.spatial import pose
from robots.workcell import load_workcell
from tamp.data.shards import read_shard, shard_paths
from tamp.learning import examples_in, examples_of, kept_aside
from tamp.record import Recorded

pytest.importorskip("h5py", reason="the extra `data` is not installed")

STORED = Path(__file__).parents[1] / "data" / "episodes"
WORKCELL = load_workcell("panda_pair")


@pytest.fixture(scope="module")
def pairs() -> list[tuple[Recorded, Example]]:
    entries = [entry for path in shard_paths(STORED) for entry in read_shard(path)]
    return [(e.recorded, example) for e in entries for example in examples_of(e.name, e.recorded, WORKCELL)]


def test_every_task_type_gives_examples(pairs: list[tuple[Recorded, Example]]) -> None:
    learned, kept = examples_in([STORED])
    assert len(learned) + len(kept) == len(pairs)
    assert {e.task for e in (*learned, *kept)} == {"articulated", "edge_push", "plate_lift", "handover"}
    assert all(kept_aside(e.instance) for e in kept) and not any(kept_aside(e.instance) for e in learned)


def test_a_goal_carried_forth_again_is_what_was_planned(pairs: list[tuple[Recorded, Example]]) -> None:
    checked = 0
    for recorded, example in pairs:
        planned = next((a for a in recorded.actions if a.stage in ("operate", "grasp")), None)
        if planned is None or example.goal is None or sum(a.stage == "push" for a in recorded.actions) > 1:
            continue
        again = example.T_move @ example.goal.T_world_hand
        assert np.allclose(again, planned.T_world_hand, atol=1e-9)
        assert np.allclose(example.T_move[:3, :3] @ example.goal.outward, planned.outward, atol=1e-9)
        checked += 1
    assert checked >= 4


def test_a_success_has_a_goal_and_a_preparation(pairs: list[tuple[Recorded, Example]]) -> None:
    for recorded, example in pairs:
        if recorded.success:
            assert example.pre is not None
            assert example.prepared and example.success
        if not recorded.actions:
            assert example.goal is None and example.pre is None and not example.tried
        assert (example.surroundings.edge is not None) == (example.task == "edge_push")
        assert (example.surroundings.place is not None) == (example.task in ("articulated", "handover"))


def test_what_was_planned_is_judged_possible_and_what_was_refused_is_not(
    pairs: list[tuple[Recorded, Example]],
) -> None:
    for recorded, example in pairs:
        passed = [judged for judged in example.judged if (judged.labels == 1).all()]
        refused = [judged for judged in example.judged if (judged.labels == 0).any()]
        assert len(passed) + len(refused) == len(example.judged)
        assert bool(passed) == bool(recorded.actions)
        assert all(judged.station.shape == (25,) and np.isfinite(judged.station).all() for judged in example.judged)


def test_a_station_tells_stage_pose_and_height() -> None:
    placement = WORKCELL.placement("left")
    T_base = pose(placement.base_xyz, placement.base_rpy)
    told = station(WORKCELL, "left", T_base * pose([0.25, 0.0, 0.0]), "grasp")
    assert told[:6].tolist() == pytest.approx([0.0, 0.0, 1.0, 0.0, 1.0, 0.0])
    assert told[6:9].tolist() == pytest.approx([1.0, 0.0, 0.0])
    assert STAGES[int(told[9:17].argmax())] == "grasp"
    spots = np.array([[0.0, 0.0, 0.1], [0.0, 0.1, -0.02], [0.45, 0.1, -0.02]])
    assert table_distance(WORKCELL.table, spots).tolist() == pytest.approx([0.1, -0.02, 0.1])


@pytest.mark.parametrize("folder", ["missing", "empty"])
def test_a_folder_without_episodes_is_refused(folder: str, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(BadInput, match=folder):
        examples_in([tmp_path / folder])
