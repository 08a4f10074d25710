"""Which candidates geometry alone gives: antipodal pairs on the observed cloud, random directions, random poses.

Nothing is known of the object but the cloud, completed by its shadow on the table, and the verb of the instruction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from affordance.candidates import (
    ContactCandidate,
    GoalCandidate,
    OperationKind,
    PoseCandidate,
    PregraspCandidate,
    Roles,
    SceneView,
)
from affordance.grip import grip_at
from affordance.preparing import LIFT
from robots.spatial import Array, hand_rotation, perpendicular, rotation_about, unit
from robots.workcell import Gripper
from worlds.tasks import TaskType

DRAWS = 120
"""Points tried for one list of candidates."""

KEPT = 24
"""Longest list of candidates."""

NEIGHBOURS = 16
"""Points from which a surface normal is fitted."""

SHADOW = 0.006
"""Distance between the levels at which the cloud is repeated down to the table [m]."""

LONGEST_PUSH = 0.25
"""Longest push drawn [m]."""

TURNS = (0.3, 3.0)
"""Turn drawn for what is turned [rad]."""

STROKES = (0.004, 0.05)
"""Motion drawn for what is pulled or pressed [m]."""

SPREAD = 0.10
"""Half width of the box in which object poses are drawn, about the middle of the shared space [m]."""


@dataclass(frozen=True, slots=True)
class UniformProposer:
    """Random candidates that fit the observed cloud.

    Attributes:
        task: What is done with the object.
        gripper: The gripper both arms carry.
    """

    task: TaskType
    gripper: Gripper

    @property
    def name(self) -> str:
        """As given to ``--proposer``."""
        return "uniform"

    def goal(self, view: SceneView, rng: np.random.Generator) -> list[GoalCandidate]:
        """Random operations at random points, or antipodal grasps anywhere."""
        if self.task == "articulated":
            return [self._operation(view, rng) for _ in range(KEPT)]
        if self.task == "handover":
            return [self._receive(view, rng) for _ in range(KEPT)]
        return [
            GoalCandidate("grasp", T, opening, np.array([0.0, 0.0, 1.0]), T.translation, LIFT, -T.rotation[:, 2], 1.0)
            for T, opening in self._antipodal(view, rng, downward=None)
        ]

    def _operation(self, view: SceneView, rng: np.random.Generator) -> GoalCandidate:
        kinds: tuple[OperationKind, ...] = ("pull", "unscrew", "press", "flip")
        kind = kinds[int(rng.integers(len(kinds)))]
        spot, outward = _spot(view.cloud, rng)
        outward = _tilted(outward, 0.4, rng)
        R = hand_rotation(-outward, rotation_about(outward, rng.uniform(0.0, 2 * np.pi)) @ perpendicular(outward))
        turning = kind in ("unscrew", "flip")
        direction = {"press": -outward, "flip": R[:, 1]}.get(kind, outward)
        depth = 0.0 if kind == "press" else rng.uniform(0.0, 0.025)
        return GoalCandidate(
            kind=kind,
            T_world_hand=pin.SE3(R, spot + (self.gripper.tip_offset - depth) * outward),
            opening=0.0 if kind == "press" else self.gripper.finger_travel,
            direction=direction,
            point=spot - rng.uniform(0.0, 0.03) * R[:, 0] * (kind == "flip"),
            amount=float(rng.uniform(*(TURNS if turning else STROKES))),
            outward=outward,
            score=float(rng.random()),
        )

    def _receive(self, view: SceneView, rng: np.random.Generator) -> GoalCandidate:
        spot, outward = _spot(view.cloud, rng)
        T = pin.SE3(hand_rotation(-outward, perpendicular(outward)), spot)
        return GoalCandidate("receive", T, self.gripper.finger_travel, outward, spot, 0.0, outward, float(rng.random()))

    def pregrasp(self, view: SceneView, goal: GoalCandidate, rng: np.random.Generator) -> list[PregraspCandidate]:
        """Antipodal grasps from above."""
        travel = self.gripper.finger_travel
        return [PregraspCandidate(T, travel, float(rng.random())) for T, _ in self._antipodal(view, rng, downward=0.5)]

    def object_pose(
        self, view: SceneView, goal: GoalCandidate, grasp: PregraspCandidate, roles: Roles, rng: np.random.Generator
    ) -> list[PoseCandidate]:
        """Any orientation near the middle of the shared space."""
        return self._poses(view, np.asarray(view.workcell.shared), SPREAD, rng)

    def present(
        self, view: SceneView, goal: GoalCandidate, grasp: PregraspCandidate, rng: np.random.Generator
    ) -> list[PoseCandidate]:
        """Any orientation in the human's zone."""
        human = view.workcell.human
        return [] if human is None else self._poses(view, np.asarray(human.zone_centre), SPREAD, rng)

    def _poses(self, view: SceneView, middle: Array, spread: float, rng: np.random.Generator) -> list[PoseCandidate]:
        pivot = view.cloud.mean(axis=0)
        found = []
        for _ in range(KEPT):
            R = Rotation.random(random_state=rng).as_matrix()
            target = middle + rng.uniform(-spread, spread, 3)
            found.append(PoseCandidate(pin.SE3(R, target - R @ pivot), float(rng.random())))
        return found

    def push(self, view: SceneView, goal: GoalCandidate, rng: np.random.Generator) -> list[ContactCandidate]:
        """Straight pushes from any seen point in any horizontal direction."""
        found = []
        for _ in range(KEPT):
            spot, _ = _spot(view.cloud, rng)
            heading = rng.uniform(0.0, 2 * np.pi)
            travel = rng.uniform(0.02, LONGEST_PUSH) * np.array([np.cos(heading), np.sin(heading), 0.0])
            found.append(self._contact(spot, travel, pin.SE3(np.eye(3), travel), rng))
        return found

    def press(self, view: SceneView, goal: GoalCandidate, rng: np.random.Generator) -> list[ContactCandidate]:
        """Presses at any seen point; the object is expected to tilt away from its middle by a random angle."""
        middle, top = view.cloud.mean(axis=0), view.workcell.table.top
        found = []
        for _ in range(KEPT):
            spot, _ = _spot(view.cloud, rng)
            aside = spot - middle
            axis = np.cross([0.0, 0.0, 1.0], [*aside[:2], 0.0])
            angle = rng.uniform(0.05, 0.5)
            R = rotation_about(axis, angle) if np.linalg.norm(axis) > 1e-6 else np.eye(3)
            pivot = np.array([*(middle + 0.5 * aside)[:2], top])
            sink = np.array([0.0, 0.0, -rng.uniform(0.005, 0.03)])
            found.append(self._contact(spot, sink, pin.SE3(R, pivot - R @ pivot), rng))
        return found

    def _contact(self, spot: Array, travel: Array, T_move: pin.SE3, rng: np.random.Generator) -> ContactCandidate:
        approach = _tilted(np.array([0.0, 0.0, -1.0]), np.radians(10.0), rng)
        R = hand_rotation(approach, rotation_about(approach, rng.uniform(0.0, 2 * np.pi)) @ perpendicular(approach))
        T_world_hand = pin.SE3(R, spot - self.gripper.tip_offset * approach)
        return ContactCandidate(T_world_hand, 0.0, travel, T_move, float(rng.random()))

    def reorient(self, grasp: PregraspCandidate, pose: PoseCandidate) -> pin.SE3:
        """The held hand follows the object rigidly."""
        return pose.T_move * grasp.T_world_hand

    def _antipodal(
        self, view: SceneView, rng: np.random.Generator, downward: float | None
    ) -> list[tuple[pin.SE3, float]]:
        """Hand poses and openings whose fingers close on both sides of a seen point.

        Args:
            view: The object.
            rng: Decides every draw.
            downward: Largest tilt from straight down [rad]; ``None`` for any direction.
        """
        solid = completed(view)
        found: list[tuple[pin.SE3, float]] = []
        for _ in range(DRAWS):
            spot = view.cloud[rng.integers(len(view.cloud))]
            if downward is None:
                approach = unit(rng.normal(size=3))
            else:
                approach = _tilted(np.array([0.0, 0.0, -1.0]), downward, rng)
            opening_axis = rotation_about(approach, rng.uniform(0.0, 2 * np.pi)) @ perpendicular(approach)
            grip = grip_at(solid, spot, approach, opening_axis, rng.uniform(0.008, 0.036), self.gripper)
            if grip is not None:
                found.append((grip.T_world_hand, grip.opening))
            if len(found) == KEPT:
                break
        return found


