"""What happens when a plan runs: joint position control and friction, watched stage by stage."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import pinocchio as pin
from msgspec import Struct

from robots.errors import SimulationDiverged
from robots.model import DualArm
from robots.spatial import Array, angle_between
from robots.workcell import SIDES, Side
from tamp.plan import Grip, Motion, Plan, Stage, StageName
from tamp.trace import Cause, Failure
from worlds import physics
from worlds.bullet.world import BulletWorld
from worlds.success import Verdict, holds, judge, part_motion
from worlds.tasks import Task

SETTLE_LIMIT = 0.3
"""Longest wait for an arm to reach the end of its motion [s]."""

TRACKING = 0.004
"""Joint error below which the arm counts as arrived [rad]."""

LOST = 0.10
"""Joint error above which the arm counts as blocked [rad]."""

CLOSED = 0.001
"""Opening of one finger below which the hand holds nothing [m]."""


class Camera(Protocol):
    """Something that records while the world runs."""

    def due(self, time: float) -> bool:
        """Whether a frame is due at a simulated time [s]."""

    def frame(self, caption: str) -> None:
        """Take a frame."""


class Checked(Struct, frozen=True, kw_only=True):
    """A monitor's verdict at the end of a stage."""

    stage: StageName
    fact: str
    true: bool
    detail: str


@dataclass(frozen=True, slots=True)
class Outcome:
    """How an execution went.

    Attributes:
        success: The paper's criterion, judged at the end.
        verdict: The judgement; ``None`` when a stage failed before the end.
        checked: The monitors' verdicts, one a stage.
        failure: Why it ended early or was not a success.
        seconds: Simulated time [s].
    """

    success: bool
    verdict: Verdict | None
    checked: tuple[Checked, ...]
    failure: Failure | None
    seconds: float


def execute(plan: Plan, world: BulletWorld, arms: DualArm, task: Task, camera: Camera | None = None) -> Outcome:
    """Run every stage in the simulated world, which must stand as it was observed, and judge the end."""
    run = _Run(plan, world, arms, task, camera)
    try:
        return run.all_stages()
    except SimulationDiverged as error:
        failure = Failure(stage=run.stage.name, reason="diverged", detail=str(error))
        return Outcome(False, None, tuple(run.checked), failure, world.time)


