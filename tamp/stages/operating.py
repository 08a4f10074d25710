"""Whether the primary can approach the functional part, operate it, let go and withdraw."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pinocchio as pin

from affordance.candidates import GoalCandidate
from planners import cartesian
from planners.cartesian import Broken
from planners.motion import JointPath
from robots.spatial import Array
from robots.workcell import Side, other
from tamp.drafts import Draft, Leg, Reject, Setting, Situation, Squeeze
from tamp.plan import Template
from tamp.stages.cell import (
    CONTACT_SPEED,
    FREE_SPEED,
    OPEN_TIME,
    RETREAT,
    Cell,
    broken,
    closing,
    drawn_back,
    touching,
)
from worlds import physics

STANDOFF = 0.008
"""Gap between finger tips and part where a press begins [m]; covers the error of the predicted pose."""

OPERATE_SPEED = 0.15
"""Share of the velocity limits while a part is moved: slow enough for friction to carry the load."""

PRESS_SPEED = 0.06
"""The same while a part is pressed: slow enough for a guarded stop when it reaches its end."""

PRESS_STOP = 35.0
"""Force at which the primary stops pressing [N], as its joint torque sensors would tell: more than any part's
resistance, less than the 60 N that count as too much."""

ABOUT_A_LINE: dict[str, Template] = {"unscrew": "twist", "flip": "flip"}
"""Operations that turn the hand about a line."""


def act(
    cell: Cell, situation: Situation, side: Side, goal: GoalCandidate, rng: np.random.Generator
) -> list[Draft] | Reject:
    """Operate, release and retreat."""
    T_contact = goal.T_world_hand
    if goal.kind == "press":
        T_contact = drawn_back(T_contact, STANDOFF)
    attempt = partial(_with, cell, situation, side, goal, T_contact)
    return cell.first_working(side, T_contact, rng, "the part", attempt)


def _with(
    cell: Cell, situation: Situation, side: Side, goal: GoalCandidate, T_contact: pin.SE3, q: Array
) -> list[Draft] | Reject:
    mine = touching(cell.workcell, side)
    apart = situation.setting(openings={side: goal.opening})
    near = replace(apart, ignored=mine) if goal.vouched else apart
    way = cell.approach(near, side, q, situation)
    if isinstance(way, Reject):
        return way
    opening = _part_opening(cell, situation, goal)
    engaged = situation.setting(openings={side: opening}, allowed=mine)
    template, moved = _operate(cell, engaged, situation, side, q, T_contact, goal)
    if isinstance(moved, Reject):
        return moved
    end, leaving = moved.points[-1], situation.setting(openings={side: goal.opening}, allowed=mine)
    release: Leg | Squeeze = Squeeze(
        side, goal.opening, physics.OPEN_FORCE, OPEN_TIME, leaving.allowed, situation.holder
    )
    if goal.kind == "press":
        T_eased = drawn_back(cell.arms[side].hand(end), goal.amount)
        eased = cell.line(engaged, side, end, T_eased, situation, "release")
        if isinstance(eased, Reject):
            return eased.at("release")
        release, end = Leg(side, "retreat", eased, CONTACT_SPEED, engaged), eased.points[-1]
    back = cell.line(leaving, side, end, drawn_back(cell.arms[side].hand(end), RETREAT), situation, "retreat")
    if isinstance(back, Reject):
        return back.at("retreat")
    speed = PRESS_SPEED if goal.kind == "press" else OPERATE_SPEED
    steps: list[Leg | Squeeze] = [
        *cell.ready(side, goal.opening, situation, near.allowed),
        Leg(side, "free", way.points[0], FREE_SPEED, apart),
        Leg(side, "approach", way, CONTACT_SPEED, near),
    ]
    if goal.kind != "press":
        steps.append(closing(side, engaged.allowed, situation.holder))
    steps.append(Leg(side, template, moved, speed, engaged, guard=PRESS_STOP if template == "press" else None))
    operated = situation.moved(side, moved.points[-1], opening=opening, touching=engaged.allowed)
    released = operated.moved(side, end, opening=goal.opening)
    away = released.moved(side, back.points[-1], touching=situation.touching)
    return [
        Draft("operate", side, "primary", tuple(steps), situation, operated, goal.score),
        Draft("release", side, "primary", (release,), operated, released),
        Draft("retreat", side, "primary", (Leg(side, "retreat", back, CONTACT_SPEED, leaving),), released, away),
    ]


def _operate(
    cell: Cell, setting: Setting, situation: Situation, side: Side, q: Array, T_contact: pin.SE3, goal: GoalCandidate
) -> tuple[Template, JointPath | Reject]:
    arm = cell.arms[side]
    if template := ABOUT_A_LINE.get(goal.kind):
        cell.apply(setting)
        still = situation.q[other(side)]
        turned = cartesian.turned(cell.world, arm, q, goal.point, goal.direction, goal.amount, still)
        return template, broken(turned, template) if isinstance(turned, Broken) else turned
    template = "press" if goal.kind == "press" else "pull"
    length = goal.amount + (STANDOFF if goal.kind == "press" else 0.0)
    T_end = pin.SE3(T_contact.rotation, T_contact.translation + length * goal.direction)
    return template, cell.line(setting, side, q, T_end, situation, template)


def _part_opening(cell: Cell, situation: Situation, goal: GoalCandidate) -> float:
    """Opening of one finger while the part is moved [m]."""
    if goal.kind == "press":
        return 0.0
    holder = situation.holder
    T_world_object = situation.T_object
    if holder is not None:
        T_world_object = cell.arms[holder].hand(situation.q[holder]) * situation.T_object
    return cell.closed_opening(goal.T_world_hand.inverse() * T_world_object, goal.opening)
