"""The planner's collision world against PyBullet's, which shares no code with it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from planners.collision import CollisionWorld
from robots.model import DualArm
from robots.spatial import Array, pose
from robots.workcell import SIDES, Workcell
from worlds.assets import library
from worlds.assets.shape import collision_vertices
from worlds.bullet.ghost import GhostCell

ROUNDING = 0.0021
"""PyBullet rounds both hulls of a pair by a millimetre [m]."""


@pytest.fixture(scope="module")
def ghost(workcell: Workcell) -> Iterator[GhostCell]:
    with GhostCell(workcell, library.load("synthetic", "Bottle", "bottle-003")) as cell:
        cell.place_object(pose((0.0, 0.0, -3.0)))
        yield cell


def nearest(ghost: GhostCell, q: Array) -> float:
    """Smallest distance that PyBullet sees, the object left out."""
    for side, part in zip(SIDES, (q[:7], q[7:]), strict=True):
        ghost.place_arm(side, part)
        ghost.place_fingers(side, (0.04, 0.04))
    pairs = [pair for pair in ghost.near() if "object" not in pair]
    return min((ghost.distance(pair) for pair in pairs), default=0.02)


def test_both_checkers_agree_on_random_states(workcell: Workcell, arms: DualArm, ghost: GhostCell) -> None:
    world, rng = CollisionWorld(workcell), np.random.default_rng(1)
    lower, upper = (np.concatenate([getattr(arms[s], end) for s in SIDES]) for end in ("lower", "upper"))
    hits = 0
    for _ in range(800):
        q = rng.uniform(lower, upper)
        ours, theirs = world.clearance(q)[0], nearest(ghost, q)
        hits += ours <= 0.0
        if ours > ROUNDING:
            assert theirs > 0.0, f"PyBullet sees {theirs}, we see {world.clearance(q)}"
        if theirs > 0.0:
            assert ours > -1e-4, f"we see {world.clearance(q)}, PyBullet {theirs}"
    assert 200 < hits < 780  # the draw has enough of both


def test_margin_contact_and_freedom_tell_the_same(workcell: Workcell, arms: DualArm) -> None:
    world, rng = CollisionWorld(workcell), np.random.default_rng(2)
    lower, upper = (np.concatenate([getattr(arms[s], end) for s in SIDES]) for end in ("lower", "upper"))
    for q in rng.uniform(lower, upper, (300, 14)):
        distance, a, b = world.clearance(q)
        contact = world.contact(q)
        assert world.free(q) == (contact is None) == (distance > world.margin)
        assert {a, b} <= world.names
        if contact is not None and distance < 0.0:
            assert contact.depth > 0.0


def test_home_is_free_and_a_hand_in_the_table_is_named(workcell: Workcell, arms: DualArm) -> None:
    world = CollisionWorld(workcell)
    assert world.free(arms.home)
    down = np.concatenate([[0.4, 0.9, 0.0, -1.2, 0.0, 2.1, 0.78], arms["right"].home])
    contact = world.contact(down)
    assert contact is not None
    assert {contact.a, contact.b} == {"left/panda_hand", "table"} or "table" in (contact.a, contact.b)
    assert contact.depth > 0.005
    assert "table" in str(contact)
    assert "mm deep" in str(contact)


def test_a_held_object_moves_with_the_hand_and_allowed_pairs_may_touch(workcell: Workcell, arms: DualArm) -> None:
    asset = library.load("synthetic", "Bottle", "bottle-003")
    vertices = np.concatenate(list(collision_vertices(asset).values()))
    world = CollisionWorld(workcell)
    world.set_object([vertices])
    grasp = pose((0.0, 0.0, 0.10))
    world.attach_object("left", grasp)
    fingers = [(f"left/panda_{finger}", "object") for finger in ("leftfinger", "rightfinger", "hand")]
    assert not world.free(arms.home)
    world.allow(fingers)
    assert world.free(arms.home)
    world.place_object(arms["left"].hand(arms["left"].home) * grasp)
    assert world.free(arms.home)
    moved = arms.home.copy()
    moved[0] += 0.4
    assert world.free(moved) or world.contact(moved) is not None
    world.remove_object()
    world.allow([])
    assert world.free(arms.home)


def test_a_flat_piece_is_refused(workcell: Workcell) -> None:
    with pytest.raises(ValueError, match="volume"):
        CollisionWorld(workcell).set_object([np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])])
