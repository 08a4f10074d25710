"""Laws of laying a drawn hand onto what was seen."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from affordance.fitting import (
    ASIDE,
    BACK,
    BELOW,
    INSIDE,
    LARGEST_LID,
    MARGIN,
    PUSHED_ASIDE,
    PUSHED_ON,
    REACH,
    TABLE_GAP,
    above_table,
    backed_off,
    behind,
    centred,
    deepened,
    farthest_push,
    hinge_of,
    middle_of,
    touching,
    unevenness,
)
from affordance.grip import FINGER_THICK, SPARE
from affordance.preparing import BESIDE, near_edge
from robots.spatial import hand_rotation, points, rotation_about
from robots.workcell import load_workcell

GRIPPER = load_workcell("panda_pair").arm("left").gripper
DOWN = hand_rotation([0.0, 0.0, -1.0], [0.0, 1.0, 0.0])


def above(tip: tuple[float, float, float]) -> pin.SE3:
    """A hand that points down with its tips at ``tip``."""
    x, y, z = tip
    return pin.SE3(DOWN, np.array([x, y, z + GRIPPER.tip_offset]))


def bar(width: float, top: float, middle: float = 0.0) -> np.ndarray:
    """Points of a bar along x, seen from above."""
    x, y = np.meshgrid(np.linspace(-0.05, 0.05, 41), middle + np.linspace(-width / 2, width / 2, 21))
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, top)])


@given(st.floats(-0.014, 0.014), st.floats(0.004, 0.05))
def test_fingers_are_centred_about_what_is_between_them(middle: float, width: float) -> None:
    T, opening = centred(above((0.0, 0.0, 0.01)), 0.02, bar(width, 0.02, middle), GRIPPER)
    if width / 2 + abs(middle) > GRIPPER.finger_travel:
        return  # part of the bar lies beyond the open fingers
    seen = points(T.inverse(), bar(width, 0.02, middle))[:, 1]
    assert seen.max() + seen.min() == pytest.approx(0.0, abs=1e-9)
    assert opening >= width / 2 + MARGIN - 1e-9
    assert opening >= 0.02 or opening == pytest.approx(width / 2 + MARGIN)


def test_a_hand_that_cannot_be_centred_stays() -> None:
    T = above((0.0, 0.0, 0.01))
    wide, aside = bar(0.079, 0.02), bar(0.004, 0.02, ASIDE + 0.01)
    level = pin.SE3(hand_rotation([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]), np.zeros(3))
    for hand, cloud in ((T, wide), (T, aside), (T, bar(0.02, 0.5)), (level, bar(0.02, 0.0))):
        moved, opening = centred(hand, 0.03, cloud, GRIPPER)
        assert np.array_equal(moved.homogeneous, hand.homogeneous)
        assert opening == 0.03


@given(st.floats(-0.015, 0.015))
def test_closed_tips_come_to_the_surface(gap: float) -> None:
    moved = touching(above((0.0, 0.0, 0.03 + gap)), 0.0, bar(0.04, 0.03), GRIPPER)
    assert moved.act(np.array([0.0, 0.0, GRIPPER.tip_offset]))[2] == pytest.approx(0.03, abs=1e-9)


def test_open_tips_stop_at_the_higher_of_two_steps() -> None:
    steps = np.concatenate([bar(0.02, 0.03, 0.025), bar(0.02, 0.033, -0.025)])
    moved = touching(above((0.0, 0.0, 0.025)), 0.02, steps, GRIPPER)
    assert moved.act(np.array([0.0, 0.0, GRIPPER.tip_offset]))[2] == pytest.approx(0.033)


def test_tips_far_from_anything_stay() -> None:
    T = above((0.0, 0.0, 0.03 + REACH + 0.005))
    assert np.array_equal(touching(T, 0.0, bar(0.04, 0.03), GRIPPER).homogeneous, T.homogeneous)


@given(st.floats(-0.05, 0.10))
def test_tips_are_kept_off_the_table(height: float) -> None:
    low = above_table(above((0.0, 0.0, height)), 0.0, GRIPPER)
    assert low.act(np.array([0.0, 0.0, GRIPPER.tip_offset]))[2] == pytest.approx(max(height, TABLE_GAP))


@given(st.floats(-0.03, 0.03))
def test_open_fingers_are_drawn_back_from_what_they_would_meet(deep: float) -> None:
    """A shoulder beside a narrow part, ``deep`` above the tips."""
    shoulder = np.concatenate([bar(0.01, 0.05), bar(0.02, 0.02, 0.03), bar(0.02, 0.02, -0.03)])
    free = backed_off(above((0.0, 0.0, 0.02 - deep)), 0.02, shoulder, GRIPPER)
    if deep > BACK - SPARE:
        assert free is None
        return
    assert free is not None
    tip = free.act(np.array([0.0, 0.0, GRIPPER.tip_offset]))[2]
    assert tip >= 0.02
    assert tip == pytest.approx(0.02 - deep) or tip <= 0.022


@given(st.floats(-0.015, 0.05))
def test_tips_reach_as_far_past_the_front_as_is_wanted(past: float) -> None:
    T = above((0.0, 0.0, 0.03 - past))
    moved = deepened(T, 0.02, bar(0.02, 0.03), GRIPPER, 0.02)
    tip = moved.act(np.array([0.0, 0.0, GRIPPER.tip_offset]))[2]
    assert tip == pytest.approx(min(0.03 - past, 0.01))
    aside = bar(0.02, 0.03) + np.array([0.2, 0.0, 0.0])
    nothing = deepened(T, 0.02, aside, GRIPPER, 0.02)
    assert np.array_equal(nothing.homogeneous, T.homogeneous)


AHEAD = np.array([1.0, 0.0, 0.0])
"""The way things are pushed in these tests; fingers of ``above`` open across it."""


def slab(
    turn: float = 0.0, at: tuple[float, float] = (0.0, 0.0), size: tuple[float, float] = (0.10, 0.16)
) -> np.ndarray:
    """Points of a slab on a table, seen from above, turned by an angle [rad] about its middle."""
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 101) * size[0], np.linspace(-0.5, 0.5, 161) * size[1])
    flat = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 0.02)])
    return np.asarray(flat @ rotation_about([0.0, 0.0, 1.0], turn).T + np.array([*at, 0.0]))


@given(st.floats(-0.9 * PUSHED_ASIDE, 0.9 * PUSHED_ASIDE), st.floats(-0.9 * PUSHED_ON, 0.9 * PUSHED_ON))
def test_pushing_fingers_come_to_touch_an_object_about_its_middle(aside: float, short: float) -> None:
    cloud = slab(at=(0.3, 0.1))
    drawn = above((0.25 - BESIDE - short, 0.1 + aside, 0.008))
    T = behind(drawn, 0.02, AHEAD, cloud, GRIPPER)
    tip = T.act(np.array([0.0, 0.0, GRIPPER.tip_offset]))
    assert tip == pytest.approx([0.25 - BESIDE, 0.1, 0.008], abs=1e-6)
    assert np.array_equal(T.rotation, drawn.rotation)
    assert unevenness(T, 0.02, AHEAD, cloud, GRIPPER) == pytest.approx(0.0, abs=1e-9)


def test_fingers_meant_for_elsewhere_do_not_come() -> None:
    cloud = slab()
    for drawn in (above((-0.05 - BESIDE - 2.0 * PUSHED_ON, 0.0, 0.008)), above((-0.2, 0.5, 0.008))):
        T = behind(drawn, 0.02, AHEAD, cloud, GRIPPER)
        assert np.allclose(T.homogeneous, drawn.homogeneous)


def test_of_two_fingers_behind_a_turned_object_one_comes_first() -> None:
    turn, opening = 0.2, 0.03
    T = behind(above((-0.07, 0.0, 0.008)), opening, AHEAD, slab(turn), GRIPPER)
    apart = 2.0 * (opening + 0.5 * FINGER_THICK)
    assert unevenness(T, opening, AHEAD, slab(turn), GRIPPER) == pytest.approx(apart * np.tan(turn), abs=0.003)
    beside = above((-0.07, 0.2, 0.008))
    assert unevenness(beside, opening, AHEAD, slab(), GRIPPER) == np.inf


def test_the_middle_is_that_of_the_outline_and_not_of_the_points() -> None:
    cloud = slab(at=(0.3, 0.1))
    dense = np.concatenate([cloud, cloud[cloud[:, 0] > 0.32], cloud[cloud[:, 0] > 0.33]])
    assert dense[:, 0].mean() > 0.305
    assert middle_of(dense) == pytest.approx([0.3, 0.1, 0.02], abs=1e-9)
    assert middle_of(cloud[:2]) == pytest.approx(cloud[:2].mean(axis=0))
    line = np.linspace([0.0, 0.0, 0.0], [0.1, 0.0, 0.0], 9)
    assert middle_of(line) == pytest.approx([0.05, 0.0, 0.0])


@given(st.floats(0.012, 0.04), st.sampled_from([-1.0, 1.0]), st.floats(-3.0, 3.0))
def test_a_lid_turns_about_its_edge_and_opens_towards_the_hand(half: float, side: float, yaw: float) -> None:
    R = rotation_about([0.0, 0.0, 1.0], yaw) @ DOWN
    T = pin.SE3(R, np.array([0.3, 0.1, 0.1 + GRIPPER.tip_offset]))
    x, y = np.meshgrid(np.linspace(-half, half, 41), np.linspace(-0.012, 0.012, 13))
    lid = points(T, np.column_stack([x.ravel(), y.ravel(), np.full(x.size, GRIPPER.tip_offset - 0.01)]))
    axis, hinge = hinge_of(T, 0.02, side, lid, GRIPPER)
    assert hinge == pytest.approx([side * half, 0.0, GRIPPER.tip_offset + BELOW], abs=1e-6)
    front = np.array([-side * half, 0.0, GRIPPER.tip_offset])
    assert np.cross(axis, front - hinge)[2] < 0.0  # the hand's z points from the hand to the lid
    assert np.linalg.norm(axis) == pytest.approx(1.0) and axis[1] == pytest.approx(-side)


def test_a_lid_of_which_nothing_is_seen_has_its_hinge_at_the_pads_and_none_is_endless() -> None:
    T = above((0.0, 0.0, 0.1))
    far = np.array([[0.0, 0.0, 0.5]])
    assert abs(hinge_of(T, 0.02, 1.0, far, GRIPPER)[1][0]) == pytest.approx(0.010)
    wide = slab() + np.array([0.0, 0.0, 0.08])
    assert abs(hinge_of(T, 0.02, -1.0, wide, GRIPPER)[1][0]) == pytest.approx(LARGEST_LID)


@given(st.floats(-0.3, 0.2), st.floats(-1.2, 1.2))
def test_no_push_takes_the_middle_of_an_object_over_the_edge(start: float, off: float) -> None:
    edge = near_edge(load_workcell("panda_pair").table)
    heading = rotation_about([0.0, 0.0, 1.0], off) @ edge.outward
    cloud = slab() + edge.at * edge.outward + start * edge.outward
    far = farthest_push(heading, cloud, edge)
    assert float((middle_of(cloud) + far * heading) @ edge.outward) == pytest.approx(edge.at - INSIDE, abs=1e-6)
    assert farthest_push(-edge.outward, cloud, edge) == np.inf
