"""One round of an episode: look, search, and keep what was found; offline planning has one, a closed loop several."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

import numpy as np
import pinocchio as pin

from affordance.candidates import GoalCandidate, OperationKind, Proposer, SceneView
from affordance.maps import ShowsMaps, save_maps
from planners import motion as free_motion
from planners import timing
from planners.collision import CollisionWorld
from planners.hulls import observed_hulls
from robots.model import DualArm
from robots.spatial import pose
from robots.workcell import SIDES, Workcell
from tamp import plan as plan_file
from tamp import trace as trace_file
from tamp.drafts import Situation
from tamp.operators import ALONE, INITIAL, OPERATORS
from tamp.overlap import overlapped
from tamp.plan import AssetReference, Operation, Plan, StageName
from tamp.refine import Budget, Search, Solved, Unsolved, order
from tamp.skeletons import roles_of, skeletons
from tamp.stages.cell import Cell
from tamp.symbols import State
from tamp.timeline import Timeline
from tamp.trace import Failure, Trace, TraceStatus
from worlds.assets.asset import Asset
from worlds.observe import Observation
from worlds.tasks import Task


class Watch(Protocol):
    """Something that shows progress."""

    def begin(self, phase: str) -> None:
        """A phase begins: ``world``, ``observe``, ``plan``, ``execute`` or ``write``."""

    def note(self, text: str) -> None:
        """Something worth a line happened."""


class Silent:
    """A watch that shows nothing."""

    def begin(self, phase: str) -> None:
        """Ignore it."""

    def note(self, text: str) -> None:
        """Ignore it."""


SILENT = Silent()


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """What an episode is about.

    Attributes:
        task: The column.
        workcell: The cell.
        arms: Kinematics of both arms.
        asset: The object; the planner reads only its names, for the plan file.
        seed: Decides every draw.
        proposer: Name of the proposer.
        budget: How many candidates are tried.
        pushes: How often the object may be pushed.
        overlap: Whether one arm may already move to where it acts next while the other still acts.
        alone: Whether one arm acts without an assistant.
        collisions: The planner's model of the cell; every round puts what it sees into it.
    """

    task: Task
    workcell: Workcell
    arms: DualArm
    asset: Asset
    seed: int
    proposer: str
    budget: Budget
    pushes: int
    overlap: bool
    alone: bool
    collisions: CollisionWorld


@dataclass
class Round:
    """A search from one observation, so that whatever ends it can save what there is.

    Attributes:
        subject: What the episode is about.
        observation: What was seen.
        folder: Where plan and trace go.
        number: Of the round, from 0; changes every draw.
        failed: Kinds of goal action that earlier rounds tried in vain; others come first now.
        plan: What was found.
        search: The search, once begun.
        unsolved: How it ended without a plan.
    """

    subject: Subject
    observation: Observation
    folder: Path
    number: int = 0
    failed: tuple[OperationKind, ...] = ()
    plan: Plan | None = None
    search: Search | None = None
    unsolved: Unsolved | None = None
    solved: Solved | None = field(default=None, repr=False)

    def seek(self, proposer: Proposer, initial: State = INITIAL, T_world_body: pin.SE3 | None = None) -> None:
        """Search from the observation, both arms waiting at home, and save the plan if there is one.

        Args:
            proposer: Where candidates come from.
            initial: What is true at the beginning.
            T_world_body: For the plan file: the simulated body when this is not how the seed builds the scene.
        """
        subject = self.subject
        T_world_object = pose(np.round(self.observation.cloud.mean(axis=0), 9))
        view = SceneView(subject.workcell, self.observation.cloud, pin.SE3.Identity(), np.zeros((0, 3)))
        seed = subject.seed + 1_000_003 * self.number
        self.search = _search(subject, view, T_world_object, proposer, seed, self.failed)
        first = proposer.goal(view, np.random.default_rng(seed))
        operators = (ALONE if subject.alone else OPERATORS)[subject.task.type]
        found = skeletons(subject.task.type, initial, operators=operators, repeats=subject.pushes)
        result = self.search.run(order(found, view, first[0] if first else None))
        if isinstance(proposer, ShowsMaps):
            save_maps(proposer.maps(), self.folder)
        if isinstance(result, Solved):
            stages = result.stages
            if subject.overlap:
                stages = replace(stages, stages=overlapped(self.search.cell, stages))
                result = replace(result, stages=stages)
            self.solved = result
            self.plan = self._as_plan(T_world_object, result, T_world_body)
            plan_file.save(self.plan, self.folder)
        else:
            self.unsolved = result

    def save_trace(self, status: TraceStatus, seconds: float, failure: Failure | None) -> Trace:
        """Write what was tried until now."""
        tried = [] if self.search is None else self.search.tried
        trace = Trace(
            category=self.subject.task.category,
            instance=self.subject.asset.instance,
            seed=self.subject.seed,
            proposer=self.subject.proposer,
            skeletons=[[str(stage) for stage in skeleton] for skeleton in tried],
            rejections=[] if self.search is None else self.search.rejections,
            chosen=len(tried) - 1 if self.plan is not None else None,
            plan_seconds=round(seconds, 3),
            status=status,
            failure=failure,
        )
        trace_file.save(trace, self.folder)
        return trace

    def no_plan(self) -> Failure:
        """Why there is no plan."""
        search, limit = self.search, self.subject.budget.seconds
        stage: StageName = "pregrasp"
        if search is not None and search.tried:
            stage = search.tried[0][0].operator.name
        if search is None or not search.rejections:
            return Failure(stage=stage, reason="budget", detail=f"no candidate was finished within {limit:g} s")
        tried = [[str(bound) for bound in skeleton] for skeleton in search.tried]
        found = trace_file.dominant(search.rejections, tried)
        if self.unsolved is not None and self.unsolved.timed_out:
            late = f"{found.detail} (the search ended at its limit of {limit:g} s)"
            return Failure(stage=found.stage, reason=found.reason, detail=late)
        return found

    def _as_plan(self, T_world_object: pin.SE3, solved: Solved, T_world_body: pin.SE3 | None) -> Plan:
        subject, roles = self.subject, roles_of(solved.skeleton)
        asset, workcell = subject.asset, subject.workcell
        return Plan(
            category=subject.task.category,
            task=subject.task.type,
            asset=AssetReference(
                source=asset.source,
                category=asset.category,
                instance=asset.instance,
                split=asset.split,
                content_hash=asset.content_hash,
            ),
            instruction=subject.task.instruction,
            seed=subject.seed,
            proposer=subject.proposer,
            workcell=workcell,
            packages=plan_file.package_versions(),
            observation_hash=self.observation.digest,
            assistant=roles.assistant,
            primary=roles.primary,
            operation=_operation(solved.goal),
            start={side: list(workcell.placement(side).home) for side in SIDES},
            start_opening=workcell.arm("left").gripper.finger_travel,
            T_world_object=plan_file.matrix(T_world_object),
            T_world_body=None if T_world_body is None else plan_file.matrix(T_world_body),
            skeleton=[str(stage) for stage in solved.skeleton],
            stages=solved.stages.stages,
        )


def ready_cell(workcell: Workcell, arms: DualArm) -> CollisionWorld:
    """The planner's model of a cell without an object, everything that it needs loaded: one small motion is planned."""
    collisions = CollisionWorld(workcell)
    timing.load()
    goal = arms["left"].home + 0.01
    free_motion.plan(collisions, arms["left"], arms["left"].home, goal[None, :], arms["right"].home, seed=0)
    return collisions


def _operation(goal: GoalCandidate) -> Operation:
    return Operation(kind=goal.kind, amount=goal.amount)


def _search(
    subject: Subject,
    view: SceneView,
    T_world_object: pin.SE3,
    proposer: Proposer,
    seed: int,
    failed: tuple[OperationKind, ...],
) -> Search:
    """A search that knows the observation, the workcell and what the proposer says, and nothing else."""
    workcell, collisions = view.workcell, subject.collisions
    hulls = observed_hulls(view.cloud, workcell.table.top)
    collisions.set_object([hull - T_world_object.translation for hull in hulls])
    cell = Cell(workcell, subject.arms, collisions, view.cloud - T_world_object.translation, T_world_object)
    travel = workcell.arm("left").gripper.finger_travel
    home = {side: subject.arms[side].home for side in SIDES}
    situation = Situation(view, home, dict.fromkeys(SIDES, travel), None, T_world_object, ())
    return Search(proposer, cell, Timeline(cell), situation, seed, subject.budget, failed)
