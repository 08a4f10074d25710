"""The affordance maps within plan.html: what can be chosen, what is drawn, and that nothing else is needed."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from affordance.maps import AffordanceMap, MapName, save_maps
from robots.spatial import pose
from robots.workcell import load_workcell
from tamp import plan as plan_file
from tamp.episode import Report
from tamp.view.html import write_html
from tamp.view.scene import CLOUD_SHOWN
from tamp.view.section import CHOICES, CLOUD_CHOICE, maps_section
from worlds import observe

TABLE = load_workcell("panda_pair").table
CLOUD = np.random.default_rng(3).uniform(-0.1, 0.1, (CLOUD_SHOWN + 500, 3))
COLOURS = np.tile([1.0, 0.5, 0.0], (len(CLOUD), 1))


def shown(name: MapName, count: int = 40) -> AffordanceMap:
    """A map with two hands above its points."""
    hands = (pose([0.0, 0.0, 0.2], [np.pi, 0.0, 0.0]), pose([0.5, 0.0, 0.2], [np.pi, 0.0, 0.0]))
    return AffordanceMap(name, CLOUD[:count], np.linspace(0.2, 0.7, count), hands, (0.9, float("-inf")))


def data(section: str) -> dict[str, Any]:
    """What the script reads; strict, since a browser reads no infinity."""
    found = re.search(r'id="bipre-maps-data">(.*?)</script>', section, re.DOTALL)
    assert found is not None

    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is no JSON")

    told: dict[str, Any] = json.loads(found.group(1), parse_constant=refuse)
    return told


def test_there_is_a_choice_for_the_cloud_and_for_each_map_that_exists() -> None:
    section = maps_section([shown("goal_before"), shown("goal_after")], CLOUD, COLOURS, TABLE)
    options = re.findall(r"<option [^>]*>(.*?)</option>", section)
    assert options == [CLOUD_CHOICE, CHOICES["goal_before"], CHOICES["goal_after"]]
    cloud, *maps = data(section)["views"]
    assert "scores" not in cloud and cloud["colours"][0] == [255, 128, 0]
    assert len(cloud["points"]) == len(cloud["colours"]) == CLOUD_SHOWN
    assert len(maps) == 2
    assert maps_section([], CLOUD, COLOURS, TABLE) == ""


def test_points_scores_and_hands_are_those_of_the_map() -> None:
    one = shown("pre")
    view = data(maps_section([one], CLOUD, COLOURS, TABLE))["views"][1]
    assert np.allclose(view["points"], one.points, atol=6e-5)
    assert np.allclose(view["scores"], one.scores, atol=6e-5)
    assert (view["least"], view["most"]) == (0.2, 0.7)
    assert [hand["score"] for hand in view["hands"]] == ["0.90", "-inf"]
    for hand, T in zip(view["hands"], one.hands, strict=True):
        line = np.array(hand["line"])
        assert np.allclose(line[:, 0], T.translation[0], atol=6e-5)
        assert (line[[0, 3], 2] < line[[1, 2], 2]).all(), "the fingers point down"
        assert np.linalg.norm(line[1] - line[2]) == pytest.approx(0.08, abs=1e-3)


def test_everything_of_a_view_lies_within_its_sphere() -> None:
    for view in data(maps_section([shown("pre")], CLOUD, COLOURS, TABLE))["views"]:
        spots = np.concatenate([view["points"], *(hand["line"] for hand in view["hands"])])
        assert np.linalg.norm(spots - np.array(view["centre"]), axis=1).max() == pytest.approx(view["radius"], abs=2e-4)


def test_the_table_is_drawn_where_it_is() -> None:
    corners = np.array(data(maps_section([shown("pre")], CLOUD, COLOURS, TABLE))["table"])
    assert corners[:, :2].mean(axis=0) == pytest.approx(TABLE.centre)
    assert np.ptp(corners, axis=0) == pytest.approx([*TABLE.size, 0.0])


def test_the_script_finds_every_element_that_it_asks_for() -> None:
    section = maps_section([shown("pre")], CLOUD, COLOURS, TABLE)
    asked = set(re.findall(r'part\("(\w+)"\)', section))
    assert asked >= {"canvas", "select", "stretch", "legend", "hands"}
    assert all(section.count(f'id="bipre-maps-{name}"') == 1 for name in asked)


def test_the_page_has_the_maps_of_its_folder_and_needs_no_network(
    dispenser: tuple[Report, Path], tmp_path: Path
) -> None:
    assert "bipre-maps" not in (dispenser[1] / "plan.html").read_text("utf-8")
    seen = observe.load(dispenser[1])
    save_maps((shown("goal_before"), shown("pre"), shown("goal_after")), tmp_path)
    page = write_html(plan_file.load(dispenser[1]), seen.cloud, seen.colours, tmp_path, None).read_text("utf-8")
    section = page.split('<section id="bipre-maps">')[1]
    assert all(f">{title}</option>" in section for title in (CLOUD_CHOICE, *CHOICES.values()))
    assert not re.search(r"(src|href)=|https?:|@import|fetch\(", section)
    assert page.rstrip().endswith("</html>")
