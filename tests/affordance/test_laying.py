"""Laws of what a drawn hand becomes: by what is done there, a goal action; with a way to go, a push or a press."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("torch", reason="torch is not installed")

from affordance.candidates import OperationKind, SceneView
from affordance.fitting import INSIDE, middle_of
from affordance.laying import MOVE_ON, OTHERWISE, TURN_ON, Meant, goal_on, hinged_otherwise, press_on, push_on
from affordance.networks import STROKE
from affordance.preparing import BEHIND, LEAST_PUSH, LIFT, near_edge
from affordance.settings import SCALE
from robots.spatial import hand_rotation, rotation_about
from robots.workcell import load_workcell

WORKCELL = load_workcell("panda_pair")
GRIPPER, TABLE = WORKCELL.arm("left").gripper, WORKCELL.table
EDGE = near_edge(TABLE)
DOWN = hand_rotation([0.0, 0.0, -1.0], [0.0, 1.0, 0.0])
TIPS = np.array([0.0, 0.0, GRIPPER.tip_offset])


def above(tip: np.ndarray) -> pin.SE3:
    """A hand that points down with its tips there."""
    return pin.SE3(DOWN, tip + np.array([0.0, 0.0, GRIPPER.tip_offset]))


def block(middle: np.ndarray, size: tuple[float, float], height: float) -> SceneView:
    """The upper side of a block on the table, as a camera above sees it."""
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 61) * size[0], np.linspace(-0.5, 0.5, 61) * size[1])
    cloud = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, height)]) + middle
    return SceneView(WORKCELL, cloud, pin.SE3.Identity(), np.zeros((0, 3)))


def at_table(back: float, height: float = 0.0, aside: float = 0.0) -> np.ndarray:
    """A point so far inside the table's edge, so high above its top."""
    up = np.array([0.0, 0.0, TABLE.top + height])
    return np.asarray((EDGE.at - back) * EDGE.outward + aside * EDGE.along + up)


LID = block(at_table(0.3), (0.03, 0.02), 0.10)
ON_LID = above(at_table(0.3, 0.095))


def meant(kind: OperationKind, amount: float = 0.5) -> Meant:
    """Something done along about the hand's approach, at a point a little aside."""
    along = np.array([0.1, 0.0, -0.995])
    return Meant(kind, along, along, np.array([0.02, 0.0, 0.01]), amount)


@pytest.mark.parametrize("kind", ["pull", "unscrew", "press", "flip", "grasp", "receive"])
def test_what_is_done_decides_where_which_way_and_how_far(kind: OperationKind) -> None:
    goal = goal_on(LID, ON_LID, 0.02, meant(kind), 0.7)
    assert goal is not None and goal.kind == kind and goal.score == 0.7
    T = goal.T_world_hand
    assert np.linalg.norm(goal.direction) == pytest.approx(1.0)
    assert goal.outward == pytest.approx(-T.rotation[:, 2])  # 6 deg off the approach: along it
    tips = T.act(TIPS)
    match kind:
        case "grasp":
            assert goal.direction.tolist() == [0.0, 0.0, 1.0] and goal.amount == LIFT
            assert goal.point == pytest.approx(T.act(np.array([0.0, 0.0, GRIPPER.tcp_offset])))
        case "unscrew":
            assert goal.point == pytest.approx(tips) and goal.amount == pytest.approx(0.5 * TURN_ON)
            assert goal.direction == pytest.approx(goal.outward)
        case "flip":
            assert goal.amount == pytest.approx(0.5 * TURN_ON)
            assert abs((T.inverse().act(goal.point))[0]) == pytest.approx(0.015, abs=1e-6)  # the lid's seen edge
            assert abs(goal.direction @ T.rotation[:, 1]) == pytest.approx(1.0)
        case _:
            assert goal.amount == pytest.approx(0.5 * STROKE + MOVE_ON)
            assert goal.direction == pytest.approx(goal.outward)
            assert goal.point == pytest.approx(T.act(TIPS + SCALE * np.array([0.02, 0.0, 0.01])))
    assert (goal.opening == 0.0) == (kind == "press")
    if kind == "press":
        assert tips[2] == pytest.approx(TABLE.top + 0.10, abs=1e-6)


