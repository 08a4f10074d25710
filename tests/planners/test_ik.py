"""Laws of inverse kinematics: what it returns is there, and what it misses is said with a distance."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from planners import ik
from robots.model import DualArm
from robots.spatial import angle_between, pose
from robots.workcell import SIDES, Side


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**31), side=st.sampled_from(SIDES))
def test_forward_kinematics_of_every_solution_is_the_pose(arms: DualArm, seed: int, side: Side) -> None:
    arm, rng = arms[side], np.random.default_rng(seed)
    wanted = arm.hand(rng.uniform(arm.lower, arm.upper))
    solved = ik.solve(arm, wanted, rng=rng, restarts=24, wanted=3)
    for q in solved.solutions if isinstance(solved, ik.Reached) else ():
        assert arm.within_limits(q)
        reached = arm.hand(q)
        assert np.linalg.norm(reached.translation - wanted.translation) < ik.POSITION_TOLERANCE
        assert angle_between(reached.rotation, wanted.rotation) < ik.ROTATION_TOLERANCE


def test_nearly_every_pose_that_can_be_reached_is_reached(arms: DualArm) -> None:
    """Poses of random configurations, some with joints close to their limits, where the few misses are."""
    arm, rng, reached = arms["right"], np.random.default_rng(5), 0
    for _ in range(200):
        wanted = arm.hand(rng.uniform(arm.lower, arm.upper))
        reached += isinstance(ik.solve(arm, wanted, rng=rng, wanted=1), ik.Reached)
    assert reached >= 194


def test_solutions_are_distinct_and_nearest_first(arms: DualArm) -> None:
    arm, rng = arms["left"], np.random.default_rng(4)
    origin = rng.uniform(arm.lower, arm.upper)
    solved = ik.solve(arm, arm.hand(origin), rng=rng, seeds=[origin], restarts=60, wanted=6)
    assert isinstance(solved, ik.Reached)
    assert len(solved.solutions) > 1
    steps = [float(np.abs(q - origin).max()) for q in solved.solutions]
    assert steps == sorted(steps)
    for k, a in enumerate(solved.solutions):
        for b in solved.solutions[:k]:
            assert np.abs(a - b).max() > ik.DISTINCT


def test_a_pose_out_of_reach_is_missed_by_at_least_the_excess(arms: DualArm) -> None:
    arm = arms["right"]
    far = pose(arm.base + np.array([1.5, 0.0, 0.0]))
    missed = ik.solve(arm, far, rng=np.random.default_rng(0))
    assert isinstance(missed, ik.Missed)
    assert missed.gap > 0.35
    assert str(missed) == f"unreachable by {1e3 * missed.gap:.0f} mm"


def test_the_same_draws_give_the_same_solutions(arms: DualArm) -> None:
    arm = arms["left"]
    wanted = arm.hand(np.array([0.3, 0.2, -0.1, -1.8, 0.2, 2.0, 0.5]))
    first, second = (ik.solve(arm, wanted, rng=np.random.default_rng(9)) for _ in range(2))
    assert isinstance(first, ik.Reached)
    assert isinstance(second, ik.Reached)
    assert np.array_equal(first.solutions, second.solutions)
