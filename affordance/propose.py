"""Which candidates do the networks propose? The paper's five calls, each drawn, judged, thinned out and ranked.

Goal on the object as it lies; pre-grasp, push or press with that goal in mind; the object's pose; the hand's motion;
and the same goal weights again on the object as it will be, with the assistant's hand in view. Nothing is read but the
observed cloud, the cell and the instruction.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
import pinocchio as pin
import torch
from torch import Tensor

from affordance import checkpoint
from affordance.candidates import (
    ContactCandidate,
    GoalCandidate,
    OperationKind,
    PoseCandidate,
    PregraspCandidate,
    Roles,
    SceneView,
)
from affordance.checkpoint import Checkpoint
from affordance.critics import feasible
from affordance.fitting import above_table, backed_off, centred
from affordance.heads import joined
from affordance.laying import Meant, goal_on, hinged_otherwise, press_on, push_on
from affordance.maps import AffordanceMap, MapName
from affordance.moving import POSES, hand_moves, object_moves, orthonormal
from affordance.networks import KINDS, Contact, Model
from affordance.preparing import near_edge
from affordance.sampling import KEPT, Drawn, Judge, Promise, distinct, hands, promise, second_apart
from affordance.settings import SCALE
from affordance.sight import Eye, Sight
from affordance.stations import station
from affordance.text import text_encoder
from affordance.variants import Variant
from robots.errors import BadInput
from robots.spatial import Array
from robots.workcell import SIDES, Side
from worlds.tasks import Task, TaskType

Ranked = TypeVar("Ranked", GoalCandidate, PregraspCandidate, PoseCandidate, ContactCandidate)

KINDS_OF: dict[TaskType, tuple[OperationKind, ...]] = {
    "articulated": ("pull", "unscrew", "press", "flip"),
    "edge_push": ("grasp",),
    "plate_lift": ("grasp",),
    "handover": ("receive",),
}
"""What can be the goal of a task."""

CLOSED = 0.005
"""A pushing hand drawn with less than this opening of a finger has closed fingers [m]: data sets have 0 or 10 mm on."""

UNLIKELY = 0.25
"""A final operation is also proposed as another kind than the likeliest, if that is at least so much as likely."""

SHOWN = 5
"""Hands that a map shows."""

AT_REST = 1e-9
"""A view moved by less has not been moved [m]."""


@dataclass
class LearnedProposer:
    """Candidates from trained networks.

    Attributes:
        name: As given to ``--proposer``.
        task: What is asked for.
        model: The networks.
        eye: What they see.
        variant: What it goes without.
    """

    name: str
    task: Task
    model: Model
    eye: Eye
    variant: Variant
    _maps: dict[MapName, AffordanceMap] = field(default_factory=dict)

    # -- what the search asks for ----------------------------------------------------------------------------------

    def goal(self, view: SceneView, rng: np.random.Generator) -> list[GoalCandidate]:
        """Where and how the primary could act: anticipatorily on the first view, finally on the predicted one."""
        with torch.no_grad():
            sight, tokens, net = self.eye.sight(view), self.model.tokens, self.model.goal
            promised, critics = promise(net, sight.look.seen.points, sight.scene, sight.is_object), self.model.critics

            def judge(index: Tensor, codes: Tensor) -> Tensor:
                action = self.eye.judged_token(sight, index, codes)
                return torch.sigmoid(critics.goal(action, sight.scene_judged))

            found = self._hands(net, sight, sight.scene, promised, judge, rng)
            operation = net.operation(found.condition, tokens.direction(found.code))
            allowed = KINDS_OF[self.task.type]
            numbers = [KINDS.index(kind) for kind in allowed]
            sorts = net.sorts(sight.look.seen.at(found.index[None]), sight.scene)[0]
            turned, anyway = (torch.softmax(logits[:, numbers], dim=1) for logits in (operation.kinds, sorts))
            likely = (turned * anyway).numpy().astype(float)
            told = (operation.direction, operation.outward, operation.point, operation.amount)
            ways, outwards, points, amounts = (part.numpy().astype(float) for part in told)
        made = []
        for k in distinct(found.R_world_hand, found.tip, found.score * likely.max(axis=1), 2 * KEPT):
            least = likely[k].max() * (1.0 if _unmoved(view) else UNLIKELY)
            for kind, number, chance in zip(allowed, numbers, likely[k], strict=True):
                if chance < least:
                    continue
                at = (k, number)
                meant = Meant(kind, ways[at], outwards[at], points[at], float(amounts[at]))
                goal = goal_on(view, *_hand(view, found, k), meant, float(found.score[k]) * float(chance))
                if goal is not None:
                    made.append(goal)
                if goal is not None and kind == "flip" and not _unmoved(view):
                    made.append(hinged_otherwise(view, goal))
        stage = "operate" if self.task.type == "articulated" else "grasp"
        if self.task.type != "handover" and not _unmoved(view):
            made = self._by_feasibility(sight, made, stage, [(_primary(view), c.T_world_hand) for c in made])
        made.sort(key=lambda candidate: -candidate.score)
        if made and _unmoved(view):
            turns = np.array([goal.T_world_hand.rotation for goal in made])
            order = second_apart(turns, np.array([goal.point for goal in made]))
            made = [made[k] for k in order]
        self._remember("goal_before" if _unmoved(view) else "goal_after", sight, promised.both, made)
        return self._given(made)

    def pregrasp(self, view: SceneView, goal: GoalCandidate, rng: np.random.Generator) -> list[PregraspCandidate]:
        """Where the assistant could hold so that the goal action stays possible."""
        found, sight, scores = self._assistant_hands(view, goal, rng)
        gripper = view.workcell.arm("left").gripper
        made = []
        for k in distinct(found.R_world_hand, found.tip, found.score, 2 * KEPT):
            T, opening = centred(*_hand(view, found, k), view.cloud, gripper)
            free = backed_off(above_table(T, view.workcell.table.top, gripper), opening, view.cloud, gripper)
            if free is not None:
                made.append(PregraspCandidate(free, opening, float(found.score[k])))
        side = _assistant(view)
        made = self._by_feasibility(sight, made, "pregrasp", [(side, c.T_world_hand) for c in made])
        self._remember("pre", sight, scores, made)
        return self._given(made)

    def push(self, view: SceneView, goal: GoalCandidate, rng: np.random.Generator) -> list[ContactCandidate]:
        """How the assistant could push the object so that it reaches over the table's edge."""
        found, sight, scores = self._assistant_hands(view, goal, rng)
        with torch.no_grad():
            heading, far, below = self.model.pre.push(found.condition, self.model.tokens.direction(found.code))
            level = torch.cat([heading, torch.zeros_like(heading[:, :1])], dim=-1)
            headings = sight.frame.directions_world(level[None])[0].numpy().astype(float)
            lengths, from_behind = (SCALE * far).numpy().astype(float), (below > 0.0).tolist()
        edge = near_edge(view.workcell.table)
        pushed = (
            push_on(
                view,
                edge,
                *_pressing_hand(view, found, k),
                headings[k],
                lengths[k],
                float(found.score[k]),
                from_behind=from_behind[k],
            )
            for k in distinct(found.R_world_hand, found.tip, found.score, 2 * KEPT)
        )
        made = [candidate for candidate in pushed if candidate is not None]
        side = _assistant(view)
        made = self._by_feasibility(sight, made, "push", [(side, c.T_world_hand) for c in made])
        self._remember("pre", sight, scores, made)
        return self._given(made)

    def press(self, view: SceneView, goal: GoalCandidate, rng: np.random.Generator) -> list[ContactCandidate]:
        """How the assistant could press the object down on one side so that the other rises."""
        found, sight, scores = self._assistant_hands(view, goal, rng)
        with torch.no_grad():
            _, far, _ = self.model.pre.push(found.condition, self.model.tokens.direction(found.code))
            depths = (SCALE * far).numpy().astype(float)
        made = [
            press_on(view, *_pressing_hand(view, found, k), depths[k], float(found.score[k]))
            for k in distinct(found.R_world_hand, found.tip, found.score, 2 * KEPT)
        ]
        side = _assistant(view)
        made = self._by_feasibility(sight, made, "press", [(side, c.T_world_hand) for c in made])
        made = [self._tilted(view, goal, candidate, rng) for candidate in made]
        self._remember("pre", sight, scores, made)
        return self._given(made)

    def object_pose(
        self, view: SceneView, goal: GoalCandidate, grasp: PregraspCandidate, roles: Roles, rng: np.random.Generator
    ) -> list[PoseCandidate]:
        """Where the object could be brought for the goal action."""
        sight, made = self.eye.sight(view), self._brought(view, goal, grasp, roles.primary, rng)
        made = self._by_feasibility(
            sight, made, "reorient", [(roles.assistant, c.T_move * grasp.T_world_hand) for c in made]
        )
        made = self._by_feasibility(
            sight, made, "operate", [(roles.primary, c.T_move * goal.T_world_hand) for c in made]
        )
        return self._given(made)

    def present(
        self, view: SceneView, goal: GoalCandidate, grasp: PregraspCandidate, rng: np.random.Generator
    ) -> list[PoseCandidate]:
        """Where the object could be brought for a human to take it."""
        sight, made = self.eye.sight(view), self._brought(view, goal, grasp, None, rng)
        side = _assistant(view)
        made = self._by_feasibility(sight, made, "present", [(side, c.T_move * grasp.T_world_hand) for c in made])
        return self._given(made)

    def reorient(self, grasp: PregraspCandidate, pose: PoseCandidate) -> pin.SE3:
        """``T_world_hand`` of the assistant's hand once the object is there: the object moves as the hand does."""
        T_world_hand: pin.SE3 = pose.T_move * grasp.T_world_hand
        return T_world_hand

    def maps(self) -> tuple[AffordanceMap, ...]:
        """Affordance of the latest calls: before the preparation, of the assistant, and after it."""
        order: tuple[MapName, ...] = ("goal_before", "pre", "goal_after")
        return tuple(self._maps[name] for name in order if name in self._maps)

    # -- what is drawn ---------------------------------------------------------------------------------------------

    def _hands(
        self, net: Contact, sight: Sight, given: Tensor, promised: Promise, judge: Judge, rng: np.random.Generator
    ) -> Drawn:
        tokens = self.model.tokens
        return hands(
            net,
            tokens.direction,
            tokens.contact,
            given,
            sight.look,
            sight.frame,
            promised,
            judge if self.variant.ranked else None,
            rng,
        )

    def _assistant_hands(
        self, view: SceneView, goal: GoalCandidate, rng: np.random.Generator
    ) -> tuple[Drawn, Sight, Tensor]:
        with torch.no_grad():
            sight, net, critics = self.eye.sight(view), self.model.pre, self.model.critics
            spot, code = sight.spot(goal.T_world_hand, goal.opening), sight.code(goal.T_world_hand)
            shown = self.model.goal_shown(self.eye.token(sight, spot, code))
            given = joined(sight.scene, shown)
            promised = promise(net, sight.look.seen.points, given, sight.is_object)
            aim = self.eye.judged_token(sight, spot, code)

            def judge(index: Tensor, codes: Tensor) -> Tensor:
                action = self.eye.judged_token(sight, index, codes)
                return torch.sigmoid(critics.pre(action, sight.scene_judged, aim))

            return self._hands(net, sight, given, promised, judge, rng), sight, promised.both

    def _tilted(
        self, view: SceneView, goal: GoalCandidate, pressed: ContactCandidate, rng: np.random.Generator
    ) -> ContactCandidate:
        """A press with the motion of the object that is expected of it."""
        hand, ranked = (pressed.T_world_hand, pressed.opening), self.variant.ranked
        moves, _ = object_moves(self.eye, view, goal, hand, None, rng, ranked=ranked)
        return replace(pressed, T_move=moves[0])

    def _brought(
        self,
        view: SceneView,
        goal: GoalCandidate,
        grasp: PregraspCandidate,
        primary: Side | None,
        rng: np.random.Generator,
    ) -> list[PoseCandidate]:
        """Where a held object could be brought.

        The Reorient Actor, if it is asked, moves the hand, and the object with it: to about the pose that was drawn for
        the object, or where no such pose is predicted, to wherever it draws.
        """
        if not self.model.settings.object_pose:
            return [PoseCandidate(T, 1.0) for T in hand_moves(self.eye, view, goal, grasp, None, POSES, rng)]
        hand, ranked = (grasp.T_world_hand, grasp.opening), self.variant.ranked
        moves, scores = object_moves(self.eye, view, goal, hand, primary, rng, ranked=ranked)
        if self.variant.reorient == "actor":
            moves = [hand_moves(self.eye, view, goal, grasp, T_move, 1, rng)[0] for T_move in moves]
        return [PoseCandidate(T_move, score) for T_move, score in zip(moves, scores, strict=True)]

    # -- what is kept ----------------------------------------------------------------------------------------------

    def _by_feasibility(
        self, sight: Sight, made: list[Ranked], stage: str, poses: list[tuple[Side | None, pin.SE3]]
    ) -> list[Ranked]:
        """Candidates with their scores times the chance that the planner takes their hand poses, best first."""
        if not made:
            return made
        chances = np.ones(len(made))
        if self.variant.feasibility:
            chances = self._chances(sight, stage, poses)
        scored = [replace(c, score=float(c.score * chance)) for c, chance in zip(made, chances, strict=True)]
        return sorted(scored, key=lambda c: -c.score)[:KEPT]

    def _chances(self, sight: Sight, stage: str, poses: list[tuple[Side | None, pin.SE3]]) -> Array:
        workcell = sight.view.workcell
        first = stage in ("pregrasp", "push", "press")
        each = []
        for side, T in poses:
            sides = SIDES if side is None else (side,)
            each.append([station(workcell, which, T, stage) for which in sides])
        stations = torch.from_numpy(np.array(each, dtype=np.float32))
        with torch.no_grad():
            features = torch.zeros(*stations.shape[:2], 128)
            if first:
                tool = np.array([0.0, 0.0, workcell.arm("left").gripper.tcp_offset])
                near = [int(np.linalg.norm(sight.points - T.act(tool), axis=1).argmin()) for _, T in poses]
                features = sight.look.judged.points[0][torch.tensor(near)][:, None].expand(*stations.shape[:2], -1)
            chance, _ = feasible(self.model.critics.feasibility(stations, features))
        return np.asarray(chance.amax(dim=1).numpy(), dtype=float)

    def _given(self, made: list[Ranked]) -> list[Ranked]:
        """The candidates that are given away."""
        return made[:1] if self.variant.first_only else made[:KEPT]

    def _remember(
        self,
        name: MapName,
        sight: Sight,
        scores: Tensor,
        made: Sequence[GoalCandidate | PregraspCandidate | ContactCandidate],
    ) -> None:
        mine = sight.is_object.numpy()
        self._maps[name] = AffordanceMap(
            name=name,
            points=sight.points[mine],
            scores=scores.numpy()[mine].astype(float),
            hands=tuple(candidate.T_world_hand for candidate in made[:SHOWN]),
            hand_scores=tuple(float(candidate.score) for candidate in made[:SHOWN]),
        )


