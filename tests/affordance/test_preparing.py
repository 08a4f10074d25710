"""Laws of what the assistant may do without a grasp, and of the grasps that it makes possible; whoever proposes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from affordance.candidates import GoalCandidate, Proposer, SceneView
from affordance.heuristic import HeuristicProposer
from affordance.preparing import near_edge
from affordance.pressing import hull_corners, tilt_under
from affordance.uniform import UniformProposer, completed
from robots.workcell import Workcell
from tamp.verify.bodies import tilt_faults
from worlds import observe, scene
from worlds.assets import library
from worlds.assets.shape import collision_vertices
from worlds.labels import truth
from worlds.tasks import task_of

Asked = tuple[HeuristicProposer, UniformProposer, SceneView, np.ndarray]


def asked(workcell: Workcell, category: str, seed: int) -> Asked:
    """Both proposers, what they see of an object, and its true vertices in the world frame."""
    task, gripper = task_of(category), workcell.arm("left").gripper
    with scene.build(workcell, library.choose("synthetic", category, None, seed), seed) as world:
        observation = observe.observe(world)
        heuristic = HeuristicProposer(task.type, truth(world, observation), gripper)
        view = SceneView(workcell, observation.cloud, pin.SE3.Identity(), np.zeros((0, 3)))
        return heuristic, UniformProposer(task.type, gripper), view, world.object_vertices()


@pytest.fixture(scope="module", params=[("Phone", 0), ("Bowl", 2)], ids=lambda case: case[0])
def flat(request: pytest.FixtureRequest, workcell: Workcell) -> Iterator[Asked]:
    yield asked(workcell, *request.param)


@pytest.fixture(scope="module")
def plate(workcell: Workcell) -> Asked:
    return asked(workcell, "Plate", 0)


def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def goal_of(proposer: Proposer, view: SceneView) -> GoalCandidate:
    return proposer.goal(view, rng())[0]


def test_a_push_moves_the_object_level_over_the_near_edge_as_the_hand_goes(flat: Asked) -> None:
    proposer, _, view, vertices = flat
    edge = near_edge(view.workcell.table)
    found = proposer.push(view, goal_of(proposer, view), rng())
    assert found
    centre = proposer.truth.T_world_body.act(proposer.truth.centre)
    for push in found:
        assert push.travel[2] == 0.0
        assert push.travel @ edge.outward == pytest.approx(np.linalg.norm(push.travel))
        assert np.allclose(push.T_move.homogeneous, pin.SE3(np.eye(3), push.travel).homogeneous)
        assert float((vertices @ edge.outward).max()) + push.travel @ edge.outward > edge.at
        assert (centre + push.travel) @ edge.outward < edge.at, "it would fall"


def test_grasps_of_what_overhangs_come_from_beyond_the_edge_and_close_around_it(flat: Asked) -> None:
    proposer, _, view, _ = flat
    edge = near_edge(view.workcell.table)
    push = proposer.push(view, goal_of(proposer, view), rng())[0]
    grasps = proposer.goal(view.moved(push.T_move, np.zeros((0, 3))), rng())
    assert grasps
    for goal in grasps:
        assert goal.kind == "grasp"
        assert goal.amount >= 0.10
        assert goal.direction[2] == 1.0
        assert 0.0 < goal.opening <= proposer.gripper.finger_travel
        assert goal.point @ edge.outward > edge.at, "where the pads close is beyond the edge"


def test_a_press_is_expected_to_tilt_the_true_plate_about_its_foot(plate: Asked) -> None:
    proposer, _, view, _ = plate
    found = proposer.press(view, goal_of(proposer, view), rng())
    assert found
    part = proposer.truth
    library_plate = library.choose("synthetic", "Plate", None, 0)
    vertices = np.concatenate(list(collision_vertices(library_plate).values()))
    for press in found:
        assert press.travel[2] < 0.0
        assert np.allclose(press.travel[:2], 0.0)
        T_after = press.T_move * part.T_world_body
        assert tilt_faults(view.workcell.table, vertices, part.T_world_body, T_after) == []


def test_grasps_of_a_tilted_plate_are_on_its_raised_side(plate: Asked) -> None:
    proposer, _, view, _ = plate
    press = proposer.press(view, goal_of(proposer, view), rng())[0]
    tilted = view.moved(press.T_move, np.zeros((0, 3)))
    middle = press.T_move.act(proposer.truth.T_world_body.act(proposer.truth.centre))
    pressed = press.T_world_hand.translation - middle
    found = proposer.goal(tilted, rng())
    assert found
    for goal in found:
        assert (goal.point - middle)[:2] @ pressed[:2] < 0.0
        assert goal.point[2] > view.workcell.table.top + 0.005


def test_random_pushes_are_level_and_random_presses_go_down(flat: Asked, plate: Asked) -> None:
    _, uniform, view, _ = flat
    for push in uniform.push(view, goal_of(uniform, view), rng()):
        assert push.travel[2] == 0.0
        assert np.allclose(push.T_move.translation, push.travel)
        assert np.linalg.norm(view.cloud - push.T_world_hand.translation, axis=1).min() < 0.2
    _, uniform, view, _ = plate
    for press in uniform.press(view, goal_of(uniform, view), rng()):
        assert press.travel[2] < 0.0
        assert abs(pin.log3(press.T_move.rotation)[2]) < 1e-9


def test_random_grasps_close_on_seen_points_or_what_they_hide(flat: Asked) -> None:
    _, uniform, view, _ = flat
    solid, found = completed(view), uniform.goal(view, rng())
    assert found
    assert len(solid) >= len(view.cloud)
    assert solid[:, 2].min() >= view.workcell.table.top
    for goal in found:
        x, y, z = ((solid - goal.T_world_hand.translation) @ goal.T_world_hand.rotation).T
        between = (np.abs(x) < 0.012) & (np.abs(y) < goal.opening) & (z < uniform.gripper.tip_offset) & (z > 0.05)
        assert between.any()


def test_the_same_draws_give_the_same_candidates(flat: Asked) -> None:
    heuristic, uniform, view, _ = flat
    for proposer in (heuristic, uniform):
        first, second = (proposer.goal(view, rng()) for _ in range(2))
        assert [goal.T_world_hand.homogeneous.tolist() for goal in first] == [
            goal.T_world_hand.homogeneous.tolist() for goal in second
        ]


def dish(foot: float, rim: float, height: float, knee: float = 0.0) -> np.ndarray:
    """Points of a dish's profile: its wall, 4 mm thick, goes up from the foot, with a knee half-way if wanted."""
    middle = 0.5 * (foot + rim)
    out = np.linspace(foot, rim, 60)
    low = np.interp(out, [foot, middle, rim], [0.0, 0.5 * height - knee, height])
    level = np.linspace(-rim, foot, 60)
    return np.concatenate(
        [np.column_stack([x, z + lift]) for x, z in ((out, low), (level, 0.0 * level)) for lift in (0.0, 0.004)]
    )


