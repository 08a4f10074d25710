"""Laws that hold for every object source."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from robots.errors import BadInput, UnknownName
from robots.spatial import pose
from worlds.assets.asset import Asset, Rejected
from worlds.assets.library import choose, load, names, parse_source, survey
from worlds.bullet.client import Client, joint_numbers

PARTNET = Path(__file__).parents[3] / "shared/assets/objects/partnet_mobility"
SOURCES = (
    "synthetic",
    pytest.param(f"partnet:{PARTNET}", marks=pytest.mark.skipif(not PARTNET.is_dir(), reason=f"no folder {PARTNET}")),
)
CATEGORIES = ("Bottle", "Dispenser")


def check_simulates(client: Client, asset: Asset) -> None:
    """Masses, limits and 20 steps of free fall of one asset."""
    body = client.load_urdf(asset.urdf, pose((0.0, 0.0, 1.0)), fixed=False, flags=client.URDF_USE_INERTIA_FROM_FILE)
    joints, links = joint_numbers(client, body)
    assert set(joints) == set(asset.joints)
    assert asset.part.link in links
    masses = [client.getDynamicsInfo(body, link)[0] for link in range(-1, client.getNumJoints(body))]
    assert min(masses) > 0.0
    assert sum(masses) == pytest.approx(asset.mass)
    for name, joint in asset.joints.items():
        lower, upper = client.getJointInfo(body, joints[name])[8:10]
        assert lower > upper or lower - 1e-9 <= joint.start <= upper + 1e-9
        assert joint.friction > 0.0
        client.resetJointState(body, joints[name], joint.start)
    for _ in range(20):
        client.stepSimulation()
    states = [client.getJointState(body, number)[:2] for number in joints.values()]
    assert np.isfinite(states).all()
    assert np.isfinite(client.getBasePositionAndOrientation(body)[0]).all()
    client.removeBody(body)


def check_part(asset: Asset) -> None:
    part = asset.part
    assert np.linalg.norm(part.axis) == pytest.approx(1.0)
    assert part.start == asset.joints[part.joint].start
    assert 0.0 < part.threshold < part.travel
    assert part.sense in (1.0, -1.0)


@pytest.mark.slow
@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("category", CATEGORIES)
def test_every_asset_simulates(source: str, category: str) -> None:
    client = Client()
    for asset in survey(source, category):
        if isinstance(asset, Asset):
            check_part(asset)
            check_simulates(client, asset)
    client.close()


@pytest.mark.parametrize("category", CATEGORIES)
def test_a_chosen_asset_simulates(category: str) -> None:
    client = Client()
    for seed in range(3):
        asset = choose("synthetic", category, None, seed)
        check_part(asset)
        check_simulates(client, asset)
    client.close()


def test_choice_repeats_and_stays_in_the_split() -> None:
    first = [choose("synthetic", "Bottle", "unseen", seed).instance for seed in range(12)]
    assert first == [choose("synthetic", "Bottle", "unseen", seed).instance for seed in range(12)]
    assert set(first) <= set(names("synthetic", "Bottle", "unseen"))
    assert len(set(first)) > 5


def test_names_are_sorted_and_splits_cover_them() -> None:
    every = names("synthetic", "Dispenser")
    assert every == sorted(every)
    assert sorted(names("synthetic", "Dispenser", "seen") + names("synthetic", "Dispenser", "unseen")) == every


@pytest.mark.parametrize("source", ["", "partnet", "partnet:", "shapenet:/tmp"])
def test_unknown_source_lists_the_valid_ones(source: str) -> None:
    with pytest.raises(BadInput, match=rf'No object source "{source}"\. Valid: synthetic, synthetic:COUNT'):
        parse_source(source)


def test_further_instances_are_there_to_learn_from() -> None:
    few, more = names("synthetic", "Lighter"), names("synthetic:60", "Lighter")
    assert len(few) < 60 and more[: len(few)] == few and len(more) == 60
    assert names("synthetic:60", "Lighter", "unseen") == names("synthetic", "Lighter", "unseen")
    assert names("synthetic:1", "Lighter") == few
    assert load("synthetic:60", "Lighter", "lighter-059").split == "seen"
    assert load("synthetic:60", "Lighter", few[3]).content_hash == load("synthetic", "Lighter", few[3]).content_hash
    for source in ("synthetic", "synthetic:59"):
        with pytest.raises(UnknownName, match="lighter-059"):
            load(source, "Lighter", "lighter-059")


@pytest.mark.parametrize("count", ["", "0", "-3", "many", "1001", "2.5", "²", "9" * 5000])
def test_a_count_is_a_number_of_instances(count: str) -> None:
    with pytest.raises(BadInput, match="COUNT is a number from 1 to 1000"):
        parse_source(f"synthetic:{count}")


def test_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=rf"No folder {tmp_path}/absent for the object source partnet:{tmp_path}/absent"):
        parse_source(f"partnet:{tmp_path}/absent")


def test_folder_without_the_category_says_what_it_has(tmp_path: Path) -> None:
    (tmp_path / "Stapler").mkdir()
    with pytest.raises(BadInput, match=rf"The folder {tmp_path} has no Bottle; it has: Stapler\."):
        names(f"partnet:{tmp_path}", "Bottle")
    with pytest.raises(BadInput, match=r"has no Bottle; it has: no folders\."):
        names(f"partnet:{tmp_path}/Stapler", "Bottle")


def test_unknown_category_gets_a_suggestion() -> None:
    with pytest.raises(UnknownName, match=r'No category "Botle". Did you mean "Bottle"\? Valid: Bottle, Bowl, Cap, '):
        load("synthetic", "Botle", "bottle-000")


def test_no_usable_instance_gives_every_reason(tmp_path: Path) -> None:
    (tmp_path / "Bottle/77").mkdir(parents=True)
    source = f"partnet:{tmp_path}"
    [refusal] = survey(source, "Bottle")
    assert refusal == Rejected(source, "Bottle", "77", "its mobility.urdf is missing")
    with pytest.raises(BadInput, match=r"No usable Bottle in partnet:.*: 77: its mobility.urdf is missing\."):
        choose(source, "Bottle", None, seed=0)
    (tmp_path / "Bottle/77").rmdir()
    with pytest.raises(BadInput, match=r"No usable Bottle in partnet:.* \(seen\): there are none\."):
        choose(source, "Bottle", "seen", seed=0)
