"""What the checks of all stages share: the collision world, joints for hand poses, straight ways to contacts."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import pinocchio as pin

from affordance.stations import hand_corners
from planners import cartesian, ik
from planners.cartesian import Broken
from planners.collision import CollisionWorld, Contact
from planners.motion import JointPath
from robots.model import DualArm
from robots.spatial import Array, points
from robots.workcell import Side, Workcell, other
from tamp.drafts import Draft, Reject, Setting, Situation, Squeeze
from tamp.plan import Pair
from worlds import physics

APPROACH = 0.10
"""Length of the straight approach to a contact [m]."""

LIFT = 0.12
"""Height of the straight lift before the object is turned [m]."""

RETREAT = 0.10
"""Length of the straight retreat [m]."""

PAD_HALF_WIDTH, PAD_LENGTH = 0.011, 0.03
"""Half the width of a finger pad, and how far the pads reach back from the tool centre point [m]."""

SOLUTIONS = 4
"""Joint solutions tried for one hand pose."""

FREE_SPEED = 0.5
"""Share of the velocity limits used when moving freely."""

HELD_SPEED = 0.35
"""The same while an arm carries the object: inertia adds little to the grip."""

CONTACT_SPEED = 0.25
"""The same on straight lines to and from contacts."""

CLOSE_TIME = 1.1
"""Time given to the fingers to close [s]: 40 mm at 50 mm/s and time to build up force."""

OPEN_TIME = 0.6
"""Time given to the fingers to open around a part [s]."""

ON_TABLE: tuple[Pair, ...] = (("object", "table"),)


def fingers(workcell: Workcell, side: Side) -> tuple[str, str]:
    """World-unique names of a hand's two fingers."""
    first, second = workcell.arm(side).gripper.finger_links
    return f"{side}/{first}", f"{side}/{second}"


def touching(workcell: Workcell, *sides: Side) -> tuple[Pair, ...]:
    """The pairs that let the fingers of the given hands touch the object."""
    return tuple((finger, "object") for side in sides for finger in fingers(workcell, side))


class Cell:
    """Checks of single configurations and straight lines in one collision world, set up for each query.

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

    def apply(self, setting: Setting) -> None:
        """Bring the collision world into a setting."""
        if setting.holder is None:
            self.world.place_object(setting.T_object)
        else:
            self.world.attach_object(setting.holder, setting.T_object)
        for side in ("left", "right"):
            travel = self.workcell.arm(side).gripper.finger_travel
            self.world.set_fingers(side, setting.openings.get(side, travel))
        self.world.allow((*setting.allowed, *setting.ignored))

    def both(self, side: Side, q: Array, q_other: Array) -> Array:
        """Joint positions of both arms ``(14,)``, left then right."""
        return np.concatenate([q, q_other] if side == "left" else [q_other, q])

    def contact(self, setting: Setting, side: Side, q: Array, situation: Situation) -> Reject | None:
        """The contact of one configuration in a setting as a rejection, or ``None``."""
        self.apply(setting)
        found = self.world.contact(self.both(side, q, situation.q[other(side)]))
        return None if found is None else collision(found)

    def solutions(
        self, side: Side, T_world_hand: pin.SE3, rng: np.random.Generator, seeds: Iterable[Array], what: str
    ) -> list[Array] | Reject:
        """Joint positions that reach a hand pose, nearest to the first seed first, or by how much it is missed."""
        starts = list(seeds)
        solved = ik.solve(self.arms[side], T_world_hand, rng=rng, seeds=starts, restarts=12, wanted=SOLUTIONS)
        if isinstance(solved, ik.Missed):
            return Reject("unreachable", f"{side} hand at {what} is {solved}", amount=solved.gap)
        return list(solved.solutions)

    def first_working(
        self,
        side: Side,
        T_world_hand: pin.SE3,
        rng: np.random.Generator,
        what: str,
        attempt: Callable[[Array], list[Draft] | Reject],
    ) -> list[Draft] | Reject:
        """What ``attempt`` makes of the first joint solution with which it works, or its last refusal."""
        solved = self.solutions(side, T_world_hand, rng, [self.arms[side].home], what)
        if isinstance(solved, Reject):
            return solved
        last = Reject("proposal", "no joint solution was tried")
        for q in solved:
            drafts = attempt(q)
            if not isinstance(drafts, Reject):
                return drafts
            last = drafts
        return last

    def approach(
        self, setting: Setting, side: Side, q: Array, situation: Situation, length: float = APPROACH
    ) -> JointPath | Reject:
        """The straight line along the hand's approach to a contact at ``q``, found backwards from it."""
        if refused := self.contact(setting, side, q, situation):
            return refused
        T_far = drawn_back(self.arms[side].hand(q), length)
        back = cartesian.straight(self.world, self.arms[side], q, T_far, situation.q[other(side)])
        if isinstance(back, Broken):
            return broken(back, "approach")
        return JointPath(back.points[::-1].copy())

    def line(
        self, setting: Setting, side: Side, q: Array, T_world_hand: pin.SE3, situation: Situation, what: str
    ) -> JointPath | Reject:
        """The straight line of a hand from ``q`` to a pose."""
        self.apply(setting)
        path = cartesian.straight(self.world, self.arms[side], q, T_world_hand, situation.q[other(side)])
        return broken(path, what) if isinstance(path, Broken) else path

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

    def ready(self, side: Side, opening: float, situation: Situation, allowed: tuple[Pair, ...]) -> tuple[Squeeze, ...]:
        """The squeeze that brings a hand's fingers to an opening; none where they have it."""
        if abs(situation.openings[side] - opening) < 1e-9:
            return ()
        duration = CLOSE_TIME if opening == 0.0 else OPEN_TIME
        return (Squeeze(side, opening, physics.OPEN_FORCE, duration, allowed, situation.holder),)

    def hand_points(self, side: Side, T_world_hand: pin.SE3) -> Array:
        """Corners of a hand's bounding box ``(8, 3)`` [m] at a hand pose."""
        return hand_corners(self.workcell.arm(side).gripper, T_world_hand)


def closing(side: Side, allowed: tuple[Pair, ...], holder: Side | None) -> Squeeze:
    """Close until the object stops the fingers: force, not position, ends it."""
    return Squeeze(side, 0.0, physics.GRIP_FORCE, CLOSE_TIME, allowed, holder)


def drawn_back(T_world_hand: pin.SE3, distance: float) -> pin.SE3:
    """A hand pose further back along its approach."""
    return T_world_hand * pin.SE3(np.eye(3), np.array([0.0, 0.0, -distance]))


def shifted(T_world_hand: pin.SE3, offset: Array) -> pin.SE3:
    """A hand pose moved by ``offset`` ``(3,)`` [m] in the world frame."""
    return pin.SE3(T_world_hand.rotation, T_world_hand.translation + np.asarray(offset))


def raised(T_world_hand: pin.SE3, height: float) -> pin.SE3:
    """A hand pose higher up."""
    return shifted(T_world_hand, np.array([0.0, 0.0, height]))


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
