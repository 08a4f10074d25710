"""Laws of the nine generated families that are pushed over a table's edge, and of the solids they are made of."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter
from itertools import pairwise

import numpy as np
import pytest

from robots.spatial import pose
from robots.workcell import Workcell
from worlds.assets.asset import Asset
from worlds.assets.library import load, names
from worlds.assets.shape import collision_vertices
from worlds.assets.solids import mass_properties, volume
from worlds.assets.synthetic.outline import Ring, disc
from worlds.assets.synthetic.slab import GAP, bars, density, rounded, shell, slab, wall
from worlds.bullet.client import Client, joint_numbers
from worlds.bullet.world import BulletWorld
from worlds.tasks import EDGE

COUNTS = {
    "Bowl": (186, 140, 46),
    "Cap": (56, 42, 14),
    "Keyboard": (65, 49, 16),
    "Laptop": (55, 42, 13),
    "Phone": (18, 14, 4),
    "Remote": (49, 37, 12),
    "Scissors": (47, 36, 11),
    "Switch": (70, 53, 17),
    "Window": (58, 44, 14),
}
"""All, seen, unseen; the totals are the paper's."""

MASSES = {
    "Bowl": (0.06, 0.50),
    "Cap": (0.05, 0.11),
    "Keyboard": (0.22, 0.55),
    "Laptop": (0.45, 0.90),
    "Phone": (0.09, 0.50),
    "Remote": (0.045, 0.17),
    "Scissors": (0.018, 0.15),
    "Switch": (0.06, 0.19),
    "Window": (0.25, 0.75),
}
"""Lightest and heaviest [kg]."""

EXTENTS = {
    "Bowl": ((0.100, 0.160), (0.040, 0.080)),
    "Cap": ((0.168, 0.240), (0.055, 0.165)),
    "Keyboard": ((0.270, 0.440), (0.009, 0.040)),
    "Laptop": ((0.190, 0.280), (0.013, 0.028)),
    "Phone": ((0.086, 0.250), (0.007, 0.022)),
    "Remote": ((0.135, 0.225), (0.013, 0.040)),
    "Scissors": ((0.088, 0.245), (0.005, 0.014)),
    "Switch": ((0.080, 0.150), (0.012, 0.065)),
    "Window": ((0.200, 0.300), (0.010, 0.030)),
}
"""Shortest and longest, lowest and highest [m]."""

JOINTED = tuple(
    (category, name)
    for category, first, step in (
        ("Laptop", 0, 14),
        ("Phone", 1, 3),  # every third is a flip phone
        ("Scissors", 0, 11),
        ("Switch", 0, 16),
        ("Window", 0, 12),
    )
    for name in names("synthetic", category)[first::step]
    if not (category == "Window" and int(name[-3:]) % 3 == 2)  # fixed ones
)
"""Instances with moving parts, of every profile that has them."""

FLOPPY = 0.02
"""How far a joint may give while its object comes to rest [m] or [rad]."""


def spread(category: str, count: int) -> list[str]:
    """``count`` instances from all over the series; with a step coprime to the numbers of profiles."""
    listed = names("synthetic", category)
    return [listed[(7 * k) % len(listed)] for k in range(count)]


def extent(asset: Asset) -> np.ndarray:
    return np.ptp(np.concatenate(list(collision_vertices(asset).values())), axis=0)


@pytest.mark.parametrize("category", COUNTS)
def test_counts_are_the_papers_and_every_fourth_is_unseen(category: str) -> None:
    assert category in EDGE
    found = tuple(len(names("synthetic", category, split)) for split in (None, "seen", "unseen"))
    assert found == COUNTS[category]
    assert names("synthetic", category)[3] in names("synthetic", category, "unseen")


@pytest.mark.parametrize("category", COUNTS)
def test_instances_differ_and_every_profile_is_in_both_splits(category: str) -> None:
    assets = [load("synthetic", category, name) for name in names("synthetic", category)]
    assert len({asset.content_hash for asset in assets}) == len(assets)
    seen, unseen = (Counter(a.topology for a in assets if a.split == split) for split in ("seen", "unseen"))
    assert set(seen) == set(unseen)
    assert len(seen) >= 3
    least, most = MASSES[category]
    assert all(least - 1e-9 <= asset.mass <= most + 1e-9 for asset in assets)
    assert np.ptp([asset.mass for asset in assets]) > 0.5 * (most - least)


