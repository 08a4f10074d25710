"""Laws of both arms moving at once: paths are free everywhere and repeatable, refusals have a reason at once."""

from __future__ import annotations

import numpy as np
import pytest

from planners.both import BothPath, plan_both
from planners.certify import Certificate, certify_together
from planners.collision import CollisionWorld
from planners.compiled.layout import FREE
from planners.motion import GoalInCollision, NoPath, OutOfLimits, StartInCollision
from planners.timing import Together, retime_together
from robots.model import DualArm
from robots.spatial import Array, pose
from robots.workcell import SIDES, Workcell


@pytest.fixture(scope="module")
def world(workcell: Workcell) -> CollisionWorld:
    return CollisionWorld(workcell)


def free_states(world: CollisionWorld, arms: DualArm, seed: int, count: int) -> list[Array]:
    rng, found = np.random.default_rng(seed), []
    lower, upper = (np.concatenate([getattr(arms[side], end) for side in SIDES]) for end in ("lower", "upper"))
    while len(found) < count:
        q = rng.uniform(lower + 0.05, upper - 0.05)
        if world.free(q):
            found.append(q)
    return found


@pytest.fixture(scope="module")
def crowded(workcell: Workcell) -> CollisionWorld:
    """Twelve boxes above the table."""
    made, rng = CollisionWorld(workcell), np.random.default_rng(0)
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    middles = rng.uniform([-0.5, -0.5, 0.1], [0.5, 0.4, 0.8], (12, 3))
    made.set_object([middle + signs * rng.uniform(0.02, 0.07, 3) for middle in middles])
    made.place_object(pose((0.0, 0.0, 0.0)))
    made.allow([("object", "table"), ("object", "floor")])
    return made


def test_paths_of_both_join_their_ends_are_free_and_keep_limits_when_timed(
    crowded: CollisionWorld, arms: DualArm, workcell: Workcell
) -> None:
    corners, models = [], (workcell.arm("left"), workcell.arm("right"))
    for seed in range(5):
        start, goal = free_states(crowded, arms, seed, 2)
        path = plan_both(crowded, arms, start, goal[None], seed=seed)
        assert isinstance(path, BothPath)
        corners.append(len(path.points) > 2)
        judged(crowded, arms, path, start, goal, seed)
        curve = retime_together(path.points, models)
        assert isinstance(curve, Together)
        proof = certify_together(crowded, arms, curve)
        assert isinstance(proof, Certificate)
        assert max(proof.max_velocity_ratio, proof.max_acceleration_ratio) <= 1.0 + 1e-9
    assert sum(corners) > 2


def judged(world: CollisionWorld, arms: DualArm, path: BothPath, start: Array, goal: Array, seed: int) -> None:
    assert np.array_equal(path.points[[0, -1]], [start, goal])
    for a, b in zip(path.points[:-1], path.points[1:], strict=True):
        for share in np.linspace(0.0, 1.0, 6):
            assert world.clearance(a + share * (b - a))[0] > 0.0
    again = plan_both(world, arms, start, goal[None], seed=seed)
    assert isinstance(again, BothPath)
    assert np.array_equal(path.points, again.points)
    assert np.array_equal(path.of("right").points, path.points[:, 7:])


def test_a_held_object_moves_with_its_hand(world: CollisionWorld, arms: DualArm) -> None:
    """A rod in the left hand: what is proven with it is free with it, and is not always what is proven without."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    world.set_object([signs * [0.02, 0.2, 0.02]])
    world.attach_object("left", pose((0.0, 0.0, 0.12)))
    fingers = [f"left/panda_{name}" for name in ("hand", "leftfinger", "rightfinger")]
    world.allow([(name, "object") for name in fingers])
    start, goal = free_states(world, arms, 3, 2)
    path = plan_both(world, arms, start, goal[None], seed=1)
    assert isinstance(path, BothPath)
    dense = np.concatenate([np.linspace(a, b, 6) for a, b in zip(path.points[:-1], path.points[1:], strict=True)])
    assert all(world.clearance(q)[0] > 0.0 for q in dense)
    proven = world.motion(SIDES, start).path(path.points, 0.6 * world.margin)[1]
    assert proven == FREE
    world.remove_object()
    world.allow([])
    world.set_object([])


def test_what_cannot_begin_or_end_is_refused_with_a_name(world: CollisionWorld, arms: DualArm) -> None:
    home = arms.home
    past, crossed = home.copy(), home.copy()
    past[10] = 0.5
    refused = plan_both(world, arms, home, past[None], seed=0)
    assert isinstance(refused, NoPath)
    assert isinstance(refused.reason, OutOfLimits)
    assert "right/panda_joint4" in str(refused)
    crossed[1] = 1.6
    refused = plan_both(world, arms, home, crossed[None], seed=0)
    assert isinstance(refused, NoPath)
    assert isinstance(refused.reason, GoalInCollision)
    refused = plan_both(world, arms, crossed, home[None], seed=0)
    assert isinstance(refused, NoPath)
    assert isinstance(refused.reason, StartInCollision)
    with pytest.raises(ValueError, match=r"\(14,\)"):
        plan_both(world, arms, home[:7], home[None], seed=0)
    with pytest.raises(ValueError, match="finite"):
        plan_both(world, arms, home, np.full((1, 14), np.nan), seed=0)
