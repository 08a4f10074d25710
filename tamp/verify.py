"""Whether a saved plan is right, checked without any of the code that made it.

Its own curves (SciPy's Hermite splines), its own kinematics and contacts (PyBullet's), and the asset's true geometry at
its true pose, against the limits and contacts that the plan claims and against what each stage may touch at all.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import pinocchio as pin
from msgspec import Struct
from scipy.interpolate import CubicHermiteSpline

from robots.spatial import Array, angle_between, from_list
from robots.workcell import SIDES, Side
from tamp.plan import Grip, Motion, Plan, Stage
from worlds import scene
from worlds.assets import library
from worlds.assets.asset import Asset
from worlds.bullet.ghost import GhostCell, Names, split_openings

SAMPLE = 0.002
"""Longest time between checked states [s]."""

PENETRATION = 0.001
"""Depth that counts as a collision [m]: PyBullet rounds each hull by a millimetre, so a touch shows as up to 2 mm."""

JOINT = 1e-6
"""Largest step between the end of one motion and the start of the next [rad]."""

REST = 1e-6
"""Largest joint velocity at the ends of a motion [rad/s]."""

OVER = 1e-6
"""How much a ratio to a limit may exceed 1 before it counts."""

FRAME = (1e-4, 1e-3)
"""How far the plan's object frames may be from the hand that carries them [m], [rad]."""

CLEARANCE_EVERY = 25
"""Every how many states the distances of bodies that do not touch are measured."""

CLEARANCE_CAP = 0.20
"""Distances beyond this are not told apart [m]."""

Kind = Literal[
    "asset_changed", "structure", "roles", "start", "jump", "not_at_rest", "position_limit", "velocity_limit",
    "acceleration_limit", "force_limit", "allows_too_much", "contact", "closes_on_nothing", "drops_object",
    "object_frame",
]  # fmt: skip

SEQUENCE = {"pregrasp": 0, "lift": 1, "reorient": 2, "operate": 3, "release": 4, "retreat": 5}
ROLE = {
    "pregrasp": "assistant", "lift": "assistant", "reorient": "assistant",
    "operate": "primary", "release": "primary", "retreat": "primary",
}  # fmt: skip
"""Which role may act in which stage."""


class Violation(Struct, frozen=True, kw_only=True):
    """One thing that is wrong.

    Attributes:
        kind: For counting.
        stage: Stage name, or ``plan``.
        step: Number of the step in the stage.
        time: When in the step it is worst [s].
        detail: What, with names and numbers.
    """

    kind: Kind
    stage: str
    step: int
    time: float
    detail: str


class Verification(Struct, frozen=True, kw_only=True):
    """What an independent check of a plan found.

    Attributes:
        ok: Nothing is wrong.
        violations: Everything that is.
        min_clearance: Smallest distance between bodies that may not touch [m], at most ``CLEARANCE_CAP``: measured at
            every ``CLEARANCE_EVERY``-th state, and at every state in which bodies nearly touch.
        max_velocity_ratio: Largest joint velocity over its limit.
        max_acceleration_ratio: Largest joint acceleration over its limit.
        checked_states: Configurations checked for contact.
        seconds: Wall time [s].
    """

    ok: bool
    violations: list[Violation]
    min_clearance: float
    max_velocity_ratio: float
    max_acceleration_ratio: float
    checked_states: int
    seconds: float


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
        min_clearance=float(check.min_clearance),
        max_velocity_ratio=float(check.velocity),
        max_acceleration_ratio=float(check.acceleration),
        checked_states=check.states,
        seconds=round(time.perf_counter() - started, 3),
    )


def may_touch(plan: Plan, stage: Stage, step: Motion | Grip) -> set[Names]:
    """What may touch at all in a step of a stage, by what the stage is for.

    The object stands on the table until it is lifted. The assistant holds it from the closing on. The primary's
    fingers meet it from the end of their approach on, until they have left.
    """
    assistant, primary = (_fingers(plan, side) for side in (plan.assistant, plan.primary))
    touching: set[Names] = set()
    if stage.name in ("pregrasp", "lift"):
        touching.add(("object", "table"))
    if stage.name != "pregrasp" or isinstance(step, Grip):
        touching |= {_pair(finger, "object") for finger in assistant}
    arriving = isinstance(step, Motion) and step.template in ("free", "approach")
    if stage.name in ("release", "retreat") or (stage.name == "operate" and not arriving):
        touching |= {_pair(finger, "object") for finger in primary}
    return touching


def _fingers(plan: Plan, side: Side) -> list[str]:
    return [f"{side}/{link}" for link in plan.workcell.arm(side).gripper.finger_links]


def _pair(a: str, b: str) -> Names:
    return (a, b) if a < b else (b, a)


