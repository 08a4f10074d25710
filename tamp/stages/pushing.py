"""Whether the assistant can push the object over the table's edge, or press it down on one side, without holding it."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from affordance.candidates import ContactCandidate
from planners.motion import JointPath
from robots.spatial import Array
from robots.workcell import Side
from tamp.drafts import Draft, Leg, Reject, Situation, Step
from tamp.stages.cell import CONTACT_SPEED, FREE_SPEED, ON_TABLE, Cell, raised, shifted, touching

HOVER = 0.012
"""Height above the expected contact from which the hand descends guarded [m]."""

RISE = 0.10
"""Height of the straight way up from a contact [m]."""

DESCEND_SPEED = 0.03
"""Share of the velocity limits while descending onto the object: about 1 mm every 30 ms."""

DRAG_SPEED = 0.05
"""The same while the object is dragged: slow enough to count as quasi-static."""

TOUCH_FORCE = 8.0
"""Force at which a descent onto an object that is to be pushed stops [N]."""

DRAG_FORCE = 40.0
"""Force kept on the object while it is dragged [N]. Pads hold it by 0.8 F, the table brakes it by 0.56 (F + m g): 40 N
move up to 1.7 kg."""

PRESS_FORCE = 30.0
"""Force at which a press on one side of an object stops [N]: ten times what tilts a plate of half a kilogram."""

OVERTRAVEL = 0.003
"""How far below the expected contact the guarded descent may go [m]: covers depth error."""


def push(
    cell: Cell, situation: Situation, side: Side, candidate: ContactCandidate, rng: np.random.Generator
) -> list[Draft] | Reject:
    """Push and retreat: down onto the object, along the table with it, up and home."""
    attempt = partial(_pushed, cell, situation, side, candidate)
    return cell.first_working(side, candidate.T_world_hand, rng, "the push", attempt)


def _pushed(
    cell: Cell, situation: Situation, side: Side, candidate: ContactCandidate, q: Array
) -> list[Draft] | Reject:
    arm, mine = cell.arms[side], touching(cell.workcell, side)
    near = situation.setting(openings={side: candidate.opening}, allowed=ON_TABLE)
    contact = situation.setting(openings={side: candidate.opening}, allowed=(*ON_TABLE, *mine))
    down = (_descent if candidate.start is None else _from_behind)(cell, situation, side, candidate, q)
    if isinstance(down, Reject):
        return down
    hover, descend, closing_in = down
    pressed = (closing_in or descend).points[-1]
    T_low = arm.hand(pressed)
    carried = replace(
        situation,
        holder=side,
        T_object=T_low.inverse() * situation.T_object,
        openings={**situation.openings, side: candidate.opening},
        touching=(*mine, *ON_TABLE),
    )
    drag = cell.line(carried.setting(), side, pressed, shifted(T_low, candidate.travel), situation, "drag")
    if isinstance(drag, Reject):
        return drag
    end = drag.points[-1]
    T_world_object = candidate.T_move * situation.T_object
    view = situation.view.moved(candidate.T_move, cell.hand_points(side, arm.hand(end)))
    there = replace(
        situation,
        T_object=T_world_object,
        openings=carried.openings,
        touching=mine,
        view=view,
        q={**situation.q, side: end},
    )
    leaving = there.setting(allowed=ON_TABLE)
    up = cell.line(leaving, side, end, raised(arm.hand(end), RISE), situation, "retreat")
    if isinstance(up, Reject):
        return up.at("retreat")
    away = replace(
        there,
        touching=(),
        q={**situation.q, side: arm.home},
        view=replace(view, hand=np.zeros((0, 3))),
    )
    clear = away.setting(allowed=ON_TABLE)
    steps: tuple[Step, ...] = (
        *cell.ready(side, candidate.opening, situation, ON_TABLE),
        Leg(side, "free", hover.points[0], FREE_SPEED, near),
        Leg(side, "approach", hover, CONTACT_SPEED, near),
        *(
            [Leg(side, "descend", descend, DESCEND_SPEED, contact, guard=TOUCH_FORCE)]
            if closing_in is None
            else [
                Leg(side, "approach", descend, CONTACT_SPEED, near),
                Leg(side, "approach", closing_in, DRAG_SPEED, contact),
            ]
        ),
        Leg(side, "drag", drag, DRAG_SPEED, carried.setting(), force=DRAG_FORCE if closing_in is None else None),
    )
    back = (
        Leg(side, "retreat", up, CONTACT_SPEED, leaving),
        Leg(side, "free", arm.home, FREE_SPEED, clear),
    )
    return [
        Draft("push", side, "assistant", steps, situation, there, candidate.score),
        Draft("retreat", side, "assistant", back, there, away),
    ]


def press(
    cell: Cell, situation: Situation, side: Side, candidate: ContactCandidate, rng: np.random.Generator
) -> list[Draft] | Reject:
    """Press: down onto one side of the object and on, until it resists."""
    attempt = partial(_pressed, cell, situation, side, candidate)
    return cell.first_working(side, candidate.T_world_hand, rng, "the press", attempt)


def _pressed(
    cell: Cell, situation: Situation, side: Side, candidate: ContactCandidate, q: Array
) -> list[Draft] | Reject:
    mine = touching(cell.workcell, side)
    near = situation.setting(openings={side: candidate.opening}, allowed=ON_TABLE)
    contact = situation.setting(openings={side: candidate.opening}, allowed=(*ON_TABLE, *mine))
    down = _descent(cell, situation, side, candidate, q, -float(candidate.travel[2]))
    if isinstance(down, Reject):
        return down
    hover, descend, _ = down
    end = descend.points[-1]
    after = replace(
        situation,
        T_object=candidate.T_move * situation.T_object,
        openings={**situation.openings, side: candidate.opening},
        touching=mine,
        q={**situation.q, side: end},
        view=situation.view.moved(candidate.T_move, cell.hand_points(side, cell.arms[side].hand(end))),
    )
    steps: tuple[Step, ...] = (
        *cell.ready(side, candidate.opening, situation, ON_TABLE),
        Leg(side, "free", hover.points[0], FREE_SPEED, near),
        Leg(side, "approach", hover, CONTACT_SPEED, near),
        Leg(side, "descend", descend, DESCEND_SPEED, contact, guard=PRESS_FORCE),
    )
    return [Draft("press", side, "assistant", steps, situation, after, candidate.score)]


Ways = tuple[JointPath, JointPath, JointPath | None]
"""To above the contact, down, and to the contact where the hand comes from behind."""


def _descent(
    cell: Cell, situation: Situation, side: Side, candidate: ContactCandidate, q: Array, depth: float = OVERTRAVEL
) -> Ways | Reject:
    """The ways to above the contact and from there straight down past it by ``depth`` [m]; ``q`` is at the contact."""
    arm, mine, T_contact = cell.arms[side], touching(cell.workcell, side), candidate.T_world_hand
    openings = {side: candidate.opening}
    near = situation.setting(openings=openings, allowed=ON_TABLE)
    contact = situation.setting(openings=openings, allowed=(*ON_TABLE, *mine))
    up = cell.line(contact, side, q, raised(T_contact, HOVER), situation, "descend")
    if isinstance(up, Reject):
        return up
    above = up.points[-1]
    hover = cell.line(near, side, above, raised(arm.hand(above), RISE - HOVER), situation, "approach")
    if isinstance(hover, Reject):
        return hover
    low = cell.line(contact, side, above, raised(T_contact, -depth), situation, "descend")
    if isinstance(low, Reject):
        return low
    return JointPath(hover.points[::-1].copy()), low, None


def _from_behind(cell: Cell, situation: Situation, side: Side, candidate: ContactCandidate, q: Array) -> Ways | Reject:
    """The ways down behind the object and from there level to the contact at ``q``."""
    arm, mine, T_contact = cell.arms[side], touching(cell.workcell, side), candidate.T_world_hand
    openings = {side: candidate.opening}
    near = situation.setting(openings=openings, allowed=ON_TABLE)
    contact = situation.setting(openings=openings, allowed=(*ON_TABLE, *mine))
    start = np.zeros(3) if candidate.start is None else candidate.start
    back = cell.line(contact, side, q, shifted(T_contact, start), situation, "approach")
    if isinstance(back, Reject):
        return back
    behind = back.points[-1]
    up = cell.line(near, side, behind, raised(arm.hand(behind), HOVER), situation, "approach")
    if isinstance(up, Reject):
        return up
    above = up.points[-1]
    hover = cell.line(near, side, above, raised(arm.hand(above), RISE - HOVER), situation, "approach")
    if isinstance(hover, Reject):
        return hover
    hover_, down, ahead = (JointPath(path.points[::-1].copy()) for path in (hover, up, back))
    return hover_, down, ahead
