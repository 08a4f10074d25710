"""How the arms follow a plan's steps: joint position control, fingers by force, contacts that are felt."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
import pinocchio as pin
from msgspec.structs import replace

from robots.model import DualArm
from robots.spatial import Array, unit
from robots.workcell import SIDES, Side
from tamp.plan import Await, Grip, Meanwhile, Motion, Plan, Stage
from worlds import physics
from worlds.bullet.human import HumanHand
from worlds.bullet.world import BulletWorld

SETTLE_LIMIT = 0.3
"""Longest wait for an arm to reach the end of its motion [s]."""

TRACKING = 0.004
"""Joint error below which the arm counts as arrived [rad]."""

FORCE_GAIN = 0.7e-6
"""How far a pressing hand is raised in each step for each newton too much [m/N]: a contact of 36 N/mm then loses 2.5 %
of the error a step. Three times as much made pads hop: the arm follows its targets some steps late."""

FORCE_READY, FORCE_WAIT = 0.2, 0.6
"""Share of the wanted force within which, and longest time for which, a drag waits for it before it moves [s]."""

FORCE_REACH = 0.008
"""Largest such correction [m]."""

FADE = 0.98
"""What is left of that correction after each step without force control: half of it is gone in 0.15 s."""


class Camera(Protocol):
    """Something that records while the world runs."""

    def due(self, time: float) -> bool:
        """Whether a frame is due at a simulated time [s]."""

    def frame(self, caption: str) -> None:
        """Take a frame."""


class Drive:
    """Two arms that do steps in a simulated world, and can go back the way they came.

    Attributes:
        plan, world, arms: What is done, where, by whom.
        target: Where each arm should be ``(7,)`` [rad].
        human: The human's hand, once it has come.
        pull: Its pull when it was felt [N].
    """

    def __init__(
        self, plan: Plan, world: BulletWorld, arms: DualArm, camera: Camera | None, watch: Callable[[], None]
    ) -> None:
        self.plan, self.world, self.arms, self.camera, self._watch = plan, world, arms, camera, watch
        self.caption = ""
        self.target: dict[Side, Array] = {side: np.array(plan.start[side]) for side in SIDES}
        self.human: HumanHand | None = None
        self.pull: float | None = None
        self.openings = dict.fromkeys(SIDES, plan.start_opening)
        self._offset = dict.fromkeys(SIDES, 0.0)
        self._guarded = False
        self._done: list[tuple[Side, Motion | Grip, float]] = []

    def do(self, stage: Stage) -> None:
        """Every step of a stage."""
        self.caption = f"{stage.name}  {stage.arm} arm, {stage.role}"
        for step in stage.steps:
            match step:
                case Motion():
                    self.move(stage.arm, step)
                case Grip():
                    self.grip(stage.arm, step)
                case Await():
                    self.wait(stage.arm, step)

    def step(self) -> None:
        """One step of the world."""
        if self.human is not None:
            self.human.act()
        self.world.step()
        self._watch()
        if self.camera is not None and self.camera.due(self.world.time):
            self.camera.frame(self.caption)

    def undo(self) -> None:
        """Go back the way everything came, so that both arms wait at home and the object stands where it was held from.

        Every motion runs backwards and every hand opens as wide as it was. What was pushed stays: a drag is not undone.
        """
        for side, step, opening in reversed(self._done):
            if isinstance(step, Grip):
                back = None if step.meanwhile is None else _reversed_part(step.meanwhile, step.duration)
                self.grip(side, replace(step, opening=opening, force=physics.OPEN_FORCE, meanwhile=back))
            elif step.template != "drag":
                self.move(side, reversed_motion(step), nearest=True)
        self._done.clear()

    def retreat(self, following: Stage) -> None:
        """Do the next stage's motions after a push whose monitor was not content, so that the arm is out of the way."""
        for step in following.steps:
            if isinstance(step, Motion):
                self.move(following.arm, step)
        self._done.clear()

    def move(self, side: Side, step: Motion, *, nearest: bool = False) -> None:
        """Follow a motion, from its start or from where it passes the arm's place, and wait until the arm is there."""
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
            self.step()
            if step.guard is not None and self.world.contact_force(side) > step.guard:
                self._guarded = True
                break
        self.world.command_arm(side, self.target[side], np.zeros(7))
        for _ in range(int(SETTLE_LIMIT / physics.STEP)):
            if self.error(side) < TRACKING:
                break
            self.step()

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
            self.step()

    def _press_on(self, side: Side, wanted: float | None) -> None:
        """Raise or lower the hand so that it presses with the wanted force; let an old correction fade."""
        if wanted is None:
            self._offset[side] *= FADE
            return
        more = FORCE_GAIN * (self.world.contact_force(side) - wanted)
        self._offset[side] = float(np.clip(self._offset[side] + more, -FORCE_REACH, FORCE_REACH))

    def _corrected(self, side: Side, q: Array) -> Array:
        """Joint positions with the hand higher by the arm's correction, by one Newton step."""
        if abs(self._offset[side]) < 1e-6:
            return np.array(q)
        arm = self.arms[side]
        J = pin.computeFrameJacobian(arm.model, arm.data, q, arm.hand_frame, pin.LOCAL_WORLD_ALIGNED)
        up = np.array([0.0, 0.0, self._offset[side], 0.0, 0.0, 0.0])
        return np.asarray(q + J.T @ np.linalg.solve(J @ J.T + 1e-6 * np.eye(6), up))

    def _resumed_at(self, side: Side, step: Motion, positions: Array, nearest: bool) -> int:
        """Where on a motion to begin: at its start, or after a guarded stop where it passes the arm's place.

        A press and its release follow one line, so the way back from a stop half way is the last part of the release.
        A drag begins where the descent stopped, as much higher as it stopped early.
        """
        if not self._guarded and not nearest:
            return 0
        self._guarded = False
        if step.force is not None:
            arm = self.arms[side]
            self._offset[side] = float(
                arm.hand(self.target[side]).translation[2] - arm.hand(positions[0]).translation[2]
            )
            return 0
        return int(np.abs(positions - self.target[side]).max(axis=1).argmin())

    def grip(self, side: Side, step: Grip) -> None:
        """Drive a hand's fingers for the time given."""
        self._done.append((side, step, self.openings[side]))
        self.openings[side] = step.opening
        self.world.command_fingers(side, step.opening, step.force)
        along = self._alongside(step)
        for k in range(1, int(np.ceil(step.duration / physics.STEP)) + 1):
            along(k * physics.STEP)
            self.step()

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

    def wait(self, side: Side, step: Await) -> None:
        """Keep still until the human pulls; the pull is what the wrist feels beyond what it felt at the beginning."""
        if self.plan.workcell.human is None:
            raise ValueError("a handover needs a workcell with a human")
        self.human = HumanHand(self.world, self.plan.workcell.human, side)
        away = unit(self.plan.workcell.human.towards)
        still = self.world.force_on(side)
        felt = 0.0
        for _ in range(int(np.ceil(step.duration / physics.STEP))):
            self.step()
            if not self.human.pulling:
                still = 0.95 * still + 0.05 * self.world.force_on(side)
                continue
            felt = 0.8 * felt + 0.2 * float((self.world.force_on(side) - still) @ away)
            if felt > step.force:
                self.pull = self.human.pull()
                return

    def error(self, side: Side) -> float:
        """Largest distance of a joint from where it should be [rad]."""
        return float(np.abs(self.world.arm_positions(side) - self.target[side]).max())


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
