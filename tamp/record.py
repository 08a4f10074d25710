"""What is kept of one episode to learn from: what was seen, where everything was, what was done and what was rejected.

A value of plain arrays and words, so that it can cross processes, be written to a data set and be compared. Whoever
plays the episode fills it; ``tamp.data`` writes and reads it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from robots.spatial import Array, frozen
from tamp.trace import Failure, Rejection
from worlds.assets.asset import Split
from worlds.tasks import TaskType

Moment = Literal["initial", "grasped", "prepared", "final"]
"""When something was looked at: at rest on the table; when the assistant has taken it up, or has pushed or pressed it,
its hand still there; when the assistant's preparation is done; when the episode has ended."""

MOMENTS: tuple[Moment, ...] = get_args(Moment)

Outcome = Literal[
    "ok", "ik", "collision", "plan", "contact", "grasp_lost", "reorient", "push_fall", "goal_miss", "drop", "timeout"
]
"""How an episode ended, in the few classes on which batches are balanced."""

OUTCOMES: tuple[Outcome, ...] = get_args(Outcome)

OUTCOME_OF_CAUSE: dict[str, Outcome] = {
    "unreachable": "ik",
    "collision": "collision",
    "no_path": "plan",
    "cartesian": "plan",
    "timing": "plan",
    "uncertified": "plan",
    "proposal": "contact",
    "budget": "timeout",
    "not_held": "grasp_lost",
    "slipped": "grasp_lost",
    "dropped": "drop",
    "not_exposed": "reorient",
    "not_presented": "reorient",
    "not_tilted": "reorient",
    "not_overhanging": "push_fall",
    "fell": "push_fall",
    "not_lifted": "grasp_lost",
    "not_handed": "goal_miss",
    "not_moved": "goal_miss",
    "force": "goal_miss",
    "tracking": "goal_miss",
    "diverged": "goal_miss",
}
"""The outcome that a cause of failure stands for; a cause that is not listed counts as ``goal_miss``."""

HANDLED = frozenset({"dropped", "slipped", "not_held", "force", "not_moved"})
"""Causes found while the object is handled, which in a push mean that it did not come to rest as it should."""

CHECKS = ("ik", "collision", "path", "timing", "certificate")
"""The planner's checks of a candidate, in their order."""

CHECK_OF_CAUSE = {
    "unreachable": "ik",
    "collision": "collision",
    "no_path": "path",
    "cartesian": "path",
    "timing": "timing",
    "uncertified": "certificate",
}
"""The check that rejected a candidate, by cause."""

PASSED, FAILED, UNKNOWN = 1, 0, -1
"""Labels of a check; unknown where it was not reached."""

ACTION_ARRAYS: dict[str, tuple[int, ...]] = {
    "T_world_hand": (4, 4),
    "contact": (3,),
    "direction": (3,),
    "outward": (3,),
    "start": (3,),
    "T_move": (4, 4),
}
"""The arrays of an action and their shapes."""

Points = np.ndarray[Any, np.dtype[np.float32]]
Links = np.ndarray[Any, np.dtype[np.uint8]]


def outcome_of(failure: Failure | None) -> Outcome:
    """The outcome of an episode that failed so, or did not."""
    if failure is None:
        return "ok"
    if failure.stage == "push" and failure.reason in HANDLED:
        return "push_fall"
    return OUTCOME_OF_CAUSE.get(failure.reason, "goal_miss")


def check_labels(cause: str) -> tuple[int, ...]:
    """One label for each of ``CHECKS``: what a rejection for this cause says about them.

    The checks are made in order, so a candidate that failed one has passed those before it.
    """
    if cause not in CHECK_OF_CAUSE:
        return (UNKNOWN,) * len(CHECKS)
    failed = CHECKS.index(CHECK_OF_CAUSE[cause])
    return tuple(PASSED if k < failed else FAILED if k == failed else UNKNOWN for k in range(len(CHECKS)))


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """What the cameras saw of the object at one moment.

    Attributes:
        points: ``(n, 3)`` in the world frame [m].
        normals: ``(n, 3)`` unit vectors, out of the surface.
        links: ``(n,)`` for each point the number of its link in ``link_names`` (privileged).
        link_names: The object's links, and whatever else points lie on.
    """

    points: Points
    normals: Points
    links: Links
    link_names: tuple[str, ...]

    def __post_init__(self) -> None:
        for name, kind in (("points", np.float32), ("normals", np.float32), ("links", np.uint8)):
            array = np.array(getattr(self, name), dtype=kind)
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        n = len(self.points)
        if self.points.shape != (n, 3) or self.normals.shape != (n, 3) or self.links.shape != (n,):
            raise ValueError(
                f"a cloud has (n, 3) points, (n, 3) normals and (n,) links, not "
                f"{self.points.shape}, {self.normals.shape} and {self.links.shape}"
            )


