"""How a skeleton becomes a plan: backtracking over candidates, each rejection sent to the stage that is to blame."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from affordance.candidates import GoalCandidate, PoseCandidate, PregraspCandidate, Proposer, Roles, SceneView
from robots.spatial import Array, points
from robots.workcell import Side, Workcell
from tamp.plan import StageName
from tamp.skeletons import Skeleton, roles_of
from tamp.stages import Exposure, Hold, Reject, StageChecker
from tamp.timeline import StagePlans, Timeline
from tamp.trace import Rejection


@dataclass(frozen=True, slots=True)
class Budget:
    """How many candidates of each stage are tried.

    Attributes:
        goals: Anticipatory goals a skeleton.
        grasps: Pre-grasps a goal.
        poses: Object poses a pre-grasp.
        finals: Final goals an object pose.
        seconds: Wall time for the whole search [s]; reaching it ends the search without a plan.
    """

    goals: int = 2
    grasps: int = 24
    poses: int = 12
    finals: int = 8
    seconds: float = 60.0


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """A refined skeleton.

    Attributes:
        number: Its number in the order tried.
        skeleton: The stages.
        goal: The final goal candidate.
        stages: The stages made concrete.
    """

    number: int
    skeleton: Skeleton
    goal: GoalCandidate
    stages: StagePlans


@dataclass(frozen=True, slots=True)
class Unsolved:
    """No candidate of any skeleton worked, or time ran out.

    Attributes:
        timed_out: Whether the wall time ended the search.
    """

    timed_out: bool


class OutOfTime(Exception):
    """Internal: the budget's wall time is spent."""


BackTo = StageName
"""The stage whose next candidate is tried after a rejection."""


