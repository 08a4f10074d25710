"""Which candidates the paper's hand-written rules give, with privileged knowledge of the object.

The rules are those of the paper's appendix: the assistant's pixel lies on a fixed link, its approach points down within
10 deg, its fingers open across the object; ``T_grp' = T_obj' T_obj^-1 T_grp``; the primary's pixel lies on the movable
link and its approach follows the functional direction, the turn about it being free.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from affordance.candidates import (
    ContactCandidate,
    GoalCandidate,
    PoseCandidate,
    PregraspCandidate,
    Roles,
    SceneView,
)
from affordance.grip import FINGER_HALF, FINGER_THICK, SPARE, grip_at
from affordance.preparing import Body, edge_grasps, near_edge, pushes, rim_grasps
from affordance.pressing import presses
from robots.spatial import Array, hand_rotation, perpendicular, points, rotation_about, unit
from robots.workcell import Gripper
from worlds.assets.asset import FunctionalPart
from worlds.labels import Truth
from worlds.tasks import TaskType

TILT = np.radians(10.0)
"""Largest deviation of the assistant's approach from straight down [rad]; the paper's value."""

ROLLS = 12
"""Turns about the approach tried for a goal candidate."""

FINGER_CLEARANCE = 0.004
"""Room kept between an open finger and the part or body on either side [m]."""

PAD_HALF = 0.011
"""Half width of a finger pad [m]."""

SHOULDER_GAP = 0.002
"""Room kept between the finger tips and what lies below the part [m]."""

LID_GAP = 0.006
"""The same below a hinged lid, which sits closer to the body's shoulder [m]."""

GRASP_DEPTH = 0.030
"""The assistant's fingers reach at most this far below the top of what they grasp [m]."""

TABLE_GAP = 0.004
"""Room kept between the assistant's finger tips and the table [m]."""

PALM_ROOM = 0.036
"""How far a standing object may reach from the finger pads towards the palm, which is 45 mm behind them [m]."""

STOOP = np.radians(30.0)
"""Largest angle by which the hand points below the horizon when it grasps a standing object [rad]."""

APPROACH = 0.11
"""How far back from a contact the straight way to it begins [m]."""

OUT_ON_LEVER = 0.007
"""How far beyond its best spot a lever is pressed [m]: most of a finger tip's half width."""

ROOM_WANTED, ROOM_WORTH = 0.07, 12.0
"""Distance between grasp and functional end that leaves room for a human's hand [m], and its worth [1/m]."""

UPRIGHT = 0.8
"""The object counts as standing when the vertical part of its long axis exceeds this."""


