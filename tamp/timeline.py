"""How a chosen combination of candidates becomes timed, certified motion, stage by stage."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from affordance.candidates import Roles
from planners import motion as free_motion
from planners.certify import Certificate, certify
from planners.motion import GoalInCollision, JointPath, NoPath, StartInCollision
from planners.timing import NotTimeable, retime
from robots.model import DualArm
from robots.spatial import Array
from robots.trajectory import Trajectory
from robots.workcell import Side, Workcell
from tamp.plan import Grip, Motion, Pair, Stage, StageName, Template, matrix
from tamp.plan import motion as motion_step
from tamp.stages import ON_TABLE, Action, Exposure, Hold, Reject, StageChecker, collision, touching
from worlds import physics

FREE_SPEED = 0.5
"""Share of the velocity limits used when moving freely."""

HELD_SPEED = 0.35
"""The same while the assistant carries the object: inertia adds little to the grip."""

CONTACT_SPEED = 0.25
"""The same on straight lines to and from contacts."""

OPERATE_SPEED = 0.15
"""The same while the part is moved: slow enough for friction to carry the load."""

PRESS_SPEED = 0.06
"""The same while a part is pressed: slow enough for a guarded stop when it reaches its end."""

CLOSE_TIME = 1.1
"""Time given to the fingers to close [s]: 40 mm at 50 mm/s and time to build up force."""

OPEN_TIME = 0.6
"""Time given to the fingers to open around a part [s]."""

Setup = Callable[[], None]


@dataclass(frozen=True, slots=True)
class StagePlans:
    """All stages of a plan.

    Attributes:
        stages: In order.
        min_clearance: Smallest distance met between anything that was not allowed to touch [m].
    """

    stages: list[Stage]
    min_clearance: float


class _Failed(Exception):
    """Internal: a stage could not be made concrete."""

    def __init__(self, stage: StageName, reject: Reject) -> None:
        self.stage, self.reject = stage, reject


class Timeline:
    """Plans free motions, times every path and certifies the timed curve in the state in which it will run."""

    def __init__(self, workcell: Workcell, arms: DualArm, checker: StageChecker) -> None:
        self.workcell, self.arms, self.checker = workcell, arms, checker

    def hand_points(self, side: Side) -> Array:
        """Corners of a hand's bounding box in its frame ``(8, 3)`` [m]."""
        gripper = self.workcell.arm(side).gripper
        x, y = 0.032, 0.10
        return np.array([[sx * x, sy * y, z] for sx in (-1, 1) for sy in (-1, 1) for z in (0.0, gripper.tip_offset)])

    def build(
        self,
        roles: Roles,
        hold: Hold,
        exposure: Exposure,
        action: Action,
        seed: int,
        counts: Mapping[str, int],
        scores: Mapping[str, float],
    ) -> StagePlans | tuple[StageName, Reject]:
        """The stages, or the first one that cannot be made and why."""
        builder = _Builder(self, roles, hold, exposure, action, seed)
        try:
            steps: dict[StageName, list[Motion | Grip]] = {
                "pregrasp": builder.pregrasp(),
                "lift": builder.lift(),
                "reorient": builder.reorient(),
                "operate": builder.operate(),
                "release": builder.release(),
                "retreat": builder.retreat(),
            }
        except _Failed as failed:
            return failed.stage, failed.reject
        stages = [
            Stage(
                name=name,
                arm=roles.assistant if name in ("pregrasp", "lift", "reorient") else roles.primary,
                role="assistant" if name in ("pregrasp", "lift", "reorient") else "primary",
                steps=steps[name],
                candidates_tried=counts.get(name, 1),
                score=float(scores.get(name, 1.0)),
                T_hand_object=None if name == "pregrasp" else matrix(hold.T_hand_object),
                T_world_object=matrix(builder.object_after(name)),
            )
            for name in steps
        ]
        return StagePlans(stages, builder.min_clearance)


