"""Which pairs of links count: found for any arm, the same for both Pandas as ever, and none left out that can meet."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from planners import ik, motion
from planners.certify import Certificate, certify
from planners.collision import CollisionWorld
from planners.motion import JointPath
from planners.pairs import public_name
from planners.timing import retime
from robots.model import DualArm
from robots.trajectory import Trajectory
from robots.workcell import SIDES, Workcell, load_workcell
from tests.conftest import SHARED

X7S = SHARED / "assets" / "robots" / "arx_x7s" / "x7s_usable.urdf"

PANDA = {
    "link0": {"link2", "link3", "link4"},
    "link1": {"link3", "link4"},
    "link2": {"link4"},
    "link3": {"link5", "link6", "link7", "hand", "leftfinger", "rightfinger"},
    "link4": {"link6", "link7", "hand", "leftfinger", "rightfinger"},
    "link6": {"leftfinger", "rightfinger"},
}
"""Links of a Panda that stay 32 mm or more apart over 30 000 random configurations."""


def own_pairs(world: CollisionWorld, side: str) -> set[frozenset[str]]:
    """Names of the pairs of one arm that are checked."""
    names = [public_name(shape.name) for shape in world._cell.geometryObjects]
    pairs = [(names[a], names[b]) for a, b in world._cell_pairs]
    return {
        frozenset(n.partition("/")[2] for n in pair) for pair in pairs if all(n.startswith(f"{side}/") for n in pair)
    }


def test_of_a_panda_just_the_links_are_left_out_that_never_meet(workcell: Workcell) -> None:
    world = CollisionWorld(workcell)
    names = [f"link{k}" for k in range(8)] + ["hand", "leftfinger", "rightfinger"]
    joint = dict(zip(names, [0, 1, 2, 3, 4, 5, 6, 7, 7, 8, 9], strict=True))
    for side in SIDES:
        left_out = set()
        for a in names:
            for b in names[names.index(a) + 1 :]:
                chained = joint[b] - joint[a] <= 1 or (b.endswith("finger") and joint[a] >= 7)
                if not chained and frozenset((f"panda_{a}", f"panda_{b}")) not in own_pairs(world, side):
                    left_out.add((a, b))
        assert left_out == {(a, b) for a, others in PANDA.items() for b in others}
    assert list((Path(os.environ["BIPRE_CACHE"]) / "robots").glob("meetings-*.json"))


def test_where_and_on_which_side_an_arm_stands_makes_no_difference(
    workcell: Workcell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("BIPRE_CACHE", str(tmp_path))
    left, right = (own_pairs(CollisionWorld(workcell), side) for side in SIDES)
    assert left == right
    assert len(list((tmp_path / "robots").glob("meetings-*.json"))) == 1


def x7s_arm(folder: Path) -> Path:
    """The left arm of the X7s on its trunk as a URDF of its own, with a hand frame whose z is the approach."""
    source = ET.parse(X7S).getroot()
    root, inside = ET.Element("robot", name="x7s_arm"), {"body"}
    joints = [joint for joint in source.findall("joint") if str(joint.get("name")).startswith("left_")]
    for joint in joints:
        child = joint.find("child")
        assert child is not None
        inside.add(str(child.get("link")))
    for link in source.findall("link"):
        if link.get("name") in inside:
            root.append(link)
    root.extend(joints)
    for mesh in root.iter("mesh"):
        mesh.set("filename", str(X7S.parent / str(mesh.get("filename"))))
    ET.SubElement(root, "link", name="left_hand")
    fixed = ET.SubElement(root, "joint", name="left_hand_joint", type="fixed")
    ET.SubElement(fixed, "parent", link="left_gripper_base")
    ET.SubElement(fixed, "child", link="left_hand")
    ET.SubElement(fixed, "origin", xyz="0.12737 0 0.021756", rpy="0 1.5707963267948966 0")
    path = folder / "x7s_arm.urdf"
    path.write_bytes(ET.tostring(root))
    return path


CELL = """
name = "x7s_pair"
floor = -0.8
shared = [0.0, 0.0, 0.2]

[models.x7s]
urdf = "{urdf}"
base_link = "body"
joints = ["left_shoulder_pitch", "left_shoulder_roll", "left_arm_yaw", "left_elbow_pitch", "left_elbow_roll",
  "left_wrist_pitch", "left_wrist_yaw"]
limits_source = "x7s_usable.urdf; velocities and accelerations are the test's"
lower = [-0.523599, -0.436332, -1.570796, -0.785398, -2.792527, -0.785398, -1.570796]
upper = [3.141593, 1.570796, 1.570796, 1.570796, 2.792527, 1.570796, 1.570796]
velocity = [2.0, 2.0, 2.0, 2.0, 2.0, 2.0, 2.0]
acceleration = [8.0, 8.0, 8.0, 8.0, 8.0, 8.0, 8.0]
torque = [100.0, 100.0, 100.0, 100.0, 100.0, 100.0, 100.0]

