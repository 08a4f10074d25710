"""Whether each stage of an execution worked, and whether the whole did: judged on the simulated state."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
from msgspec import Struct

from robots.model import DualArm
from robots.spatial import angle_between, unit
from robots.workcell import Side
from tamp.drive import Drive
from tamp.plan import Grip, Plan, Stage, StageName
from tamp.trace import Cause
from worlds import physics
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

LOST = 0.10
"""Joint error above which the arm counts as blocked [rad]."""

FLICKER = 12
"""Steps in a row without contact of both fingers that still count as held: contacts of a resting pad come and go."""

FELL = 0.05
"""How far below the table top the object's body is when it has fallen off [m]."""


class Checked(Struct, frozen=True, kw_only=True):
    """A monitor's verdict at the end of a stage."""

    stage: StageName
    fact: str
    true: bool
    detail: str


class Monitors:
    """What is watched while a plan runs.

    Attributes:
        plan, world, arms, task: What is done, where, by whom, within which limits.
        drive: What the arms do; set before the first step.
    """

    def __init__(self, plan: Plan, world: BulletWorld, arms: DualArm, task: Task) -> None:
        self.plan, self.world, self.arms, self.task = plan, world, arms, task
        self.drive: Drive
        self.stage = plan.stages[0]
        self.T_grasp: pin.SE3 | None = None
        self.height = float(world.object_pose().translation[2])
        self.R_start = world.object_pose().rotation.copy()
        self.before = 0.0
        self.peak_moved, self.peak_force = 0.0, 0.0
        self.facing, self.in_zone = np.pi, False

    def begin(self, stage: Stage) -> None:
        """A stage begins."""
        self.stage = stage
        if stage.name == "operate":
            self.before = part_motion(self.world)

    def watch(self) -> None:
        """The world has moved on by a step."""
        if self.stage.name in ("operate", "release", "retreat") and self.stage.role == "primary":
            self.peak_moved = max(self.peak_moved, part_motion(self.world) - self.before)
            self.peak_force = max(self.peak_force, self.world.contact_force(self.stage.arm))

    def check(self, stage: Stage) -> tuple[Checked, Cause]:
        """What the monitor of a stage says at its end, and the cause of failure if it is not content."""
        self.stage = stage
        if stage.name not in ("push", "press") and (error := self.drive.error(stage.arm)) > LOST:
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
        good = self.drive.pull is not None and self.drive.human is not None and self.drive.human.holds()
        felt = "no pull was felt" if self.drive.pull is None else f"let go at {self.drive.pull:.1f} N"
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

    def judge(self) -> tuple[AnyVerdict, Cause]:
        """The success criterion at the end, after a settle time, and the cause of failure if it is not met."""
        match self.plan.task:
            case "articulated":
                return self._judge_articulated()
            case "edge_push" | "plate_lift":
                return self._judge_lift()
            case "handover":
                return self._judge_handover()

    def _wait(self, seconds: float) -> None:
        for _ in range(int(seconds / physics.STEP)):
            self.drive.step()

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
            self.drive.step()
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
            self.world, self.task, self.plan.assistant, pull=self.drive.pull, facing=self.facing, in_zone=self.in_zone,
            human_holds=self.drive.human is not None and self.drive.human.holds(),
        )  # fmt: skip
        cause: Cause = "dropped" if verdict.supported else "not_handed"
        return verdict, cause


def _cause(verdict: Verdict, task: Task) -> Cause:
    """The first thing a verdict blames, as a cause."""
    if verdict.moved < verdict.threshold:
        return "not_moved"
    if not verdict.held:
        return "not_held"
    return "slipped" if verdict.slip > task.hold_slip or verdict.turn > task.hold_turn else "force"
