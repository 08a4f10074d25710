"""Where everything is at any time of a plan, as the plan expects it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pinocchio as pin

from robots.model import DualArm
from robots.spatial import Array, from_list, points
from robots.trajectory import Trajectory
from robots.workcell import SIDES, Side
from tamp.plan import Await, Grip, Motion, Plan, Stage

PAD_HALF_WIDTH = 0.011
"""Half the width of a finger pad [m]."""

PAD_LENGTH = 0.03
"""How far the pads reach back from the tool centre point [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """The cell at one time.

    Attributes:
        stage: Number of the stage.
        q: Joint positions by arm, ``(7,)`` [rad].
        opening: Opening of one finger by arm [m].
        T_world_object: The object frame.
    """

    stage: int
    q: dict[Side, Array]
    opening: dict[Side, float]
    T_world_object: pin.SE3


@dataclass(frozen=True, slots=True, eq=False)
class _Tilt:
    """How the object turns while a hand presses it down.

    Attributes:
        T_after: ``T_world_object`` when the hand is at its lowest.
        lowest: Height of the pressing tool centre point then [m].
        sink: How far the pressed spot goes down [m].
    """

    T_after: pin.SE3
    lowest: float
    sink: float

    def at(self, T_before: pin.SE3, height: float) -> pin.SE3:
        """``T_world_object`` while the tool centre point is at a height [m]."""
        share = float(np.clip((self.lowest + self.sink - height) / max(self.sink, 1e-9), 0.0, 1.0))
        return pin.exp6(share * pin.log6(self.T_after * T_before.inverse())) * T_before


@dataclass(frozen=True, slots=True, eq=False)
class _Segment:
    """One step with what stands still meanwhile.

    Attributes:
        begin: When it begins [s].
        stage: Number of its stage.
        arm: Who acts.
        step: The step.
        curve: Of a motion.
        q: Joint positions by arm when it begins ``(7,)`` [rad].
        opening: Opening of one finger by arm when it begins and when it ends [m].
        T_world_object: The object frame when it begins.
        T_hand_object: The same in the hand with which it moves; ``None`` while it does not.
        holder: That hand.
        tilt: How the object turns when it is pressed.
    """

    begin: float
    stage: int
    arm: Side
    step: Motion | Grip | Await
    curve: Trajectory | None
    q: dict[Side, Array]
    opening: dict[Side, tuple[float, float]]
    T_world_object: pin.SE3
    T_hand_object: pin.SE3 | None
    holder: Side | None
    tilt: _Tilt | None


class Playback:
    """A plan as a function of time.

    Attributes:
        plan: The plan.
        arms: Kinematics of both arms.
        duration: Length [s].
    """

    def __init__(self, plan: Plan, cloud: Array) -> None:
        self.plan, self.arms = plan, DualArm(plan.workcell)
        self._cloud = cloud - np.asarray(plan.T_world_object)[:3, 3]
        self._segments: list[_Segment] = []
        self._build()
        self._begins = np.array([segment.begin for segment in self._segments])
        self.duration = plan.duration

    def stage_times(self) -> list[float]:
        """When each stage begins, and the end of the plan [s]."""
        begins = np.cumsum([0.0, *(stage.duration for stage in self.plan.stages)])
        return [float(t) for t in begins]

    def at(self, t: float) -> Moment:
        """The cell at ``t`` [s], clamped to the plan."""
        k = int(np.clip(np.searchsorted(self._begins, t, side="right") - 1, 0, len(self._segments) - 1))
        segment = self._segments[k]
        inside = float(np.clip(t - segment.begin, 0.0, segment.step.duration))
        q, share = dict(segment.q), inside / max(segment.step.duration, 1e-9)
        if segment.curve is not None:
            q[segment.arm] = segment.curve.at(inside)
        if (part := segment.step.meanwhile) is not None:
            q[part.arm] = part.trajectory().at(inside - part.begin)
        opening = {side: a + share * (b - a) for side, (a, b) in segment.opening.items()}
        return Moment(segment.stage, q, opening, self._object(segment, q))

    def path(self, number: int) -> Array:
        """Where the tool centre point of a stage's arm goes during the stage ``(n, 3)`` [m]."""
        first, last = list(pairwise(self.stage_times()))[number]
        side = self.plan.stages[number].arm
        times = np.linspace(first, last - 1e-6, max(2, int(20 * (last - first))))
        return np.array([self.arms[side].tcp(self.at(float(t)).q[side]).translation for t in times])

    def _object(self, segment: _Segment, q: dict[Side, Array]) -> pin.SE3:
        """``T_world_object`` while the arms are at ``q`` in a segment."""
        if segment.tilt is not None:
            return segment.tilt.at(
                segment.T_world_object, float(self.arms[segment.arm].tcp(q[segment.arm]).translation[2])
            )
        if segment.T_hand_object is not None and segment.holder is not None:
            return self.arms[segment.holder].hand(q[segment.holder]) * segment.T_hand_object
        return segment.T_world_object

    def _build(self) -> None:
        plan = self.plan
        q: dict[Side, Array] = {side: np.array(plan.start[side]) for side in SIDES}
        opening = dict.fromkeys(SIDES, plan.start_opening)
        T_world_object, begin = from_list(plan.T_world_object), 0.0
        for number, stage in enumerate(plan.stages):
            for step in stage.steps:
                segment = self._segment(begin, number, stage, step, q, opening, T_world_object)
                self._segments.append(segment)
                begin += step.duration
                opening = {side: last for side, (_, last) in segment.opening.items()}
                if segment.curve is not None:
                    q = {**q, stage.arm: segment.curve.positions[-1]}
                if step.meanwhile is not None:
                    q = {**q, step.meanwhile.arm: np.array(step.meanwhile.positions[-1])}
                T_world_object = self._object(segment, q)

    def _segment(
        self,
        begin: float,
        number: int,
        stage: Stage,
        step: Motion | Grip | Await,
        q: dict[Side, Array],
        opening: dict[Side, float],
        T_world_object: pin.SE3,
    ) -> _Segment:
        """A step that begins with everything at the given places."""
        after, curve, held, tilt = dict(opening), None, None, None
        if isinstance(step, Grip):
            after[stage.arm] = self._reached(stage, step, q, T_world_object)
        elif isinstance(step, Motion):
            curve = step.trajectory()
            if stage.name == "press" and step.template == "descend":
                tilt = self._tilt(stage, curve.positions[-1], T_world_object)
        if step.meanwhile is not None and step.meanwhile.opening is not None:
            after[step.meanwhile.arm] = step.meanwhile.opening
        if step.holder is not None:
            held = self.arms[step.holder].hand(q[step.holder]).inverse() * T_world_object
        openings = {side: (opening[side], after[side]) for side in SIDES}
        return _Segment(begin, number, stage.arm, step, curve, q, openings, T_world_object, held, step.holder, tilt)

    def _tilt(self, stage: Stage, q_lowest: Array, T_before: pin.SE3) -> _Tilt:
        """How far the spot under the pressing finger sinks, from where the object frame is expected to be."""
        T_after = from_list(stage.T_world_object)
        tip = np.array([0.0, 0.0, self.plan.workcell.arm(stage.arm).gripper.tip_offset])
        spot = self.arms[stage.arm].hand(q_lowest).act(tip)
        sink = float((T_before * T_after.inverse()).act(spot)[2] - spot[2])
        return _Tilt(T_after, float(self.arms[stage.arm].tcp(q_lowest).translation[2]), sink)

    def _reached(self, stage: Stage, step: Grip, q: dict[Side, Array], T_world_object: pin.SE3) -> float:
        """Where the fingers stop: at their target, or at the observed object when they close on it."""
        gripper = self.plan.workcell.arm(stage.arm).gripper
        if step.opening > 0.0 or not any("object" in pair and stage.arm in pair[0] for pair in step.allowed):
            return step.opening
        seen = points(self.arms[stage.arm].hand(q[stage.arm]).inverse() * T_world_object, self._cloud)
        between = (np.abs(seen[:, 0]) < PAD_HALF_WIDTH) & (seen[:, 2] > gripper.tcp_offset - PAD_LENGTH)
        between &= np.abs(seen[:, 1]) < gripper.finger_travel
        return float(np.abs(seen[between, 1]).max(initial=0.0))