@dataclass(frozen=True, slots=True)
class HeuristicProposer:
    """The paper's rules on the true pose and parts of one object.

    Attributes:
        task: What is done with the object.
        truth: Privileged knowledge at the time of the observation.
        gripper: The gripper both arms carry.
    """

    task: TaskType
    truth: Truth
    gripper: Gripper

    @property
    def name(self) -> str:
        """As given to ``--proposer``."""
        return "heuristic"

    # -- goal ------------------------------------------------------------------------------------------------------

    def goal(self, view: SceneView, rng: np.random.Generator) -> list[GoalCandidate]:
        """What the primary does, by task: operate the part, grasp an edge, or take it as a human would."""
        match self.task:
            case "edge_push":
                return edge_grasps(self._body(view), near_edge(view.workcell.table), self.gripper, rng)
            case "plate_lift":
                return rim_grasps(self._body(view), self.gripper, rng)
            case "handover":
                return [self._receive(view)]
            case "articulated":
                return self._operations(view, rng)

    def _body(self, view: SceneView) -> Body:
        """The true surface where the view has the object."""
        T = view.T_move * self.truth.T_world_body
        return Body(points(T, self.truth.surface), self.truth.normals @ T.rotation.T, T.act(self.truth.centre))

    def _part(self) -> FunctionalPart:
        if self.truth.part is None:
            raise ValueError("the object has no functional part")
        return self.truth.part

    def _receive(self, view: SceneView) -> GoalCandidate:
        """A human takes the object with its functional end first."""
        part, T_world_body = self._part(), view.T_move * self.truth.T_world_body
        outward, point = T_world_body.rotation @ self.truth.long_axis, T_world_body.act(part.point)
        R = hand_rotation(-outward, perpendicular(outward))
        T_world_hand = pin.SE3(R, point + self.gripper.tip_offset * outward)
        return GoalCandidate("receive", T_world_hand, self.gripper.finger_travel, outward, point, 0.0, outward, 1.0)

    def _operations(self, view: SceneView, rng: np.random.Generator) -> list[GoalCandidate]:
        """Candidates on the movable link, approaching along the functional direction, turned about it at random."""
        T_world_body = view.T_move * self.truth.T_world_body
        part = self._part()
        outward = T_world_body.rotation @ part.outward
        first = rng.uniform(0.0, 2 * np.pi)
        rolls = first + 2 * np.pi * np.arange(ROLLS) / ROLLS
        found = [
            self._press(T_world_body, outward, roll)
            if part.kind == "press"
            else self._grasp_part(T_world_body, outward, roll)
            for roll in rolls
        ]
        kept = [candidate for candidate in found if candidate is not None]
        return sorted(kept, key=lambda candidate: -candidate.score)

    def _press(self, T_world_body: pin.SE3, outward: Array, roll: float) -> GoalCandidate:
        part = self._part()
        point = T_world_body.act(part.point) + self._further_out(T_world_body, outward)
        R = hand_rotation(-outward, rotation_about(outward, roll) @ perpendicular(outward))
        travel = part.travel * (part.lever or 1.0)
        needed = part.threshold * (part.lever or 1.0)
        return GoalCandidate(
            kind="press",
            T_world_hand=pin.SE3(R, point + self.gripper.tip_offset * outward),
            opening=0.0,
            direction=-outward,
            point=point,
            amount=min(0.75 * travel, needed + 0.005),
            outward=outward,
            score=1.0,
            vouched=self._way_is_clear(T_world_body, pin.SE3(R, point + self.gripper.tip_offset * outward), 0.0),
        )

    def _further_out(self, T_world_body: pin.SE3, outward: Array) -> Array:
        """Shift of the pressed spot towards a lever's free end: the near side of a finger tip is what presses on it."""
        part = self._part()
        if not part.lever:
            return np.zeros(3)
        vertices = points(T_world_body, self.truth.part_vertices) - T_world_body.act(part.point)
        arm = -vertices.mean(axis=0)
        arm -= (arm @ outward) * outward
        if np.linalg.norm(arm) < 1e-3:
            return np.zeros(3)
        end = float((vertices @ unit(arm)).max())
        return np.asarray(min(OUT_ON_LEVER, end + 0.001) * unit(arm))

    def _grasp_part(self, T_world_body: pin.SE3, outward: Array, roll: float) -> GoalCandidate | None:
        part = self._part()
        vertices = points(T_world_body, self.truth.part_vertices)
        hinge = T_world_body.act(part.point)
        origin = hinge if part.kind != "flip" else 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
        opening_axis = rotation_about(outward, roll) @ perpendicular(outward)
        if part.kind == "flip":  # the fingers turn with the lid about the hinge, so they open along it
            opening_axis = T_world_body.rotation @ part.axis * np.sign(np.cos(roll) or 1.0)
        across = np.cross(outward, opening_axis)
        along = (vertices - origin) @ outward
        gap = LID_GAP if part.kind == "flip" else SHOULDER_GAP
        tip = max(along.min() + gap, along.max() - 2 * PAD_HALF)
        in_pad = (np.abs((vertices - origin) @ across) < PAD_HALF) & (along > tip - 0.02)
        if not in_pad.any():
            in_pad = along > tip - 0.02
        spread = (vertices[in_pad] - origin) @ opening_axis
        width = float(spread.max() - spread.min())
        half = width / 2 + FINGER_CLEARANCE
        if half > self.gripper.finger_travel:
            return None
        centre = origin + outward * tip + opening_axis * (spread.max() + spread.min()) / 2
        R = hand_rotation(-outward, opening_axis)
        T_world_hand = pin.SE3(R, centre + outward * self.gripper.tip_offset)
        opening = min(self.gripper.finger_travel, half + 0.010)
        return GoalCandidate(
            kind=part.kind,
            T_world_hand=T_world_hand,
            opening=opening,
            direction=T_world_body.rotation @ part.axis,
            point=hinge,
            amount=self._amount(),
            outward=outward,
            score=1.0 - width,
            vouched=self._way_is_clear(T_world_body, T_world_hand, opening),
        )

    def _way_is_clear(self, T_world_body: pin.SE3, T_world_hand: pin.SE3, opening: float) -> bool:
        """Whether open fingers coming straight to a hand pose pass beside everything of the true object."""
        seen = points(T_world_hand.inverse() * T_world_body, self.truth.surface)
        aside, ahead = np.abs(seen[:, 1]), seen[:, 2] < self.gripper.tip_offset - 0.001
        near = (np.abs(seen[:, 0]) < FINGER_HALF) & ahead & (seen[:, 2] > -APPROACH)
        return not (near & (aside > opening - SPARE) & (aside < opening + FINGER_THICK)).any()

    def _amount(self) -> float:
        part = self._part()
        if part.kind in ("unscrew", "flip"):
            return min(part.travel, 1.3 * part.threshold)
        return min(0.95 * part.travel, part.threshold + 0.010)

    # -- pre-grasp -------------------------------------------------------------------------------------------------

    def pregrasp(self, view: SceneView, goal: GoalCandidate, rng: np.random.Generator) -> list[PregraspCandidate]:
        """Candidates on fixed links near the centre of mass, opening across the long axis, away from the part."""
        axis = self.truth.T_world_body.rotation @ self.truth.long_axis
        fixed = view.cloud[~self.truth.movable]
        if len(fixed) == 0:
            return []
        propose = self._standing if abs(axis[2]) > UPRIGHT else self._lying
        found = [c for c in (propose(view, fixed, axis, goal, rng) for _ in range(24)) if c is not None]
        apart = [c for c in found if not self._takes_part(c)]
        if not apart or self.task == "handover":
            apart += self._beside(view, axis, goal, rng)
        return sorted(apart, key=lambda c: -c.score - self._left_free(c, goal))

    def _left_free(self, candidate: PregraspCandidate, goal: GoalCandidate) -> float:
        """What a handover gains from leaving room for the human's hand between grasp and functional end."""
        if self.task != "handover":
            return 0.0
        tcp = candidate.T_world_hand.act(np.array([0.0, 0.0, self.gripper.tcp_offset]))
        return ROOM_WORTH * min(float((goal.point - tcp) @ goal.outward), ROOM_WANTED)

    def _takes_part(self, candidate: PregraspCandidate) -> bool:
        """Whether the functional part lies between the open fingers or in their way."""
        spots = points(self.truth.T_world_body, self.truth.surface[self.truth.on_part])
        seen = points(candidate.T_world_hand.inverse(), spots)
        wide = candidate.opening + FINGER_THICK
        inside = (np.abs(seen[:, 0]) < PAD_HALF) & (np.abs(seen[:, 1]) < wide)
        return bool((inside & (seen[:, 2] > 0.06) & (seen[:, 2] < self.gripper.tip_offset)).any())

    def _beside(
        self, view: SceneView, axis: Array, goal: GoalCandidate, rng: np.random.Generator
    ) -> list[PregraspCandidate]:
        """Grasps from above of a fixed link that has the part beside it: the fingers open just wide enough."""
        T = self.truth.T_world_body
        surface = points(T, self.truth.surface)
        fixed = surface[~self.truth.on_part]
        flat = unit([axis[0], axis[1], 0.0]) if np.hypot(axis[0], axis[1]) > 0.2 else np.array([1.0, 0.0, 0.0])
        centre, lowest = T.act(self.truth.centre), view.workcell.table.top + TABLE_GAP
        found = []
        for _ in range(160):
            spot = fixed[rng.integers(len(fixed))]
            across = rotation_about([0.0, 0.0, 1.0], rng.normal(0.0, 0.25)) @ np.cross([0.0, 0.0, 1.0], flat)
            approach = rotation_about(across, rng.uniform(-TILT, TILT)) @ np.array([0.0, 0.0, -1.0])
            depth = min(GRASP_DEPTH, float(spot[2]) - lowest)
            grip = grip_at(surface, spot, approach, across, depth, self.gripper) if depth > 0.002 else None
            if grip is None or grip.cover < 0.1:
                continue
            low = grip.T_world_hand.act(np.array([0.0, 0.0, self.gripper.tip_offset]))[2]
            raise_by = np.array([0.0, 0.0, max(0.0, lowest - float(low))])
            T_world_hand = pin.SE3(grip.T_world_hand.rotation, grip.T_world_hand.translation + raise_by)
            near = abs(float((spot - centre) @ flat))
            candidate = PregraspCandidate(T_world_hand, grip.opening, grip.cover - 2.0 * near)
            if not self._takes_part(candidate) and np.linalg.norm(goal.point - spot) > 0.03:
                found.append(candidate)
        return found

    def _lying(
        self, view: SceneView, fixed: Array, axis: Array, goal: GoalCandidate, rng: np.random.Generator
    ) -> PregraspCandidate | None:
        centre = self.truth.T_world_body.act(self.truth.centre)
        flat = unit([axis[0], axis[1], 0.0])
        along = (fixed - centre) @ flat
        part_at = float((goal.point - centre) @ flat)
        where = rng.normal(-0.012 * np.sign(part_at), 0.018)
        slab = np.abs(along - where) < PAD_HALF
        if slab.sum() < 20 or abs(part_at - where) < 0.035:
            return None
        opening_axis = np.cross([0.0, 0.0, 1.0], flat) * rng.choice([-1.0, 1.0])
        spread = (fixed[slab] - centre) @ opening_axis
        half = (spread.max() - spread.min()) / 2
        if half + FINGER_CLEARANCE > self.gripper.finger_travel:
            return None
        top = float(fixed[slab, 2].max())
        table = view.workcell.table.top
        depth = min(0.5 * (top - table), GRASP_DEPTH)
        low = table + TABLE_GAP + self.gripper.tip_offset - self.gripper.tcp_offset
        middle = centre + flat * where + opening_axis * (spread.max() + spread.min()) / 2
        tcp = np.array([middle[0], middle[1], max(top - depth, low)])
        approach = rotation_about(opening_axis, rng.uniform(-TILT, TILT)) @ np.array([0.0, 0.0, -1.0])
        return self._hold(tcp, approach, opening_axis, score=1.0 - abs(where) - 0.05 * np.arccos(-approach[2]))

    def _standing(
        self, view: SceneView, fixed: Array, axis: Array, goal: GoalCandidate, rng: np.random.Generator
    ) -> PregraspCandidate | None:
        low, high = fixed.min(axis=0), fixed.max(axis=0)
        heading = rng.uniform(0.0, 2 * np.pi)
        level = np.array([np.cos(heading), np.sin(heading), 0.0])
        opening_axis = np.array([-level[1], level[0], 0.0])
        stoop = rng.uniform(0.0, STOOP)
        approach = np.cos(stoop) * level - np.sin(stoop) * np.array([0.0, 0.0, 1.0])
        spread = fixed @ opening_axis
        half = (spread.max() - spread.min()) / 2
        if half + FINGER_CLEARANCE > self.gripper.finger_travel:
            return None
        table = view.workcell.table.top
        centre = self.truth.T_world_body.act(self.truth.centre)
        height = float(np.clip(centre[2] + rng.normal(0.0, 0.015), table + 0.045, max(high[2] - 0.02, table + 0.046)))
        middle = (low + high) / 2
        side = opening_axis * ((spread.max() + spread.min()) / 2 - middle @ opening_axis)
        back = max(0.0, float(np.ptp(fixed @ level)) / 2 - PALM_ROOM)
        tcp = np.array([middle[0], middle[1], height]) + side - back * approach
        return self._hold(tcp, approach, opening_axis, score=1.0 - abs(height - centre[2]) + rng.uniform(0.0, 0.02))

    def _hold(self, tcp: Array, approach: Array, opening_axis: Array, score: float) -> PregraspCandidate:
        R = hand_rotation(approach, opening_axis)
        T_world_hand = pin.SE3(R, tcp - self.gripper.tcp_offset * R[:, 2])
        return PregraspCandidate(T_world_hand, self.gripper.finger_travel, float(score))

    # -- object pose -----------------------------------------------------------------------------------------------

    def object_pose(
        self, view: SceneView, goal: GoalCandidate, grasp: PregraspCandidate, roles: Roles, rng: np.random.Generator
    ) -> list[PoseCandidate]:
        """The part turned towards the primary arm in the shared space, with the object turned as little as possible."""
        middle = np.asarray(view.workcell.shared)
        base = np.asarray(view.workcell.placement(roles.primary).base_xyz)
        towards = unit([base[0] - middle[0], base[1] - middle[1], 0.0])
        pitch_now = float(np.arcsin(np.clip(goal.outward[2], -1.0, 1.0)))
        found = []
        for k in range(24):
            spread = min(1.0, k / 8)
            yaw = rng.normal(0.0, 0.35) * (0.4 + spread)
            pitch = _chosen_pitch(pitch_now, k, rng)
            facing = rotation_about([0.0, 0.0, 1.0], yaw) @ (
                np.cos(pitch) * towards + np.sin(pitch) * np.array([0.0, 0.0, 1.0])
            )
            R = _turn(goal.outward, facing)
            target = middle + rng.normal(0.0, 1.0, 3) * np.array([0.04, 0.04, 0.03]) * (0.4 + spread)
            pivot = (goal.point + grasp.T_world_hand.act(np.array([0.0, 0.0, self.gripper.tcp_offset]))) / 2
            found.append(PoseCandidate(pin.SE3(R, target - R @ pivot), 1.0 - 0.01 * k))
        return found

    def present(
        self, view: SceneView, goal: GoalCandidate, grasp: PregraspCandidate, rng: np.random.Generator
    ) -> list[PoseCandidate]:
        """The functional part turned towards the human, inside the human's zone."""
        human = view.workcell.human
        if human is None:
            return []
        towards, zone = unit(human.towards), np.asarray(human.zone_centre)
        found = []
        for k in range(24):
            spread = min(1.0, k / 8)
            yaw, pitch = rng.normal(0.0, 0.2) * (0.3 + spread), rng.normal(0.0, 0.15) * (0.3 + spread)
            level = rotation_about([0.0, 0.0, 1.0], yaw) @ towards
            facing = np.cos(pitch) * level + np.sin(pitch) * np.array([0.0, 0.0, 1.0])
            R = rotation_about(facing, rng.choice([0.0, 0.5, -0.5, 1.0, -1.0])) @ _turn(goal.outward, facing)
            target = zone + rng.uniform(-0.35, 0.35, 3) * np.asarray(human.zone_size)
            found.append(PoseCandidate(pin.SE3(R, target - R @ goal.point), 1.0 - 0.01 * k))
        return found

    # -- contacts without a grasp ----------------------------------------------------------------------------------

    def push(self, view: SceneView, goal: GoalCandidate, rng: np.random.Generator) -> list[ContactCandidate]:
        """One straight push towards the near edge."""
        return pushes(self._body(view), near_edge(view.workcell.table), self.gripper, rng)

    def press(self, view: SceneView, goal: GoalCandidate, rng: np.random.Generator) -> list[ContactCandidate]:
        """Presses on the outer edge; those opposite to the goal first."""
        body = self._body(view)
        found = presses(body, self.gripper, view.workcell.table.top, rng)
        away = unit([*(body.centre - goal.point)[:2], 0.0])
        return sorted(found, key=lambda c: -float((c.T_world_hand.translation - body.centre) @ away))

    def reorient(self, grasp: PregraspCandidate, pose: PoseCandidate) -> pin.SE3:
        """The held hand follows the object rigidly: ``T_grp' = T_obj' T_obj^-1 T_grp``."""
        return pose.T_move * grasp.T_world_hand


def _chosen_pitch(now: float, k: int, rng: np.random.Generator) -> float:
    """How far above the horizon the part should face [rad]: as now, between, or level, by turns."""
    share = (0.0, 1.0, 0.5)[k % 3]
    return float(np.clip(now * (1.0 - share) + rng.normal(0.0, 0.12), -0.3, np.pi / 2))


def _turn(before: Array, after: Array) -> Array:
    """The rotation from one direction to another: first about the vertical, then in the vertical plane."""
    flat = np.hypot(*before[:2]) > 0.2 and np.hypot(*after[:2]) > 1e-6
    yaw = np.arctan2(after[1], after[0]) - (np.arctan2(before[1], before[0]) if flat else 0.0)
    turned = rotation_about([0.0, 0.0, 1.0], float(np.arctan2(np.sin(yaw), np.cos(yaw)))) @ before
    normal = np.cross(turned, after)
    angle = float(np.arctan2(np.linalg.norm(normal), turned @ after))
    if angle < 1e-6:
        return rotation_about([0.0, 0.0, 1.0], float(yaw))
    if np.linalg.norm(normal) < 1e-9:
        normal = perpendicular(after)
    return rotation_about(normal, angle) @ rotation_about([0.0, 0.0, 1.0], float(yaw))