@dataclass(frozen=True, slots=True)
class _Worst:
    """The deepest unintended contact of two bodies in one step, and from when to when there was one."""

    time: float
    depth: float
    first: float
    last: float


class _Seen:
    """Unintended contacts met in one step."""

    def __init__(self, allowed: set[Names]) -> None:
        self.allowed = allowed
        self.worst: dict[Names, _Worst] = {}

    def note(self, pair: Names, t: float, depth: float) -> None:
        """Two bodies are this deep [m] in each other at ``t`` [s]."""
        before = self.worst.get(pair)
        if before is None:
            self.worst[pair] = _Worst(t, depth, t, t)
        elif depth > before.depth:
            self.worst[pair] = _Worst(t, depth, before.first, t)
        else:
            self.worst[pair] = _Worst(before.time, before.depth, before.first, t)


class _Part:
    """The functional joint while a hand moves it: it follows the hand's motion relative to the body."""

    def __init__(self, cell: GhostCell, asset: Asset, side: Side, step: Motion) -> None:
        self.cell, self.part, self.side, self.template = cell, asset.part, side, step.template
        arm = cell.workcell.arm(side)
        self.T_hand_tcp = pin.SE3(np.eye(3), np.array([0.0, 0.0, arm.gripper.tcp_offset]))
        self.slack = (
            max(0.0, min(cell.finger_gap(side, finger) for finger in (0, 1))) if step.template == "press" else 0
        )
        self.before: pin.SE3 | None = None
        self.moved = 0.0

    def follow(self, T_world_body: pin.SE3) -> None:
        """Put the joint where the hand has brought it by now."""
        T_body_tcp = T_world_body.inverse() * self.cell.hand(self.side) * self.T_hand_tcp
        if self.before is not None:
            if self.template == "twist":
                turned = pin.log3(T_body_tcp.rotation @ self.before.rotation.T)
                self.moved += float(turned @ self.part.axis)
            else:
                self.moved += float((T_body_tcp.translation - self.before.translation) @ self.part.axis)
        self.before = T_body_tcp
        driven = (self.moved - self.slack) / (self.part.lever or 1.0)
        self.cell.place_part(self.part.start + self.part.sense * float(np.clip(driven, 0.0, self.part.travel)))


def _peaks(spline: CubicHermiteSpline) -> tuple[Array, Array]:
    """Largest speed and acceleration on every segment ``(n - 1, 7)``, exactly: a parabola and a line."""
    c3, c2, c1, _ = spline.c
    h = np.diff(spline.x)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        turning = np.where(np.abs(c3) > 0.0, -c2 / (3.0 * c3), 0.0)
    u = np.stack([np.zeros_like(c1), np.broadcast_to(h, c1.shape), np.clip(turning, 0.0, h)])
    speeds = np.abs(3.0 * c3 * u**2 + 2.0 * c2 * u + c1).max(axis=0)
    rates = np.abs(6.0 * c3 * u[:2] + 2.0 * c2).max(axis=0)
    return speeds, rates


