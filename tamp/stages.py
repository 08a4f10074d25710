"""Whether one candidate of one stage works geometrically: keyframes, lines and contacts, before free motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from affordance.candidates import GoalCandidate, PregraspCandidate, Roles
from planners import cartesian, ik
from planners.cartesian import Broken
from planners.collision import CollisionWorld, Contact
from planners.motion import JointPath
from robots.model import DualArm
from robots.spatial import Array, points
from robots.workcell import SIDES, Side, Workcell
from tamp.plan import Pair, Template
from tamp.trace import Cause

APPROACH = 0.10
"""Length of the straight approach to a contact [m]."""

LIFT = 0.12
"""Height of the straight lift [m]."""

RETREAT = 0.10
"""Length of the straight retreat [m]."""

STANDOFF = 0.008
"""Gap between finger tips and part where a press begins [m]; covers the error of the predicted pose."""

PAD_HALF_WIDTH, PAD_LENGTH = 0.011, 0.03
"""Half the width of a finger pad, and how far the pads reach back from the tool centre point [m]."""

SOLUTIONS = 4
"""Joint solutions tried for one hand pose."""


@dataclass(frozen=True, slots=True)
class Reject:
    """Why a candidate does not work.

    Attributes:
        cause: For counting.
        detail: For reading, with names and numbers.
        bodies: The two names that collide, where the cause is a collision.
        amount: Penetration or miss [m], where there is one.
    """

    cause: Cause
    detail: str
    bodies: tuple[str, str] | None = None
    amount: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Hold:
    """The assistant's grasp and lift.

    Attributes:
        candidate: What was proposed.
        approach: Joint path to the grasp ``(n, 7)``.
        lift: Joint path from the grasp straight up ``(m, 7)``.
        opening: Expected opening of one finger once closed [m].
        T_hand_object: Where the hand then holds the object frame.
    """

    candidate: PregraspCandidate
    approach: JointPath
    lift: JointPath
    opening: float
    T_hand_object: pin.SE3


@dataclass(frozen=True, slots=True, eq=False)
class Exposure:
    """The assistant's arm where the object faces the primary.

    Attributes:
        q: Joint positions ``(7,)`` [rad].
        T_world_object: The object frame there.
    """

    q: Array
    T_world_object: pin.SE3


@dataclass(frozen=True, slots=True, eq=False)
class Action:
    """The primary's approach, operation and retreat.

    Attributes:
        candidate: What was proposed.
        approach: Joint path to the contact, or to just before it for a press.
        operate: Joint path while operating.
        template: ``pull``, ``twist`` or ``press``.
        release: Joint path of a press letting go; ``None`` where opening the fingers does.
        retreat: Joint path away.
        opening: Expected opening of one finger while operating [m].
    """

    candidate: GoalCandidate
    approach: JointPath
    operate: JointPath
    template: Template
    release: JointPath | None
    retreat: JointPath
    opening: float


def fingers(workcell: Workcell, side: Side) -> tuple[str, str]:
    """World-unique names of a hand's two fingers."""
    first, second = workcell.arm(side).gripper.finger_links
    return f"{side}/{first}", f"{side}/{second}"


def touching(workcell: Workcell, *sides: Side) -> list[Pair]:
    """The pairs that let the fingers of the given hands touch the object."""
    return [(finger, "object") for side in sides for finger in fingers(workcell, side)]


ON_TABLE: list[Pair] = [("object", "table")]


