"""What do stored episodes teach: which examples do data sets hold, and which objects are kept aside for tests?"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, cast, get_args

import numpy as np
import pinocchio as pin

from affordance.candidates import OperationKind
from affordance.examples import Act, Example, Judged
from affordance.stations import STAGES, hand_corners, station, surroundings
from affordance.text import paraphrases
from robots.errors import BadInput
from robots.spatial import Array
from robots.workcell import SIDES, Gripper, Side, Workcell, load_workcell, other
from tamp.data.shards import read_shard, require_h5py, shard_paths
from tamp.episode import Request
from tamp.record import CHECK_OF_CAUSE, CHECKS, FAILED, PASSED, UNKNOWN, Action, Recorded
from tamp.trace import Rejection
from worlds.tasks import task_of

GOAL_STAGES = ("operate", "grasp", "receive")
"""Stages whose candidate is a goal; at the last, a human's."""

PRE_STAGES = ("pregrasp", "push", "press")
"""Stages by which the assistant begins a preparation."""

MOVE_STAGES = ("reorient", "present", "push", "press")
"""Stages whose candidate says how the object is expected to move."""

ASIDE = 8
"""One object in so many is kept to test what was learned, chosen by its name."""

GOAL_FAILED = ("operate", "grasp", "lift", "release", "retreat", "receive")
"""Stages at which a failure came after the primary's turn had begun, where the assistant was the other arm."""


def examples_in(folders: Sequence[Path]) -> tuple[list[Example], list[Example]]:
    """The examples of data sets: those to learn from, and those of objects kept to test what was learned.

    Raises:
        BadInput: A folder is missing or holds no episode.
        BadRunFolder: A shard is damaged.
        MissingDependency: Data sets cannot be read.
    """
    require_h5py()
    workcell = load_workcell(Request(category="").workcell)
    learned: list[Example] = []
    kept: list[Example] = []
    for folder in folders:
        if not folder.is_dir():
            raise BadInput(f"There is no data set {folder}. `bipre collect --out {folder}` makes one.")
        found = 0
        for path in shard_paths(folder):
            for entry in read_shard(path):
                found += 1
                chosen = kept if kept_aside(entry.recorded.instance) else learned
                chosen.extend(examples_of(entry.name, entry.recorded, workcell))
        if not found:
            raise BadInput(f"The data set {folder} holds no episode.")
    if not learned:
        raise BadInput("The data sets hold no example of an object that is not kept aside for tests.")
    return learned, kept


def kept_aside(instance: str) -> bool:
    """Whether an object is kept to test what was learned."""
    return hashlib.sha256(instance.encode()).digest()[0] % ASIDE == 0


def examples_of(name: str, recorded: Recorded, workcell: Workcell) -> Iterator[Example]:
    """One example for each preparation of an episode; one without actions where nothing was planned."""
    task = task_of(recorded.category)
    texts, _ = paraphrases(task)
    points = recorded.clouds["initial"].points
    starts = [k for k, action in enumerate(recorded.actions) if action.stage in PRE_STAGES]
    last = next((a for a in reversed(recorded.actions) if a.stage in GOAL_STAGES), None)
    assistant = recorded.actions[starts[0]].arm if starts else "left"
    primary = other(cast(Side, assistant))
    judged = tuple(_judgements(recorded, workcell))
    common: dict[str, Any] = {
        "episode": name,
        "category": recorded.category,
        "instance": recorded.instance,
        "task": task.type,
        "texts": texts,
        "surroundings": surroundings(workcell, task.type, primary),
    }
    if not starts or last is None:
        yield Example(
            **common, points=points, goal=None, pre=None, T_move=np.eye(4), hand=np.zeros((0, 3)), tried=False,
            prepared=False, success=False, judged=judged,
        )  # fmt: skip
        return
    tried, prepared = _reached(recorded)
    grippers = {side: workcell.arm(side).gripper for side in SIDES}
    before = np.eye(4)
    for number, (begin, end) in enumerate(zip(starts, [*starts[1:], len(recorded.actions)], strict=True)):
        stages = recorded.actions[begin:end]
        after = before
        for action in stages:
            if action.stage in MOVE_STAGES:
                after = action.T_move @ before
        T_move = after @ np.linalg.inv(before)
        final = end == len(recorded.actions)
        yield Example(
            **common,
            points=(points @ before[:3, :3].T + before[:3, 3]).astype(np.float32),
            goal=_goal(last, T_move if last.stage != "receive" else np.eye(4), grippers[primary]) if final else None,
            pre=_pre(stages[0], grippers[cast(Side, stages[0].arm)]),
            T_move=T_move,
            hand=_hand(stages, T_move, workcell),
            tried=tried and final,
            prepared=prepared,
            success=recorded.success,
            judged=judged if number == 0 else (),
        )
        before = after


