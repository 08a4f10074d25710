"""How a plan is walked through, step by step, with the true object in the hands that carry it."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicHermiteSpline

from robots.spatial import Array, angle_between, from_list
from robots.workcell import SIDES, Side, other
from tamp.plan import Await, Grip, Meanwhile, Motion, Plan, Stage
from tamp.verify.bodies import (
    Body,
    Carried,
    Dragged,
    Operated,
    Pressed,
    beyond_edge,
    finger_gap,
    missed,
    tilt_faults,
)
from tamp.verify.contacts import SHALLOW, Lookout, Seen
from tamp.verify.curves import JOINT, OVER, REST, SAMPLE, examine, examine_part
from tamp.verify.found import Kind, Verification, Violation
from tamp.verify.rules import (
    GUARDED,
    HOLDS_LAST,
    ORDER,
    Step,
    arm_of,
    fingers,
    hands_over,
    in_order,
    may_touch,
    meets_level,
    pair_of,
    presses_on,
    rule_of,
    takes,
)
from worlds import scene
from worlds.assets import library
from worlds.assets.asset import Asset
from worlds.assets.shape import collision_vertices
from worlds.bullet.ghost import GhostCell, Names, split_openings
from worlds.bullet.world import BulletWorld
from worlds.labels import centre_of_mass
from worlds.tasks import TASKS

FRAME = (1e-4, 1e-3)
"""How far the plan's object frames may be from the hand that carries them [m], [rad]."""

STRONGEST = 60.0
"""Largest force at which a hand may stop, press or be pulled [N]: what the tasks allow for a press."""


def verify(plan: Plan) -> Verification:
    """Check a plan against its workcell and the true object.

    Raises:
        BadInput: The plan's object source, category or instance does not exist here.
    """
    started = time.perf_counter()
    asset = library.load(plan.asset.source, plan.asset.category, plan.asset.instance)
    check = _Check(plan, asset)
    if check.structure():
        with GhostCell(plan.workcell, asset) as cell:
            check.motions(cell)
    return Verification(
        ok=not check.violations,
        violations=check.violations,
        min_clearance=float(check.lookout.clearance),
        max_velocity_ratio=float(check.velocity),
        max_acceleration_ratio=float(check.acceleration),
        checked_states=check.lookout.states,
        seconds=round(time.perf_counter() - started, 3),
    )


def beginning(plan: Plan, asset: Asset) -> tuple[pin.SE3, Array]:
    """``T_world_body`` when the plan begins, and the centre of mass in the body frame ``(3,)`` [m]."""
    if plan.T_world_body is None:
        with scene.build(plan.workcell, asset, plan.seed) as world:
            return world.object_pose(), centre_of_mass(world)
    with BulletWorld(plan.workcell, asset) as world:
        return from_list(plan.T_world_body), centre_of_mass(world)


