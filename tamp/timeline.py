"""How drafted stages become timed, certified motion: free motions planned, paths timed, curves certified."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from planners import motion as free_motion
from planners.certify import Certificate, certify
from planners.motion import GoalInCollision, JointPath, NoPath, StartInCollision
from planners.timing import NotTimeable, retime
from robots.model import DualArm
from robots.trajectory import Trajectory
from robots.workcell import Side, other
from tamp.drafts import Draft, Leg, Pause, Reject, Setting, Situation, Squeeze
from tamp.plan import Await, Grip, Motion, Stage, StageName, matrix
from tamp.stages.cell import Cell, collision


@dataclass(frozen=True, slots=True)
class StagePlans:
    """All stages of a plan.

    Attributes:
        stages: In order.
        min_clearance: Smallest distance met between anything that was not allowed to touch [m].
        settings: The collision world during every step, by stage.
    """

    stages: list[Stage]
    min_clearance: float
    settings: list[list[Setting]]


class _Failed(Exception):
    """Internal: a stage could not be made concrete."""

    def __init__(self, reject: Reject) -> None:
        self.reject = reject


class Timeline:
    """Plans free motions, times every path and certifies the timed curve in the state in which it will run."""

    def __init__(self, cell: Cell) -> None:
        self.cell = cell

    def build(self, drafts: list[Draft], seed: int, counts: Mapping[StageName, int]) -> StagePlans | tuple[int, Reject]:
        """The stages, or the number of the first draft that cannot be made and why."""
        builder = _Builder(self.cell, seed)
        stages, settings = [], []
        for number, draft in enumerate(drafts):
            try:
                stages.append(builder.stage(draft, counts.get(draft.stage, 1)))
                settings.append(step_settings(draft))
            except _Failed as failed:
                return number, failed.reject
        return StagePlans(stages, builder.min_clearance, settings)


class _Builder:
    """What passes from stage to stage while a timeline is built."""

    def __init__(self, cell: Cell, seed: int) -> None:
        self.cell, self.seed = cell, seed
        self.min_clearance = np.inf

    def stage(self, draft: Draft, tried: int) -> Stage:
        """One stage, every motion planned, timed and certified."""
        q = dict(draft.before.q)
        steps: list[Motion | Grip | Await] = []
        for step in draft.steps:
            match step:
                case Leg():
                    motion, q[step.side] = self._motion(draft.stage, step, q[step.side], q[other(step.side)])
                    steps.append(motion)
                case Squeeze():
                    steps.append(
                        Grip(
                            opening=step.opening,
                            force=step.force,
                            duration=step.duration,
                            allowed=list(step.allowed),
                            holder=step.holder,
                        )
                    )
                case Pause():
                    steps.append(
                        Await(force=step.force, duration=step.duration, allowed=list(step.allowed), holder=step.holder)
                    )
        before, after = draft.before, draft.after
        return Stage(
            name=draft.stage,
            arm=draft.arm,
            role=draft.role,
            steps=steps,
            candidates_tried=tried,
            score=float(draft.score),
            T_hand_object=None if before.holder is None else matrix(before.T_object),
            T_world_object=matrix(world_object(self.cell.arms, after)),
        )

    def _motion(self, stage: StageName, leg: Leg, q: np.ndarray, still: np.ndarray) -> tuple[Motion, np.ndarray]:
        self.cell.apply(leg.setting)
        path = leg.way if isinstance(leg.way, JointPath) else self._free(stage, leg, q, still)
        model = self.cell.workcell.arm(leg.side)
        trajectory = retime(path, model, speed=leg.speed)
        if isinstance(trajectory, NotTimeable):
            raise _Failed(Reject("timing", f"{leg.template}: {trajectory.reason}", stage=stage))
        self._certify(stage, leg, trajectory, still)
        return (
            Motion(
                template=leg.template,
                times=trajectory.times.tolist(),
                positions=trajectory.positions.tolist(),
                velocities=trajectory.velocities.tolist(),
                allowed=list(leg.setting.allowed),
                holder=leg.setting.holder,
                guard=leg.guard,
                force=leg.force,
            ),
            trajectory.positions[-1],
        )

    def _free(self, stage: StageName, leg: Leg, q: np.ndarray, still: np.ndarray) -> JointPath:
        self.seed += 1
        goal = np.asarray(leg.way)[None, :]
        path = free_motion.plan(self.cell.world, self.cell.arms[leg.side], q, goal, still, seed=self.seed)
        if isinstance(path, NoPath):
            raise _Failed(no_path(path).at(stage))
        return path

    def _certify(self, stage: StageName, leg: Leg, trajectory: Trajectory, still: np.ndarray) -> None:
        side = leg.side
        model = self.cell.workcell.arm(side)
        result = certify(self.cell.world, self.cell.arms[side], model, trajectory, still)
        if not isinstance(result, Certificate):
            bodies = None if result.contact is None else (result.contact.a, result.contact.b)
            detail = f"{leg.template} at {result.time:.2f} s: {result.reason}"
            raise _Failed(Reject("uncertified", detail, bodies, stage=stage))
        self.min_clearance = min(self.min_clearance, result.min_clearance)


def world_object(arms: DualArm, situation: Situation) -> pin.SE3:
    """``T_world_object`` in a situation."""
    holder: Side | None = situation.holder
    if holder is None:
        return situation.T_object
    return arms[holder].hand(situation.q[holder]) * situation.T_object


def step_settings(draft: Draft) -> list[Setting]:
    """The collision world during every step of a draft; while fingers move they count as wide as before or after."""
    found: list[Setting] = []
    last = draft.before.setting()
    for step in draft.steps:
        if isinstance(step, Leg):
            last = step.setting
            found.append(last)
        else:
            found.append(replace(last, allowed=step.allowed))
    return found


def no_path(path: NoPath) -> Reject:
    """A motion planner's failure as a rejection."""
    if isinstance(path.reason, StartInCollision | GoalInCollision):
        contact = collision(path.reason.contact)
        return Reject("collision", str(path), contact.bodies, contact.amount)
    return Reject("no_path", str(path))