[models.x7s.gripper]
hand_link = "left_hand"
finger_links = ["left_gripper_left", "left_gripper_right"]
finger_joints = ["left_gripper_0", "left_gripper_1"]
finger_travel = 0.044
finger_velocity = 0.05
force_limit = 40.0
tcp_offset = 0.06
tip_offset = 0.08

[arms.left]
model = "x7s"
base_xyz = [-0.6, 0.0, 0.05]
home = [0.3, 1.0, 0.0, 0.6, 0.0, 0.0, 0.0]

[arms.right]
model = "x7s"
base_xyz = [0.6, 0.0, 0.05]
base_rpy = [0.0, 0.0, 3.141592653589793]
home = [0.3, 1.0, 0.0, 0.6, 0.0, 0.0, 0.0]

[table]
centre = [0.0, 0.0]
size = [0.5, 0.6]
top = -0.1
thickness = 0.04

[[cameras]]
name = "overhead"
eye = [0.0, -0.02, 1.0]
target = [0.0, 0.0, 0.0]
width = 64
height = 64
fov_deg = 42.0
"""


@pytest.fixture(scope="module")
def x7s(tmp_path_factory: pytest.TempPathFactory) -> Workcell:
    """Two X7s arms, each on its trunk, that face each other across a table."""
    if not X7S.is_file():
        pytest.skip(f"{X7S} is absent")
    folder = tmp_path_factory.mktemp("x7s")
    path = folder / "cell.toml"
    path.write_text(CELL.format(urdf=x7s_arm(folder)))
    return load_workcell(str(path))


def test_another_arm_plans_a_free_motion_with_pairs_found_for_it(x7s: Workcell) -> None:
    arms, world = DualArm(x7s), CollisionWorld(x7s)
    assert world.free(arms.home), world.contact(arms.home)
    arm, rng = arms["left"], np.random.default_rng(2)
    draws = rng.uniform(arm.lower + 0.1, arm.upper - 0.1, (60, 7))
    draws[:, 1] = rng.uniform(1.0, 1.5, 60)  # nearer to the trunk its hull, fatter than the trunk, meets the shoulder's
    goals = [q for q in draws if world.free(np.concatenate([q, arms["right"].home]))]
    assert len(goals) >= 3
    for goal in goals[:3]:
        path = motion.plan(world, arm, arm.home, goal[None], arms["right"].home, seed=0)
        assert isinstance(path, JointPath), str(path)
        trajectory = retime(path, x7s.arm("left"))
        assert isinstance(trajectory, Trajectory)
        proof = certify(world, arm, x7s.arm("left"), trajectory, arms["right"].home)
        assert isinstance(proof, Certificate), str(proof)
    assert isinstance(ik.solve(arm, arm.hand(goals[0]), rng=rng, seeds=[goals[0]]), ik.Reached)


def test_no_pair_is_left_out_that_meets_in_fresh_samples(x7s: Workcell, workcell: Workcell) -> None:
    """Every pair of one arm at configurations that the search for pairs did not look at, half of them at limits."""
    for cell in (x7s, workcell):
        world, arms = CollisionWorld(cell), DualArm(cell)
        model, geometry = world._model, world._cell.copy()
        checked = {tuple(sorted(pair)) for pair in world._cell_pairs}
        joints = [int(shape.parentJoint) for shape in geometry.geometryObjects]
        names = [str(shape.name) for shape in geometry.geometryObjects]
        parents = [int(parent) for parent in model.parents]
        left_out = [
            (a, b)
            for b in range(len(names))
            for a in range(b)
            if names[a].startswith("left/")
            and names[b].startswith("left/")
            and (a, b) not in checked
            and joints[a] != joints[b]
            and parents[joints[b]] != joints[a]
            and parents[joints[a]] != joints[b]
            and parents[joints[a]] != parents[joints[b]]
        ]
        assert left_out
        for pair in left_out:
            geometry.addCollisionPair(pin.CollisionPair(*pair))
        data, geometry_data = model.createData(), geometry.createData()
        arm, rng = arms["left"], np.random.default_rng(77)
        q, met = pin.neutral(model), np.zeros(len(left_out), dtype=int)
        for k in range(1500):
            row = rng.uniform(arm.lower, arm.upper)
            ends = np.where(rng.random(7) < 0.5, arm.lower, arm.upper)
            q[world._slots["left"]] = np.where(rng.random(7) < 0.5 * (k % 2), ends, row)
            q[world._fingers["left"]] = rng.uniform(0.0, cell.arm("left").gripper.finger_travel)
            pin.computeCollisions(model, data, geometry, geometry_data, q, False)
            met += [result.isCollision() for result in geometry_data.collisionResults]
        assert ((met == 0) | (met == 1500)).all()
