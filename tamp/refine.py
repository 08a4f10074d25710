"""How a skeleton becomes a plan: backtracking over candidates, each rejection sent to the stage that is to blame."""

from __future__ import annotations

import functools
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pinocchio as pin

from affordance.candidates import GoalCandidate, OperationKind, PoseCandidate, Proposer, Roles, SceneView
from robots.workcell import Side
from tamp.drafts import Draft, Reject, Situation
from tamp.plan import StageName
from tamp.skeletons import BoundStage, Skeleton, roles_of
from tamp.stages.cell import Cell
from tamp.stages.grasping import take
from tamp.stages.holding import bring, hold, present
from tamp.stages.operating import act
from tamp.stages.pushing import press, push
from tamp.timeline import StagePlans, Timeline
from tamp.trace import Rejection

ENOUGH_POSES = 5
"""Object poses in which the primary's hand meets the object at the part before no other pose is tried."""


@dataclass(frozen=True, slots=True)
class Budget:
    """How many candidates are tried.

    Attributes:
        goals: Anticipatory goals a skeleton.
        pregrasp, object_pose, goal, push, press, present: Candidates at each level, by the proposer's method.
        skeletons: Skeletons.
        seconds: Wall time for the whole search [s]; reaching it ends the search without a plan.
    """

    goals: int = 2
    pregrasp: int = 24
    object_pose: int = 12
    goal: int = 8
    push: int = 10
    press: int = 10
    present: int = 12
    skeletons: int = 8
    seconds: float = 60.0


ONE_SHOT = Budget(goals=1, pregrasp=1, object_pose=1, goal=1, push=1, press=1, present=1, skeletons=1)
"""The paper's deployment rule: the best candidate of each stage, and no other when a check refuses it."""


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """A refined skeleton.

    Attributes:
        number: Its number in the order tried.
        skeleton: The stages.
        goal: The final goal candidate.
        stages: The stages made concrete.
        drafts: What they were made of.
        chosen: The candidate used at each level.
    """

    number: int
    skeleton: Skeleton
    goal: GoalCandidate
    stages: StagePlans
    drafts: tuple[Draft, ...]
    chosen: tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class Unsolved:
    """No candidate of any skeleton worked, or time ran out.

    Attributes:
        timed_out: Whether the wall time ended the search.
    """

    timed_out: bool


class OutOfTime(Exception):
    """Internal: the budget's wall time is spent."""


@dataclass(frozen=True, slots=True)
class Level:
    """Stages that one candidate decides: a sampled one and those that follow from it.

    Attributes:
        stages: In order; the first has the sampler.
        first: Number of the first in the skeleton.
    """

    stages: tuple[BoundStage, ...]
    first: int

    @property
    def name(self) -> StageName:
        """The sampled stage."""
        return self.stages[0].operator.name

    @property
    def sampler(self) -> str:
        """The proposer's method."""
        return self.stages[0].operator.sampler

    @property
    def arm(self) -> Side:
        """Who does the sampled stage."""
        return self.stages[0].arm


@dataclass(frozen=True, slots=True, eq=False)
class Partial:
    """A skeleton refined up to some level.

    Attributes:
        levels: All levels.
        roles: Which arm plays which role.
        goal: The goal candidate in force: anticipatory at first, then the final one.
        chosen: The candidate used at each level so far.
        drafts: The stages so far.
        situation: Where things are predicted to be.
        index: Numbers of the goal and of the candidates used.
    """

    levels: tuple[Level, ...]
    roles: Roles
    goal: GoalCandidate
    chosen: tuple[Any, ...]
    drafts: tuple[Draft, ...]
    situation: Situation
    index: tuple[int, ...]