@given(
    foot=st.floats(0.04, 0.07),
    wide=st.floats(0.03, 0.06),
    height=st.floats(0.012, 0.03),
    knee=st.floats(0.0, 0.005),
    share=st.floats(0.2, 0.9),
)
def test_a_pressed_dish_rolls_on_the_table_and_not_into_it(
    foot: float, wide: float, height: float, knee: float, share: float
) -> None:
    profile = dish(foot, foot + wide, height, knee)
    corners = hull_corners(profile)
    assert corners[0] == pytest.approx([foot, 0.0]) and corners[-1, 0] == pytest.approx(foot + wide)
    tilt = tilt_under(profile, corners, foot + share * wide)
    if tilt is None:
        return
    c, s = np.cos(tilt.angle), np.sin(tilt.angle)
    moved = profile @ np.array([[c, s], [-s, c]]).T + tilt.moved
    assert moved[:, 1].min() == pytest.approx(0.0, abs=1e-3)  # a corner too close to the one before is left out
    assert tilt.last < tilt.first
    assert tilt.doubt >= 0.0


def test_a_dish_pressed_at_its_rim_lands_on_the_rim() -> None:
    """From the foot at 60 mm to a rim 20 mm high at 100 mm the slope is 26.6 deg, and nothing turns it further."""
    profile = dish(0.060, 0.100, 0.020)
    tilt = tilt_under(profile, hull_corners(profile), 0.091)
    assert tilt is not None
    assert tilt.angle == pytest.approx(np.arctan2(0.020, 0.040), abs=1e-6)
    assert tilt.doubt == pytest.approx(0.0, abs=1e-6)


def test_a_dish_pressed_above_its_foot_does_not_turn() -> None:
    profile = dish(0.060, 0.100, 0.020)
    assert tilt_under(profile, hull_corners(profile), 0.045) is None