@dataclass
class Search:
    """One search for a plan. ``rejections`` grows while it runs, so it can be read after an interruption.

    Attributes:
        workcell: The cell.
        proposer: Where candidates come from.
        checker: Geometric checks.
        timeline: Motion planning and timing of a chosen combination.
        view: What was observed.
        seed: Decides every draw.
        budget: Limits.
        rejections: Every candidate dropped so far.
        tried: Skeletons in the order tried.
    """

    workcell: Workcell
    proposer: Proposer
    checker: StageChecker
    timeline: Timeline
    view: SceneView
    seed: int
    budget: Budget
    rejections: list[Rejection] = field(default_factory=list)
    tried: list[Skeleton] = field(default_factory=list)

    def run(self, skeletons: list[Skeleton]) -> Solved | Unsolved:
        """Refine the skeletons in order until one works."""
        self._deadline = time.monotonic() + self.budget.seconds
        try:
            for skeleton in skeletons:
                self.tried.append(skeleton)
                if solved := self._refine(skeleton):
                    return solved
        except OutOfTime:
            return Unsolved(timed_out=True)
        return Unsolved(timed_out=False)

    # -- one level of the search each ------------------------------------------------------------------------------

    def _refine(self, skeleton: Skeleton) -> Solved | None:
        roles = roles_of(skeleton)
        goals = self.proposer.goal(self.view, self._rng(0))[: self.budget.goals]
        if not goals:
            self._reject(
                "operate", roles.primary, 0, Reject("proposal", "no way to act on the part was proposed"), "operate"
            )
        for number, goal in enumerate(goals):
            grasps = self.proposer.pregrasp(self.view, goal, self._rng(1, number))[: self.budget.grasps]
            if not grasps:
                reject = Reject("proposal", "no grasp of the fixed body was proposed: it is too wide or out of view")
                self._reject("pregrasp", roles.assistant, number, reject, "operate")
            for k, grasp in enumerate(grasps):
                if solved := self._with_grasp(skeleton, roles, goal, grasp, (number, k)):
                    return solved
        return None

    def _with_grasp(
        self, skeleton: Skeleton, roles: Roles, goal: GoalCandidate, grasp: PregraspCandidate, index: tuple[int, int]
    ) -> Solved | None:
        self._check_time()
        tried = self._tried(*index)
        hold = self.checker.hold(roles, grasp, self._rng(2, *index))
        if isinstance(hold, Reject):
            self._reject("pregrasp", roles.assistant, tried, hold, "pregrasp", grasp.T_world_hand)
            return None
        poses = self.proposer.object_pose(self.view, goal, grasp, roles, self._rng(3, *index))[: self.budget.poses]
        for k, pose in enumerate(poses):
            outcome = self._with_pose(skeleton, roles, hold, pose, (*index, k))
            if isinstance(outcome, Solved):
                return outcome
            if outcome == "pregrasp":
                return None
        return None

    def _with_pose(
        self, skeleton: Skeleton, roles: Roles, hold: Hold, pose: PoseCandidate, index: tuple[int, int, int]
    ) -> Solved | BackTo:
        self._check_time()
        T_world_hand = self.proposer.reorient(hold.candidate, pose)
        exposure = self.checker.expose(roles, hold, T_world_hand, self._rng(4, *index))
        if isinstance(exposure, Reject):
            self._reject("reorient", roles.assistant, index[-1] + 1, exposure, "reorient", T_world_hand)
            return "reorient"
        scene = self.view.moved(pose.T_move, self._hand_points(roles.assistant, T_world_hand))
        finals = self.proposer.goal(scene, self._rng(5, *index))[: self.budget.finals]
        causes: list[Reject] = []
        for k, goal in enumerate(finals):
            outcome = self._with_goal(skeleton, roles, hold, exposure, pose, goal, (*index, k))
            if isinstance(outcome, Solved):
                return outcome
            if isinstance(outcome, str):
                return outcome
            causes.append(outcome)
        return "pregrasp" if causes and all(hands_clash(cause, roles) for cause in causes) else "reorient"

    def _with_goal(
        self,
        skeleton: Skeleton,
        roles: Roles,
        hold: Hold,
        exposure: Exposure,
        pose: PoseCandidate,
        goal: GoalCandidate,
        index: tuple[int, int, int, int],
    ) -> Solved | BackTo | Reject:
        self._check_time()
        action = self.checker.act(roles, hold, exposure, goal, self._rng(6, *index))
        if isinstance(action, Reject):
            blame: BackTo = "pregrasp" if hands_clash(action, roles) else "reorient"
            self._reject("operate", roles.primary, index[-1] + 1, action, blame, goal.T_world_hand)
            return action
        counts = {"pregrasp": self._tried(*index[:2]), "reorient": index[2] + 1, "operate": index[3] + 1}
        scores = {"pregrasp": hold.candidate.score, "reorient": pose.score, "operate": goal.score}
        stages = self.timeline.build(roles, hold, exposure, action, self._seed(7, *index), counts, scores)
        if isinstance(stages, StagePlans):
            return Solved(len(self.tried) - 1, skeleton, goal, stages)
        stage, reject = stages
        arm = roles.primary if stage in ("operate", "release", "retreat") else roles.assistant
        blame = {"pregrasp": "pregrasp", "lift": "pregrasp", "reorient": "reorient"}.get(stage, "operate")  # type: ignore[assignment]
        self._reject(stage, arm, counts.get(stage, 1), reject, blame)
        return reject if blame == "operate" else blame

    # -- bookkeeping -----------------------------------------------------------------------------------------------

    def _tried(self, goal: int, grasp: int) -> int:
        return goal * self.budget.grasps + grasp + 1

    def _reject(
        self,
        stage: StageName,
        arm: Side,
        candidate: int,
        reject: Reject,
        blame: BackTo,
        T_world_hand: pin.SE3 | None = None,
    ) -> None:
        skeleton = len(self.tried) - 1
        roles = roles_of(self.tried[-1])
        self.rejections.append(
            Rejection(
                skeleton=skeleton,
                stage=stage,
                arm=arm,
                role="assistant" if arm == roles.assistant else "primary",
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

    def _hand_points(self, side: Side, T_world_hand: pin.SE3) -> Array:
        return points(T_world_hand, self.timeline.hand_points(side))


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
