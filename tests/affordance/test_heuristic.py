"""Laws of the privileged rules."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio as pin
import pytest

from affordance.candidates import Roles, SceneView
from affordance.heuristic import GRASP_DEPTH, TILT, HeuristicProposer
from robots.spatial import pose
from robots.workcell import Workcell
from worlds import observe, scene
from worlds.assets import library
from worlds.labels import truth

ROLES = Roles(assistant="left", primary="right")
CASES = (
    ("Bottle", "bottle-000"),
    ("Bottle", "bottle-002"),
    ("Dispenser", "dispenser-000"),
    ("Dispenser", "dispenser-001"),
)


@pytest.fixture(scope="module", params=CASES, ids=lambda case: case[1])
def asked(request: pytest.FixtureRequest, workcell: Workcell) -> Iterator[tuple[HeuristicProposer, SceneView]]:
    with scene.build(workcell, library.load("synthetic", *request.param), 3) as world:
        observation = observe.observe(world)
        proposer = HeuristicProposer("articulated", truth(world, observation), workcell.arm("left").gripper)
        yield proposer, SceneView(workcell, observation.cloud, pin.SE3.Identity(), np.zeros((0, 3)))


def test_goals_approach_along_the_functional_direction(asked: tuple[HeuristicProposer, SceneView]) -> None:
    proposer, view = asked
    goals = proposer.goal(view, np.random.default_rng(0))
    axis = proposer.truth.T_world_body.rotation @ proposer.truth.part.axis
    assert goals
    for goal in goals:
        assert goal.T_world_hand.rotation[:, 2] @ goal.outward == pytest.approx(-1.0)
        assert abs(goal.outward @ axis) == pytest.approx(1.0)
        assert goal.kind == proposer.truth.part.kind
        assert goal.amount > 0.0


def test_goals_move_rigidly_with_the_object(asked: tuple[HeuristicProposer, SceneView]) -> None:
    proposer, view = asked
    T_move = pose((0.1, -0.2, 0.3), (0.4, 0.2, -1.0))
    before = proposer.goal(view, np.random.default_rng(1))
    after = proposer.goal(view.moved(T_move, np.zeros((0, 3))), np.random.default_rng(1))
    assert len(before) == len(after)
    for old, new in zip(before, after, strict=True):
        along = T_move.rotation @ old.direction
        assert np.allclose(new.direction, along, atol=1e-9)
        assert np.allclose(new.point, T_move.act(old.point), atol=1e-9)


def test_pregrasps_come_from_above_and_open_across_the_object(asked: tuple[HeuristicProposer, SceneView]) -> None:
    proposer, view = asked
    goal = proposer.goal(view, np.random.default_rng(0))[0]
    grasps = proposer.pregrasp(view, goal, np.random.default_rng(0))
    axis = proposer.truth.T_world_body.rotation @ proposer.truth.long_axis
    assert grasps
    assert [grasp.score for grasp in grasps] == sorted((grasp.score for grasp in grasps), reverse=True)
    for grasp in grasps:
        R = grasp.T_world_hand.rotation
        assert -R[2, 2] >= np.cos(TILT) - 1e-9
        assert abs(R[:, 1] @ axis) < 0.1
        tcp = grasp.T_world_hand.act(np.array([0.0, 0.0, proposer.gripper.tcp_offset]))
        assert tcp[2] > view.cloud[:, 2].max() - GRASP_DEPTH - 0.03
        assert tcp[2] > view.workcell.table.top


def test_object_poses_turn_the_part_towards_the_primary(asked: tuple[HeuristicProposer, SceneView]) -> None:
    proposer, view = asked
    rng = np.random.default_rng(0)
    goal = proposer.goal(view, rng)[0]
    grasp = proposer.pregrasp(view, goal, rng)[0]
    base = np.asarray(view.workcell.placement("right").base_xyz)
    for candidate in proposer.object_pose(view, goal, grasp, ROLES, rng)[:8]:
        facing = candidate.T_move.rotation @ goal.outward
        at = candidate.T_move.act(goal.point)
        assert facing[:2] @ (base - at)[:2] > 0.0
        assert np.allclose(candidate.T_move.rotation @ candidate.T_move.rotation.T, np.eye(3), atol=1e-9)


def test_reorient_keeps_the_object_in_the_hand(asked: tuple[HeuristicProposer, SceneView]) -> None:
    proposer, view = asked
    rng = np.random.default_rng(0)
    goal = proposer.goal(view, rng)[0]
    grasp = proposer.pregrasp(view, goal, rng)[0]
    candidate = proposer.object_pose(view, goal, grasp, ROLES, rng)[0]
    T_world_object = pose(view.cloud.mean(axis=0))
    before = grasp.T_world_hand.inverse() * T_world_object
    after = proposer.reorient(grasp, candidate).inverse() * (candidate.T_move * T_world_object)
    assert np.allclose(before.homogeneous, after.homogeneous, atol=1e-9)


def test_the_same_rng_proposes_the_same(asked: tuple[HeuristicProposer, SceneView]) -> None:
    proposer, view = asked
    first, second = (proposer.goal(view, np.random.default_rng(7)) for _ in range(2))
    assert all(
        np.array_equal(a.T_world_hand.homogeneous, b.T_world_hand.homogeneous)
        for a, b in zip(first, second, strict=True)
    )