class _Builder:
    """The state that passes from stage to stage while a timeline is built."""

    def __init__(
        self, timeline: Timeline, roles: Roles, hold: Hold, exposure: Exposure, action: Action, seed: int
    ) -> None:
        self.timeline, self.checker, self.workcell = timeline, timeline.checker, timeline.workcell
        self.roles, self.hold_, self.exposure, self.action, self.seed = roles, hold, exposure, action, seed
        self.q = {side: timeline.arms[side].home for side in (roles.assistant, roles.primary)}
        self.by_assistant = touching(self.workcell, roles.assistant)
        self.by_both = self.by_assistant + touching(self.workcell, roles.primary)
        self.min_clearance = np.inf

    def object_after(self, name: StageName) -> pin.SE3:
        """The object frame expected at the end of a stage."""
        if name == "pregrasp":
            return self.checker.T_world_object
        if name == "lift":
            arm = self.timeline.arms[self.roles.assistant]
            return arm.hand(self.hold_.lift.points[-1]) * self.hold_.T_hand_object
        return self.exposure.T_world_object

    # -- stages ----------------------------------------------------------------------------------------------------

    def pregrasp(self) -> list[Motion | Grip]:
        side, hold = self.roles.assistant, self.hold_

        def resting() -> None:
            self.checker.resting({side: hold.candidate.opening}, ON_TABLE)

        free = self._free("pregrasp", side, hold.approach.points[0], resting, ON_TABLE, FREE_SPEED)
        approach = self._timed("pregrasp", side, "approach", hold.approach, resting, ON_TABLE, CONTACT_SPEED)
        return [free, approach, self._close(self.by_assistant + ON_TABLE)]

    def lift(self) -> list[Motion | Grip]:
        allowed = self.by_assistant + ON_TABLE
        return [
            self._timed(
                "lift", self.roles.assistant, "lift", self.hold_.lift, self._held(None, allowed), allowed, CONTACT_SPEED
            )
        ]

    def reorient(self) -> list[Motion | Grip]:
        setup = self._held(None, self.by_assistant)
        return [self._free("reorient", self.roles.assistant, self.exposure.q, setup, self.by_assistant, HELD_SPEED)]

    def operate(self) -> list[Motion | Grip]:
        side, action = self.roles.primary, self.action
        ready = action.candidate.opening
        near, touch = self._held(ready, self.by_assistant), self._held(action.opening, self.by_both)
        steps: list[Motion | Grip] = [
            Grip(
                opening=ready,
                force=physics.OPEN_FORCE,
                duration=CLOSE_TIME if ready == 0.0 else OPEN_TIME,
                allowed=self.by_assistant,
            ),
            self._free("operate", side, action.approach.points[0], near, self.by_assistant, FREE_SPEED),
            self._timed("operate", side, "approach", action.approach, near, self.by_assistant, CONTACT_SPEED),
        ]
        if action.candidate.kind != "press":
            steps.append(self._close(self.by_both))
        speed = PRESS_SPEED if action.template == "press" else OPERATE_SPEED
        steps.append(self._timed("operate", side, action.template, action.operate, touch, self.by_both, speed))
        return steps

    def release(self) -> list[Motion | Grip]:
        side, action = self.roles.primary, self.action
        if action.release is not None:
            setup = self._held(0.0, self.by_both)
            return [self._timed("release", side, "retreat", action.release, setup, self.by_both, CONTACT_SPEED)]
        return [
            Grip(opening=action.candidate.opening, force=physics.OPEN_FORCE, duration=OPEN_TIME, allowed=self.by_both)
        ]

    def retreat(self) -> list[Motion | Grip]:
        setup = self._held(self.action.candidate.opening, self.by_both)
        return [
            self._timed(
                "retreat", self.roles.primary, "retreat", self.action.retreat, setup, self.by_both, CONTACT_SPEED
            )
        ]

    # -- steps -----------------------------------------------------------------------------------------------------

    def _held(self, primary_opening: float | None, allowed: list[Pair]) -> Setup:
        hold, roles = self.hold_, self.roles
        openings = {roles.assistant: hold.opening}
        if primary_opening is not None:
            openings[roles.primary] = primary_opening
        return lambda: self.checker.held(roles.assistant, hold.T_hand_object, openings, allowed)

    def _close(self, allowed: list[Pair]) -> Grip:
        """Close until the object stops the fingers: force, not position, ends it."""
        return Grip(opening=0.0, force=physics.GRIP_FORCE, duration=CLOSE_TIME, allowed=allowed)

    def _free(
        self, stage: StageName, side: Side, goal: Array, setup: Setup, allowed: list[Pair], speed: float
    ) -> Motion:
        setup()
        arm, still = self.timeline.arms[side], self._still(side)
        self.seed += 1
        path = free_motion.plan(self.checker.world, arm, self.q[side], goal[None, :], still, seed=self.seed)
        if isinstance(path, NoPath):
            raise _Failed(stage, no_path(path))
        return self._timed(stage, side, "free", path, setup, allowed, speed)

    def _timed(
        self,
        stage: StageName,
        side: Side,
        template: Template,
        path: JointPath,
        setup: Setup,
        allowed: list[Pair],
        speed: float,
    ) -> Motion:
        model = self.workcell.arm(side)
        trajectory = retime(path, model, speed=speed)
        if isinstance(trajectory, NotTimeable):
            raise _Failed(stage, Reject("timing", f"{template}: {trajectory.reason}"))
        self._certify(stage, side, template, trajectory, setup)
        self.q[side] = trajectory.positions[-1]
        return motion_step(template, trajectory, allowed)

    def _certify(self, stage: StageName, side: Side, template: Template, trajectory: Trajectory, setup: Setup) -> None:
        setup()
        result = certify(
            self.checker.world, self.timeline.arms[side], self.workcell.arm(side), trajectory, self._still(side)
        )
        if not isinstance(result, Certificate):
            bodies = None if result.contact is None else (result.contact.a, result.contact.b)
            detail = f"{template} at {result.time:.2f} s: {result.reason}"
            raise _Failed(stage, Reject("uncertified", detail, bodies))
        self.min_clearance = min(self.min_clearance, result.min_clearance)

    def _still(self, side: Side) -> Array:
        return self.q[self.roles.primary if side == self.roles.assistant else self.roles.assistant]


def no_path(path: NoPath) -> Reject:
    """A motion planner's failure as a rejection."""
    if isinstance(path.reason, StartInCollision | GoalInCollision):
        contact = collision(path.reason.contact)
        return Reject("collision", str(path), contact.bodies, contact.amount)
    return Reject("no_path", str(path))