def test_a_direction_far_from_every_axis_of_the_hand_stays() -> None:
    slanting = np.array([0.6, 0.0, -0.8])
    goal = goal_on(LID, ON_LID, 0.02, Meant("pull", slanting, slanting, np.zeros(3), 0.5), 1.0)
    assert goal is not None
    assert goal.direction == pytest.approx(goal.T_world_hand.rotation @ slanting)


def test_open_fingers_that_would_meet_the_object_make_no_goal() -> None:
    deep = above(at_table(0.3, 0.05))
    assert goal_on(block(at_table(0.3), (0.2, 0.2), 0.10), deep, 0.02, meant("pull"), 1.0) is None


def test_the_other_hinge_is_across_the_lid_and_opens_it_the_other_way() -> None:
    goal = goal_on(LID, ON_LID, 0.02, meant("flip"), 0.8)
    assert goal is not None
    other = hinged_otherwise(LID, goal)
    mine, its = (g.T_world_hand.inverse().act(g.point) for g in (goal, other))
    assert its == pytest.approx([-mine[0], mine[1], mine[2]])
    assert other.direction == pytest.approx(-goal.direction)
    assert other.score == pytest.approx(OTHERWISE * goal.score) and other.amount == goal.amount
    again = hinged_otherwise(LID, other)
    assert again.point == pytest.approx(goal.point) and again.direction == pytest.approx(goal.direction)


@given(st.floats(0.0, 0.4), st.floats(0.06, 0.3), st.booleans())
def test_a_push_goes_along_its_heading_and_never_too_far(length: float, back: float, from_behind: bool) -> None:
    view = block(at_table(back), (0.10, 0.10), 0.02)
    hand = above(at_table(back + 0.06, 0.01))
    pushed = push_on(view, EDGE, hand, 0.02, EDGE.outward, length, 0.6, from_behind=from_behind)
    room = back - INSIDE
    if min(length, room) < LEAST_PUSH - 1e-9:
        assert pushed is None
        return
    if pushed is None:
        assert min(length, room) < LEAST_PUSH + 1e-9
        return
    assert pushed.travel == pytest.approx(min(length, room) * EDGE.outward, abs=1e-6)
    assert float((middle_of(view.cloud) + pushed.travel) @ EDGE.outward) <= EDGE.at - INSIDE + 1e-6
    assert np.array_equal(pushed.T_move.translation, pushed.travel)
    if from_behind:
        assert pushed.start == pytest.approx(-BEHIND * EDGE.outward)
        assert pushed.score == pytest.approx(0.6)  # both fingers meet a straight side at once
    else:
        assert pushed.start is None and pushed.score == 0.6


def test_fingers_that_meet_an_object_one_after_the_other_are_rated_down() -> None:
    straight = block(np.zeros(3), (0.16, 0.10), 0.02).cloud
    turned = straight @ rotation_about([0.0, 0.0, 1.0], 0.2).T + at_table(0.2)
    view = SceneView(WORKCELL, turned, pin.SE3.Identity(), np.zeros((0, 3)))
    pushed = push_on(view, EDGE, above(at_table(0.28, 0.01)), 0.03, EDGE.outward, 0.1, 0.6, from_behind=True)
    assert pushed is not None and 0.0 < pushed.score < 0.6 * np.exp(-0.5)  # one comes 14 mm after the other


def test_a_press_goes_straight_down_from_where_it_touches() -> None:
    view = block(at_table(0.2), (0.10, 0.10), 0.02)
    pressed = press_on(view, above(at_table(0.2, 0.03)), 0.0, 0.01, 0.4)
    assert pressed.travel.tolist() == [0.0, 0.0, -0.01] and pressed.score == 0.4 and pressed.start is None
    assert pressed.T_world_hand.act(TIPS)[2] == pytest.approx(TABLE.top + 0.02, abs=1e-6)
