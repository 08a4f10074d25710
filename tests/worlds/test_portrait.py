"""Laws of a single asset's picture."""

from __future__ import annotations

import numpy as np
import pytest

from worlds.assets.library import load
from worlds.bullet.portrait import GROUND, portrait


@pytest.mark.parametrize(
    ("category", "instance"), [("Bottle", "bottle-000"), ("Pliers", "pliers-001"), ("Plate", "plate-003")]
)
def test_the_whole_asset_is_in_the_middle_of_the_picture(category: str, instance: str) -> None:
    picture = portrait(load("synthetic", category, instance), 160)
    assert picture.shape == (160, 160, 3)
    drawn = np.argwhere((picture != GROUND).any(axis=2))
    low, high = drawn.min(axis=0), drawn.max(axis=0)
    assert low.min() > 0
    assert high.max() < 159
    assert max(high - low) > 90
    assert np.abs((low + high) / 2 - 79.5).max() < 24


def test_every_link_shows_its_own_colour() -> None:
    picture = portrait(load("synthetic", "Bottle", "bottle-000"), 160)
    rows = np.argwhere((picture != GROUND).any(axis=2))[:, 0]
    lid, body = picture[rows.min() + 6, 80].astype(int), picture[rows.max() - 40, 80].astype(int)
    assert np.abs(lid - body).max() > 60


def test_the_same_asset_gives_the_same_picture() -> None:
    asset = load("synthetic", "Lighter", "lighter-003")
    assert np.array_equal(portrait(asset, 80), portrait(asset, 80))