@dataclass
class _Check:
    """What is known while a plan is walked through."""

    plan: Plan
    asset: Asset
    violations: list[Violation] = field(default_factory=list)
    min_clearance: float = CLEARANCE_CAP
    velocity: float = 0.0
    acceleration: float = 0.0
    states: int = 0

    def __post_init__(self) -> None:
        self.q: dict[Side, Array] = {side: np.array(self.plan.start[side]) for side in SIDES}
        self.openings: dict[Side, tuple[float, float]] = {side: (self.plan.start_opening,) * 2 for side in SIDES}
        self.T_hand_body: pin.SE3 | None = None
        self.engaged = False
        self.where: tuple[str, int] = ("plan", 0)

    def say(self, kind: Kind, detail: str, at: float = 0.0) -> None:
        """Note a violation at the present stage and step."""
        self.violations.append(
            Violation(kind=kind, stage=self.where[0], step=self.where[1], time=round(at, 4), detail=detail)
        )

    # -- the plan as a whole ---------------------------------------------------------------------------------------

    def structure(self) -> bool:
        """Whether stages, arms and roles make sense, and the object is the one planned for."""
        plan = self.plan
        if self.asset.content_hash != plan.asset.content_hash:
            was, now = plan.asset.content_hash, self.asset.content_hash
            self.say("asset_changed", f"{plan.asset.instance} was {was} when the plan was made and is {now} now")
        names = [f"{stage.name}({stage.arm})" for stage in plan.stages]
        if names != plan.skeleton:
            self.say("structure", f"the skeleton says {' '.join(plan.skeleton)}, the stages are {' '.join(names)}")
        order = [SEQUENCE[stage.name] for stage in plan.stages]
        if order != sorted(set(order)) or set(order) != set(SEQUENCE.values()):
            self.say("structure", f"the stages {' '.join(names)} are not {', '.join(SEQUENCE)} once each, in order")
        for number, stage in enumerate(plan.stages):
            self.where = (stage.name, 0)
            expected = plan.assistant if stage.role == "assistant" else plan.primary
            if stage.role != ROLE[stage.name] or stage.arm != expected:
                self.say("roles", f"stage {number} is done by the {stage.arm} arm as {stage.role}; it is the job of "
                         f"the {ROLE[stage.name]}, the {self._arm_of(stage)} arm")  # fmt: skip
        self.where = ("plan", 0)
        return not any(found.kind == "structure" for found in self.violations)

    def _arm_of(self, stage: Stage) -> Side:
        return self.plan.assistant if ROLE[stage.name] == "assistant" else self.plan.primary

    def motions(self, cell: GhostCell) -> None:
        """Walk through every step."""
        plan = self.plan
        with scene.build(plan.workcell, self.asset, plan.seed) as world:
            self.T_world_body = world.object_pose()
        self.T_object_body = from_list(plan.T_world_object).inverse() * self.T_world_body
        cell.place_object(self.T_world_body)
        for side in SIDES:
            home = np.array(plan.workcell.placement(side).home)
            if (off := np.abs(self.q[side] - home).max()) > JOINT:
                self.say("start", f"the {side} arm starts {off:.6f} rad from its waiting configuration")
            cell.place_arm(side, self.q[side])
            cell.place_fingers(side, self.openings[side])
        for stage in plan.stages:
            for number, step in enumerate(stage.steps):
                self.where = (stage.name, number)
                self._permissions(stage, step)
                if isinstance(step, Motion):
                    self._motion(cell, stage, step)
                else:
                    self._grip(cell, stage, step)
            self.where = (stage.name, len(stage.steps) - 1)
            self._object_frame(cell, stage)

    def _permissions(self, stage: Stage, step: Motion | Grip) -> None:
        legal = may_touch(self.plan, stage, step)
        for pair in sorted({_pair(*pair) for pair in step.allowed} - legal):
            self.say("allows_too_much", f"{pair[0]} may not touch {pair[1]} here, but the plan allows it")

    def _allowed(self, stage: Stage, step: Motion | Grip) -> set[Names]:
        return may_touch(self.plan, stage, step) & {_pair(*pair) for pair in step.allowed}

    # -- steps -----------------------------------------------------------------------------------------------------

    def _motion(self, cell: GhostCell, stage: Stage, step: Motion) -> None:
        side = stage.arm
        times, positions = self._curve(side, step)
        part = _Part(cell, self.asset, side, step) if self._operates(stage, step) else None
        seen = _Seen(self._allowed(stage, step))
        for t, q in zip(times, positions, strict=True):
            cell.place_arm(side, q)
            self._carry(cell)
            if part is not None:
                part.follow(self.T_body(cell))
            self._look(cell, float(t), seen)
        self._tell(seen)
        self.q[side] = positions[-1]

    def _operates(self, stage: Stage, step: Motion) -> bool:
        return stage.name == "operate" and step.template in ("pull", "twist", "press")

    def _curve(self, side: Side, step: Motion) -> tuple[Array, Array]:
        """Times and positions to check, after the curve itself was checked against its limits."""
        arm, knots = self.plan.workcell.arm(side), np.array(step.times)
        spline = CubicHermiteSpline(knots, np.array(step.positions), np.array(step.velocities))
        first, last = np.array(step.velocities[0]), np.array(step.velocities[-1])
        if (off := np.abs(np.array(step.positions[0]) - self.q[side]).max()) > JOINT:
            self.say("jump", f"the {side} arm would jump by {off:.6f} rad to where the motion starts")
        for end, speed in ((0.0, first), (step.duration, last)):
            if (moving := np.abs(speed).max()) > REST:
                self.say("not_at_rest", f"a joint of the {side} arm moves at {moving:.6f} rad/s", end)
        speeds, rates = _peaks(spline)
        self._limits("velocity_limit", arm.joints, speeds, np.array(arm.velocity), knots, "rad/s")
        self._limits("acceleration_limit", arm.joints, rates, np.array(arm.acceleration), knots, "rad/s^2")
        self.velocity = max(self.velocity, float((speeds / np.array(arm.velocity)).max()))
        self.acceleration = max(self.acceleration, float((rates / np.array(arm.acceleration)).max()))
        times = np.linspace(0.0, step.duration, int(np.ceil(step.duration / SAMPLE)) + 1)
        positions: Array = spline(times)
        past = np.maximum(positions - np.array(arm.upper), np.array(arm.lower) - positions)
        k, joint = np.unravel_index(int(past.argmax()), past.shape)
        if past[k, joint] > JOINT:
            self.say("position_limit", f"{side}/{arm.joints[joint]} at {positions[k, joint]:.4f} rad, limits "
                     f"{arm.lower[joint]} to {arm.upper[joint]} rad", float(times[k]))  # fmt: skip
        return times, positions

    def _limits(self, kind: Kind, joints: tuple[str, ...], peaks: Array, limit: Array, knots: Array, unit: str) -> None:
        """Note every joint whose peak ``(segments, 7)`` is over its limit."""
        for joint in np.flatnonzero((peaks > limit * (1.0 + OVER)).any(axis=0)):
            segment = int(peaks[:, joint].argmax())
            peak = peaks[segment, joint]
            text = f"{joints[joint]} reaches {peak:.3f} {unit}, {peak / limit[joint]:.4f} of its limit {limit[joint]:g}"
            self.say(kind, text, float(knots[segment]))

    def _grip(self, cell: GhostCell, stage: Stage, step: Grip) -> None:
        side, gripper = stage.arm, self.plan.workcell.arm(stage.arm).gripper
        if step.force > gripper.force_limit * (1.0 + OVER) or not 0.0 <= step.opening <= gripper.finger_travel:
            self.say("force_limit", f"{step.force:.1f} N to {1e3 * step.opening:.1f} mm asked of fingers that give "
                     f"{gripper.force_limit:g} N and open {1e3 * gripper.finger_travel:g} mm")  # fmt: skip
        before, after = self.openings[side], (step.opening, step.opening)
        holding = side == self.plan.assistant and self.T_hand_body is not None
        closing = step.opening < min(before)
        if holding and not closing:
            self.say("drops_object", f"the {side} hand opens while it holds the object")
        meant = {_pair(finger, "object") for finger in _fingers(self.plan, side)}
        if closing and meant <= self._allowed(stage, step):
            met = split_openings(cell, side, max(before))
            if met is None:
                self.say("closes_on_nothing", f"the {side} fingers close without meeting the object")
            after = met or after
        seen = _Seen(self._allowed(stage, step))
        distance = max(abs(a - b) for a, b in zip(before, after, strict=True))
        for share in np.linspace(0.0, 1.0, max(2, int(np.ceil(distance / gripper.finger_velocity / SAMPLE)) + 1)):
            first, second = (float(b + share * (a - b)) for a, b in zip(after, before, strict=True))
            cell.place_fingers(side, (first, second))
            self._look(cell, float(share * distance / gripper.finger_velocity), seen)
        self._tell(seen)
        self.openings[side] = after
        if side == self.plan.assistant and closing and self.T_hand_body is None:
            self.T_hand_body = cell.hand(side).inverse() * self.T_world_body

    # -- contacts --------------------------------------------------------------------------------------------------

    def T_body(self, cell: GhostCell) -> pin.SE3:
        """Where the object's body is: on the table, or in the assistant's hand."""
        return self.T_world_body if self.T_hand_body is None else cell.hand(self.plan.assistant) * self.T_hand_body

    def _carry(self, cell: GhostCell) -> None:
        if self.T_hand_body is not None:
            cell.place_object(self.T_body(cell))

    def _look(self, cell: GhostCell, t: float, seen: _Seen) -> None:
        if self.states % CLEARANCE_EVERY == 0:
            wide = [distance for pair, distance in cell.around(CLEARANCE_CAP).items() if pair not in seen.allowed]
            self.min_clearance = min([self.min_clearance, *wide])
        self.states += 1
        for pair, distance in cell.near().items():
            if pair in seen.allowed or (distance >= self.min_clearance and distance >= -PENETRATION):
                continue
            fresh = cell.distance(pair)  # what the engine remembers of a contact may be stale
            self.min_clearance = min(self.min_clearance, fresh)
            if fresh < -PENETRATION:
                seen.note(pair, t, -fresh)

    def _tell(self, seen: _Seen) -> None:
        for (a, b), worst in sorted(seen.worst.items()):
            text = f"{a} is {1e3 * worst.depth:.1f} mm inside {b}, from {worst.first:.2f} to {worst.last:.2f} s"
            self.say("contact", text, worst.time)

    # -- frames ----------------------------------------------------------------------------------------------------

    def _object_frame(self, cell: GhostCell, stage: Stage) -> None:
        """Whether the object frame that the plan expects is where the true body was carried."""
        claimed, true = from_list(stage.T_world_object), self.T_body(cell) * self.T_object_body.inverse()
        off = float(np.linalg.norm(claimed.translation - true.translation))
        turn = angle_between(claimed.rotation, true.rotation)
        if off > FRAME[0] or turn > FRAME[1]:
            self.say("object_frame", f"the plan expects the object {1e3 * off:.2f} mm and {np.degrees(turn):.2f} deg "
                     "from where its motions bring it")  # fmt: skip
