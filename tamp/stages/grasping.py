"""Whether the primary can grasp what was prepared - an overhanging or raised edge - and lift it alone."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from affordance.candidates import GoalCandidate
from robots.spatial import Array, points
from robots.workcell import Side, other
from tamp.drafts import Draft, Leg, Reject, Situation, Step
from tamp.stages.cell import (
    APPROACH,
    CONTACT_SPEED,
    FREE_SPEED,
    ON_TABLE,
    PAD_HALF_WIDTH,
    Cell,
    closing,
    raised,
    touching,
)

LIFT_SPEED = 0.15
"""Share of the velocity limits while the primary lifts the object by its edge."""

FINGER_THICK = 0.016
"""How far a finger reaches outwards from its pad [m]; measured on pybullet_data's finger mesh."""

FINGER_LENGTH = 0.045
"""How far the fingers reach back from the tips before the palm begins [m]."""

BACK_OFF = 0.05
"""Height of the assistant's way up after it has pressed [m]."""


def take(
    cell: Cell, situation: Situation, side: Side, goal: GoalCandidate, release: bool, rng: np.random.Generator
) -> list[Draft] | Reject:
    """Grasp, the assistant's release where it still presses, and lift."""
    if refused := swept_clear(cell, situation, goal):
        return refused
    attempt = partial(_with, cell, situation, side, goal, release)
    return cell.first_working(side, goal.T_world_hand, rng, "the edge", attempt)


def _with(
    cell: Cell, situation: Situation, side: Side, goal: GoalCandidate, release: bool, q: Array
) -> list[Draft] | Reject:
    mine = touching(cell.workcell, side)
    around = situation.setting(openings={side: goal.opening}, allowed=ON_TABLE, ignored=mine)
    way = cell.approach(around, side, q, situation)
    if isinstance(way, Reject):
        return way
    T_hand_object = goal.T_world_hand.inverse() * situation.T_object
    opening = cell.closed_opening(T_hand_object, goal.opening)
    closed = situation.moved(side, q, opening=opening, touching=(*situation.touching, *mine, *ON_TABLE))
    steps: tuple[Step, ...] = (
        *cell.ready(side, goal.opening, situation, (*situation.touching, *ON_TABLE)),
        Leg(side, "free", way.points[0], FREE_SPEED, situation.setting(openings=around.openings, allowed=ON_TABLE)),
        Leg(side, "approach", way, CONTACT_SPEED, around),
        closing(side, closed.touching, side),
    )
    drafts = [Draft("grasp", side, "primary", steps, situation, closed, goal.score)]
    if release:
        freed = _release(cell, closed, other(side))
        if isinstance(freed, Reject):
            return freed.at("release")
        drafts.append(freed)
    held = replace(drafts[-1].after, holder=side, T_object=T_hand_object, touching=mine)
    lifting = held.setting(allowed=ON_TABLE)
    up = cell.line(lifting, side, q, raised(goal.T_world_hand, goal.amount), held, "lift")
    if isinstance(up, Reject):
        return up.at("lift")
    lifted = held.moved(side, up.points[-1])
    drafts.append(
        Draft("lift", side, "primary", (Leg(side, "lift", up, LIFT_SPEED, lifting),), drafts[-1].after, lifted)
    )
    return drafts


def _release(cell: Cell, situation: Situation, side: Side) -> Draft | Reject:
    """The assistant moves straight up from what it presses, and home."""
    arm, q = cell.arms[side], situation.q[side]
    theirs = touching(cell.workcell, other(side))
    setting = situation.setting()
    up = cell.line(setting, side, q, raised(arm.hand(q), BACK_OFF), situation, "release")
    if isinstance(up, Reject):
        return up
    away = situation.moved(side, arm.home, touching=(*theirs, *ON_TABLE))
    legs = (
        Leg(side, "retreat", up, CONTACT_SPEED, setting),
        Leg(side, "free", arm.home, FREE_SPEED, away.setting()),
    )
    return Draft("release", side, "assistant", legs, situation, away)


def swept_clear(cell: Cell, situation: Situation, goal: GoalCandidate) -> Reject | None:
    """Whether the open fingers, moving straight to the grasp, meet no observed point; and some point lies between.

    The convex model of the object fills its hollows, into which a finger may well reach; the observed points do not.
    """
    gripper = cell.workcell.arm("left").gripper
    seen = points(goal.T_world_hand.inverse(), situation.view.cloud)
    x, y, z = np.abs(seen[:, 0]), np.abs(seen[:, 1]), seen[:, 2]
    near = (x < PAD_HALF_WIDTH) & (z < gripper.tip_offset) & (z > -APPROACH)
    hit = near & (y > goal.opening) & (y < goal.opening + FINGER_THICK)
    if hit.any():
        deep = float((gripper.tip_offset - z[hit]).max())
        detail = f"open fingers would meet {int(hit.sum())} seen points, {1e3 * deep:.0f} mm from their tips"
        return Reject("collision", detail, ("fingers", "object"), deep)
    if not (near & (y <= goal.opening) & (z > gripper.tip_offset - FINGER_LENGTH)).any():
        return Reject("proposal", "no seen point lies between the open fingers")
    return None
