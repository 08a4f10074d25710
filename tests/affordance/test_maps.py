"""Affordance maps come back from a run folder as they were, or say that they cannot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from affordance.maps import MAPS_FILE, AffordanceMap, ShowsMaps, load_maps, save_maps
from affordance.uniform import UniformProposer
from robots.errors import BadRunFolder
from robots.spatial import pose
from robots.workcell import load_workcell


def maps() -> tuple[AffordanceMap, ...]:
    rng = np.random.default_rng(0)
    hands = (pose([0.0, 0.0, 0.2], [np.pi, 0.0, 0.3]), pose([0.1, 0.0, 0.2]))
    return (
        AffordanceMap("goal_before", rng.normal(size=(30, 3)), rng.random(30), hands, (0.9, 0.4)),
        AffordanceMap("goal_after", rng.normal(size=(22, 3)), rng.random(22), (), ()),
    )


def test_maps_come_back_as_they_were(tmp_path: Path) -> None:
    save_maps(maps(), tmp_path)
    for kept, found in zip(maps(), load_maps(tmp_path), strict=True):
        assert (kept.name, kept.hand_scores) == (found.name, found.hand_scores)
        assert np.array_equal(kept.points, found.points) and np.array_equal(kept.scores, found.scores)
        pairs = zip(kept.hands, found.hands, strict=True)
        assert all(np.array_equal(a.homogeneous, b.homogeneous) for a, b in pairs)


def test_a_folder_without_maps_has_none_and_a_damaged_file_is_said(tmp_path: Path) -> None:
    assert load_maps(tmp_path) == ()
    data = save_maps(maps(), tmp_path).read_bytes()
    for broken in (b"", data[:200], b"not a zip"):
        (tmp_path / MAPS_FILE).write_bytes(broken)
        with pytest.raises(BadRunFolder, match=MAPS_FILE):
            load_maps(tmp_path)


def test_shapes_must_agree() -> None:
    with pytest.raises(ValueError, match=r"a map has \(n, 3\) points"):
        AffordanceMap("pre", np.zeros((3, 3)), np.zeros(4), (), ())
    with pytest.raises(ValueError, match="1 for 0"):
        AffordanceMap("pre", np.zeros((3, 3)), np.zeros(3), (), (0.5,))


def test_a_proposer_without_networks_shows_none() -> None:
    assert not isinstance(UniformProposer("edge_push", load_workcell("panda_pair").arm("left").gripper), ShowsMaps)
