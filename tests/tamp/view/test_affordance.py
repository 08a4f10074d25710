"""The picture of affordance maps: what is drawn where, and which names are refused."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest

from affordance.maps import AffordanceMap, save_maps
from robots.errors import BadInput
from robots.spatial import pose
from tamp.folder import prepared
from tamp.view.affordance import SIZE, affordance_png, colour, require_affordance_png, spread, write_affordance_png

Image = pytest.importorskip("PIL.Image", reason="the extra `video` is not installed")


def bar(name: str, scores: np.ndarray) -> AffordanceMap:
    """A row of points, one hand above its middle."""
    spots = np.column_stack([np.linspace(-0.1, 0.1, len(scores)), np.zeros(len(scores)), np.zeros(len(scores))])
    return AffordanceMap(name, spots, scores, (pose([0.0, 0.0, 0.15], [np.pi, 0.0, 0.0]),), (0.8,))  # type: ignore[arg-type]


def test_colours_grow_lighter_with_the_score() -> None:
    light = [np.dot(colour(score), (0.2126, 0.7152, 0.0722)) for score in np.linspace(0.0, 1.0, 21)]
    assert (np.diff(light) > 0.0).all()
    assert colour(-1.0) == colour(0.0) and colour(2.0) == colour(1.0)


def test_a_flat_map_still_shows_its_order() -> None:
    assert spread(np.array([0.41, 0.40, 0.42])).tolist() == pytest.approx([0.5, 0.0, 1.0])
    assert spread(np.full(3, 0.4)).tolist() == [0.5, 0.5, 0.5]


def test_each_map_has_its_place_and_the_best_points_its_colour(tmp_path: Path) -> None:
    scores = np.linspace(0.0, 1.0, 60)
    maps = [bar("goal_before", scores), bar("pre", scores), bar("goal_after", scores)]
    path = write_affordance_png(maps, tmp_path / "maps.png")
    assert path.read_bytes() == affordance_png(maps)
    image = np.asarray(Image.open(io.BytesIO(path.read_bytes()))).astype(int)
    assert image.shape[1] == 3 * SIZE
    for k in range(3):
        panel = image[40:SIZE, k * SIZE : (k + 1) * SIZE]
        low, high = (np.argwhere(np.abs(panel - colour(share)).sum(axis=2) < 30)[:, 1] for share in (0.0, 1.0))
        assert len(low) and len(high) and low.mean() != pytest.approx(high.mean(), abs=50.0)


def test_names_that_cannot_be_written_are_refused(tmp_path: Path) -> None:
    (tmp_path / "folder.png").mkdir()
    for name, message in (
        ("maps.jpg", "is not a PNG file"), ("folder.png", "is a folder"), ("missing/maps.png", "there is no folder"),
    ):  # fmt: skip
        with pytest.raises(BadInput, match=message):
            require_affordance_png(tmp_path / name)
    require_affordance_png(tmp_path / "maps.png")


def test_a_place_where_nothing_can_be_written_is_one_message() -> None:
    with pytest.raises(BadInput, match=r"--affordance-png /proc/maps\.png cannot be written: "):
        write_affordance_png([], Path("/proc/maps.png"))


def test_a_run_folder_with_maps_is_used_again(tmp_path: Path) -> None:
    save_maps((bar("pre", np.linspace(0.0, 1.0, 5)),), tmp_path)
    assert list(prepared(tmp_path, "run").iterdir()) == []
