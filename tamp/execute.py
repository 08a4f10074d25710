"""What happens when a plan runs: joint position control and friction, watched stage by stage."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import pinocchio as pin
from msgspec import Struct
from msgspec.structs import replace

from robots.errors import SimulationDiverged
from robots.model import DualArm
from robots.spatial import Array, angle_between, unit
from robots.workcell import SIDES, Side
from tamp.plan import Await, Grip, Meanwhile, Motion, Plan, Stage, StageName
from tamp.trace import Cause, Failure
from worlds import physics
from worlds.bullet.human import HumanHand
from worlds.bullet.world import BulletWorld
from worlds.success import (
    AnyVerdict,
    Verdict,
    grips,
    holds,
    judge,
    judge_handover,
    judge_lift,
    overhang,
    part_motion,
)
from worlds.tasks import Task

SETTLE_LIMIT = 0.3
"""Longest wait for an arm to reach the end of its motion [s]."""

TRACKING = 0.004
"""Joint error below which the arm counts as arrived [rad]."""

LOST = 0.10
"""Joint error above which the arm counts as blocked [rad]."""

FORCE_GAIN = 0.7e-6
"""How far a pressing hand is raised in each step for each newton too much [m/N]: a contact of 36 N/mm then loses 2.5 %
of the error a step. Three times as much made pads hop: the arm follows its targets some steps late."""

FORCE_READY, FORCE_WAIT = 0.2, 0.6
"""Share of the wanted force within which, and longest time for which, a drag waits for it before it moves [s]."""

FORCE_REACH = 0.008
"""Largest such correction [m]."""

FADE = 0.98
"""What is left of that correction after each step without force control: half of it is gone in 0.15 s."""

FLICKER = 12
"""Steps in a row without contact of both fingers that still count as held: contacts of a resting pad come and go."""

FELL = 0.05
"""How far below the table top the object's body is when it has fallen off [m]."""


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
    verdict: AnyVerdict | None
    checked: tuple[Checked, ...]
    failure: Failure | None
    seconds: float


Moment = Callable[[str], None]
"""Called when a stage has ended, with its name."""


def execute(
    plan: Plan,
    world: BulletWorld,
    arms: DualArm,
    task: Task,
    camera: Camera | None = None,
    *,
    until: int | None = None,
    moment: Moment | None = None,
) -> Outcome:
    """Run the stages in the simulated world, which must stand as it was observed, and judge the end.

    Args:
        plan: What to run.
        world: The world, moved by this.
        arms: Kinematics of both arms.
        task: The limits.
        camera: Records meanwhile.
        until: Run only so many stages; the outcome then has no verdict, and ``success`` says whether all monitors
            agreed.
        moment: Called after each stage.
    """
    return Execution(plan, world, arms, task, camera).run(until, moment)


