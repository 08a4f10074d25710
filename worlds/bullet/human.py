"""A scripted human hand: it comes, grips what is held out by friction, pulls until it is let go, and draws back.

The hand is a body of its own with two pads that close by force; only its wrist is led along a scripted path. Where to
grip it reads from the simulated object: a human sees well.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import pinocchio as pin

from robots.spatial import Array, points, unit
from robots.workcell import Human, Side
from worlds import physics
from worlds.assets.shape import surface
from worlds.bullet.client import bullet_pose
from worlds.bullet.world import BulletWorld

PAD = (0.012, 0.044, 0.030)
"""Thickness, length along the reach and height of a pad [m]: thumb against fingers."""

WIDEST = 0.110
"""Largest distance between the pads [m]; an adult's grip spans 100 to 130 mm."""

GRIP = 45.0
"""Force of each pad [N]; light grips are 20 to 60 N."""

FAR = 0.22
"""Where the hand starts, away from where it grips [m]."""

REACH_SPEED, LEAVE_SPEED = 0.25, 0.10
"""Speeds of the approach and of drawing back with the object [m/s]."""

PULL_RATE = 8.0
"""How fast the pull grows [N/s]."""

STIFF, LOOSE = 200.0, 2.0
"""Largest force of the wrist while it is led along [N], and while the pads close, so that it gives way to them."""

MASSES = (0.5, 0.1, 0.1)
"""Masses of wrist and pads [kg]; the arm behind them bears their weight."""

STRONGEST = 15.0
"""Pull at which the human gives up [N]."""

CLOSING = 0.6
"""Time given to the pads to close [s]."""

BACK = 0.14
"""How far the hand draws back with the object [m]."""

ROOM = 0.045
"""Least distance kept from the robot's tool centre point along the reach [m]."""

TURNED = np.cos(np.radians(40.0))
"""How far the hand is turned out of its straight way to align with a handle, at most (cosine): wrist and forearm reach
that; a thing across the way is taken straight."""

Phase = Literal["reach", "close", "pull", "leave", "rest"]