class StageChecker:
    """Checks candidates of every stage in one collision world, which it sets up for each query.

    Attributes:
        workcell, arms, world: What the planner knows of the cell.
        cloud: Observed object points in the object frame ``(n, 3)`` [m].
        T_world_object: The object frame at the time of the observation.
    """

    def __init__(
        self, workcell: Workcell, arms: DualArm, world: CollisionWorld, cloud: Array, T_world_object: pin.SE3
    ) -> None:
        self.workcell, self.arms, self.world = workcell, arms, world
        self.cloud, self.T_world_object = cloud, T_world_object

    # -- the collision world's states ------------------------------------------------------------------------------

    def resting(self, openings: dict[Side, float], allowed: list[Pair]) -> None:
        """The object lies where it was observed."""
        self.world.place_object(self.T_world_object)
        self._set(openings, allowed)

    def held(self, side: Side, T_hand_object: pin.SE3, openings: dict[Side, float], allowed: list[Pair]) -> None:
        """The object moves with a hand."""
        self.world.attach_object(side, T_hand_object)
        self._set(openings, allowed)

    def _set(self, openings: dict[Side, float], allowed: list[Pair]) -> None:
        for side in SIDES:
            travel = self.workcell.arm(side).gripper.finger_travel
            self.world.set_fingers(side, openings.get(side, travel))
        self.world.allow(allowed)

    def both(self, side: Side, q: Array, q_other: Array) -> Array:
        """Joint positions of both arms ``(14,)``, left then right."""
        return np.concatenate([q, q_other] if side == "left" else [q_other, q])

    # -- pre-grasp and lift ----------------------------------------------------------------------------------------

    def hold(self, roles: Roles, candidate: PregraspCandidate, rng: np.random.Generator) -> Hold | Reject:
        """Whether the assistant can approach, close and lift straight up."""
        side = roles.assistant
        arm, q_other = self.arms[side], self.arms[roles.primary].home
        self.resting({side: candidate.opening}, ON_TABLE)
        solved = ik.solve(arm, candidate.T_world_hand, rng=rng, seeds=[arm.home], restarts=12, wanted=SOLUTIONS)
        if isinstance(solved, ik.Missed):
            return missed(solved, f"{side} hand at the grasp")
        T_hand_object = candidate.T_world_hand.inverse() * self.T_world_object
        opening = self.closed_opening(T_hand_object, candidate.opening)
        last = Reject("proposal", "no joint solution was tried")
        for q in solved.solutions:
            self.resting({side: candidate.opening}, ON_TABLE)
            approach = self._approach(side, q, q_other, candidate.T_world_hand)
            if isinstance(approach, Reject):
                last = approach
                continue
            self.held(side, T_hand_object, {side: opening}, touching(self.workcell, side) + ON_TABLE)
            lift = cartesian.straight(self.world, arm, q, raised(candidate.T_world_hand, LIFT), q_other)
            if isinstance(lift, JointPath):
                return Hold(candidate, approach, lift, opening, T_hand_object)
            last = broken(lift, "lift")
        return last

    def _approach(self, side: Side, q: Array, q_other: Array, T_world_hand: pin.SE3) -> JointPath | Reject:
        """The straight line to a contact, found backwards from it."""
        if contact := self.world.contact(self.both(side, q, q_other)):
            return collision(contact)
        back = cartesian.straight(self.world, self.arms[side], q, drawn_back(T_world_hand, APPROACH), q_other)
        if isinstance(back, Broken):
            return broken(back, "approach")
        return JointPath(back.points[::-1].copy())

    def closed_opening(self, T_hand_object: pin.SE3, widest: float) -> float:
        """Half the width that the closed fingers will find, in the hand frame [m].

        It is that of the observed points between the pads; where the camera saw none there, that of what it saw above
        or beside them, which hides the rest.
        """
        gripper = self.workcell.arm("left").gripper
        seen = points(T_hand_object, self.cloud)
        within = np.abs(seen[:, 0]) < PAD_HALF_WIDTH
        between = within & (seen[:, 2] > gripper.tcp_offset - PAD_LENGTH)
        chosen = next((mask for mask in (between, within) if mask.any()), np.ones(len(seen), dtype=bool))
        return float(np.clip(np.abs(seen[chosen, 1]).max(), 0.0, widest))

    # -- reorient --------------------------------------------------------------------------------------------------

    def expose(self, roles: Roles, hold: Hold, T_world_hand: pin.SE3, rng: np.random.Generator) -> Exposure | Reject:
        """Whether the assistant can hold the object at the proposed pose."""
        side = roles.assistant
        arm, q_other = self.arms[side], self.arms[roles.primary].home
        solved = ik.solve(
            arm, T_world_hand, rng=rng, seeds=[hold.lift.points[-1], arm.home], restarts=8, wanted=SOLUTIONS
        )
        if isinstance(solved, ik.Missed):
            return missed(solved, f"{side} hand at the object pose")
        self.held(side, hold.T_hand_object, {side: hold.opening}, touching(self.workcell, side))
        last: Reject | None = None
        for q in solved.solutions:
            contact = self.world.contact(self.both(side, q, q_other))
            if contact is None:
                return Exposure(q, T_world_hand * hold.T_hand_object)
            last = last or collision(contact)
        return last or Reject("proposal", "no joint solution was tried")

    # -- operate, release, retreat ---------------------------------------------------------------------------------

    def act(
        self, roles: Roles, hold: Hold, exposure: Exposure, goal: GoalCandidate, rng: np.random.Generator
    ) -> Action | Reject:
        """Whether the primary can approach, operate and withdraw while the assistant keeps still."""
        side = roles.primary
        arm = self.arms[side]
        T_contact = drawn_back(goal.T_world_hand, STANDOFF if goal.kind == "press" else 0.0)
        solved = ik.solve(arm, T_contact, rng=rng, seeds=[arm.home], restarts=8, wanted=SOLUTIONS)
        if isinstance(solved, ik.Missed):
            return missed(solved, f"{side} hand at the goal")
        last: Reject | None = None
        for q in solved.solutions:
            action = self._act_from(roles, hold, exposure, goal, T_contact, q)
            if isinstance(action, Action):
                return action
            last = last or action
        return last or Reject("proposal", "no joint solution was tried")

    def _act_from(
        self, roles: Roles, hold: Hold, exposure: Exposure, goal: GoalCandidate, T_contact: pin.SE3, q: Array
    ) -> Action | Reject:
        side, still = roles.primary, exposure.q
        assistant = touching(self.workcell, roles.assistant)
        both = assistant + touching(self.workcell, side)

        def during(opening: float, allowed: list[Pair]) -> None:
            self.held(roles.assistant, hold.T_hand_object, {roles.assistant: hold.opening, side: opening}, allowed)

        during(goal.opening, assistant)
        approach = self._approach(side, q, still, T_contact)
        if isinstance(approach, Reject):
            return approach
        opening = self._part_opening(goal, exposure)
        during(opening, both)
        template, operate = self._operate(side, q, still, T_contact, goal)
        if isinstance(operate, Broken):
            return broken(operate, template)
        end = operate.points[-1]
        T_end = self.arms[side].hand(end)
        release: JointPath | None = None
        if goal.kind == "press":
            eased = cartesian.straight(self.world, self.arms[side], end, drawn_back(T_end, goal.amount), still)
            if isinstance(eased, Broken):
                return broken(eased, "release")
            release, end = eased, eased.points[-1]
            T_end = self.arms[side].hand(end)
        during(goal.opening, both)
        retreat = cartesian.straight(self.world, self.arms[side], end, drawn_back(T_end, RETREAT), still)
        if isinstance(retreat, Broken):
            return broken(retreat, "retreat")
        return Action(goal, approach, operate, template, release, retreat, opening)

    def _operate(
        self, side: Side, q: Array, still: Array, T_contact: pin.SE3, goal: GoalCandidate
    ) -> tuple[Template, JointPath | Broken]:
        arm = self.arms[side]
        if goal.kind == "unscrew":
            turned = cartesian.turned(self.world, arm, q, goal.point, goal.direction, goal.amount, still)
            return "twist", turned
        length = goal.amount + (STANDOFF if goal.kind == "press" else 0.0)
        T_end = pin.SE3(T_contact.rotation, T_contact.translation + length * goal.direction)
        return ("press" if goal.kind == "press" else "pull"), cartesian.straight(self.world, arm, q, T_end, still)

    def _part_opening(self, goal: GoalCandidate, exposure: Exposure) -> float:
        if goal.kind == "press":
            return 0.0
        return self.closed_opening(goal.T_world_hand.inverse() * exposure.T_world_object, goal.opening)


def drawn_back(T_world_hand: pin.SE3, distance: float) -> pin.SE3:
    """A hand pose further back along its approach."""
    return T_world_hand * pin.SE3(np.eye(3), np.array([0.0, 0.0, -distance]))


def raised(T_world_hand: pin.SE3, height: float) -> pin.SE3:
    """A hand pose higher up."""
    return pin.SE3(T_world_hand.rotation, T_world_hand.translation + np.array([0.0, 0.0, height]))


def missed(miss: ik.Missed, what: str) -> Reject:
    """An inverse kinematics miss as a rejection."""
    return Reject("unreachable", f"{what} is {miss}", amount=miss.gap)


def collision(contact: Contact) -> Reject:
    """A contact as a rejection."""
    return Reject("collision", str(contact), (contact.a, contact.b), contact.depth)


def broken(line: Broken, what: str) -> Reject:
    """A straight line that could not be followed as a rejection."""
    if isinstance(line.reason, Contact):
        contact = line.reason
        return Reject(
            "collision",
            f"{what}: {contact} after {100 * line.fraction:.0f} % of the line",
            (contact.a, contact.b),
            contact.depth,
        )
    return Reject("cartesian", f"{what} ends after {100 * line.fraction:.0f} %: {line.reason}")
