"""Laws of the generated pliers and plates, and of every lid that flips open."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from robots.spatial import Array, hand_rotation, perpendicular, pose
from tests.worlds.test_synthetic_small import gaps, moved_by
from worlds import physics
from worlds.assets.asset import Asset
from worlds.assets.library import load, names
from worlds.assets.shape import collision_vertices
from worlds.bullet.client import Client, from_bullet, joint_numbers

PLIERS = names("synthetic", "Pliers")
PLATES = names("synthetic", "Plate")
LIDS = tuple(
    (category, name)
    for category in ("Bottle", "Lighter")
    for name in names("synthetic", category)
    if load("synthetic", category, name).part.kind == "flip"
)

PISTON = """<robot name="piston"><link name="base"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="tip"><inertial><mass value="0.2"/><inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/>
</inertial><collision><geometry><box size="0.02 0.02 0.02"/></geometry></collision></link>
<joint name="slide" type="prismatic"><parent link="base"/><child link="tip"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="100" velocity="10"/></joint></robot>"""
"""A tip as wide as a finger, driven along its z axis."""

TOUCHING = 0.0105
"""Centre of the tip above a surface it all but touches [m]."""


@dataclass
class Bench:
    """A server with one asset and a piston in it.

    Attributes:
        client: The server.
        asset: What is loaded.
        body: Its body number.
    """

    client: Client
    asset: Asset
    body: int

    def pose(self) -> pin.SE3:
        """``T_world_body``."""
        info = self.client.getDynamicsInfo(self.body, -1)
        T_world_inertia = from_bullet(*self.client.getBasePositionAndOrientation(self.body))
        return T_world_inertia * from_bullet(info[3], info[4]).inverse()

    def turned(self) -> float:
        """Position of the functional joint [rad]."""
        joints, _ = joint_numbers(self.client, self.body)
        return float(self.client.getJointState(self.body, joints[self.asset.part.joint])[0])

    def run(self, seconds: float) -> None:
        """Let time pass."""
        for _ in range(round(seconds / physics.STEP)):
            self.client.stepSimulation()

    def push(self, tip: int, force: float, seconds: float, speed: float = 0.04) -> None:
        """Drive a piston with at most ``force`` [N]."""
        for _ in range(round(seconds / physics.STEP)):
            self.client.setJointMotorControl2(tip, 0, self.client.VELOCITY_CONTROL, targetVelocity=speed, force=force)
            self.client.stepSimulation()


def bench(asset: Asset, T_world_body: pin.SE3, *, fixed: bool, table: float = 0.0) -> Bench:
    """The asset with its resistances, over a table whose top is at ``table`` [m] unless it is fixed."""
    client = Client()
    client.setPhysicsEngineParameter(fixedTimeStep=physics.STEP, numSolverIterations=physics.SOLVER_ITERATIONS)
    client.setGravity(0, 0, -physics.GRAVITY)
    body = client.load_urdf(asset.urdf, T_world_body, fixed=fixed, flags=client.URDF_USE_INERTIA_FROM_FILE)
    for link in range(-1, client.getNumJoints(body)):
        client.changeDynamics(
            body, link, lateralFriction=physics.OBJECT_FRICTION, spinningFriction=physics.OBJECT_SPINNING,
            rollingFriction=physics.OBJECT_ROLLING, jointDamping=0.0,
        )  # fmt: skip
    joints, _ = joint_numbers(client, body)
    for name, joint in asset.joints.items():
        client.setJointMotorControl2(
            body, joints[name], client.VELOCITY_CONTROL, targetVelocity=0, force=joint.friction
        )
    if not fixed:
        slab = client.createCollisionShape(client.GEOM_BOX, halfExtents=[0.5, 0.5, 0.1])
        top = client.createMultiBody(0.0, slab, basePosition=[0, 0, table - 0.1])
        client.changeDynamics(top, -1, lateralFriction=physics.TABLE_FRICTION)
    return Bench(client, asset, body)


def piston(made: Bench, point: Array, way: Array, folder: Path) -> int:
    """The body number of a piston that all but touches ``point`` and pushes along ``way``."""
    file = folder / "piston.urdf"
    file.write_text(PISTON)
    across = perpendicular(way)
    T_world_piston = pin.SE3(hand_rotation(way, across), np.asarray(point - TOUCHING * way))
    tip = made.client.load_urdf(file, T_world_piston, fixed=True)
    made.client.changeDynamics(tip, 0, lateralFriction=physics.PAD_FRICTION)
    return tip


# -- pliers ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("category", "counts"), [("Pliers", (25, 19, 6)), ("Plate", (22, 17, 5))])
def test_counts_and_splits_are_the_papers(category: str, counts: tuple[int, int, int]) -> None:
    assert tuple(len(names("synthetic", category, split)) for split in (None, "seen", "unseen")) == counts
    assets = [load("synthetic", category, name) for name in names("synthetic", category)]
    assert len({asset.content_hash for asset in assets}) == len(assets)
    seen, unseen = (Counter(a.topology for a in assets if a.split == split) for split in ("seen", "unseen"))
    assert set(seen) == set(unseen)
    assert len(seen) == 4


@pytest.mark.parametrize("instance", PLIERS)
def test_pliers_have_the_size_and_weight_of_real_ones(instance: str) -> None:
    asset = load("synthetic", "Pliers", instance)
    vertices = collision_vertices(asset)
    extent = np.ptp(np.concatenate(list(vertices.values())), axis=0)
    assert 0.080 < asset.mass < 0.250
    assert 0.120 < extent[2] < 0.200
    assert 0.008 < extent[1] < 0.014
    half_open = 0.5 * (asset.part.travel + np.radians(3.0))
    grip = vertices["body"][vertices["body"][:, 2] > 0.5 * vertices["body"][:, 2].max()]
    width = np.ptp(grip @ [np.cos(half_open), 0.0, -np.sin(half_open)])
    assert 0.009 < width < 0.0165
    assert np.radians(12.0) < asset.part.travel < np.radians(25.0)


@pytest.mark.parametrize("instance", PLIERS[::4])
def test_the_halves_keep_clear_and_the_handle_gives_way_at_its_resistance(instance: str) -> None:
    asset = load("synthetic", "Pliers", instance)
    assert min(gaps(asset)) > 0.0004
    assert 3.0 < asset.joints[asset.part.joint].friction / asset.part.lever < 6.0
    assert moved_by(asset, 0.6) < 0.1
    assert moved_by(asset, 1.4) > 0.95


@pytest.mark.parametrize("instance", PLIERS)
def test_the_pressed_spot_lies_outside_the_moving_handle_and_moves_towards_the_fixed_one(instance: str) -> None:
    asset = load("synthetic", "Pliers", instance)
    part = asset.part
    vertices = collision_vertices(asset)
    assert part.lever == pytest.approx(float(np.linalg.norm(part.point)))
    assert part.axis @ part.point == pytest.approx(0.0, abs=1e-12)
    assert part.axis @ (vertices["body"][vertices["body"][:, 2] > part.point[2] - 0.01].mean(axis=0) - part.point) > 0.0
    near = vertices["handle"][np.abs(vertices["handle"][:, 2] - part.point[2]) < 0.03]
    assert ((near - part.point) @ part.axis).min() > -0.006


@pytest.mark.parametrize("instance", PLIERS[:4])
def test_a_finger_on_the_handle_closes_the_pliers(instance: str, tmp_path: Path) -> None:
    asset = load("synthetic", "Pliers", instance)
    force = asset.joints[asset.part.joint].friction / asset.part.lever
    moved = {}
    for share in (0.6, 1.5):
        made = bench(asset, pin.SE3.Identity(), fixed=True)
        tip = piston(made, asset.part.point, asset.part.axis, tmp_path)
        made.push(tip, share * force, 1.0)
        moved[share] = made.turned()
        made.client.close()
    assert moved[0.6] < 0.1 * asset.part.travel
    assert moved[1.5] > asset.part.threshold


@pytest.mark.parametrize("instance", PLIERS[:4])
def test_pliers_lie_flat(instance: str) -> None:
    asset = load("synthetic", "Pliers", instance)
    made = bench(asset, pose((0.0, 0.0, 0.04), (np.pi / 2 - 0.5, 0.3, 0.0)), fixed=False)
    made.run(2.0)
    assert abs(made.pose().rotation[2, 1]) > np.cos(np.radians(2.0))
    assert abs(made.turned()) < np.radians(1.0)
    made.client.close()


@pytest.mark.parametrize("instance", PLIERS[:4])
def test_a_gripper_on_the_fixed_handle_holds_the_pliers_while_they_are_squeezed(instance: str, tmp_path: Path) -> None:
    """Two finger pads, one driven with the grip force and one locked, carry the free pliers by friction alone."""
    asset = load("synthetic", "Pliers", instance)
    part, vertices = asset.part, collision_vertices(asset)["body"]
    half_open = 0.5 * (part.travel + np.radians(3.0))
    inner_to_outer = np.array([np.cos(half_open), 0.0, -np.sin(half_open)])
    along = np.array([np.sin(half_open), 0.0, np.cos(half_open)])
    where = 0.7 * (vertices @ along).max()
    grip = vertices[(vertices @ along) > 0.5 * (vertices @ along).max()]
    inner, outer = (edge * inner_to_outer + where * along for edge in np.sort(grip @ inner_to_outer)[[0, -1]])
    upright = pin.SE3(pin.exp3(np.array([-np.pi / 2, 0.0, 0.0])), np.zeros(3))  # thickness points up, as when lying
    made = bench(asset, upright, fixed=False, table=-1.0)
    R = upright.rotation
    pads = [
        piston(made, R @ inner, R @ inner_to_outer, tmp_path),
        piston(made, R @ outer, -R @ inner_to_outer, tmp_path),
    ]
    made.client.setJointMotorControl2(pads[0], 0, made.client.VELOCITY_CONTROL, targetVelocity=0, force=500)
    made.push(pads[1], physics.GRIP_FORCE, 0.5)
    held = made.pose()
    tip = piston(made, made.pose().act(part.point) - 0.001 * (R @ part.axis), R @ part.axis, tmp_path)
    for _ in range(240):
        made.client.setJointMotorControl2(
            pads[1], 0, made.client.VELOCITY_CONTROL, targetVelocity=0.04, force=physics.GRIP_FORCE
        )
        made.push(tip, 1.5 * asset.joints[part.joint].friction / part.lever, physics.STEP)
    assert made.turned() > part.threshold
    slip = held.inverse() * made.pose()
    assert np.linalg.norm(slip.translation) < 0.004
    assert np.linalg.norm(pin.log3(slip.rotation)) < 0.05
    made.client.close()


# -- plates ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("instance", PLATES)
def test_plates_have_the_size_and_weight_of_real_ones(instance: str) -> None:
    asset = load("synthetic", "Plate", instance)
    vertices = collision_vertices(asset)["body"]
    across, height = np.ptp(vertices[:, 0]), np.ptp(vertices[:, 2])
    assert asset.function is None
    assert 0.150 < asset.mass < 0.500
    assert 0.160 < across < 0.260
    assert 0.015 < height < 0.0301
    foot = np.ptp(vertices[vertices[:, 2] < 1e-6][:, 0])
    assert 0.50 < foot / across < 0.65


def test_a_plate_is_hollow_and_its_rim_thin() -> None:
    """Seen from above the floor lies far below the rim, which is a few millimetres of sheet."""
    for instance in PLATES[:4]:
        made = bench(load("synthetic", "Plate", instance), pose((0.0, 0.0, 0.0)), fixed=True)
        edge = 0.94 * float(collision_vertices(made.asset)["body"][:, 0].max())
        down, up = made.client.rayTestBatch([[0, 0, 1], [edge, 0, 1]], [[0, 0, -1], [edge, 0, -1]])
        below = made.client.rayTest([edge, 0, -1], [edge, 0, 1])[0]
        assert down[3][2] < 0.5 * up[3][2]
        assert 0.003 < up[3][2] - below[3][2] < 0.008
        made.client.close()


@pytest.mark.parametrize("instance", PLATES[::3])
def test_a_pressed_rim_tilts_the_plate_and_lifts_the_other_side(instance: str, tmp_path: Path) -> None:
    asset = load("synthetic", "Plate", instance)
    vertices = collision_vertices(asset)["body"]
    far = np.array([-vertices[:, 0].max(), 0.0, vertices[:, 2].max()])
    made = bench(asset, pose((0.0, 0.0, 0.001)), fixed=False)
    tip = piston(made, np.array([-far[0] - 0.010, 0.0, far[2] + 0.003]), np.array([0.0, 0.0, -1.0]), tmp_path)
    made.push(tip, 50.0, 0.5, speed=0.0)
    before = made.pose()
    made.push(tip, 15.0, 2.5)
    after = made.pose()
    assert abs(before.rotation[2, 2]) > np.cos(np.radians(0.5))
    assert after.act(far)[2] - before.act(far)[2] > 0.025
    assert np.linalg.norm((after.translation - before.translation)[:2]) < 0.015
    assert np.radians(5.0) < np.arccos(after.rotation[2, 2]) < np.radians(45.0)
    made.client.close()


def test_a_dropped_plate_rests_level_on_few_contacts() -> None:
    """What keeps a step cheap: the foot is one solid, not a ring of wedges."""
    for instance in PLATES[:4]:
        made = bench(load("synthetic", "Plate", instance), pose((0.0, 0.0, 0.012), (0.06, 0.03, 0.4)), fixed=False)
        made.run(2.0)
        assert 3 <= len(made.client.getContactPoints(made.body)) <= 8
        assert made.pose().rotation[2, 2] > np.cos(np.radians(0.5))
        assert np.linalg.norm(made.client.getBaseVelocity(made.body)) < 0.01
        made.client.close()


# -- lids that flip --------------------------------------------------------------------------------------------------


def test_flip_lids_are_in_both_splits() -> None:
    found = Counter((category, load("synthetic", category, name).split) for category, name in LIDS)
    assert found == {
        ("Bottle", "seen"): 10, ("Bottle", "unseen"): 4, ("Lighter", "seen"): 3, ("Lighter", "unseen"): 1,
    }  # fmt: skip


@pytest.mark.parametrize(("category", "instance"), LIDS)
def test_a_flip_lid_fits_a_gripper_that_opens_along_its_hinge(category: str, instance: str) -> None:
    asset = load("synthetic", category, instance)
    part, lid = asset.part, collision_vertices(asset)["lid"] - asset.part.point
    assert part.facing is not None
    assert part.facing @ part.axis == pytest.approx(0.0)
    assert np.ptp(lid @ part.axis) <= 0.060
    assert np.ptp(lid @ part.facing) >= 0.015
    depth = float(np.ptp(lid @ np.cross(part.axis, part.facing)))
    assert 3.0 < asset.joints[part.joint].friction / (depth + 0.001) < 6.0
    assert np.radians(100.0) <= part.travel <= np.radians(120.0)
    assert part.threshold == pytest.approx(0.7)


@pytest.mark.parametrize(("category", "instance"), LIDS)
def test_a_flip_lid_keeps_clear_of_the_body(category: str, instance: str) -> None:
    assert min(gaps(load("synthetic", category, instance))) > 0.0004


def opened_by(asset: Asset, share: float) -> float:
    """Angle after a second under ``share`` times the resistance as a couple about the hinge [rad]."""
    made = bench(asset, pin.SE3.Identity(), fixed=True)
    _, links = joint_numbers(made.client, made.body)
    torque = share * asset.joints[asset.part.joint].friction * asset.part.axis
    for _ in range(240):
        made.client.applyExternalTorque(made.body, links["lid"], torque.tolist(), made.client.WORLD_FRAME)
        made.client.stepSimulation()
    turned = made.turned()
    made.client.close()
    return turned


@pytest.mark.parametrize(("category", "instance"), LIDS)
def test_a_flip_lid_opens_above_its_resistance_and_not_below(category: str, instance: str) -> None:
    asset = load("synthetic", category, instance)
    assert abs(opened_by(asset, 0.5)) < 0.05
    assert opened_by(asset, 1.3) > asset.part.threshold
    assert opened_by(asset, -1.3) < 0.05


def test_an_opened_flip_lid_has_its_front_up() -> None:
    """The joint's sense is the part's: a right-hand turn about the axis lifts the front."""
    for category, instance in LIDS[::6]:
        asset = load("synthetic", category, instance)
        lid = collision_vertices(asset)["lid"]
        front = lid[np.argmax(lid[:, 0])] - asset.part.point
        R = pin.exp3(asset.part.threshold * asset.part.axis)
        assert (R @ front)[2] > front[2] + 0.010
