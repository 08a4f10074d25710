"""Laws of both arms moving at once: paths are free everywhere and repeatable, refusals have a reason at once."""

from __future__ import annotations

import numpy as np
import pytest

from planners.both import BothPath, plan_both
from planners.collision import CollisionWorld
from planners.compiled.layout import FREE
from planners.motion import GoalInCollision, NoPath, OutOfLimits, StartInCollision
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


@pytest.mark.parametrize("seed", range(4))
def test_a_path_of_both_joins_its_ends_and_is_free_everywhere(world: CollisionWorld, arms: DualArm, seed: int) -> None:
    start, goal = free_states(world, arms, seed, 2)
    path = plan_both(world, arms, start, goal[None], seed=seed)
    assert isinstance(path, BothPath)
    assert np.array_equal(path.points[[0, -1]], [start, goal])
    for a, b in zip(path.points[:-1], path.points[1:], strict=True):
        for share in np.linspace(0.0, 1.0, 8):
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
