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
from tamp.plan import Grip, Motion, Plan, Stage

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
class _Segment:
    """One step with what stands still meanwhile."""

    begin: float
    stage: int
    arm: Side
    step: Motion | Grip
    curve: Trajectory | None
    q: dict[Side, Array]
    opening: dict[Side, tuple[float, float]]
    T_hand_object: pin.SE3 | None


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
        self._rest = from_list(plan.T_world_object)
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
        opening = {side: a + share * (b - a) for side, (a, b) in segment.opening.items()}
        T = self._rest
        if segment.T_hand_object is not None:
            T = self.arms[self.plan.assistant].hand(q[self.plan.assistant]) * segment.T_hand_object
        return Moment(segment.stage, q, opening, T)

    def path(self, number: int) -> Array:
        """Where the tool centre point of a stage's arm goes during the stage ``(n, 3)`` [m]."""
        first, last = list(pairwise(self.stage_times()))[number]
        side = self.plan.stages[number].arm
        times = np.linspace(first, last - 1e-6, max(2, int(20 * (last - first))))
        return np.array([self.arms[side].tcp(self.at(float(t)).q[side]).translation for t in times])

    def _build(self) -> None:
        plan = self.plan
        q: dict[Side, Array] = {side: np.array(plan.start[side]) for side in SIDES}
        opening = dict.fromkeys(SIDES, plan.start_opening)
        held: pin.SE3 | None = None
        begin = 0.0
        for number, stage in enumerate(plan.stages):
            for step in stage.steps:
                after = dict(opening)
                curve = step.trajectory() if isinstance(step, Motion) else None
                if isinstance(step, Grip):
                    after[stage.arm] = self._reached(stage, step, q)
                openings = {side: (opening[side], after[side]) for side in SIDES}
                self._segments.append(_Segment(begin, number, stage.arm, step, curve, dict(q), openings, held))
                begin += step.duration
                opening = after
                if curve is not None:
                    q[stage.arm] = curve.positions[-1]
                elif held is None and stage.arm == plan.assistant:
                    held = self.arms[stage.arm].hand(q[stage.arm]).inverse() * self._rest

    def _reached(self, stage: Stage, step: Grip, q: dict[Side, Array]) -> float:
        """Where the fingers stop: at their target, or at the observed object when they close on it."""
        gripper = self.plan.workcell.arm(stage.arm).gripper
        if step.opening > 0.0 or not any("object" in pair and stage.arm in pair[0] for pair in step.allowed):
            return step.opening
        T_world_object = from_list(stage.T_world_object)
        seen = points(self.arms[stage.arm].hand(q[stage.arm]).inverse() * T_world_object, self._cloud)
        between = (np.abs(seen[:, 0]) < PAD_HALF_WIDTH) & (seen[:, 2] > gripper.tcp_offset - PAD_LENGTH)
        between &= np.abs(seen[:, 1]) < gripper.finger_travel
        return float(np.abs(seen[between, 1]).max(initial=0.0))
