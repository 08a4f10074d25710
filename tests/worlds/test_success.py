"""What counts as success and what does not, on staged states of the simulated cell."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from planners import ik
from robots.model import DualArm
from robots.spatial import Array, hand_rotation
from robots.workcell import Side, Workcell
from worlds import physics
from worlds.assets import library
from worlds.assets.shape import collision_vertices
from worlds.bullet.world import BulletWorld
from worlds.success import grips, holds, judge, judge_handover, judge_lift, overhang, part_motion
from worlds.tasks import task_of

BAR = library.load("synthetic", "Remote", "remote-000")
"""A long flat bar that two hands can hold side by side."""

DOWN, ACROSS = np.array([0.0, 0.0, -1.0]), np.array([0.0, 1.0, 0.0])
HEIGHT = 0.30
"""Where the bar is held above the table [m]."""


def frame_of_bar() -> tuple[pin.SE3, Array]:
    """``T_body_box``: the middle of the bar with x along, y through and z across it, and its extents [m]."""
    vertices = np.concatenate(list(collision_vertices(BAR).values()))
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    thin, wide, long = np.argsort(high - low)
    R = np.zeros((3, 3))
    R[long, 0], R[thin, 1] = 1.0, 1.0
    R[:, 2] = np.cross(R[:, 0], R[:, 1])
    return pin.SE3(R, 0.5 * (low + high)), np.array([(high - low)[long], (high - low)[thin], (high - low)[wide]])


def placed(arms: DualArm, side: Side, T_world_hand: pin.SE3) -> Array:
    """Joint positions ``(7,)`` [rad] of a hand pose."""
    found = ik.solve(
        arms[side], T_world_hand, rng=np.random.default_rng(0), seeds=[arms[side].home], restarts=40, wanted=1
    )
    assert isinstance(found, ik.Reached), found
    return np.asarray(found.solutions[0])


def hand_at(arms: DualArm, tcp: Array, approach: Array, opening_axis: Array) -> pin.SE3:
    """``T_world_hand`` with the tool centre point there."""
    R = hand_rotation(approach, opening_axis)
    return pin.SE3(R, tcp) * arms["left"].T_hand_tcp.inverse()


def wait(world: BulletWorld, seconds: float) -> None:
    for _ in range(int(seconds / physics.STEP)):
        world.step()


@contextmanager
def bar_held(workcell: Workcell, arms: DualArm, hands: dict[Side, float], middle: Array) -> Iterator[BulletWorld]:
    """The bar upright on its edge, gripped from above by hands at distances along it from its middle [m]."""
    T_body_box, extents = frame_of_bar()
    with BulletWorld(workcell, BAR) as world:
        world.put_object(pin.SE3(np.eye(3), middle) * T_body_box.inverse())
        for side, along in hands.items():
            tcp = middle + np.array([along, 0.0, 0.0])
            q = placed(arms, side, hand_at(arms, tcp, DOWN, ACROSS))
            world.put_arm(side, q, 0.5 * float(extents[1]) + 0.0015)
            world.command_fingers(side, 0.0, physics.GRIP_FORCE)
        wait(world, 0.5)
        yield world


@contextmanager
def bar_scooped(workcell: Workcell, arms: DualArm, side: Side) -> Iterator[BulletWorld]:
    """The bar lying flat on two open fingers that hold nothing."""
    T_body_box, extents = frame_of_bar()
    tcp = np.array([0.0, -0.1, HEIGHT])
    with BulletWorld(workcell, BAR) as world:
        level = np.array([1.0, 0.0, 0.0]) * (1.0 if side == "left" else -1.0)
        T_world_hand = hand_at(arms, tcp, level, ACROSS)
        world.put_arm(side, placed(arms, side, T_world_hand), workcell.arm(side).gripper.finger_travel)
        R = np.column_stack([ACROSS, [0.0, 0.0, 1.0], np.cross(ACROSS, [0.0, 0.0, 1.0])])
        above = np.array([0.0, 0.0, 0.014 + 0.5 * float(extents[1])])
        world.put_object(pin.SE3(R, tcp + above - 0.02 * level) * T_body_box.inverse())
        wait(world, 0.6)
        yield world


AIR = np.array([0.0, -0.05, HEIGHT])
TASK = task_of("Remote")


# -- lifted by the primary alone -------------------------------------------------------------------------------------


def test_a_bar_gripped_by_the_primary_alone_is_lifted(workcell: Workcell, arms: DualArm) -> None:
    with bar_held(workcell, arms, {"right": 0.0}, AIR) as world:
        assert holds(world, "right")
        assert grips(world, "right")
        assert not holds(world, "left")
        verdict = judge_lift(world, TASK, "right", rise=0.12, slip=0.002)
        assert verdict.success, verdict.reason
        assert verdict.width == pytest.approx(frame_of_bar()[1][1], abs=0.003)
        for rise, slip, dropped, words in (
            (0.099, 0.002, False, "object rose 99 mm, 100 needed"),
            (0.12, 0.011, False, "object slipped 11 mm in the hand, 10 allowed"),
            (0.12, 0.002, True, "the right fingers do not grip the object"),
        ):
            refused = judge_lift(world, TASK, "right", rise=rise, slip=slip, dropped=dropped)
            assert not refused.success
            assert refused.reason.startswith(words)
        assert not judge_lift(world, TASK, "left", rise=0.12, slip=0.0).success


def test_a_bar_that_both_hands_hold_is_not_lifted_by_the_primary_alone(workcell: Workcell, arms: DualArm) -> None:
    with bar_held(workcell, arms, {"left": -0.055, "right": 0.055}, AIR) as world:
        assert grips(world, "left")
        assert grips(world, "right")
        verdict = judge_lift(world, TASK, "right", rise=0.12, slip=0.0)
        assert (verdict.success, verdict.held, verdict.alone) == (False, True, False)
        assert verdict.reason == "something else still bears the object"


def test_a_bar_that_the_assistant_holds_is_not_lifted_by_the_primary(workcell: Workcell, arms: DualArm) -> None:
    with bar_held(workcell, arms, {"left": 0.0}, AIR) as world:
        verdict = judge_lift(world, TASK, "right", rise=0.12, slip=0.0)
        assert (verdict.success, verdict.held, verdict.alone) == (False, False, False)


def test_a_bar_that_stands_on_the_table_is_not_lifted(workcell: Workcell, arms: DualArm) -> None:
    on_table = np.array([0.0, 0.0, workcell.table.top + 0.5 * float(frame_of_bar()[1][2]) + 0.0005])
    with bar_held(workcell, arms, {"right": 0.0}, on_table) as world:
        assert grips(world, "right")
        assert world.supported()
        verdict = judge_lift(world, TASK, "right", rise=0.12, slip=0.0)
        assert (verdict.success, verdict.held, verdict.alone) == (False, True, False)


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_bar_that_lies_on_open_fingers_is_scooped_not_grasped(side: Side, workcell: Workcell, arms: DualArm) -> None:
    with bar_scooped(workcell, arms, side) as world:
        assert holds(world, side), "both fingers bear it"
        assert not world.supported()
        assert not grips(world, side)
        verdict = judge_lift(world, TASK, side, rise=0.12, slip=0.0)
        assert (verdict.success, verdict.held, verdict.alone) == (False, False, True)
        assert "80 mm apart" in verdict.reason


def test_a_hand_that_closes_beside_the_bar_grips_nothing(workcell: Workcell, arms: DualArm) -> None:
    with bar_held(workcell, arms, {"right": 0.0}, AIR) as world:
        world.command_fingers("right", 0.04, physics.OPEN_FORCE)
        wait(world, 1.0)
        world.command_fingers("right", 0.0, physics.GRIP_FORCE)
        wait(world, 1.0)
        assert not holds(world, "right")
        assert not judge_lift(world, TASK, "right", rise=0.12, slip=0.0).success


def test_overhang_is_how_far_the_true_object_reaches_over_an_edge(workcell: Workcell) -> None:
    table = workcell.table
    T_body_box, extents = frame_of_bar()
    with BulletWorld(workcell, BAR) as world:
        for beyond in (-0.05, 0.03):
            middle = np.array([0.0, table.centre[1] - table.size[1] / 2 - beyond, table.top + 0.05])
            R = np.column_stack([ACROSS, [0.0, 0.0, 1.0], np.cross(ACROSS, [0.0, 0.0, 1.0])])
            world.put_object(pin.SE3(R, middle) * T_body_box.inverse())
            assert overhang(world) == pytest.approx(beyond + 0.5 * extents[0], abs=1e-6)


# -- operated while the assistant holds ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def bottle_in_hand(workcell: Workcell, arms: DualArm) -> Iterator[tuple[BulletWorld, pin.SE3]]:
    """A bottle that the left hand grips level, and ``T_hand_body``."""
    asset = library.load("synthetic", "Bottle", "bottle-000")
    vertices = collision_vertices(asset)["body"]
    tcp = np.array([0.0, 0.0, HEIGHT])
    R = hand_rotation(asset.long_axis, [1.0, 0.0, 0.0])  # columns: the bottle's frame with z along it
    centre = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    half = float(np.abs(((vertices - centre) @ R)[:, :2]).max())
    upright = pin.SE3(np.eye(3), tcp) * pin.SE3(R, centre).inverse()
    with BulletWorld(workcell, asset) as world:
        world.put_object(upright)
        T_world_hand = hand_at(arms, tcp - [max(0.0, half - 0.03), 0.0, 0.0], np.array([1.0, 0.0, 0.0]), ACROSS)
        world.put_arm("left", placed(arms, "left", T_world_hand), min(0.04, half + 0.0015))
        world.command_fingers("left", 0.0, physics.GRIP_FORCE)
        wait(world, 0.5)
        yield world, in_hand(world, arms)


def in_hand(world: BulletWorld, arms: DualArm) -> pin.SE3:
    return arms["left"].hand(world.arm_positions("left")).inverse() * world.object_pose()


def test_a_bottle_is_opened_when_its_lid_moved_and_the_assistant_held_it(
    bottle_in_hand: tuple[BulletWorld, pin.SE3],
) -> None:
    world, T = bottle_in_hand
    part, task = world.asset.part, task_of("Bottle")
    assert part_motion(world) == pytest.approx(0.0, abs=1e-3)
    opened = judge(world, task, "left", T, T, peak_moved=part.threshold, peak_force=5.0)
    assert opened.success, opened.reason


SLIPPED, TURNED = (
    pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.021])),
    pin.SE3(pin.exp3(np.array([0.36, 0.0, 0.0])), np.zeros(3)),
)


@pytest.mark.parametrize(
    ("change", "share", "assistant", "words"),
    [
        (pin.SE3.Identity(), 0.99, "left", "joint moved"),
        (SLIPPED, 1.0, "left", "object slipped 21 mm in the hand, 20 allowed"),
        (TURNED, 1.0, "left", "object turned 21 deg in the hand, 20 allowed"),
        (pin.SE3.Identity(), 1.0, "right", "the assistant no longer holds the object"),
    ],
    ids=["lid still", "slipped", "turned", "not held"],
)
def test_a_bottle_is_not_opened(
    bottle_in_hand: tuple[BulletWorld, pin.SE3], change: pin.SE3, share: float, assistant: Side, words: str
) -> None:
    world, T = bottle_in_hand
    moved = share * world.asset.part.threshold
    verdict = judge(world, task_of("Bottle"), assistant, T * change, T, peak_moved=moved, peak_force=5.0)
    assert not verdict.success
    assert verdict.reason.startswith(words)


# -- handed over -----------------------------------------------------------------------------------------------------

GIVEN: dict[str, Any] = {"pull": 8.0, "facing": 0.1, "in_zone": True, "human_holds": True}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({}, ""),
        ({"pull": None}, "the assistant did not let go"),
        ({"pull": 4.9}, "let go at 4.9 N, 5 to 15 N wanted"),
        ({"pull": 15.1}, "let go at 15.1 N, 5 to 15 N wanted"),
        ({"facing": 0.61}, "the functional part points 35 deg away from the human, 34 allowed"),
        ({"in_zone": False}, "the object was not presented in the human's zone"),
        ({"human_holds": False}, "the human does not hold the object alone"),
    ],
    ids=lambda value: str(value) if isinstance(value, dict) else "",
)
def test_a_handover_needs_pull_zone_direction_and_a_human_that_holds(
    change: dict[str, Any], words: str, bar_with_human: BulletWorld
) -> None:
    verdict = judge_handover(bar_with_human, task_of("Handover-Bottle"), "left", **(GIVEN | change))
    assert verdict.success is (not words)
    assert verdict.reason == words


@pytest.fixture(scope="module")
def bar_with_human(workcell: Workcell, arms: DualArm) -> Iterator[BulletWorld]:
    """The bar in the air and out of the assistant's, the left, hand: the right one stands in for the human's."""
    with bar_held(workcell, arms, {"right": 0.0}, AIR) as world:
        yield world


def dropped(workcell: Workcell, arms: DualArm) -> Any:
    """The bar on the table, in nobody's hand."""
    return bar_held(workcell, arms, {}, np.array([0.0, 0.0, workcell.table.top + 0.06]))


def kept(workcell: Workcell, arms: DualArm) -> Any:
    """The bar in the assistant's hand as well."""
    return bar_held(workcell, arms, {"left": -0.055, "right": 0.055}, AIR)


@pytest.mark.parametrize(
    ("stage", "words"),
    [(kept, "the human does not hold the object alone"), (dropped, "the object touches table or floor")],
)
def test_a_handover_that_ends_on_the_table_or_in_both_hands_fails(
    stage: Callable[[Workcell, DualArm], Any], words: str, workcell: Workcell, arms: DualArm
) -> None:
    with stage(workcell, arms) as world:
        verdict = judge_handover(world, task_of("Handover-Bottle"), "left", **GIVEN)
        assert not verdict.success
        assert verdict.reason == words