def _reached(recorded: Recorded) -> tuple[bool, bool]:
    """Whether the primary's turn came, and whether the assistant's stages went well."""
    prepared = "prepared" in recorded.link_poses
    if recorded.failure is None:
        return True, True
    return prepared and recorded.failure.stage in GOAL_FAILED, prepared


def _goal(action: Action, T_move: Array, gripper: Gripper) -> Act:
    """A goal action carried back by how the object was expected to have moved."""
    back = np.linalg.inv(T_move)
    turn = back[:3, :3]
    assert action.kind in get_args(OperationKind)
    return Act(
        T_world_hand=back @ action.T_world_hand,
        tip_offset=gripper.tip_offset,
        tcp_offset=gripper.tcp_offset,
        opening=action.opening,
        direction=turn @ (action.direction if action.direction.any() else action.outward),
        amount=action.amount,
        kind=cast(OperationKind, action.kind),
        point=turn @ action.contact + back[:3, 3],
        outward=turn @ action.outward,
    )


def _pre(action: Action, gripper: Gripper) -> Act:
    nothing = np.zeros(3)
    return Act(
        action.T_world_hand, gripper.tip_offset, gripper.tcp_offset, action.opening, action.direction, action.amount,
        None, nothing, nothing, behind=bool(action.start.any()),
    )  # fmt: skip


def _hand(stages: Sequence[Action], T_move: Array, workcell: Workcell) -> Array:
    """The assistant's hand as the planner saw it when the primary's turn came."""
    pre = stages[0]
    side, T = cast(Side, pre.arm), pre.T_world_hand.copy()
    if pre.stage == "push":
        return np.zeros((0, 3))
    if pre.stage == "press":
        T[:3, 3] += pre.amount * pre.direction
    else:
        T = T_move @ T
    return hand_corners(workcell.arm(side).gripper, pin.SE3(T))


# -- what the planner said ---------------------------------------------------------------------------------------------


def _judgements(recorded: Recorded, workcell: Workcell) -> Iterator[Judged]:
    for rejection in recorded.rejections:
        labels = _labels(rejection)
        if labels is not None and rejection.approach is not None and rejection.stage in STAGES:
            T = pin.SE3(np.array(rejection.approach).reshape(4, 4))
            yield _judged(workcell, rejection.arm, T, rejection.stage, labels)
    for action in recorded.actions:
        if action.stage in (*PRE_STAGES, "reorient", "present", "operate", "grasp"):
            passed = np.ones(3, dtype=np.int8)
            yield _judged(workcell, cast(Side, action.arm), pin.SE3(action.T_world_hand), action.stage, passed)


def _judged(workcell: Workcell, side: Side, T: pin.SE3, stage: str, labels: np.ndarray) -> Judged:
    tool = T.act(np.array([0.0, 0.0, workcell.arm(side).gripper.tcp_offset]))
    return Judged(station(workcell, side, T, stage), tool if stage in PRE_STAGES else None, labels)


def _labels(rejection: Rejection) -> np.ndarray | None:
    """Labels of reach, collision and everything after, as the feasibility critic answers; ``None`` without any."""
    if rejection.cause not in CHECK_OF_CAUSE:
        return None
    failed = min(CHECKS.index(CHECK_OF_CAUSE[rejection.cause]), 2)
    return np.array([PASSED if k < failed else FAILED if k == failed else UNKNOWN for k in range(3)], dtype=np.int8)
