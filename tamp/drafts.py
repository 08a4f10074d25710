"""What a stage is before it is timed: where things stand, which way the hand goes, what may touch meanwhile."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import pinocchio as pin

from affordance.candidates import SceneView
from planners.motion import JointPath
from robots.spatial import Array
from robots.workcell import Side
from tamp.plan import Pair, Role, StageName, Template
from tamp.trace import Cause


@dataclass(frozen=True, slots=True)
class Reject:
    """Why a candidate does not work.

    Attributes:
        cause: For counting.
        detail: For reading, with names and numbers.
        bodies: The two names that collide, where the cause is a collision.
        amount: Penetration or miss [m], where there is one.
        stage: The stage that does not work; ``None`` for the one whose candidate it is.
    """

    cause: Cause
    detail: str
    bodies: tuple[str, str] | None = None
    amount: float | None = None
    stage: StageName | None = None

    def at(self, stage: StageName) -> Reject:
        """The same, at a stage."""
        return replace(self, stage=stage)


@dataclass(frozen=True, slots=True, eq=False)
class Setting:
    """The collision world while something happens.

    Attributes:
        holder: The hand with which the object moves, or ``None``.
        T_object: ``T_hand_object`` of the holder, else ``T_world_object``.
        openings: Opening of one finger by arm [m]; wide open where an arm is missing.
        allowed: Contacts intended.
        ignored: Contacts not judged by this model of the object, whose hollows are filled; a check of its own judges
            them.
    """

    holder: Side | None
    T_object: pin.SE3
    openings: Mapping[Side, float]
    allowed: tuple[Pair, ...]
    ignored: tuple[Pair, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Situation:
    """Where everything is predicted to be between two stages.

    Attributes:
        view: The object as it is seen or predicted, and the hands near it.
        q: Joint positions by arm ``(7,)`` [rad].
        openings: Opening of one finger by arm [m].
        holder: The hand that holds the object, or ``None``.
        T_object: ``T_hand_object`` of the holder, else ``T_world_object``.
        touching: Contacts that last between stages.
    """

    view: SceneView
    q: dict[Side, Array]
    openings: dict[Side, float]
    holder: Side | None
    T_object: pin.SE3
    touching: tuple[Pair, ...]

    def setting(
        self,
        *,
        openings: Mapping[Side, float] | None = None,
        allowed: tuple[Pair, ...] = (),
        ignored: tuple[Pair, ...] = (),
    ) -> Setting:
        """The collision world as things stand, with more allowed contacts and other openings."""
        merged = {**self.openings, **(openings or {})}
        return Setting(self.holder, self.T_object, merged, _union(self.touching, allowed), ignored)

    def moved(
        self,
        side: Side,
        q: Array,
        *,
        opening: float | None = None,
        touching: tuple[Pair, ...] | None = None,
        view: SceneView | None = None,
    ) -> Situation:
        """The same after one arm has moved and perhaps let go of, or met, something."""
        return replace(
            self,
            q={**self.q, side: q},
            openings=self.openings if opening is None else {**self.openings, side: opening},
            touching=self.touching if touching is None else touching,
            view=self.view if view is None else view,
        )


def _union(first: tuple[Pair, ...], second: tuple[Pair, ...]) -> tuple[Pair, ...]:
    return tuple(dict.fromkeys((*first, *second)))


@dataclass(frozen=True, slots=True, eq=False)
class Leg:
    """One motion of one arm.

    Attributes:
        side: The arm.
        template: How it moves.
        way: The joint path, or for a free motion its goal ``(7,)`` [rad].
        speed: Share of the velocity limits.
        setting: The collision world meanwhile.
        guard: Contact force at which it stops early [N].
        force: Force to keep along the way [N].
    """

    side: Side
    template: Template
    way: JointPath | Array
    speed: float
    setting: Setting
    guard: float | None = None
    force: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Squeeze:
    """Fingers move while both arms keep still.

    Attributes:
        side: The arm.
        opening: Commanded opening of one finger [m].
        force: Force limit [N].
        duration: Time given [s].
        allowed: Contacts intended.
        holder: The hand that holds the object when it ends.
    """

    side: Side
    opening: float
    force: float
    duration: float
    allowed: tuple[Pair, ...]
    holder: Side | None


@dataclass(frozen=True, slots=True, eq=False)
class Pause:
    """Both arms keep still until a pull is felt.

    Attributes:
        side: The arm that feels.
        force: Pull that ends it [N].
        duration: Longest wait [s].
        allowed: Contacts intended.
        holder: The hand that holds the object.
    """

    side: Side
    force: float
    duration: float
    allowed: tuple[Pair, ...]
    holder: Side | None


Step = Leg | Squeeze | Pause
"""What a drafted stage consists of."""


@dataclass(frozen=True, slots=True, eq=False)
class Draft:
    """One stage made concrete but for free motions and times.

    Attributes:
        stage: The stage.
        arm: Who acts.
        role: As what.
        steps: In order.
        before: Where things stood.
        after: Where they will stand.
        score: The proposer's score of the candidate used.
    """

    stage: StageName
    arm: Side
    role: Role
    steps: tuple[Step, ...]
    before: Situation
    after: Situation
    score: float = field(default=1.0)