@dataclass
class Search:
    """One search for a plan. ``rejections`` grows while it runs, so it can be read after an interruption.

    Attributes:
        proposer: Where candidates come from.
        cell: Geometric checks.
        timeline: Motion planning and timing of a chosen combination.
        situation: What was observed, and where the arms are.
        seed: Decides every draw.
        budget: Limits.
        failed: Kinds of goal action that were executed in vain before; candidates of others come first.
        rejections: Every candidate dropped so far.
        tried: Skeletons in the order tried.
    """

    proposer: Proposer
    cell: Cell
    timeline: Timeline
    situation: Situation
    seed: int
    budget: Budget
    failed: tuple[OperationKind, ...] = ()
    rejections: list[Rejection] = field(default_factory=list)
    tried: list[Skeleton] = field(default_factory=list)
    _object_hits: Counter[tuple[int, int]] = field(default_factory=Counter)

    def run(self, skeletons: Sequence[Skeleton]) -> Solved | Unsolved:
        """Refine the skeletons in order until one works."""
        self._deadline = time.monotonic() + self.budget.seconds
        try:
            for skeleton in skeletons[: self.budget.skeletons]:
                self.tried.append(skeleton)
                if solved := self._refine(skeleton):
                    return solved
        except OutOfTime:
            return Unsolved(timed_out=True)
        return Unsolved(timed_out=False)

    def _refine(self, skeleton: Skeleton) -> Solved | None:
        roles, levels = roles_of(skeleton), levels_of(skeleton)
        situation = replace(self.situation, view=replace(self.situation.view, roles=roles))
        goals = self.proposer.goal(situation.view, self._rng(0))[: self.budget.goals]
        if not goals:
            last = levels[-1]
            self._reject(last, 0, Reject("proposal", f"no way to {last.name} was proposed"), last.name)
        for number, goal in enumerate(goals):
            start = Partial(levels, roles, goal, (), (), situation, (number,))
            outcome = self._descend(start)
            if isinstance(outcome, Solved):
                return outcome
        return None

    # -- one level of the search -----------------------------------------------------------------------------------

    def _descend(self, partial: Partial) -> Solved | int:
        """A plan, or the level whose next candidate is to be tried; -1 for the next anticipatory goal."""
        depth = len(partial.chosen)
        if depth == len(partial.levels):
            return self._finish(partial)
        level = partial.levels[depth]
        found = self._candidates(partial, level)[: getattr(self.budget, level.sampler)]
        if not found:
            reject = Reject(
                "proposal", f"no candidate for {level.name} was proposed: nothing fits, or it is out of view"
            )
            self._reject(level, 0, reject, self._blamed(partial.levels, depth, depth - 1))
            return depth - 1
        causes: list[Reject] = []
        for k, candidate in enumerate(found):
            self._check_time()
            index = (*partial.index, k)
            drafts = self._check(partial, level, candidate, index)
            if isinstance(drafts, Reject):
                causes.append(drafts)
                blame = self._to_blame(partial, depth, [drafts])
                name = (
                    level.name if depth == 0 or level.sampler != "goal" else self._blamed(partial.levels, depth, blame)
                )
                self._reject(level, self._tried(index), drafts, name, self._hand(partial, candidate))
                continue
            outcome = self._descend(
                replace(
                    partial,
                    goal=candidate if isinstance(candidate, GoalCandidate) else partial.goal,
                    chosen=(*partial.chosen, candidate),
                    drafts=(*partial.drafts, *drafts),
                    situation=drafts[-1].after,
                    index=index,
                )
            )
            if isinstance(outcome, Solved) or outcome < depth:
                return outcome
        return self._to_blame(partial, depth, causes) if causes else depth - 1

    def _candidates(self, partial: Partial, level: Level) -> Sequence[Any]:
        view, rng = partial.situation.view, self._rng(1, len(partial.chosen), *partial.index)
        proposer, goal = self.proposer, partial.goal
        match level.sampler:
            case "pregrasp":
                return proposer.pregrasp(view, goal, rng)
            case "object_pose":
                return proposer.object_pose(view, goal, partial.chosen[-1], partial.roles, rng)
            case "present":
                return proposer.present(view, goal, partial.chosen[-1], rng)
            case "push":
                return proposer.push(view, goal, rng)
            case "press":
                return proposer.press(view, goal, rng)
            case "goal":
                return sorted(proposer.goal(view, rng), key=lambda candidate: candidate.kind in self.failed)
            case unknown:
                raise ValueError(f"no sampler {unknown}")

    def _check(self, partial: Partial, level: Level, candidate: Any, index: tuple[int, ...]) -> list[Draft] | Reject:
        cell, situation, rng = self.cell, partial.situation, self._rng(2, len(partial.chosen), *index)
        match level.name:
            case "pregrasp":
                return hold(cell, situation, level.arm, candidate, rng)
            case "reorient" | "present":
                T_world_hand = self.proposer.reorient(partial.chosen[-1], candidate)
                check = bring if level.name == "reorient" else functools.partial(present, partial.chosen[-1].opening)
                return check(cell, situation, level.arm, candidate, T_world_hand, rng)
            case "operate":
                return act(cell, situation, level.arm, candidate, rng)
            case "push":
                return push(cell, situation, level.arm, candidate, rng)
            case "press":
                return press(cell, situation, level.arm, candidate, rng)
            case "grasp":
                release = any(stage.operator.name == "release" for stage in level.stages)
                return take(cell, situation, level.arm, candidate, release, rng)
            case unknown:
                raise ValueError(f"the stage {unknown} has no candidates")

    def _hand(self, partial: Partial, candidate: Any) -> pin.SE3:
        """The hand pose that a candidate asks for."""
        if isinstance(candidate, PoseCandidate):
            return self.proposer.reorient(partial.chosen[-1], candidate)
        T_world_hand: pin.SE3 = candidate.T_world_hand
        return T_world_hand

    def _finish(self, partial: Partial) -> Solved | int:
        """The timeline of a full combination, or the level of the stage that cannot be timed."""
        counts = {level.name: self._tried(partial.index[: depth + 2]) for depth, level in enumerate(partial.levels)}
        stages = self.timeline.build(list(partial.drafts), self._seed(3, *partial.index), counts)
        if isinstance(stages, StagePlans):
            return Solved(len(self.tried) - 1, self.tried[-1], partial.goal, stages, partial.drafts, partial.chosen)
        number, reject = stages
        depth = next(
            d for d, level in enumerate(partial.levels) if level.first <= number < level.first + len(level.stages)
        )
        level = partial.levels[depth]
        self._reject(level, counts[level.name], reject, level.name)
        return depth

    def _to_blame(self, partial: Partial, depth: int, causes: Sequence[Reject]) -> int:
        """Where to go back to when a level's candidates failed for these causes.

        Two hands that meet at the part blame the grasp: hand and part move together, so another pose cannot help.
        A primary hand that meets the object itself does so in every pose and with every grasp: once that has happened
        in ``ENOUGH_POSES``, each with draws of its own, it blames the anticipatory goal. Everything else blames the
        level before: its next candidate makes another scene.
        """
        if partial.levels[depth].name == "operate" and all(hits_object(cause, partial.roles) for cause in causes):
            key = (len(self.tried), partial.index[0])
            self._object_hits[key] += len(causes) > 1
            if self._object_hits[key] >= ENOUGH_POSES:
                return -1
        grasp = next((d for d, level in enumerate(partial.levels[:depth]) if level.sampler == "pregrasp"), None)
        if grasp is not None and all(hands_clash(cause, partial.roles) for cause in causes):
            return grasp
        return depth - 1

    # -- bookkeeping -----------------------------------------------------------------------------------------------

    def _blamed(self, levels: Sequence[Level], depth: int, blame: int) -> StageName:
        """The stage of the level to go back to; the goal's stage stands for the anticipatory goal."""
        return levels[blame].name if blame >= 0 else levels[-1].name

    def _tried(self, index: tuple[int, ...]) -> int:
        """How many candidates of a level were tried; those of the first level go on over all goals."""
        return index[0] * self.budget.pregrasp + index[1] + 1 if len(index) == 2 else index[-1] + 1

    def _reject(
        self,
        level: Level,
        candidate: int,
        reject: Reject,
        blame: StageName,
        T_world_hand: pin.SE3 | None = None,
    ) -> None:
        stage = next((s for s in level.stages if s.operator.name == reject.stage), level.stages[0])
        self.rejections.append(
            Rejection(
                skeleton=len(self.tried) - 1,
                stage=stage.operator.name,
                arm=stage.arm,
                role=stage.operator.role,
                candidate=candidate,
                cause=reject.cause,
                detail=reject.detail,
                blame=blame,
                bodies=reject.bodies,
                amount=reject.amount,
                approach=None
                if T_world_hand is None
                else [round(float(v), 6) for v in T_world_hand.homogeneous.ravel()],
            )
        )

    def _rng(self, *key: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, len(self.tried), *key])

    def _seed(self, *key: int) -> int:
        return int(self._rng(*key).integers(1, 2**31 - 1))

    def _check_time(self) -> None:
        if time.monotonic() > self._deadline:
            raise OutOfTime