def completed(view: SceneView) -> Array:
    """The seen points and what they may hide: copies of them down to the table while the object rests on it."""
    top = view.workcell.table.top
    if np.abs(view.T_move.translation[2]) > 0.02 or view.cloud[:, 2].min() > top + 0.05:
        return view.cloud
    levels = np.arange(top + SHADOW / 2, float(view.cloud[:, 2].max()), SHADOW)
    below = [view.cloud[view.cloud[:, 2] > level] * [1, 1, 0] + [0, 0, level] for level in levels]
    return np.concatenate([view.cloud, *below])


def _spot(cloud: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """A seen point and the normal of the surface there, towards the camera above."""
    spot = cloud[rng.integers(len(cloud))]
    near = cloud[cKDTree(cloud).query(spot, k=min(NEIGHBOURS, len(cloud)))[1]]
    normal = np.linalg.svd(near - near.mean(axis=0), full_matrices=False)[2][2]
    return spot, np.asarray(normal if normal[2] >= 0.0 else -normal)


def _tilted(direction: Array, most: float, rng: np.random.Generator) -> Array:
    """A direction turned by up to ``most`` [rad] about a random axis perpendicular to it."""
    axis = rotation_about(direction, rng.uniform(0.0, 2 * np.pi)) @ perpendicular(direction)
    return rotation_about(axis, rng.uniform(0.0, most)) @ direction