class _Run:
    """One execution in progress."""

    def __init__(self, plan: Plan, world: BulletWorld, arms: DualArm, task: Task, camera: Camera | None) -> None:
        self.plan, self.world, self.arms, self.task, self.camera = plan, world, arms, task, camera
        self.stage = plan.stages[0]
        self.target: dict[Side, Array] = {side: np.array(plan.start[side]) for side in SIDES}
        self.checked: list[Checked] = []
        self.T_grasp: pin.SE3 | None = None
        self.before = 0.0
        self.peak_moved, self.peak_force = 0.0, 0.0
        self.guarded = False

    def all_stages(self) -> Outcome:
        for stage in self.plan.stages:
            self.stage = stage
            if stage.name == "operate":
                self.before = part_motion(self.world)
            for step in stage.steps:
                if isinstance(step, Motion):
                    self._move(stage.arm, step)
                else:
                    self._grip(stage.arm, step)
            verdict, cause = self._monitor(stage)
            self.checked.append(verdict)
            if not verdict.true:
                failure = Failure(stage=stage.name, reason=cause, detail=verdict.detail)
                return Outcome(False, None, tuple(self.checked), failure, self.world.time)
        return self._judge()

    # -- steps -----------------------------------------------------------------------------------------------------

    def _move(self, side: Side, step: Motion) -> None:
        curve = step.trajectory()
        times = np.arange(1, int(np.ceil(curve.duration / physics.STEP)) + 1) * physics.STEP
        positions, velocities, _ = curve.sample(times)
        first = self._resumed_at(side, positions)
        for q, qd in zip(positions[first:], velocities[first:], strict=True):
            self.target[side] = q
            self.world.command_arm(side, q, qd)
            self._step()
            if step.template == "press" and self.world.contact_force(side) > self.task.press_stop:
                self.guarded = True
                break
        self.world.command_arm(side, self.target[side], np.zeros(7))
        for _ in range(int(SETTLE_LIMIT / physics.STEP)):
            if self._error(side) < TRACKING:
                break
            self._step()

    def _resumed_at(self, side: Side, positions: Array) -> int:
        """Where on a motion to begin: at its start, or after a guarded stop where it passes the arm's place.

        A press and its release follow one line, so the way back from a stop half way is the last part of the release.
        """
        if not self.guarded:
            return 0
        self.guarded = False
        return int(np.abs(positions - self.target[side]).max(axis=1).argmin())

    def _grip(self, side: Side, step: Grip) -> None:
        self.world.command_fingers(side, step.opening, step.force)
        for _ in range(int(np.ceil(step.duration / physics.STEP))):
            self._step()

    def _step(self) -> None:
        world = self.world
        world.step()
        if self.stage.role == "primary":
            self.peak_moved = max(self.peak_moved, part_motion(world) - self.before)
            self.peak_force = max(self.peak_force, world.contact_force(self.stage.arm))
        if self.camera is not None and self.camera.due(world.time):
            self.camera.frame(f"{self.stage.name}  {self.stage.arm} arm, {self.stage.role}")

    def _error(self, side: Side) -> float:
        return float(np.abs(self.world.arm_positions(side) - self.target[side]).max())

    # -- monitors --------------------------------------------------------------------------------------------------

    def _monitor(self, stage: Stage) -> tuple[Checked, Cause]:
        if (error := self._error(stage.arm)) > LOST:
            return self._say(
                "tracking", False, f"{stage.arm} arm is {np.degrees(error):.0f} deg from where it should be"
            ), "tracking"
        check = {
            "pregrasp": self._held,
            "lift": self._lifted,
            "reorient": self._exposed,
            "operate": self._operated,
            "release": self._disengaged,
            "retreat": self._still_held,
        }[stage.name]
        return check()

    def _say(self, fact: str, true: bool, detail: str) -> Checked:
        return Checked(stage=self.stage.name, fact=fact, true=true, detail=detail)

    def _held(self) -> tuple[Checked, Cause]:
        side = self.plan.assistant
        opening = self.world.opening(side)
        good = holds(self.world, side) and opening > CLOSED
        self.T_grasp = self._in_hand()
        return self._say(
            "held",
            good,
            f"fingers {'closed on the object' if good else 'closed beside the object'}, {2e3 * opening:.0f} mm apart",
        ), "not_held"

    def _lifted(self) -> tuple[Checked, Cause]:
        good = holds(self.world, self.plan.assistant) and not self.world.supported()
        self.T_grasp = self._in_hand()
        return self._say("lifted", good, "clear of the table" if good else "the object was not lifted"), "not_held"

    def _exposed(self) -> tuple[Checked, Cause]:
        slip, turn = self._slipped()
        good = holds(self.world, self.plan.assistant) and slip <= self.task.hold_slip and turn <= self.task.hold_turn
        return self._say(
            "exposed", good, f"slipped {1e3 * slip:.1f} mm, {np.degrees(turn):.1f} deg in the hand"
        ), "not_exposed"

    def _operated(self) -> tuple[Checked, Cause]:
        threshold = self.world.asset.part.threshold
        good = self.peak_moved >= threshold
        part = self.world.asset.part
        unit, scale = ("deg", np.degrees(1.0)) if part.kind == "unscrew" or part.lever else ("mm", 1e3)
        return self._say(
            "operated", good, f"joint moved {scale * self.peak_moved:.1f} of {scale * threshold:.1f} {unit} needed"
        ), "not_moved"

    def _disengaged(self) -> tuple[Checked, Cause]:
        last = self.stage.steps[-1]
        wanted = last.opening if isinstance(last, Grip) else 0.0
        opening = self.world.opening(self.plan.primary)
        good = opening > wanted - 0.004
        return self._say("disengaged", good, f"fingers {2e3 * opening:.0f} mm apart"), "tracking"

    def _still_held(self) -> tuple[Checked, Cause]:
        good = holds(self.world, self.plan.assistant)
        return self._say(
            "held", good, "the assistant still holds" if good else "the assistant lost the object"
        ), "not_held"

    def _in_hand(self) -> pin.SE3:
        """``T_hand_body``: the object in the assistant's hand (privileged, for success only)."""
        side = self.plan.assistant
        return self.arms[side].hand(self.world.arm_positions(side)).inverse() * self.world.object_pose()

    def _slipped(self) -> tuple[float, float]:
        before, now = self.T_grasp, self._in_hand()
        assert before is not None  # the pre-grasp stage sets it before any stage that reads it
        return float(np.linalg.norm(now.translation - before.translation)), angle_between(before.rotation, now.rotation)

    def _judge(self) -> Outcome:
        for _ in range(int(self.task.settle / physics.STEP)):
            self._step()
        assert self.T_grasp is not None  # the pre-grasp stage sets it
        verdict = judge(
            self.world,
            self.task,
            self.plan.assistant,
            self._in_hand(),
            self.T_grasp,
            peak_moved=self.peak_moved,
            peak_force=self.peak_force,
        )
        failure = None
        if not verdict.success:
            failure = Failure(stage=self.stage.name, reason=_cause(verdict, self.task), detail=verdict.reason)
        return Outcome(verdict.success, verdict, tuple(self.checked), failure, self.world.time)


def _cause(verdict: Verdict, task: Task) -> Cause:
    """The first thing a verdict blames, as a cause."""
    if verdict.moved < verdict.threshold:
        return "not_moved"
    if not verdict.held:
        return "not_held"
    return "slipped" if verdict.slip > task.hold_slip or verdict.turn > task.hold_turn else "force"