def levels_of(skeleton: Skeleton) -> tuple[Level, ...]:
    """The stages grouped by the candidate that decides them."""
    starts = [k for k, stage in enumerate(skeleton) if stage.operator.sampler]
    ends = [*starts[1:], len(skeleton)]
    return tuple(Level(skeleton[a:b], a) for a, b in zip(starts, ends, strict=True))


def hands_clash(reject: Reject, roles: Roles) -> bool:
    """Whether the primary's hand hits the assistant's hand.

    The assistant's hand and the part move together, so another object pose cannot help: the pre-grasp is to blame.
    A collision with the rest of the assistant's arm, or a hand pose out of reach, blames the object pose instead.
    """
    if reject.bodies is None:
        return False
    sides = {name.partition("/")[0] for name in reject.bodies}
    return sides == {roles.assistant, roles.primary} and all(
        "hand" in name or "finger" in name for name in reject.bodies
    )


def hits_object(reject: Reject, roles: Roles) -> bool:
    """Whether the primary's hand meets the object where it is not to be touched."""
    if reject.bodies is None or "object" not in reject.bodies:
        return False
    return any(name.startswith(f"{roles.primary}/") and ("hand" in name or "finger" in name) for name in reject.bodies)


def order(skeletons: Iterator[Skeleton], view: SceneView, goal: GoalCandidate | None) -> list[Skeleton]:
    """The skeletons by cost, equal costs by how far the object must turn to face the primary arm."""
    found = list(skeletons)
    if goal is None:
        return found

    def away(skeleton: Skeleton) -> float:
        base = np.asarray(view.workcell.placement(roles_of(skeleton).primary).base_xyz)
        towards = base[:2] - view.cloud[:, :2].mean(axis=0)
        return float(-towards @ goal.outward[:2] / np.linalg.norm(towards))

    return sorted(found, key=lambda skeleton: (len(skeleton), away(skeleton)))