class Execution:
    """One execution in progress: stages forward, and back when something must be tried again."""

    def __init__(self, plan: Plan, world: BulletWorld, arms: DualArm, task: Task, camera: Camera | None) -> None:
        self.plan, self.world, self.arms, self.task, self.camera = plan, world, arms, task, camera
        self.stage = plan.stages[0]
        self.target: dict[Side, Array] = {side: np.array(plan.start[side]) for side in SIDES}
        self.offset = dict.fromkeys(SIDES, 0.0)
        self.checked: list[Checked] = []
        self.T_grasp: pin.SE3 | None = None
        self.height = float(world.object_pose().translation[2])
        self.R_start = world.object_pose().rotation.copy()
        self.before = 0.0
        self.peak_moved, self.peak_force = 0.0, 0.0
        self.guarded = False
        self.human: HumanHand | None = None
        self.pull: float | None = None
        self.facing, self.in_zone = np.pi, False
        self.openings = dict.fromkeys(SIDES, plan.start_opening)
        self._done: list[tuple[Side, Motion | Grip, float]] = []

    def run(self, until: int | None = None, moment: Moment | None = None) -> Outcome:
        """As ``execute``."""
        try:
            return self._stages(len(self.plan.stages) if until is None else until, moment)
        except SimulationDiverged as error:
            failure = Failure(stage=self.stage.name, reason="diverged", detail=str(error))
            return Outcome(False, None, tuple(self.checked), failure, self.world.time)

    def undo(self) -> None:
        """Go back the way everything came, so that both arms wait at home and the object stands where it was held from.

        Every motion runs backwards and every hand opens as wide as it was. What was pushed stays: a drag is not undone.
        """
        for side, step, opening in reversed(self._done):
            if isinstance(step, Grip):
                back = None if step.meanwhile is None else _reversed_part(step.meanwhile, step.duration)
                self._grip(side, replace(step, opening=opening, force=physics.OPEN_FORCE, meanwhile=back))
            elif step.template != "drag":
                self._move(side, reversed_motion(step), nearest=True)
        self._done.clear()

    def retreat(self) -> None:
        """Do the next stage's motions after a push whose monitor was not content, so that the arm is out of the way."""
        following = self.plan.stages[len(self.checked)]
        for step in following.steps:
            if isinstance(step, Motion):
                self._move(following.arm, step)
        self._done.clear()

    def _stages(self, count: int, moment: Moment | None) -> Outcome:
        """The first ``count`` stages; all of them are judged."""
        for stage in self.plan.stages[:count]:
            self.stage = stage
            if stage.name == "operate":
                self.before = part_motion(self.world)
            for step in stage.steps:
                match step:
                    case Motion():
                        self._move(stage.arm, step)
                    case Grip():
                        self._grip(stage.arm, step)
                    case Await():
                        self._await(stage.arm, step)
            verdict, cause = self._monitor(stage)
            self.checked.append(verdict)
            if moment is not None:
                moment(stage.name)
            if not verdict.true:
                failure = Failure(stage=stage.name, reason=cause, detail=verdict.detail)
                return Outcome(False, None, tuple(self.checked), failure, self.world.time)
        if count < len(self.plan.stages):
            return Outcome(True, None, tuple(self.checked), None, self.world.time)
        return self._judge()

    # -- steps -----------------------------------------------------------------------------------------------------

    def _move(self, side: Side, step: Motion, *, nearest: bool = False) -> None:
        self._done.append((side, step, self.openings[side]))
        curve = step.trajectory()
        times = np.arange(1, int(np.ceil(curve.duration / physics.STEP)) + 1) * physics.STEP
        positions, velocities, _ = curve.sample(times)
        first = self._resumed_at(side, step, positions, nearest)
        self._build_up(side, step, positions[0])
        along = self._alongside(step)
        for t, q, qd in zip(times[first:], positions[first:], velocities[first:], strict=True):
            along(float(t))
            self._press_on(side, step.force)
            self.target[side] = self._corrected(side, q)
            self.world.command_arm(side, self.target[side], qd)
            self._step()
            if step.guard is not None and self.world.contact_force(side) > step.guard:
                self.guarded = True
                break
        self.world.command_arm(side, self.target[side], np.zeros(7))
        for _ in range(int(SETTLE_LIMIT / physics.STEP)):
            if self._error(side) < TRACKING:
                break
            self._step()

    def _build_up(self, side: Side, step: Motion, q: Array) -> None:
        """Wait at the beginning of a drag until the hand presses as it should."""
        if step.force is None:
            return
        for _ in range(int(FORCE_WAIT / physics.STEP)):
            if abs(self.world.contact_force(side) - step.force) < FORCE_READY * step.force:
                break
            self._press_on(side, step.force)
            self.target[side] = self._corrected(side, q)
            self.world.command_arm(side, self.target[side], np.zeros(7))
            self._step()

    def _press_on(self, side: Side, wanted: float | None) -> None:
        """Raise or lower the hand so that it presses with the wanted force; let an old correction fade."""
        if wanted is None:
            self.offset[side] *= FADE
            return
        more = FORCE_GAIN * (self.world.contact_force(side) - wanted)
        self.offset[side] = float(np.clip(self.offset[side] + more, -FORCE_REACH, FORCE_REACH))

    def _corrected(self, side: Side, q: Array) -> Array:
        """Joint positions with the hand higher by the arm's correction, by one Newton step."""
        if abs(self.offset[side]) < 1e-6:
            return np.array(q)
        arm = self.arms[side]
        J = pin.computeFrameJacobian(arm.model, arm.data, q, arm.hand_frame, pin.LOCAL_WORLD_ALIGNED)
        up = np.array([0.0, 0.0, self.offset[side], 0.0, 0.0, 0.0])
        return np.asarray(q + J.T @ np.linalg.solve(J @ J.T + 1e-6 * np.eye(6), up))

    def _resumed_at(self, side: Side, step: Motion, positions: Array, nearest: bool) -> int:
        """Where on a motion to begin: at its start, or after a guarded stop where it passes the arm's place.

        A press and its release follow one line, so the way back from a stop half way is the last part of the release.
        A drag begins where the descent stopped, as much higher as it stopped early.
        """
        if not self.guarded and not nearest:
            return 0
        self.guarded = False
        if step.force is not None:
            arm = self.arms[side]
            self.offset[side] = float(
                arm.hand(self.target[side]).translation[2] - arm.hand(positions[0]).translation[2]
            )
            return 0
        return int(np.abs(positions - self.target[side]).max(axis=1).argmin())

    def _grip(self, side: Side, step: Grip) -> None:
        self._done.append((side, step, self.openings[side]))
        self.openings[side] = step.opening
        self.world.command_fingers(side, step.opening, step.force)
        along = self._alongside(step)
        for k in range(1, int(np.ceil(step.duration / physics.STEP)) + 1):
            along(k * physics.STEP)
            self._step()

    def _alongside(self, step: Motion | Grip) -> Callable[[float], None]:
        """What commands the other arm at a time of the step [s]."""
        part = step.meanwhile
        if part is None:
            return lambda _: None
        curve, side, shaped = part.trajectory(), part.arm, part.opening is None

        def command(t: float) -> None:
            nonlocal shaped
            if t < part.begin:
                return
            if not shaped and part.opening is not None:
                shaped = True
                self.openings[side] = part.opening
                self.world.command_fingers(side, part.opening, physics.OPEN_FORCE)
            q, qd, _ = curve.sample(t - part.begin)
            done = t - part.begin >= curve.duration and not qd.any()
            self.target[side] = q[0]
            self.world.command_arm(side, q[0], np.zeros(7) if done else qd[0])

        return command

    def _await(self, side: Side, step: Await) -> None:
        """Keep still until the human pulls; the pull is what the wrist feels beyond what it felt at the beginning."""
        if self.plan.workcell.human is None:
            raise ValueError("a handover needs a workcell with a human")
        self.human = HumanHand(self.world, self.plan.workcell.human, side)
        away = unit(self.plan.workcell.human.towards)
        still = self.world.force_on(side)
        felt = 0.0
        for _ in range(int(np.ceil(step.duration / physics.STEP))):
            self._step()
            if not self.human.pulling:
                still = 0.95 * still + 0.05 * self.world.force_on(side)
                continue
            felt = 0.8 * felt + 0.2 * float((self.world.force_on(side) - still) @ away)
            if felt > step.force:
                self.pull = self.human.pull()
                return

    def _step(self) -> None:
        world = self.world
        if self.human is not None:
            self.human.act()
        world.step()
        if self.stage.name in ("operate", "release", "retreat") and self.stage.role == "primary":
            self.peak_moved = max(self.peak_moved, part_motion(world) - self.before)
            self.peak_force = max(self.peak_force, world.contact_force(self.stage.arm))
        if self.camera is not None and self.camera.due(world.time):
            self.camera.frame(f"{self.stage.name}  {self.stage.arm} arm, {self.stage.role}")

    def _error(self, side: Side) -> float:
        return float(np.abs(self.world.arm_positions(side) - self.target[side]).max())

    # -- monitors --------------------------------------------------------------------------------------------------

    def _monitor(self, stage: Stage) -> tuple[Checked, Cause]:
        if stage.name not in ("push", "press") and (error := self._error(stage.arm)) > LOST:
            return self._say(
                "tracking", False, f"{stage.arm} arm is {np.degrees(error):.0f} deg from where it should be"
            ), "tracking"
        if self.world.object_pose().translation[2] < self.world.workcell.table.top - FELL:
            return self._say("held", False, "the object fell off the table"), "fell"
        return self._check_of(stage)()

    def _check_of(self, stage: Stage) -> Callable[[], tuple[Checked, Cause]]:
        """The monitor of a stage."""
        by_name: dict[str, Callable[[], tuple[Checked, Cause]]] = {
            "pregrasp": self._held,
            "grasp": self._held,
            "lift": self._lifted,
            "reorient": self._exposed,
            "present": self._presented,
            "operate": self._operated,
            "push": self._overhanging,
            "press": self._tilted,
        }
        by_role: dict[tuple[str, str], Callable[[], tuple[Checked, Cause]]] = {
            ("release", "primary"): self._disengaged,
            ("release", "assistant"): self._handed if self.plan.task == "handover" else self._primary_holds,
            ("retreat", "primary"): self._assistant_holds,
            ("retreat", "assistant"): self._overhanging,
        }
        return by_name.get(stage.name) or by_role[stage.name, stage.role]

    def _say(self, fact: str, true: bool, detail: str) -> Checked:
        return Checked(stage=self.stage.name, fact=fact, true=true, detail=detail)

    def _held(self) -> tuple[Checked, Cause]:
        side = self.stage.arm
        good = grips(self.world, side)
        self.T_grasp = self._in_hand(side)
        return self._say(
            "held",
            good,
            f"fingers {'closed on the object' if good else 'closed beside the object'}, "
            f"{2e3 * self.world.opening(side):.0f} mm apart",
        ), "not_held"

    def _lifted(self) -> tuple[Checked, Cause]:
        side = self.stage.arm
        good = holds(self.world, side) and not self.world.supported()
        self.T_grasp = self._in_hand(side)
        cause: Cause = "not_held" if self.stage.role == "assistant" else "not_lifted"
        return self._say("lifted", good, "clear of the table" if good else "the object was not lifted"), cause

    def _exposed(self) -> tuple[Checked, Cause]:
        good, detail = self._firm()
        return self._say("exposed", good, detail), "not_exposed"

    def _firm(self) -> tuple[bool, str]:
        """Whether the assistant still holds the object as it did, and by how much it slipped."""
        slip, turn = self._slipped(self.plan.assistant)
        good = holds(self.world, self.plan.assistant) and slip <= self.task.hold_slip and turn <= self.task.hold_turn
        return good, f"slipped {1e3 * slip:.1f} mm, {np.degrees(turn):.1f} deg in the hand"

    def _presented(self) -> tuple[Checked, Cause]:
        good, detail = self._firm()
        human, part = self.plan.workcell.human, self.world.asset.part
        if human is None:
            raise ValueError("a handover needs a workcell with a human")
        T = self.world.object_pose()
        out = T.rotation @ self.world.asset.long_axis
        self.facing = float(np.arccos(np.clip(out @ unit(human.towards), -1.0, 1.0)))
        off = np.abs(T.act(np.asarray(part.point)) - np.asarray(human.zone_centre)) - np.asarray(human.zone_size) / 2
        self.in_zone = bool(off.max() <= 0.0)
        good = good and self.in_zone and self.facing <= self.task.facing
        where = "in the human's zone" if self.in_zone else f"{1e3 * off.max():.0f} mm outside the human's zone"
        return self._say(
            "presented", good, f"{where}, part {np.degrees(self.facing):.0f} deg from the human, {detail}"
        ), "not_presented"

    def _operated(self) -> tuple[Checked, Cause]:
        threshold = self.world.asset.part.threshold
        good = self.peak_moved >= threshold
        part = self.world.asset.part
        unit_, scale = ("deg", np.degrees(1.0)) if part.kind in ("unscrew", "flip") or part.lever else ("mm", 1e3)
        return self._say(
            "operated", good, f"joint moved {scale * self.peak_moved:.1f} of {scale * threshold:.1f} {unit_} needed"
        ), "not_moved"

    def _overhanging(self) -> tuple[Checked, Cause]:
        reach = overhang(self.world)
        low, high = self.task.overhang
        return self._say(
            "overhanging",
            low <= reach <= high,
            f"the object reaches {1e3 * reach:.0f} mm over the edge, {1e3 * low:.0f} to {1e3 * high:.0f} wanted",
        ), "not_overhanging"

    def _tilted(self) -> tuple[Checked, Cause]:
        angle = angle_between(self.R_start, self.world.object_pose().rotation)
        return self._say(
            "tilted", angle >= self.task.tilt,
            f"the object is tilted by {np.degrees(angle):.0f} deg, {np.degrees(self.task.tilt):.0f} needed",
        ), "not_tilted"  # fmt: skip

    def _disengaged(self) -> tuple[Checked, Cause]:
        last = self.stage.steps[-1]
        wanted = last.opening if isinstance(last, Grip) else 0.0
        opening = self.world.opening(self.plan.primary)
        good = opening > wanted - 0.004
        return self._say("disengaged", good, f"fingers {2e3 * opening:.0f} mm apart"), "tracking"

    def _handed(self) -> tuple[Checked, Cause]:
        good = self.pull is not None and self.human is not None and self.human.holds()
        felt = "no pull was felt" if self.pull is None else f"let go at {self.pull:.1f} N"
        return self._say("handed", good, felt), "not_handed"

    def _primary_holds(self) -> tuple[Checked, Cause]:
        return self._still_held(self.plan.primary)

    def _assistant_holds(self) -> tuple[Checked, Cause]:
        return self._still_held(self.plan.assistant)

    def _still_held(self, side: Side) -> tuple[Checked, Cause]:
        good = holds(self.world, side)
        role = "assistant" if side == self.plan.assistant else "primary"
        return self._say("held", good, f"the {role} still holds" if good else f"the {role} lost the object"), "not_held"

    def _in_hand(self, side: Side) -> pin.SE3:
        """``T_hand_body``: the object in a hand (privileged, for success only)."""
        return self.arms[side].hand(self.world.arm_positions(side)).inverse() * self.world.object_pose()

    def _slipped(self, side: Side) -> tuple[float, float]:
        before, now = self.T_grasp, self._in_hand(side)
        if before is None:
            raise ValueError("no stage has grasped the object yet")
        return float(np.linalg.norm(now.translation - before.translation)), angle_between(before.rotation, now.rotation)

    # -- the end ---------------------------------------------------------------------------------------------------

    def _judge(self) -> Outcome:
        match self.plan.task:
            case "articulated":
                verdict, cause = self._judge_articulated()
            case "edge_push" | "plate_lift":
                verdict, cause = self._judge_lift()
            case "handover":
                verdict, cause = self._judge_handover()
        failure = None if verdict.success else Failure(stage=self.stage.name, reason=cause, detail=verdict.reason)
        return Outcome(verdict.success, verdict, tuple(self.checked), failure, self.world.time)

    def _wait(self, seconds: float) -> None:
        for _ in range(int(seconds / physics.STEP)):
            self._step()

    def _judge_articulated(self) -> tuple[AnyVerdict, Cause]:
        self._wait(self.task.settle)
        if self.T_grasp is None:
            raise ValueError("no stage has grasped the object")
        side = self.plan.assistant
        moved, force = self.peak_moved, self.peak_force
        verdict = judge(
            self.world, self.task, side, self._in_hand(side), self.T_grasp, peak_moved=moved, peak_force=force
        )
        return verdict, _cause(verdict, self.task)

    def _judge_lift(self) -> tuple[AnyVerdict, Cause]:
        side = self.plan.primary
        self._wait(self.task.settle)
        before = self._in_hand(side)
        rise, slip, lost, longest = np.inf, 0.0, 0, 0
        for _ in range(int(np.ceil(self.task.hold_time / physics.STEP))):
            self._step()
            rise = min(rise, float(self.world.object_pose().translation[2]) - self.height)
            slip = max(slip, float(np.linalg.norm(self._in_hand(side).translation - before.translation)))
            lost = 0 if holds(self.world, side) else lost + 1
            longest = max(longest, lost)
        verdict = judge_lift(self.world, self.task, side, rise=rise, slip=slip, dropped=longest > FLICKER)
        cause: Cause = "dropped" if not verdict.held else "not_lifted" if rise < self.task.lift_height else "slipped"
        return verdict, cause if verdict.alone or not verdict.held else "not_lifted"

    def _judge_handover(self) -> tuple[AnyVerdict, Cause]:
        self._wait(self.task.settle + self.task.hold_time)
        verdict = judge_handover(
            self.world, self.task, self.plan.assistant, pull=self.pull, facing=self.facing, in_zone=self.in_zone,
            human_holds=self.human is not None and self.human.holds(),
        )  # fmt: skip
        cause: Cause = "dropped" if verdict.supported else "not_handed"
        return verdict, cause


def reversed_motion(step: Motion) -> Motion:
    """The same curve backwards, without guard or force."""
    end = step.times[-1]
    return replace(
        step,
        times=[end - t for t in reversed(step.times)],
        positions=step.positions[::-1],
        velocities=[[-v for v in row] for row in reversed(step.velocities)],
        guard=None,
        force=None,
        meanwhile=None if step.meanwhile is None else _reversed_part(step.meanwhile, end),
    )


def _reversed_part(part: Meanwhile, duration: float) -> Meanwhile:
    """What the other arm did during a step of some duration [s], backwards."""
    end = part.times[-1]
    return replace(
        part,
        begin=max(0.0, duration - part.end),
        times=[0.0, *(end - t for t in reversed(part.times[:-1]))],
        positions=part.positions[::-1],
        velocities=[[-v for v in row] for row in reversed(part.velocities)],
        opening=None,
    )


def _cause(verdict: Verdict, task: Task) -> Cause:
    """The first thing a verdict blames, as a cause."""
    if verdict.moved < verdict.threshold:
        return "not_moved"
    if not verdict.held:
        return "not_held"
    return "slipped" if verdict.slip > task.hold_slip or verdict.turn > task.hold_turn else "force"