@dataclass
class _Check:
    """What is known while a plan is walked through."""

    plan: Plan
    asset: Asset
    violations: list[Violation] = field(default_factory=list)
    velocity: float = 0.0
    acceleration: float = 0.0

    def __post_init__(self) -> None:
        self.lookout = Lookout()
        self.q: dict[Side, Array] = {side: np.array(self.plan.start[side]) for side in SIDES}
        self.openings: dict[Side, tuple[float, float]] = {side: (self.plan.start_opening,) * 2 for side in SIDES}
        self.where: tuple[str, int] = ("plan", 0)
        self.part: tuple[Meanwhile, CubicHermiteSpline] | None = None
        self.speed = np.zeros(7)
        self.unheld = False

    def say(self, kind: Kind, detail: str, at: float = 0.0) -> None:
        """Note a violation at the present stage and step."""
        self.violations.append(
            Violation(kind=kind, stage=self.where[0], step=self.where[1], time=round(at, 4), detail=detail)
        )

    # -- the plan as a whole ---------------------------------------------------------------------------------------

    def structure(self) -> bool:
        """Whether task, stages, arms and roles make sense, and the object is the one planned for."""
        plan = self.plan
        if self.asset.content_hash != plan.asset.content_hash:
            was, now = plan.asset.content_hash, self.asset.content_hash
            self.say("asset_changed", f"{plan.asset.instance} was {was} when the plan was made and is {now} now")
        task = TASKS.get(plan.category)
        if task is None or (task.type, task.objects) != (plan.task, plan.asset.category):
            self.say("structure", f"{plan.category} is no {plan.task} task with a {plan.asset.category}")
        names = [f"{stage.name}({stage.arm})" for stage in plan.stages]
        if names != plan.skeleton:
            self.say("structure", f"the skeleton says {' '.join(plan.skeleton)}, the stages are {' '.join(names)}")
        if not in_order(plan):
            self.say("structure", f"the stages {' '.join(names)} are not those of {plan.task}: {ORDER[plan.task]}")
        else:
            self._roles()
        return not any(found.kind == "structure" for found in self.violations)

    def _roles(self) -> None:
        for number, stage in enumerate(self.plan.stages):
            self.where = (stage.name, 0)
            role = rule_of(self.plan, stage).role
            expected = arm_of(self.plan, role)
            if stage.role != role or stage.arm != expected:
                self.say("roles", f"stage {number} is done by the {stage.arm} arm as {stage.role}; it is the job of "
                         f"the {role}, the {expected} arm")  # fmt: skip
        self.where = ("plan", 0)

    def motions(self, cell: GhostCell) -> None:
        """Walk through every step."""
        plan = self.plan
        T_world_body, self.centre = beginning(plan, self.asset)
        self.T_object_body = from_list(plan.T_world_object).inverse() * T_world_body
        self.body = Body(cell, T_world_body)
        for side in SIDES:
            home = np.array(plan.workcell.placement(side).home)
            if (off := np.abs(self.q[side] - home).max()) > JOINT:
                self.say("start", f"the {side} arm starts {off:.6f} rad from its waiting configuration")
            cell.place_arm(side, self.q[side])
            cell.place_fingers(side, self.openings[side])
        for stage in plan.stages:
            self.where = (stage.name, 0)
            self._begins(cell, stage)
            for number, step in enumerate(stage.steps):
                self.where = (stage.name, number)
                self._permissions(stage, number)
                self._step(cell, stage, number, step)
            self.where = (stage.name, len(stage.steps) - 1)
            self._ends(cell, stage)
        self.where = ("plan", 0)
        self._holds(HOLDS_LAST[plan.task] and arm_of(plan, HOLDS_LAST[plan.task]), "the plan ends")

    # -- stages ----------------------------------------------------------------------------------------------------

    def _begins(self, cell: GhostCell, stage: Stage) -> None:
        """Whether the object is in the hand in which it must be, and the plan knows how it lies there."""
        held = arm_of(self.plan, rule_of(self.plan, stage).held)
        self._holds(held, f"the stage {stage.name} begins")
        if stage.T_hand_object is None:
            return
        if self.body.holder is None:
            self.say("object_frame", "the plan says how the object lies in a hand, but no hand holds it")
            return
        T_world_object = self.body.pose() * self.T_object_body.inverse()
        self._frame(cell.hand(self.body.holder) * from_list(stage.T_hand_object), T_world_object, "in the hand")

    def _holds(self, side: Side | None, when: str) -> None:
        if self.body.holder != side and not self.unheld:
            self.unheld = True
            held = "nothing holds it" if self.body.holder is None else f"the {self.body.holder} hand does"
            wanted = "nothing should hold the object" if side is None else f"the {side} hand should hold the object"
            self.say("not_held", f"{wanted} when {when}, but {held}")

    def _ends(self, cell: GhostCell, stage: Stage) -> None:
        table = self.plan.workcell.table
        true = self.body.pose() * self.T_object_body.inverse()
        self._frame(from_list(stage.T_world_object), true, "after its motions")
        if stage.name == "push" and (off := beyond_edge(table, self.body.pose().act(self.centre))) > 0.0:
            self.say("off_table", f"the object's centre of mass is {1e3 * off:.1f} mm beyond the table's edge")
        if stage.name == "lift" and cell.distance(("object", "table")) <= 0.0:
            self.say("on_table", "the lifted object still touches the table")

    def _frame(self, claimed: pin.SE3, true: pin.SE3, when: str) -> None:
        """Whether an object frame that the plan expects is where the true body was carried."""
        off = float(np.linalg.norm(claimed.translation - true.translation))
        turn = angle_between(claimed.rotation, true.rotation)
        if off > FRAME[0] or turn > FRAME[1]:
            self.say("object_frame", f"the plan expects the object {1e3 * off:.2f} mm and {np.degrees(turn):.2f} deg "
                     f"from where it is {when}")  # fmt: skip

    def _permissions(self, stage: Stage, number: int) -> None:
        legal = may_touch(self.plan, stage, number)
        for pair in sorted({pair_of(*pair) for pair in stage.steps[number].allowed} - legal):
            self.say("allows_too_much", f"{pair[0]} may not touch {pair[1]} here, but the plan allows it")

    def _allowed(self, stage: Stage, number: int) -> set[Names]:
        claimed = {pair_of(*pair) for pair in stage.steps[number].allowed}
        return may_touch(self.plan, stage, number) & claimed

    # -- steps -----------------------------------------------------------------------------------------------------

    def _step(self, cell: GhostCell, stage: Stage, number: int, step: Step) -> None:
        self._alongside(stage, number)
        touch = {pair_of(finger, "object") for finger in fingers(self.plan, stage.arm)}
        seen = Seen(self._allowed(stage, number), touch if meets_level(stage, number) else None)
        match step:
            case Motion():
                self._forces(stage, step)
                self._motion(cell, stage, step, seen)
                self._met(cell, stage, step, meets_level(stage, number))
            case Grip():
                self._grip(cell, stage, number, step, seen)
                self._holder(stage, step, self.body.holder)
            case Await():
                self._await(cell, stage, step, seen)
        for text, at in seen.told():
            self.say("contact", text, at)

    def _alongside(self, stage: Stage, number: int) -> None:
        """Look at what the other arm does during a step, and make ready to place it at any time of the step."""
        part = stage.steps[number].meanwhile
        self.part = None
        if part is not None and part.arm == stage.arm:
            self.say("jump", f"the {part.arm} arm cannot be in two places at once")
            self.speed = np.zeros(7)
            return
        if part is None:
            if np.abs(self.speed).max() > REST:
                self.say("not_at_rest", f"the {other(stage.arm)} arm stops at once where it was moving")
                self.speed = np.zeros(7)
            return
        if np.abs(self.speed).max() > REST and part.begin > 1e-6:
            self.say("jump", f"the {part.arm} arm pauses at once where it was moving")
        going_on = number + 1 < len(stage.steps) or part.end >= stage.steps[number].duration - 1e-6
        arm, q = self.plan.workcell.arm(part.arm), self.q[part.arm]
        curve = examine_part(part, arm, q, self.speed, last=not going_on)
        for kind, text, at in curve.faults:
            self.say(kind, text, at)
        self.velocity, self.acceleration = (
            max(self.velocity, curve.velocity),
            max(self.acceleration, curve.acceleration),
        )
        self.speed = np.array(part.velocities[-1])
        self.part = (part, CubicHermiteSpline(part.times, part.positions, part.velocities))

    def _place_other(self, cell: GhostCell, t: float) -> None:
        """Put the other arm where it is at a time of the step [s]."""
        if self.part is None:
            return
        part, spline = self.part
        self.q[part.arm] = np.array(spline(np.clip(t - part.begin, 0.0, part.times[-1])))
        cell.place_arm(part.arm, self.q[part.arm])
        if part.opening is not None and t >= part.begin:
            wide = max(*self.openings[part.arm], part.opening)
            cell.place_fingers(part.arm, (wide, wide))
            self.openings[part.arm] = (part.opening, part.opening)

    def _met(self, cell: GhostCell, stage: Stage, step: Motion, level: bool) -> None:
        """Whether a hand that should have come to the object to push it has."""
        if not level and (stage.name, step.template) != ("push", "descend"):
            return
        if (gap := finger_gap(cell, stage.arm)) > (SHALLOW if level else 0.0):
            self.say(*missed(stage.arm, gap), step.duration)

    def _forces(self, stage: Stage, step: Motion) -> None:
        for name, force in (("guard", step.guard), ("force", step.force)):
            if force is not None and not 0.0 < force <= STRONGEST:
                self.say(
                    "force_limit",
                    f"the {step.template} has a {name} of {force:g} N; above 0 to {STRONGEST:g} N are allowed",
                )
        if step.template in GUARDED and step.guard is None:
            self.say("unguarded", f"the {step.template} goes past the expected contact without a force to stop at")
        if step.template == "drag" and step.force is None and presses_on(stage):
            self.say("unguarded", "the drag presses on the object without a force to keep")

    def _holder(self, stage: Stage, step: Step, expected: Side | None) -> None:
        """Whether the plan moves the object with the hand that truly holds it.

        It may say that nothing does while the object still stands on the table and its hand keeps still.
        """
        standing = "table" in rule_of(self.plan, stage).touch and expected != stage.arm
        if step.holder != expected and not (step.holder is None and standing):
            claimed, truly = (f"the {side} hand" if side else "nothing" for side in (step.holder, expected))
            self.say("holder", f"the plan says {claimed} holds the object here; {truly} does")

    def _motion(self, cell: GhostCell, stage: Stage, step: Motion, seen: Seen) -> None:
        side = stage.arm
        curve = examine(step, side, self.plan.workcell.arm(side), self.q[side])
        for kind, text, at in curve.faults:
            self.say(kind, text, at)
        self.velocity = max(self.velocity, curve.velocity)
        self.acceleration = max(self.acceleration, curve.acceleration)
        carried = self._carried(cell, stage, step, curve.positions)
        self._holder(stage, step, self.body.holder)
        for t, q in zip(curve.times, curve.positions, strict=True):
            self._place_other(cell, float(t))
            cell.place_arm(side, q)
            carried.follow()
            self.lookout.look(cell, float(t), seen)
        for kind, text in carried.end():
            self.say(kind, text, step.duration)
        self.q[side] = curve.positions[-1]

    def _carried(self, cell: GhostCell, stage: Stage, step: Motion, positions: Array) -> Carried:
        """What the object does during a motion."""
        side = stage.arm
        cell.place_arm(side, positions[0])
        match (stage.name, step.template):
            case ("operate", "pull" | "twist" | "press" | "flip"):
                return Operated(self.body, self.asset, side, step.template)
            case ("push", "drag"):
                return Dragged(self.body, side)
            case ("press", "descend"):
                T_after = from_list(stage.T_world_object) * self.T_object_body
                vertices = np.concatenate(list(collision_vertices(self.asset).values()))
                for kind, text in tilt_faults(self.plan.workcell.table, vertices, self.body.pose(), T_after):
                    self.say(kind, text)
                cell.place_arm(side, positions[-1])
                lowest = float(cell.hand(side).translation[2])
                cell.place_arm(side, positions[0])
                return Pressed(self.body, side, T_after, lowest)
            case _:
                return Carried(self.body)

    def _grip(self, cell: GhostCell, stage: Stage, number: int, step: Grip, seen: Seen) -> None:
        side, gripper = stage.arm, self.plan.workcell.arm(stage.arm).gripper
        if step.force > gripper.force_limit * (1.0 + OVER) or not 0.0 <= step.opening <= gripper.finger_travel:
            self.say("force_limit", f"{step.force:.1f} N to {1e3 * step.opening:.1f} mm asked of fingers that give "
                     f"{gripper.force_limit:g} N and open {1e3 * gripper.finger_travel:g} mm")  # fmt: skip
        before, after = self.openings[side], (step.opening, step.opening)
        closing = step.opening < min(before)
        meant = {pair_of(finger, "object") for finger in fingers(self.plan, side)} <= seen.allowed
        if closing and meant:
            met = split_openings(cell, side, max(before))
            if met is None:
                self.say("closes_on_nothing", f"the {side} fingers close without meeting the object")
            after = met or after
        distance = max(abs(a - b) for a, b in zip(before, after, strict=True))
        for share in np.linspace(0.0, 1.0, max(2, int(np.ceil(distance / gripper.finger_velocity / SAMPLE)) + 1)):
            first, second = (float(b + share * (a - b)) for a, b in zip(after, before, strict=True))
            cell.place_fingers(side, (first, second))
            self._place_other(cell, float(share * distance / gripper.finger_velocity))
            self.lookout.look(cell, float(share * distance / gripper.finger_velocity), seen)
        self.openings[side] = after
        if self.part is not None:
            for t in np.arange(distance / gripper.finger_velocity, step.duration + SAMPLE, SAMPLE):
                self._place_other(cell, float(t))
                self.lookout.look(cell, float(t), seen)
        if closing and meant and takes(stage, number) and self.body.holder is None:
            self.body.take(side)
        elif self.body.holder == side and not closing:
            if hands_over(self.plan, stage, number):
                self.body.leave()
            else:
                self.say("drops_object", f"the {side} hand opens while it holds the object")

    def _await(self, cell: GhostCell, stage: Stage, step: Await, seen: Seen) -> None:
        if (self.plan.task, stage.name) != ("handover", "release"):
            self.say("structure", "nobody comes to pull at the object here")
        if not 0.0 < step.force <= STRONGEST:
            self.say("force_limit", f"a pull of {step.force:g} N is waited for; above 0 to {STRONGEST:g} N are allowed")
        self._holder(stage, step, self.body.holder)
        self.lookout.look(cell, 0.0, seen)