def learned_proposer(name: str, task: Task, variant: Variant, weights: Path) -> LearnedProposer:
    """A proposer with the weights of a file.

    Raises:
        BadInput: The file is missing, damaged or not a model, or was trained with a text encoder that is not here.
    """
    torch.set_num_threads(1)  # searches run beside each other, and the sums of several threads depend on their number
    loaded = _loaded(weights, weights.stat().st_mtime_ns if weights.is_file() else 0)
    if loaded.text_backend != "hash":
        raise BadInput(
            f"{weights} was trained with the text encoder {loaded.text_backend}; only hash can be used here."
        )
    text = torch.from_numpy(text_encoder(loaded.text_backend).encode([task.instruction]))
    return LearnedProposer(name, task, loaded.model, Eye(loaded.model, text, task.type), variant)


@functools.lru_cache(maxsize=4)
def _loaded(weights: Path, changed: int) -> Checkpoint:
    """A model, read once for each change of its file."""
    return checkpoint.load(weights)


def _hand(view: SceneView, found: Drawn, k: int) -> tuple[pin.SE3, float]:
    """One of the drawn hands, and the opening of one of its fingers [m]."""
    R = orthonormal(found.R_world_hand[k])
    tip_offset = view.workcell.arm("left").gripper.tip_offset
    return pin.SE3(R, found.tip[k] - tip_offset * R[:, 2]), float(found.opening[k])


def _pressing_hand(view: SceneView, found: Drawn, k: int) -> tuple[pin.SE3, float]:
    """The same of a hand that pushes or presses: its fingers are open or shut, not ajar."""
    T_world_hand, opening = _hand(view, found, k)
    return T_world_hand, 0.0 if opening < CLOSED else opening


def _assistant(view: SceneView) -> Side | None:
    return None if view.roles is None else view.roles.assistant


def _primary(view: SceneView) -> Side | None:
    return None if view.roles is None else view.roles.primary


def _unmoved(view: SceneView) -> bool:
    return float(np.abs(view.T_move.homogeneous - np.eye(4)).max()) < AT_REST
