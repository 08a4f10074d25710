"""Laws of the generated bottles and dispensers."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from robots.errors import UnknownName
from robots.spatial import pose
from worlds.assets.asset import Asset
from worlds.assets.library import load, names
from worlds.assets.solids import box, mass_properties, volume
from worlds.assets.synthetic.outline import PROFILES, container, cylinder, stack
from worlds.bullet.client import Client, joint_numbers

CATEGORIES = ("Bottle", "Dispenser")
SAMPLE = tuple((category, name) for category in CATEGORIES for name in names("synthetic", category)[::7])
EVERY = tuple((category, name) for category in CATEGORIES for name in names("synthetic", category))


def clearance(asset: Asset, steps: int = 10) -> float:
    """Least distance between the body and the moving part over its travel [m]."""
    client = Client()
    try:
        body = client.load_urdf(asset.urdf, pose((0.0, 0.0, 0.0)), fixed=True)
        joints, links = joint_numbers(client, body)
        link = links[asset.part.link]
        gaps = []
        for share in np.linspace(0.0, 1.0, steps):
            position = asset.part.start + asset.part.sense * asset.part.travel * share
            client.resetJointState(body, joints[asset.part.joint], position)
            near = client.getClosestPoints(body, body, 0.05, linkIndexA=-1, linkIndexB=link)
            gaps += [contact[8] for contact in near]
        return float(min(gaps))
    finally:
        client.close()


PISTON = """<robot name="piston"><link name="base"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="tip"><inertial><mass value="0.2"/><inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/>
</inertial><collision><geometry><box size="0.012 0.012 0.02"/></geometry></collision></link>
<joint name="slide" type="prismatic"><parent link="base"/><child link="tip"/><axis xyz="0 0 -1"/>
<limit lower="-1" upper="1" effort="100" velocity="10"/></joint></robot>"""
PISTON_WEIGHT = 0.2 * 9.81


def pressed_by(asset: Asset, share: float, piston: Path) -> float:
    """Share of the travel after two seconds under ``share`` times the resistance, through contact alone."""
    piston.write_text(PISTON)
    part, friction = asset.part, asset.joints[asset.part.joint].friction
    client = Client()
    try:
        client.setGravity(0, 0, -9.81)
        client.setPhysicsEngineParameter(numSolverIterations=150)
        body = client.load_urdf(asset.urdf, pose((0.0, 0.0, 0.0)), fixed=True, flags=client.URDF_USE_INERTIA_FROM_FILE)
        client.setJointMotorControl2(body, 0, client.VELOCITY_CONTROL, targetVelocity=0.0, force=friction)
        client.changeDynamics(body, 0, jointDamping=0.0)
        tip = client.load_urdf(piston, pose(part.point + np.array([0.0, 0.0, 0.0115])), fixed=True)
        force = share * friction / (part.lever or 1.0) - PISTON_WEIGHT
        for _ in range(480):
            client.setJointMotorControl2(tip, 0, client.VELOCITY_CONTROL, targetVelocity=0.05, force=force)
            client.stepSimulation()
        return float(client.getJointState(body, 0)[0] / part.travel)
    finally:
        client.close()


@pytest.mark.parametrize("instance", ["dispenser-000", "dispenser-001", "dispenser-002"])
def test_head_gives_way_at_its_resistance(instance: str, tmp_path: Path) -> None:
    asset = load("synthetic", "Dispenser", instance)
    assert pressed_by(asset, 0.8, tmp_path / "piston.urdf") < 0.1
    assert pressed_by(asset, 1.4, tmp_path / "piston.urdf") > 0.95


def check_proportions(asset: Asset) -> None:
    assert 0.04 < asset.mass < 0.36
    if asset.part.kind == "flip":
        assert asset.part.threshold == pytest.approx(0.7)
    else:
        assert asset.part.threshold == pytest.approx(0.5 * asset.part.travel)
    along = {"press": -1.0, "flip": 0.0}.get(asset.part.kind, 1.0)
    assert asset.part.axis @ asset.long_axis == pytest.approx(-np.sin(0.3) if asset.topology == "trigger" else along)
    assert asset.part.point[2] > 0.0


@pytest.mark.parametrize("category", CATEGORIES)
def test_57_instances_split_43_to_14(category: str) -> None:
    assert len(names("synthetic", category)) == 57
    assert len(names("synthetic", category, "seen")) == 43
    assert len(names("synthetic", category, "unseen")) == 14


@pytest.mark.parametrize("category", CATEGORIES)
def test_every_topology_is_in_both_splits(category: str) -> None:
    topologies = {
        split: Counter(load("synthetic", category, name).topology for name in names("synthetic", category, split))
        for split in ("seen", "unseen")
    }
    assert set(topologies["seen"]) == set(topologies["unseen"])
    assert len(topologies["unseen"]) == 4
    assert min(topologies["unseen"].values()) >= 3


@pytest.mark.parametrize("category", CATEGORIES)
def test_all_instances_differ(category: str) -> None:
    hashes = {load("synthetic", category, name).content_hash for name in names("synthetic", category)}
    assert len(hashes) == 57


@pytest.mark.parametrize(("category", "instance"), SAMPLE)
def test_part_keeps_clear_of_the_body_over_its_travel(category: str, instance: str) -> None:
    asset = load("synthetic", category, instance)
    check_proportions(asset)
    assert clearance(asset) > 0.0004


@pytest.mark.slow
@pytest.mark.parametrize(("category", "instance"), EVERY)
def test_every_part_keeps_clear_of_the_body(category: str, instance: str) -> None:
    asset = load("synthetic", category, instance)
    check_proportions(asset)
    assert clearance(asset) > 0.0004


def test_same_instance_gives_the_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BIPRE_CACHE", str(tmp_path))
    first = load("synthetic", "Bottle", "bottle-010")
    before = {path: path.read_bytes() for path in first.urdf.parent.iterdir()}
    for path in before:
        path.unlink()
    second = load("synthetic", "Bottle", "bottle-010")
    assert {path: path.read_bytes() for path in second.urdf.parent.iterdir()} == before
    assert second.content_hash == first.content_hash


def test_hash_does_not_depend_on_the_cache_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    hashes = set()
    for folder in ("one", "two"):
        monkeypatch.setenv("BIPRE_CACHE", str(tmp_path / folder))
        hashes.add(load("synthetic", "Dispenser", "dispenser-003").content_hash)
    assert len(hashes) == 1


def test_damaged_cache_file_is_repaired(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BIPRE_CACHE", str(tmp_path))
    urdf = load("synthetic", "Bottle", "bottle-000").urdf
    whole = urdf.read_text()
    urdf.write_text(whole[:100])
    assert load("synthetic", "Bottle", "bottle-000").urdf.read_text() == whole


def test_body_fits_the_hand_and_lid_stands_proud() -> None:
    for name in names("synthetic", "Bottle")[::5]:
        asset = load("synthetic", "Bottle", name)
        vertices = {part: obj_vertices(asset, part) for part in ("body", "lid")}
        assert np.ptp(vertices["body"][:, :2], axis=0).min() <= 0.072
        assert 0.0215 <= np.ptp(vertices["lid"][:, 0]) <= 0.0501
        assert 0.016 <= np.ptp(vertices["lid"][:, 2]) <= 0.035
        assert 0.120 <= np.ptp(vertices["body"][:, 2]) + np.ptp(vertices["lid"][:, 2]) <= 0.260


def test_head_has_room_for_fingertips() -> None:
    for name in names("synthetic", "Dispenser")[::5]:
        asset = load("synthetic", "Dispenser", name)
        extent = np.ptp(obj_vertices(asset, "head"), axis=0)
        across = extent[1:] if asset.topology == "trigger" else extent[:2]
        assert across.min() >= 0.020
        moved = asset.part.travel * (asset.part.lever or 1.0)
        assert 0.008 <= moved <= 0.030


def obj_vertices(asset: Asset, link: str) -> np.ndarray:
    rows = (asset.urdf.parent / f"{link}_visual.obj").read_text().splitlines()
    return np.array([[float(word) for word in row.split()[1:]] for row in rows if row.startswith("v ")])


def test_unknown_instance_gets_a_suggestion() -> None:
    with pytest.raises(UnknownName, match=r'No Bottle instance "botle-001". Did you mean "bottle-001"\?'):
        load("synthetic", "Bottle", "botle-001")


@pytest.mark.parametrize("profile", PROFILES)
def test_outline_rises_from_floor_to_rim(profile: str) -> None:
    rings = container(profile, np.random.default_rng(0), width=0.06, height=0.2, neck=0.015)
    heights = [ring.z for ring in rings]
    assert heights == sorted(heights)
    assert (heights[0], heights[-1]) == pytest.approx((-0.1, 0.1))
    assert max(ring.x for ring in rings) == pytest.approx(0.03)
    assert sum(volume(solid) for solid in stack(rings)) < 0.06 * 0.06 * 0.2


def test_mass_properties_of_a_box_are_the_textbook_ones() -> None:
    found = mass_properties((box((0.1, 0.2, 0.3), (1.0, -2.0, 0.5)),), density=1000.0)
    assert found.mass == pytest.approx(6.0)
    assert found.centre == pytest.approx([1.0, -2.0, 0.5])
    assert np.diag(found.inertia) == pytest.approx([6.0 / 12 * 0.13, 6.0 / 12 * 0.10, 6.0 / 12 * 0.05])


def test_volume_of_a_cylinder_is_that_of_its_32_corners() -> None:
    inscribed = 16 * math.sin(2 * math.pi / 32) * 0.03**2 * 0.1
    assert volume(cylinder(0.0, 0.1, 0.03)) == pytest.approx(inscribed)
