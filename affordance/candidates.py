"""What a proposer is asked and what it answers: ranked candidates, each a value that can be checked and refused."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
import pinocchio as pin

from robots.spatial import Array, frozen, points
from robots.workcell import Side, Workcell

OperationKind = Literal["pull", "unscrew", "press", "flip", "grasp", "receive"]
"""What is done at the goal: ``flip`` turns a lid about its hinge, ``grasp`` takes the object and lifts it, ``receive``
is a human's grip."""


@dataclass(frozen=True, slots=True)
class Roles:
    """Which arm plays which role.

    Attributes:
        assistant: The arm that prepares.
        primary: The arm that does the goal action.
    """

    assistant: Side
    primary: Side


@dataclass(frozen=True, slots=True, eq=False)
class SceneView:
    """What a proposer looks at: the object now, or as predicted after it has been moved.

    Attributes:
        workcell: What stands in the cell.
        cloud: ``(n, 3)`` object points in the world frame [m], already moved.
        T_move: How the object has moved since it was observed, in the world frame; identity for the first view.
        hand: ``(m, 3)`` points of the assistant's hand in the world frame [m], empty before it holds.
        roles: Which arm plays which role; ``None`` while that is open.
    """

    workcell: Workcell
    cloud: Array
    T_move: pin.SE3
    hand: Array
    roles: Roles | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "cloud", frozen(self.cloud))
        object.__setattr__(self, "hand", frozen(self.hand))
        object.__setattr__(self, "T_move", self.T_move.copy())

    def moved(self, T_move: pin.SE3, hand: Array) -> SceneView:
        """This view after the object moves by ``T_move`` (world frame) and the assistant's hand has come."""
        return SceneView(self.workcell, points(T_move, self.cloud), T_move * self.T_move, hand, self.roles)


@dataclass(frozen=True, slots=True, eq=False)
class GoalCandidate:
    """Where and how the primary acts.

    Attributes:
        kind: What is done there.
        T_world_hand: Hand pose at contact.
        opening: Opening of one finger while approaching [m]; 0 presses with closed fingers.
        direction: Unit vector ``(3,)`` in the world frame: pull, press, grasp and receive - the motion of the hand;
            unscrew and flip - the axis about which it turns, right-handed.
        point: A point ``(3,)`` of the line of motion or of the turning axis [m]; grasp: where the pads close.
        amount: Motion commanded [m] or [rad].
        outward: Unit vector ``(3,)`` in the world frame from the part towards free space: the way the part must face
            to be exposed.
        score: Higher is better.
        vouched: Whether the proposer knows that the fingers meet nothing of the object on their straight way there. The
            planner's own solid holds everything that the camera could not see, and would often object.
    """

    kind: OperationKind
    T_world_hand: pin.SE3
    opening: float
    direction: Array
    point: Array
    amount: float
    outward: Array
    score: float
    vouched: bool = False

    def __post_init__(self) -> None:
        for name in ("direction", "point", "outward"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        object.__setattr__(self, "T_world_hand", self.T_world_hand.copy())


@dataclass(frozen=True, slots=True, eq=False)
class PregraspCandidate:
    """Where the assistant holds.

    Attributes:
        T_world_hand: Hand pose when the fingers close.
        opening: Opening of one finger while approaching [m].
        score: Higher is better.
    """

    T_world_hand: pin.SE3
    opening: float
    score: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_world_hand", self.T_world_hand.copy())


@dataclass(frozen=True, slots=True, eq=False)
class PoseCandidate:
    """Which object pose makes room.

    Attributes:
        T_move: How the object should move from where it was observed, in the world frame.
        score: Higher is better.
    """

    T_move: pin.SE3
    score: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_move", self.T_move.copy())


@dataclass(frozen=True, slots=True, eq=False)
class ContactCandidate:
    """Where the assistant pushes or presses, without holding.

    Attributes:
        T_world_hand: Hand pose at which the fingers meet the object.
        opening: Opening of one finger [m]; 0 touches with closed fingers.
        travel: How the hand moves from there on, in a straight line ``(3,)`` [m].
        T_move: How the object is expected to move meanwhile, in the world frame.
        score: Higher is better.
        start: From where the hand comes to the contact, relative to it ``(3,)`` [m]: straight down onto it by default,
            or from behind, the fingers low beside the object.
    """

    T_world_hand: pin.SE3
    opening: float
    travel: Array
    T_move: pin.SE3
    score: float
    start: Array | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_world_hand", self.T_world_hand.copy())
        object.__setattr__(self, "T_move", self.T_move.copy())
        object.__setattr__(self, "travel", frozen(self.travel))
        if self.start is not None:
            object.__setattr__(self, "start", frozen(self.start))


class Proposer(Protocol):
    """Anything that yields ranked candidates. Lists are best first and may be empty; ``rng`` decides every draw."""

    @property
    def name(self) -> str:
        """As given to ``--proposer``."""

    def goal(self, view: SceneView, rng: np.random.Generator) -> list[GoalCandidate]:
        """Where the primary could act: anticipatorily on the first view, finally on the predicted one."""

    def pregrasp(self, view: SceneView, goal: GoalCandidate, rng: np.random.Generator) -> list[PregraspCandidate]:
        """Where the assistant could hold so that the goal action stays possible."""

    def object_pose(
        self, view: SceneView, goal: GoalCandidate, grasp: PregraspCandidate, roles: Roles, rng: np.random.Generator
    ) -> list[PoseCandidate]:
        """Where the object could be brought for the goal action."""

    def push(self, view: SceneView, goal: GoalCandidate, rng: np.random.Generator) -> list[ContactCandidate]:
        """How the assistant could push the object so that it reaches over the table's edge."""

    def press(self, view: SceneView, goal: GoalCandidate, rng: np.random.Generator) -> list[ContactCandidate]:
        """How the assistant could press the object down on one side so that the other rises."""

    def present(
        self, view: SceneView, goal: GoalCandidate, grasp: PregraspCandidate, rng: np.random.Generator
    ) -> list[PoseCandidate]:
        """Where the object could be brought for a human to take it."""

    def reorient(self, grasp: PregraspCandidate, pose: PoseCandidate) -> pin.SE3:
        """``T_world_hand`` of the assistant's hand once the object is there."""