@dataclass(frozen=True, slots=True, eq=False)
class Action:
    """What one arm did at one stage.

    Attributes:
        stage: For example ``pregrasp``; ``receive`` is what a human is expected to do.
        arm: ``left`` or ``right``; the other one than the assistant's stands for a human.
        role: ``assistant`` or ``primary``.
        T_world_hand: ``(4, 4)`` pose of the hand at the contact; where it goes, in a stage that makes none.
        contact: ``(3,)`` contact point, or else the tool centre point there, in the world frame [m].
        direction: ``(3,)`` unit vector in the world frame along which the hand moves from the contact on, or about
            which it then turns; in a stage without a contact, along which it has come. Zero if it does not move.
        amount: How far [m], or how much it turns [rad].
        opening: Opening of one finger at the contact [m].
        score: The proposer's score.
        kind: What is done there, as in ``GoalCandidate``; empty in a stage that is no goal.
        outward: ``(3,)`` as in ``GoalCandidate``; zero in a stage that is no goal.
        start: ``(3,)`` as in ``ContactCandidate`` [m]; zero where the hand comes straight down.
        T_move: ``(4, 4)`` how the object was expected to move from where it was first seen, in the world frame;
            identity in a stage that does not move it.
    """

    stage: str
    arm: str
    role: str
    T_world_hand: Array
    contact: Array
    direction: Array
    amount: float
    opening: float
    score: float
    kind: str
    outward: Array
    start: Array
    T_move: Array

    def __post_init__(self) -> None:
        for name, shape in ACTION_ARRAYS.items():
            array = frozen(getattr(self, name))
            if array.shape != shape:
                raise ValueError(f"{name} of an action has shape {shape}, not {array.shape}")
            object.__setattr__(self, name, array)


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """One episode.

    Attributes:
        seed: Decides everything about it, with the settings of the data set.
        category: Column of the benchmark.
        instance: The object.
        source: Where it comes from, as in ``Asset``.
        content_hash: Digest of its meshes and physics, as in ``Asset``.
        split: ``seen`` or ``unseen``.
        task_type: As in ``Task``.
        instruction: As in ``Task``.
        proposer: Where the candidates came from.
        clouds: By moment; those that the episode reached.
        link_poses: By moment, then by link name: ``(4, 4)`` pose of the link in the world frame.
        actions: In the order of the plan; none without a plan.
        rejections: Every candidate that was dropped.
        success: The task's criterion.
        outcome: How it ended.
        failure: Why it failed; ``None`` on success.
        versions: Of the packages that shape an episode.
    """

    seed: int
    category: str
    instance: str
    source: str
    content_hash: str
    split: Split
    task_type: TaskType
    instruction: str
    proposer: str
    clouds: dict[Moment, Cloud]
    link_poses: dict[Moment, dict[str, Array]]
    actions: tuple[Action, ...]
    rejections: tuple[Rejection, ...]
    success: bool
    outcome: Outcome
    failure: Failure | None
    versions: dict[str, str]

    def __post_init__(self) -> None:
        if self.success != (self.outcome == "ok") or self.success != (self.failure is None):
            raise ValueError(f"success {self.success}, outcome {self.outcome} and failure {self.failure} disagree")
        for moment, poses in self.link_poses.items():
            for link, T in poses.items():
                if np.shape(T) != (4, 4):
                    raise ValueError(f"the pose of {link} at {moment} has shape {np.shape(T)}, not (4, 4)")