@pytest.mark.parametrize("category", COUNTS)
def test_sizes_are_those_of_real_things_and_shapes_are_few(category: str) -> None:
    for name in spread(category, 8):
        asset = load("synthetic", category, name)
        size = extent(asset)
        (short, long), (low, high) = EXTENTS[category]
        assert short <= size[:2].max() <= long
        assert low <= size[2] <= high
        assert size[0] >= size[1] - 1e-9
        assert asset.long_axis == pytest.approx([1.0, 0.0, 0.0])
        assert asset.function is None
        assert asset.urdf.read_text().count("<collision") <= 70
        assert asset.urdf.read_text().index('<link name="body"') < 200


@pytest.mark.parametrize("category", COUNTS)
def test_objects_come_to_rest_on_the_table_whichever_way_they_lie(category: str, workcell: Workcell) -> None:
    for name in spread(category, 2):
        asset = load("synthetic", category, name)
        vertices = np.concatenate(list(collision_vertices(asset).values()))
        with BulletWorld(workcell, asset) as world:
            for rpy in ((0.0, 0.0, 0.2), (np.pi, 0.0, 0.5), (0.2, 0.1, 1.2)):
                T = pose((0.0, 0.1, 0.0), rpy)
                T.translation[2] = 0.002 - (vertices @ T.rotation[2]).min()
                world.put_object(T)
                assert world.settle_object(), (name, rpy)
                contacts = world.client.getContactPoints(world.object, world.table)
                assert contacts
                assert min(contact[8] for contact in contacts) > -0.002
                lowest = (vertices @ world.object_pose().rotation[2]).min() + world.object_pose().translation[2]
                assert abs(lowest) < 0.002
                for joint, physics in asset.joints.items():
                    assert abs(world.joint_position(joint) - physics.start) < FLOPPY


def moved_by(asset: Asset, joint: str, share: float) -> tuple[float, float]:
    """How far a joint got in a second each way under ``share`` times its resistance, [m] or [rad]."""
    client = Client()
    try:
        client.setPhysicsEngineParameter(numSolverIterations=150)
        body = client.load_urdf(asset.urdf, pose((0.0, 0.0, 0.0)), fixed=True, flags=client.URDF_USE_INERTIA_FROM_FILE)
        joints, _ = joint_numbers(client, body)
        number, resistance = joints[joint], asset.joints[joint]
        client.setJointMotorControl2(
            body, number, client.VELOCITY_CONTROL, targetVelocity=0.0, force=resistance.friction
        )
        client.changeDynamics(body, number, jointDamping=0.0)
        info = client.getJointInfo(body, number)
        slides, axis = info[2] == client.JOINT_PRISMATIC, np.array(info[13])
        found = []
        for sense in (1.0, -1.0):
            client.resetJointState(body, number, resistance.start)
            load_along = [float(v) for v in sense * share * resistance.friction * axis]
            for _ in range(240):
                if slides:
                    middle = client.getLinkState(body, number)[0]
                    client.applyExternalForce(body, number, load_along, middle, client.WORLD_FRAME)
                else:
                    client.applyExternalTorque(body, number, load_along, client.WORLD_FRAME)
                client.stepSimulation()
            found.append(abs(client.getJointState(body, number)[0] - resistance.start))
        return found[0], found[1]
    finally:
        client.close()


def ranges(asset: Asset) -> dict[str, float]:
    """Upper less lower limit of every joint, [m] or [rad]."""
    limits = {e.attrib["name"]: e.find("limit") for e in ET.parse(asset.urdf).iter("joint")}
    return {name: float(e.attrib["upper"]) - float(e.attrib["lower"]) for name, e in limits.items() if e is not None}


@pytest.mark.parametrize(("category", "name"), JOINTED)
def test_a_part_gives_way_above_its_resistance_and_not_below(category: str, name: str) -> None:
    asset = load("synthetic", category, name)
    for joint in asset.joints:
        assert max(moved_by(asset, joint, 0.7)) < 0.002
        assert sum(moved_by(asset, joint, 1.5)) > 0.5 * ranges(asset)[joint]


@pytest.mark.parametrize(("category", "name"), JOINTED)
def test_parts_keep_clear_of_the_rest_over_their_travel(category: str, name: str) -> None:
    asset = load("synthetic", category, name)
    client = Client()
    try:
        body = client.load_urdf(asset.urdf, pose((0.0, 0.0, 0.0)), fixed=True)
        joints, _ = joint_numbers(client, body)
        for number in joints.values():
            low, high = client.getJointInfo(body, number)[8:10]
            for share in np.linspace(0.0, 1.0, 6):
                client.resetJointState(body, number, low + share * (high - low))
                near = client.getClosestPoints(body, body, 0.01, linkIndexA=-1, linkIndexB=number)
                assert min((contact[8] for contact in near), default=1.0) > 0.0004
    finally:
        client.close()


