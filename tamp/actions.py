"""Which actions does a plan consist of? One for each stage, with the numbers a network learns to propose."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from affordance.candidates import ContactCandidate, GoalCandidate, PoseCandidate, PregraspCandidate
from robots.model import DualArm
from robots.spatial import Array, unit
from robots.workcell import Workcell, other
from tamp.drafts import Draft
from tamp.record import Action
from tamp.refine import Solved, levels_of

STILL = 1e-6
"""A hand that moves less than this far does not move [m]."""


def actions_of(solved: Solved, arms: DualArm, workcell: Workcell) -> tuple[Action, ...]:
    """The actions of a plan in the order of its stages, at last how a human is expected to take the object."""
    levels = levels_of(solved.skeleton)
    candidates = {level.first: candidate for level, candidate in zip(levels, solved.chosen, strict=True)}
    found = [_action(draft, candidates.get(k), arms, workcell) for k, draft in enumerate(solved.drafts)]
    return (*found, _received(solved)) if solved.goal.kind == "receive" else tuple(found)


def _action(draft: Draft, candidate: Any, arms: DualArm, workcell: Workcell) -> Action:
    side = draft.arm
    T_world_hand, opening = arms[side].hand(draft.after.q[side]), draft.after.openings[side]
    contact: Array | None = None
    travel = T_world_hand.translation - arms[side].hand(draft.before.q[side]).translation
    kind, outward, start, T_move = "", np.zeros(3), np.zeros(3), pin.SE3.Identity()
    match candidate:
        case GoalCandidate():
            T_world_hand, opening, contact = candidate.T_world_hand, candidate.opening, candidate.point
            travel = candidate.amount * candidate.direction
            kind, outward = candidate.kind, candidate.outward
        case PregraspCandidate():
            T_world_hand, opening, travel = candidate.T_world_hand, candidate.opening, np.zeros(3)
        case ContactCandidate():
            T_world_hand, opening, travel = candidate.T_world_hand, candidate.opening, candidate.travel
            start, T_move = np.zeros(3) if candidate.start is None else candidate.start, candidate.T_move
        case PoseCandidate():
            T_move = candidate.T_move
    if contact is None:
        contact = _tool_centre(T_world_hand, workcell.arm(side).gripper.tcp_offset)
    amount = float(np.linalg.norm(travel))
    return Action(
        stage=draft.stage,
        arm=side,
        role=draft.role,
        T_world_hand=T_world_hand.homogeneous,
        contact=contact,
        direction=unit(travel) if amount > STILL else np.zeros(3),
        amount=amount if amount > STILL else 0.0,
        opening=float(opening),
        score=float(draft.score),
        kind=kind,
        outward=outward,
        start=start,
        T_move=T_move.homogeneous,
    )


def _received(solved: Solved) -> Action:
    """What a human is expected to do, where the object lay when the goal was proposed."""
    goal, side = solved.goal, other(solved.drafts[0].arm)
    return Action(
        stage="receive",
        arm=side,
        role="primary",
        T_world_hand=goal.T_world_hand.homogeneous,
        contact=goal.point,
        direction=goal.direction,
        amount=goal.amount,
        opening=goal.opening,
        score=goal.score,
        kind=goal.kind,
        outward=goal.outward,
        start=np.zeros(3),
        T_move=np.eye(4),
    )


def _tool_centre(T_world_hand: pin.SE3, offset: float) -> Array:
    """The tool centre point ``(3,)`` [m] of a hand."""
    return np.asarray(T_world_hand.act(np.array([0.0, 0.0, offset])))
