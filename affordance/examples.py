"""What can be learned from one preparation: what was seen, what both arms did, how it went and what was refused.

Plain arrays in the world frame, as they were when the assistant began: a second push is an example of its own, seen
after the first. Whoever knows the stored episodes makes these; ``affordance.dataset`` turns them into tensors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from affordance.candidates import OperationKind
from robots.spatial import Array, frozen
from worlds.tasks import TaskType


@dataclass(frozen=True, slots=True, eq=False)
class Act:
    """What one hand did, where the object lay when the assistant began.

    Attributes:
        T_world_hand: ``(4, 4)`` its pose at the contact.
        tip_offset, tcp_offset: From there along the approach to the very end of the fingers, and to the tool centre
            point [m].
        opening: Opening of one finger while approaching [m].
        direction: ``(3,)`` unit vector as in ``GoalCandidate``; of a push or press, along which it moved on; else zero.
        amount: How far it moved [m] or turned [rad].
        kind: Of a goal action, as in ``GoalCandidate``; ``None`` of the assistant's.
        point: ``(3,)`` of a goal action, as in ``GoalCandidate`` [m]; else zero.
        outward: ``(3,)`` of a goal action, as in ``GoalCandidate``; else zero.
        behind: Whether a push came from behind the object.
    """

    T_world_hand: Array
    tip_offset: float
    tcp_offset: float
    opening: float
    direction: Array
    amount: float
    kind: OperationKind | None
    point: Array
    outward: Array
    behind: bool = False

    def __post_init__(self) -> None:
        for name in ("T_world_hand", "direction", "point", "outward"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """What is known of the cell, as far as it matters to a task.

    Attributes:
        edge: A point on the edge that the object is pushed over, and the horizontal unit vector from there into free
            space, ``(2, 3)``; ``None`` in a task without one.
        place: Middle of the space in which the object is to be held [m], and the horizontal unit vector from there to
            whom it is held out to, ``(2, 3)``; ``None`` in a task that does not lift it for another hand.
    """

    edge: Array | None
    place: Array | None


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """What the planner said of one candidate.

    Attributes:
        station: ``(25,)`` what the feasibility critic is told of it.
        tool: ``(3,)`` tool centre point where the object had not moved yet, else ``None`` [m].
        labels: ``(3,)`` int: of each check of ``affordance.critics``, 1 passed, 0 failed, -1 not reached.
    """

    station: Array
    tool: Array | None
    labels: np.ndarray[tuple[int], np.dtype[np.int8]]


@dataclass(frozen=True, slots=True, eq=False)
class Example:
    """One preparation of one episode.

    Attributes:
        episode: Its name in the data set.
        category: Column.
        instance: The object.
        task: What is asked for.
        texts: Ways to ask for it.
        points: ``(n, 3)`` object points when the assistant began [m].
        surroundings: The edge or place.
        goal: What the primary did, carried back to where the object lay; ``None`` when nothing was planned.
        pre: What the assistant did; ``None`` when nothing was planned.
        T_move: ``(4, 4)`` how the object was expected to move by it; what the primary did fits the object moved so.
        hand: ``(m, 3)`` points of the assistant's hand while the primary acts [m]; none when it has gone.
        tried: Whether the primary's turn came.
        prepared: Whether the assistant's stages went well.
        success: Whether the whole episode did.
        judged: What the planner said of this and of other candidates.
    """

    episode: str
    category: str
    instance: str
    task: TaskType
    texts: tuple[str, ...]
    points: np.ndarray[tuple[int, int], np.dtype[np.float32]]
    surroundings: Surroundings
    goal: Act | None
    pre: Act | None
    T_move: Array
    hand: Array
    tried: bool
    prepared: bool
    success: bool
    judged: tuple[Judged, ...]