@pytest.mark.parametrize(("category", "name"), JOINTED)
def test_a_part_does_not_move_under_gravity_however_the_object_is_held(category: str, name: str) -> None:
    asset = load("synthetic", category, name)
    client = Client()
    try:
        client.setPhysicsEngineParameter(numSolverIterations=150)
        body = client.load_urdf(asset.urdf, pose((0.0, 0.0, 0.0)), fixed=True, flags=client.URDF_USE_INERTIA_FROM_FILE)
        joints, _ = joint_numbers(client, body)
        for down in (*np.eye(3), *-np.eye(3)):
            client.setGravity(*(9.81 * down))
            for joint, physics in asset.joints.items():
                number = joints[joint]
                client.resetJointState(body, number, physics.start)
                client.setJointMotorControl2(
                    body, number, client.VELOCITY_CONTROL, targetVelocity=0.0, force=physics.friction
                )
            for _ in range(120):
                client.stepSimulation()
            for joint, physics in asset.joints.items():
                assert abs(client.getJointState(body, joints[joint])[0] - physics.start) < 0.002
    finally:
        client.close()


def ray(asset: Asset, start: tuple[float, float, float], end: tuple[float, float, float]) -> float:
    """The height at which a ray from ``start`` to ``end`` meets the object [m]."""
    client = Client()
    try:
        client.load_urdf(asset.urdf, pose((0.0, 0.0, 0.0)), fixed=True)
        hit = client.rayTest(start, end)[0]
        assert hit[0] >= 0
        return float(hit[3][2])
    finally:
        client.close()


@pytest.mark.parametrize("name", spread("Bowl", 8))
def test_bowls_are_hollow(name: str) -> None:
    asset = load("synthetic", "Bowl", name)
    size = extent(asset)
    for x in (0.0, 0.15 * size[0], -0.15 * size[0]):
        assert ray(asset, (x, 0.001, 1.0), (x, 0.001, -1.0)) < 0.35 * size[2]


@pytest.mark.parametrize("name", spread("Cap", 8))
def test_caps_are_hollow_from_below(name: str) -> None:
    asset = load("synthetic", "Cap", name)
    vertices = np.concatenate(list(collision_vertices(asset).values()))
    for x in (0.0, 0.02, -0.02):
        assert ray(asset, (x, 0.001, -1.0), (x, 0.001, 1.0)) > 0.6 * vertices[:, 2].max()


def test_a_shell_is_as_thick_as_asked_everywhere() -> None:
    profile = np.array([[0.03, 0.0], [0.05, 0.02], [0.06, 0.045], [0.065, 0.07]])
    levels = wall(profile, 0.004)
    for (outer, inner), (above, over) in pairwise(levels):
        edge = np.array([above.x - outer.x, above.z - outer.z])
        across = np.array([edge[1], -edge[0]]) / np.linalg.norm(edge)
        for near, far in ((outer, inner), (above, over)):
            assert 0.003 < np.array([near.x - far.x, near.z - far.z]) @ across < 0.0047


def test_the_volume_of_a_straight_shell_is_that_of_two_polygons() -> None:
    pieces = shell(((disc(0.0, 0.05), disc(0.0, 0.04)), (disc(0.1, 0.05), disc(0.1, 0.04))), 12)
    polygons = 6.0 * np.sin(np.pi / 6.0) * (0.05**2 - 0.04**2)
    assert len(pieces) == 12
    assert sum(volume(piece) for piece in pieces) == pytest.approx(0.1 * polygons)


def test_a_square_shell_reaches_its_half_width_along_both_axes() -> None:
    levels = tuple((Ring(z, 0.05, 0.04, 5.0), Ring(z, 0.045, 0.035, 5.0)) for z in (0.0, 0.01))
    corners = np.concatenate([piece.vertices for piece in shell(levels)])
    assert np.abs(corners).max(axis=0) == pytest.approx([0.05, 0.04, 0.01])
    assert np.linalg.norm(corners[:, :2], axis=1).max() > 0.055


def test_slabs_bars_and_density() -> None:
    plate = slab((0.1, 0.06, 0.008), (0.0, 0.0, 0.004), 0.01, 0.001)
    assert np.ptp(plate.vertices, axis=0) == pytest.approx([0.1, 0.06, 0.008])
    assert plate.vertices[:, 2].min() == pytest.approx(0.0)
    frame = bars((0.1, 0.08), 0.02, 0.0, 0.01)
    assert sum(volume(bar) for bar in frame) == pytest.approx(0.01 * 4.0 * (0.1 * 0.08 - 0.08 * 0.06))
    assert mass_properties(frame, density(frame, 0.4)).mass == pytest.approx(0.4)
    assert np.abs(rounded(0.05, 0.03, 0.01)).max(axis=0) == pytest.approx([0.05, 0.03])
    assert GAP > 0.002
