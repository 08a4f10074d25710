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
    MARGIN,
    REACH,
    TABLE_GAP,
    above_table,
    backed_off,
    centred,
    deepened,
    touching,
)
from affordance.grip import SPARE
from robots.spatial import hand_rotation, points
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
