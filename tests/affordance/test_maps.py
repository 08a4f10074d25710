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
    turned = bytearray(data)
    turned[len(data) // 3] ^= 0xFF
    for broken in (b"", data[:200], b"not a zip", bytes(turned)):
        (tmp_path / MAPS_FILE).write_bytes(broken)
        with pytest.raises(BadRunFolder, match=MAPS_FILE):
            load_maps(tmp_path)


def test_shapes_must_agree() -> None:
    with pytest.raises(ValueError, match=r"a map has \(n, 3\) points"):
        AffordanceMap("pre", np.zeros((3, 3)), np.zeros(4), (), ())
    with pytest.raises(ValueError, match="1 for 0"):
        AffordanceMap("pre", np.zeros((3, 3)), np.zeros(3), (), (0.5,))


def test_any_flipped_byte_is_said_or_harmless(tmp_path: Path) -> None:
    """Damage reaches the archive, its compression and the headers of the arrays, each with errors of its own."""
    data = save_maps(maps(), tmp_path).read_bytes()
    said = 0
    for at in range(0, len(data), 23):
        turned = bytearray(data)
        turned[at] ^= 0xFF
        (tmp_path / MAPS_FILE).write_bytes(bytes(turned))
        try:
            load_maps(tmp_path)
        except BadRunFolder:
            said += 1
    assert said > 100


@pytest.mark.parametrize("hands", [np.zeros((1, 3, 3)), 2.0 * np.eye(4)[None]])
def test_a_hand_that_is_no_pose_is_said(hands: np.ndarray, tmp_path: Path) -> None:
    arrays = {"points": np.zeros((3, 3)), "scores": np.zeros(3), "hands": hands, "hand_scores": np.zeros(1)}
    np.savez(tmp_path / MAPS_FILE, allow_pickle=False, **{f"pre.{name}": values for name, values in arrays.items()})
    with pytest.raises(BadRunFolder, match="pose"):
        load_maps(tmp_path)


def test_values_must_be_scores_and_places() -> None:
    for scores in ([np.nan], [1.1], [-0.1]):
        with pytest.raises(ValueError, match="between 0 and 1"):
            AffordanceMap("pre", np.zeros((1, 3)), np.array(scores), (), ())
    with pytest.raises(ValueError, match="points of a map are finite"):
        AffordanceMap("pre", np.full((1, 3), np.inf), np.zeros(1), (), ())


def test_a_map_keeps_its_own_hands() -> None:
    hand = pose([0.0, 0.0, 0.2])
    kept = AffordanceMap("pre", np.zeros((1, 3)), np.zeros(1), (hand,), (0.5,))
    hand.translation = np.ones(3)
    assert kept.hands[0].translation.tolist() == [0.0, 0.0, 0.2]


def test_a_proposer_without_networks_shows_none() -> None:
    assert not isinstance(UniformProposer("edge_push", load_workcell("panda_pair").arm("left").gripper), ShowsMaps)
