"""Whether the assistant can grasp and lift the object, and bring it where it is needed."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pinocchio as pin

from affordance.candidates import PoseCandidate, PregraspCandidate
from robots.spatial import Array
from robots.workcell import Side
from tamp.drafts import Draft, Leg, Pause, Reject, Situation, Squeeze, Step
from tamp.stages.cell import (
    CONTACT_SPEED,
    FREE_SPEED,
    HELD_SPEED,
    LIFT,
    ON_TABLE,
    OPEN_TIME,
    Cell,
    closing,
    drawn_back,
    raised,
    touching,
)
from worlds import physics

PULL = 8.0
"""Pull at the wrist at which the assistant lets go [N]: above what carrying shakes, below the human's 15 N."""

WITHDRAW = 0.07
"""How far the open hand draws back from what it has given [m]."""

PATIENCE = 12.0
"""Longest wait for the human [s]."""


def hold(
    cell: Cell, situation: Situation, side: Side, candidate: PregraspCandidate, rng: np.random.Generator
) -> list[Draft] | Reject:
    """Pre-grasp and lift: whether an arm can approach, close and lift straight up."""
    attempt = partial(_held, cell, situation, side, candidate)
    return cell.first_working(side, candidate.T_world_hand, rng, "the grasp", attempt)


def _held(cell: Cell, situation: Situation, side: Side, candidate: PregraspCandidate, q: Array) -> list[Draft] | Reject:
    around = situation.setting(openings={side: candidate.opening}, allowed=ON_TABLE)
    T_hand_object = candidate.T_world_hand.inverse() * situation.T_object
    opening = cell.closed_opening(T_hand_object, candidate.opening)
    mine = touching(cell.workcell, side)
    held = replace(
        situation, holder=side, T_object=T_hand_object, openings={**situation.openings, side: opening}, touching=mine
    )
    lifting = held.setting(allowed=ON_TABLE)
    way = cell.approach(around, side, q, situation)
    if isinstance(way, Reject):
        return way
    up = cell.line(lifting, side, q, raised(candidate.T_world_hand, LIFT), situation, "lift")
    if isinstance(up, Reject):
        return up.at("lift")
    grasped, lifted = held.moved(side, q), held.moved(side, up.points[-1])
    steps: tuple[Step, ...] = (
        *cell.ready(side, candidate.opening, situation, ()),
        Leg(side, "free", way.points[0], FREE_SPEED, around),
        Leg(side, "approach", way, CONTACT_SPEED, around),
        closing(side, (*mine, *ON_TABLE), side),
    )
    return [
        Draft("pregrasp", side, "assistant", steps, situation, grasped, candidate.score),
        Draft("lift", side, "assistant", (Leg(side, "lift", up, CONTACT_SPEED, lifting),), grasped, lifted),
    ]


def bring(
    cell: Cell, situation: Situation, side: Side, pose: PoseCandidate, T_world_hand: pin.SE3, rng: np.random.Generator
) -> list[Draft] | Reject:
    """Reorient: whether the assistant can hold the object at the proposed pose."""
    after = _brought(cell, situation, side, pose, T_world_hand, rng)
    if isinstance(after, Reject):
        return after
    leg = Leg(side, "free", after.q[side], HELD_SPEED, situation.setting())
    return [Draft("reorient", side, "assistant", (leg,), situation, after, pose.score)]


def present(
    opening: float,
    cell: Cell,
    situation: Situation,
    side: Side,
    pose: PoseCandidate,
    T_world_hand: pin.SE3,
    rng: np.random.Generator,
) -> list[Draft] | Reject:
    """Present and release: whether the assistant can hold the object out, to let go when it is pulled.

    Fingers open as far as they were when they came to grasp, ``opening`` [m]: so far there is room beside the object.
    """
    after = _brought(cell, situation, side, pose, T_world_hand, rng)
    if isinstance(after, Reject):
        return after
    mine = touching(cell.workcell, side)
    leg = Leg(side, "free", after.q[side], HELD_SPEED, situation.setting())
    given = replace(
        after,
        holder=None,
        T_object=T_world_hand * situation.T_object,
        openings={**after.openings, side: opening},
        touching=mine,
    )
    q, leaving = after.q[side], given.setting()
    back = cell.line(leaving, side, q, drawn_back(cell.arms[side].hand(q), WITHDRAW), given, "release")
    if isinstance(back, Reject):
        return back.at("release")
    letting_go = (
        Pause(side, PULL, PATIENCE, mine, side),
        Squeeze(side, opening, physics.OPEN_FORCE, OPEN_TIME + 0.4, mine, None),
        Leg(side, "retreat", back, CONTACT_SPEED, leaving),
    )
    given = given.moved(side, back.points[-1], touching=())
    return [
        Draft("present", side, "assistant", (leg,), situation, after, pose.score),
        Draft("release", side, "assistant", letting_go, after, given),
    ]


def _brought(
    cell: Cell, situation: Situation, side: Side, pose: PoseCandidate, T_world_hand: pin.SE3, rng: np.random.Generator
) -> Situation | Reject:
    """The situation with the held object at the pose, at the first joint solution that touches nothing."""
    seeds = [situation.q[side], cell.arms[side].home]
    solved = cell.solutions(side, T_world_hand, rng, seeds, "the object pose")
    if isinstance(solved, Reject):
        return solved
    view = situation.view.moved(pose.T_move, cell.hand_points(side, T_world_hand))
    last: Reject | None = None
    for q in solved:
        refused = cell.contact(situation.setting(), side, q, situation)
        if refused is None:
            return situation.moved(side, q, view=view)
        last = last or refused
    return last or Reject("proposal", "no joint solution was tried")