class HumanHand:
    """A hand in a simulated cell, moved on by ``act`` before every step of the world.

    Attributes:
        phase: What it does.
        pulling: Whether it pulls.
    """

    def __init__(self, world: BulletWorld, human: Human, giver: Side) -> None:
        self.world, self.client = world, world.client
        self.away = unit(human.towards)
        self.phase: Phase = "reach"
        self._grip = _where(world, self.away, giver)
        T_far = pin.SE3(self._grip.rotation, self._grip.translation + FAR * self.away)
        self._offset, self._left = FAR, CLOSING
        self._still, self._pull, self._firm = np.zeros(3), 0.0, STIFF
        self._build(T_far)

    @property
    def pulling(self) -> bool:
        """Whether it pulls."""
        return self.phase == "pull"

    def _build(self, T: pin.SE3) -> None:
        client = self.client
        half = [0.5 * v for v in PAD]
        wrist = client.createCollisionShape(client.GEOM_BOX, halfExtents=[0.03, 0.02, 0.02])
        pad = client.createCollisionShape(client.GEOM_BOX, halfExtents=half)
        skin = client.createVisualShape(client.GEOM_BOX, halfExtents=half, rgbaColor=[0.85, 0.65, 0.52, 1.0])
        palm = client.createVisualShape(
            client.GEOM_BOX, halfExtents=[0.03, 0.02, 0.02], rgbaColor=[0.85, 0.65, 0.52, 1.0]
        )
        behind = -0.075
        side = 0.5 * WIDEST + 0.5 * PAD[0]
        xyz, quaternion = bullet_pose(T * pin.SE3(np.eye(3), np.array([0.0, behind, 0.0])))
        self.body = client.createMultiBody(
            MASSES[0], wrist, palm, xyz, quaternion,
            linkMasses=list(MASSES[1:]), linkCollisionShapeIndices=[pad, pad], linkVisualShapeIndices=[skin, skin],
            linkPositions=[[side, -behind, 0.0], [-side, -behind, 0.0]], linkOrientations=[[0, 0, 0, 1]] * 2,
            linkInertialFramePositions=[[0, 0, 0]] * 2, linkInertialFrameOrientations=[[0, 0, 0, 1]] * 2,
            linkParentIndices=[0, 0], linkJointTypes=[client.JOINT_PRISMATIC] * 2,
            linkJointAxis=[[-1, 0, 0], [1, 0, 0]],
        )  # fmt: skip
        for link in (-1, 0, 1):
            client.changeDynamics(
                self.body, link, lateralFriction=physics.PAD_FRICTION, spinningFriction=physics.PAD_SPINNING,
                rollingFriction=physics.PAD_ROLLING, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0,
            )  # fmt: skip
        self._behind = pin.SE3(np.eye(3), np.array([0.0, behind, 0.0]))
        self._tie = client.createConstraint(
            self.body, -1, -1, -1, client.JOINT_FIXED, [0, 0, 0], [0, 0, 0], xyz, [0, 0, 0, 1], quaternion
        )
        self._lead()
        self._pads(0.0, 20.0)

    def _lead(self) -> None:
        """Lead the wrist to where the script has it."""
        T = pin.SE3(self._grip.rotation, self._grip.translation + self._offset * self.away) * self._behind
        xyz, quaternion = bullet_pose(T)
        self.client.changeConstraint(self._tie, xyz, quaternion, maxForce=self._firm)
        for link, mass in zip((-1, 0, 1), MASSES, strict=True):
            up = [0.0, 0.0, mass * physics.GRAVITY]
            at = self._position(link)
            self.client.applyExternalForce(self.body, link, up, at, self.client.WORLD_FRAME)

    def _position(self, link: int) -> list[float]:
        """Centre of mass of the wrist (-1) or a pad [m]."""
        if link < 0:
            return list(self.client.getBasePositionAndOrientation(self.body)[0])
        return list(self.client.getLinkState(self.body, link)[0])

    def _pads(self, travel: float, force: float) -> None:
        for joint in (0, 1):
            self.client.setJointMotorControl2(
                self.body, joint, self.client.POSITION_CONTROL, targetPosition=travel, force=force, maxVelocity=0.15
            )

    def act(self) -> None:
        """Do what the script says for the next step."""
        match self.phase:
            case "reach":
                self._reach()
            case "close":
                self._close()
            case "pull":
                self._draw()
            case "leave":
                self._leave()
            case "rest":
                pass
        self._lead()

    def _reach(self) -> None:
        self._offset = max(0.0, self._offset - REACH_SPEED * physics.STEP)
        if self._offset == 0.0:
            self.phase, self._firm = "close", LOOSE
            self._pads(0.5 * WIDEST, GRIP)

    def _close(self) -> None:
        self._left -= physics.STEP
        if self._left <= 0.0:
            self.phase = "pull" if self.holds() else "rest"
            self._still = self._force()

    def _draw(self) -> None:
        """Pull with a force that grows until the object is given, or the human gives up."""
        self._pull = min(STRONGEST, self._pull + PULL_RATE * physics.STEP)
        self._offset, self._firm = BACK, self._pull
        if self._given():
            T = pin.SE3(self._grip.rotation, np.asarray(self._position(-1))) * self._behind.inverse()
            self._offset = float((T.translation - self._grip.translation) @ self.away)
            self.phase, self._firm = "leave", STIFF

    def _leave(self) -> None:
        """Draw back, and wait where something catches: the robot's hand has still to clear the object."""
        if self.pull() > STRONGEST:
            return
        self._offset = min(BACK, self._offset + LEAVE_SPEED * physics.STEP)
        if self._offset == BACK:
            self.phase = "rest"

    def _given(self) -> bool:
        """Whether the robot's fingers have left the object."""
        return all(self.world.contact_force(side) == 0.0 for side in ("left", "right"))

    def _force(self) -> Array:
        """Force of the object on the hand ``(3,)`` [N]."""
        return self.world.force_of_object(self.body)

    def pull(self) -> float:
        """Force with which the hand pulls the object towards the human [N], beyond what it was before."""
        return float(-(self._force() - self._still) @ self.away)

    def holds(self) -> bool:
        """Whether both pads touch the object."""
        touched = {c[3] for c in self.client.getContactPoints(self.body, self.world.object) if c[9] > 0.0}
        return {0, 1} <= touched


def _where(world: BulletWorld, away: Array, giver: Side) -> pin.SE3:
    """``T_world_grip``: x across the pads, y from the palm towards the object.

    The grip is on the body, as near to the human as it goes, across the narrowest direction there.
    """
    # The surface, not the vertices: a long straight handle has none between its ends.
    seen = points(world.object_pose(), surface(world.asset)["body"][0])
    reach = seen @ away
    end = float(reach.max()) - 0.4 * PAD[1]
    at = max(end, float(world.tcp(giver) @ away) + ROOM)
    slab = seen[np.abs(reach - at) < 0.5 * PAD[1]]
    slab = slab if len(slab) >= 4 else seen[np.abs(reach - reach.max()) < PAD[1]]
    along = _lengthwise(slab, away)
    plane = np.linalg.svd(along[None])[2][1:].T
    flat = slab @ plane
    turns = np.linspace(0.0, np.pi, 12, endpoint=False)
    ways = np.column_stack([np.cos(turns), np.sin(turns)])
    across = plane @ ways[int(np.argmin(np.ptp(flat @ ways.T, axis=0)))]
    middle = plane @ (0.5 * (flat.max(axis=0) + flat.min(axis=0)))
    ends = slab @ along
    middle += 0.5 * (ends.max() + ends.min()) * along
    return pin.SE3(np.column_stack([across, -along, np.cross(across, -along)]), np.asarray(middle))


def _lengthwise(slab: Array, away: Array) -> Array:
    """Along a handle that points about towards the human, as a wrist turns to it; towards the human where none does."""
    axis = unit(np.linalg.svd(slab - slab.mean(axis=0), full_matrices=False)[2][0])
    axis = axis if axis @ away > 0.0 else -axis
    return axis if axis @ away > TURNED else away
