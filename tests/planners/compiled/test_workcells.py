"""The compiled proofs of whole workcells against Coal and PyBullet: nothing that touches is ever called free."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from planners.collision import CollisionWorld
from planners.compiled import layout as at
from planners.compiled.cell import Cell
from planners.compiled.robot import robot
from robots.model import DualArm
from robots.spatial import pose
from robots.workcell import SIDES, Workcell
from tests.conftest import SHARED

X7S = SHARED / "assets" / "robots" / "arx_x7s" / "x7s_usable.urdf"


@pytest.fixture(scope="module")
def world(workcell: Workcell) -> CollisionWorld:
    return CollisionWorld(workcell)


def draw(arms: DualArm, rng: np.random.Generator, count: int) -> np.ndarray:
    lower, upper = (np.concatenate([getattr(arms[s], end) for s in SIDES]) for end in ("lower", "upper"))
    return np.asarray(rng.uniform(lower, upper, (count, 14)))


def agree(world: CollisionWorld, arms: DualArm, count: int, seed: int) -> tuple[int, int]:
    """Compare random states; how many were free and how many were not decided."""
    q = draw(arms, np.random.default_rng(seed), count)
    verdicts = world.motion(SIDES, arms.home).states(q, world.margin)
    ours = [world.free(row) for row in q]
    wrong = [(row, world.clearance(row)) for row, v, f in zip(q, verdicts, ours, strict=True) if v == at.FREE and not f]
    assert all(clearance[0] > world.margin - 2e-6 for _, clearance in wrong), wrong
    missed = [row for row, v, f in zip(q, verdicts, ours, strict=True) if v == at.HIT and f]
    assert all(world.clearance(row)[0] < world.margin + 2e-6 for row in missed)
    return int(np.sum(ours)), int((verdicts == at.UNSURE).sum())


def test_two_arms_alone_with_an_object_at_rest_and_with_one_in_hand(world: CollisionWorld, arms: DualArm) -> None:
    rng = np.random.default_rng(0)
    pieces = [rng.normal(size=(30, 3)) * [0.04, 0.06, 0.3] + [0.1 * k, 0.0, 0.0] for k in range(4)]
    world.set_object(pieces)
    free, unsure = agree(world, arms, 1500, 1)
    assert free > 50
    assert unsure < 15
    world.place_object(pose((0.0, 0.1, 1.6)))
    world.allow([("object", "table"), ("object", "floor")])
    assert agree(world, arms, 1500, 2)[0] < free
    world.attach_object("left", pose((0.0, 0.0, 0.15)))
    world.allow(
        [("left/panda_hand", "object"), ("left/panda_leftfinger", "object"), ("left/panda_rightfinger", "object")]
    )
    world.set_fingers("left", 0.01)
    agree(world, arms, 1500, 3)
    world.remove_object()
    world.allow([])
    world.set_fingers("left", 0.04)
    agree(world, arms, 500, 4)


@pytest.mark.slow
def test_a_million_states(world: CollisionWorld, arms: DualArm) -> None:
    world.set_object([])
    for seed in range(20):
        agree(world, arms, 50_000, 100 + seed)


def test_an_object_larger_than_the_gripper_is_a_contact_with_a_name(world: CollisionWorld, arms: DualArm) -> None:
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    world.set_object([signs * 0.3])
    world.attach_object("left", pose((0.0, 0.0, 0.1)))
    contact = world.contact(arms.home)
    assert contact is not None
    assert "object" in (contact.a, contact.b)
    assert world.motion(["left"], arms.home).states(arms["left"].home[None])[0] == at.HIT
    world.set_object([])


def sometimes_apart(
    model: pin.Model, geometry: pin.GeometryModel, pairs: list[tuple[int, int]], q: np.ndarray
) -> list[tuple[int, int]]:
    """The pairs that are apart in half of the states, made active; the hulls of the others overlap by construction."""
    for pair in pairs:
        geometry.addCollisionPair(pin.CollisionPair(*pair))
    data, geometry_data = model.createData(), geometry.createData()
    hits = np.zeros(len(pairs))
    for row in q:
        pin.computeCollisions(model, data, geometry, geometry_data, row, False)
        hits += [result.isCollision() for result in geometry_data.collisionResults]
    kept = [pair for pair, count in zip(pairs, hits, strict=True) if count < len(q) / 2]
    geometry.removeAllCollisionPairs()
    for pair in kept:
        geometry.addCollisionPair(pin.CollisionPair(*pair))
    return kept


@pytest.mark.skipif(not X7S.is_file(), reason=f"{X7S} is absent")
def test_another_robot_is_read_from_its_urdf_alone() -> None:
    """The ARX X7s: both its arms on one trunk, against Coal on the same hulls."""
    model = pin.buildModelFromUrdf(str(X7S))
    geometry = pin.buildGeomFromUrdf(model, str(X7S), pin.GeometryType.COLLISION, package_dirs=[str(X7S.parent)])
    for shape in geometry.geometryObjects:
        if hasattr(shape.geometry, "buildConvexHull"):
            shape.geometry.buildConvexHull(True, "Qt")
            shape.geometry = shape.geometry.convex
    joints = [int(shape.parentJoint) for shape in geometry.geometryObjects]
    parents = [int(parent) for parent in model.parents]
    pairs = [
        (a, b)
        for b, jb in enumerate(joints)
        for a, ja in enumerate(joints[:b])
        if ja != jb and parents[ja] != jb and parents[jb] != ja
    ]
    low, high = np.asarray(model.lowerPositionLimit), np.asarray(model.upperPositionLimit)
    q = np.random.default_rng(0).uniform(low, high, (150, model.nq))
    pairs = sometimes_apart(model, geometry, pairs, q[:40])
    motion = Cell(robot(model, geometry, pairs), [], []).motion(range(model.nq), np.zeros(model.nq))
    data, geometry_data = model.createData(), geometry.createData()
    verdicts = motion.states(q)
    for row, verdict in zip(q, verdicts, strict=True):
        touches = pin.computeCollisions(model, data, geometry, geometry_data, row, True)
        assert not (touches and verdict == at.FREE)
        assert touches or verdict != at.HIT
    assert len(set(verdicts.tolist())) > 1
