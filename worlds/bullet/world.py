"""The simulated cell: two arms under position control, a table and one object, moved by physics alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from robots.errors import SimulationDiverged
from robots.model import arm_urdf_file
from robots.spatial import Array, points, pose
from robots.workcell import SIDES, Camera, Side, Workcell
from worlds import physics
from worlds.assets.asset import Asset
from worlds.assets.shape import collision_vertices
from worlds.bullet.client import Client, bullet_pose, from_bullet, joint_numbers
from worlds.camera import Image


@dataclass(frozen=True, slots=True)
class Touch:
    """One contact of a finger with the object.

    Attributes:
        finger: World-unique link name.
        link: Object link touched.
        force: Normal force [N].
        depth: Penetration [m], negative for a gap.
    """

    finger: str
    link: str
    force: float
    depth: float


class _Arm:
    """Body and joint numbers of one loaded arm."""

    def __init__(self, client: Client, workcell: Workcell, side: Side) -> None:
        model = workcell.arm(side)
        self.model = model
        self.body = client.load_urdf(arm_urdf_file(workcell, side), pin.SE3.Identity(), fixed=True)
        joints, links = joint_numbers(client, self.body)
        self.joints = [joints[f"{side}/{name}"] for name in model.joints]
        self.fingers = [joints[f"{side}/{name}"] for name in model.gripper.finger_joints]
        self.hand = links[f"{side}/{model.gripper.hand_link}"]
        self.finger_links = [links[f"{side}/{name}"] for name in model.gripper.finger_links]
        self.names = {number: name for name, number in links.items()}


class BulletWorld:
    """A PyBullet simulation of the workcell with one object. Owns a physics server; close it when done.

    Attributes:
        workcell: What stands in the cell.
        asset: The object.
        time: Simulated time since construction [s].
        images: What each camera saw since anything last moved.
    """

    def __init__(self, workcell: Workcell, asset: Asset) -> None:
        self.workcell, self.asset = workcell, asset
        self.time = 0.0
        self.images: dict[Camera, Image] = {}
        self._vertices: Array | None = None
        self.client = client = Client()
        client.setPhysicsEngineParameter(
            fixedTimeStep=physics.STEP, numSolverIterations=physics.SOLVER_ITERATIONS, deterministicOverlappingPairs=1
        )
        client.setGravity(0.0, 0.0, -physics.GRAVITY)
        self.table = self._box_top(
            workcell.table.centre, workcell.table.size, workcell.table.top, workcell.table.thickness
        )
        self.floor = self._box_top((0.0, 0.0), (4.0, 4.0), workcell.floor, 0.1)
        client.changeVisualShape(self.table, -1, rgbaColor=[0.80, 0.76, 0.68, 1.0])
        client.changeVisualShape(self.floor, -1, rgbaColor=[0.55, 0.56, 0.58, 1.0])
        self.arms = {side: _Arm(client, workcell, side) for side in SIDES}
        for side in SIDES:
            self._prepare_arm(side)
        self._load_object(asset)

    def __enter__(self) -> BulletWorld:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the physics server."""
        self.client.close()

    def _box_top(self, centre: tuple[float, float], size: tuple[float, float], top: float, thickness: float) -> int:
        shape = self.client.createCollisionShape(
            self.client.GEOM_BOX, halfExtents=[size[0] / 2, size[1] / 2, thickness / 2]
        )
        body = self.client.createMultiBody(0.0, shape, basePosition=[*centre, top - thickness / 2])
        self.client.changeDynamics(body, -1, lateralFriction=physics.TABLE_FRICTION)
        return int(body)

    def _prepare_arm(self, side: Side) -> None:
        client, arm = self.client, self.arms[side]
        for link in range(-1, client.getNumJoints(arm.body)):
            client.changeDynamics(arm.body, link, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0)
        for link in arm.finger_links:
            client.changeDynamics(
                arm.body,
                link,
                lateralFriction=physics.PAD_FRICTION,
                spinningFriction=physics.PAD_SPINNING,
                rollingFriction=physics.PAD_ROLLING,
                contactStiffness=physics.PAD_STIFFNESS,
                contactDamping=physics.PAD_DAMPING,
                frictionAnchor=1,
            )
        gear = client.createConstraint(
            arm.body, arm.fingers[0], arm.body, arm.fingers[1], client.JOINT_GEAR, [1, 0, 0], [0, 0, 0], [0, 0, 0]
        )
        client.changeConstraint(gear, gearRatio=-1, erp=physics.FINGER_GEAR_ERP, maxForce=physics.FINGER_GEAR_FORCE)
        self.put_arm(side, np.asarray(self.workcell.placement(side).home), arm.model.gripper.finger_travel)

    def put_arm(self, side: Side, q: Array, opening: float) -> None:
        """Set one arm's joints ``(7,)`` [rad] and finger opening [m] before an episode begins; nothing moves there."""
        self.images.clear()
        arm = self.arms[side]
        for joint, value in zip(arm.joints, q, strict=True):
            self.client.resetJointState(arm.body, joint, float(value))
        for joint in arm.fingers:
            self.client.resetJointState(arm.body, joint, opening)
        self.command_arm(side, q, np.zeros(7))
        self.command_fingers(side, opening, physics.OPEN_FORCE)

    def _load_object(self, asset: Asset) -> None:
        client = self.client
        self.object = client.load_urdf(
            asset.urdf, pose((0.0, 0.0, 1.0)), fixed=False, flags=client.URDF_USE_INERTIA_FROM_FILE
        )
        self.object_joints, links = joint_numbers(client, self.object)
        self.object_links = {number: name for name, number in links.items()}
        for link in range(-1, client.getNumJoints(self.object)):
            client.changeDynamics(
                self.object,
                link,
                lateralFriction=physics.OBJECT_FRICTION,
                spinningFriction=physics.OBJECT_SPINNING,
                rollingFriction=physics.OBJECT_ROLLING,
                jointDamping=0.0,
            )
        self._damp_object(physics.OBJECT_DAMPING)
        for name, joint in asset.joints.items():
            number = self.object_joints[name]
            client.resetJointState(self.object, number, joint.start)
            client.setJointMotorControl2(
                self.object, number, client.VELOCITY_CONTROL, targetVelocity=0.0, force=joint.friction
            )

    def _damp_object(self, damping: float) -> None:
        for link in range(-1, self.client.getNumJoints(self.object)):
            self.client.changeDynamics(self.object, link, linearDamping=damping, angularDamping=damping)

    # -- the object ------------------------------------------------------------------------------------------------

    def put_object(self, T_world_body: pin.SE3) -> None:
        """Place the object's body link before an episode begins, at rest and with its joints at their start."""
        self.images.clear()
        info = self.client.getDynamicsInfo(self.object, -1)
        T_body_inertia = from_bullet(info[3], info[4])
        self.client.resetBasePositionAndOrientation(self.object, *bullet_pose(T_world_body * T_body_inertia))
        self.client.resetBaseVelocity(self.object, [0, 0, 0], [0, 0, 0])
        for name, joint in self.asset.joints.items():
            self.client.resetJointState(self.object, self.object_joints[name], joint.start)

    def object_pose(self) -> pin.SE3:
        """``T_world_body`` of the object's root link (privileged)."""
        info = self.client.getDynamicsInfo(self.object, -1)
        T_world_inertia = from_bullet(*self.client.getBasePositionAndOrientation(self.object))
        return T_world_inertia * from_bullet(info[3], info[4]).inverse()

    def object_bounds(self) -> tuple[Array, Array]:
        """Lower and upper corner of the object's bounding box in the world frame [m] (privileged).

        PyBullet's boxes are loose: they may reach some millimetres beyond the object.
        """
        boxes = [self.client.getAABB(self.object, k) for k in range(-1, self.client.getNumJoints(self.object))]
        lows, highs = zip(*boxes, strict=True)
        return np.min(lows, axis=0), np.max(highs, axis=0)

    def object_vertices(self) -> Array:
        """Vertices of the object's collision geometry, its joints at their start ``(n, 3)`` [m] (privileged)."""
        if self._vertices is None:
            self._vertices = np.concatenate(list(collision_vertices(self.asset).values()))
        return points(self.object_pose(), self._vertices)

    def object_speed(self) -> tuple[float, float]:
        """Linear [m/s] and angular [rad/s] speed of the object's body."""
        linear, angular = self.client.getBaseVelocity(self.object)
        return float(np.linalg.norm(linear)), float(np.linalg.norm(angular))

    def joint_position(self, joint: str) -> float:
        """Position of an object joint [m] or [rad] (privileged)."""
        return float(self.client.getJointState(self.object, self.object_joints[joint])[0])

    def settle_object(self) -> bool:
        """Let the object come to rest under extra damping; whether it did within the limit."""
        self._damp_object(physics.SETTLE_DAMPING)
        calm = 0
        for _ in range(int(physics.SETTLE_LIMIT / physics.STEP)):
            self.step()
            linear, angular = self.object_speed()
            calm = calm + 1 if linear < physics.REST_SPEED and angular < 10 * physics.REST_SPEED else 0
            if calm >= 24:
                break
        self._damp_object(physics.OBJECT_DAMPING)
        return calm >= 24

    # -- the arms --------------------------------------------------------------------------------------------------

    def command_arm(self, side: Side, q: Array, qd: Array) -> None:
        """Position targets ``(7,)`` [rad] with feed-forward velocities ``(7,)`` [rad/s], within the torque limits."""
        arm = self.arms[side]
        self.client.setJointMotorControlArray(
            arm.body,
            arm.joints,
            self.client.POSITION_CONTROL,
            targetPositions=[float(v) for v in q],
            targetVelocities=[float(v) for v in qd],
            forces=list(arm.model.torque),
            positionGains=[physics.ARM_POSITION_GAIN] * 7,
            velocityGains=[physics.ARM_VELOCITY_GAIN] * 7,
        )

    def command_fingers(self, side: Side, opening: float, force: float) -> None:
        """Drive both fingers to an opening of one finger [m] with at most ``force`` [N] each."""
        arm = self.arms[side]
        grip = arm.model.gripper
        for joint in arm.fingers:
            self.client.setJointMotorControl2(
                arm.body,
                joint,
                self.client.POSITION_CONTROL,
                targetPosition=opening,
                force=min(force, grip.force_limit),
                maxVelocity=grip.finger_velocity,
            )

    def arm_positions(self, side: Side) -> Array:
        """Measured joint positions ``(7,)`` [rad]."""
        arm = self.arms[side]
        return np.array([state[0] for state in self.client.getJointStates(arm.body, arm.joints)])

    def tcp(self, side: Side) -> Array:
        """Measured position of the tool centre point ``(3,)`` [m]."""
        arm = self.arms[side]
        state = self.client.getLinkState(arm.body, arm.hand, computeForwardKinematics=1)
        T_world_hand = from_bullet(state[4], state[5])
        return np.asarray(T_world_hand.act(np.array([0.0, 0.0, arm.model.gripper.tcp_offset])))

    def opening(self, side: Side) -> float:
        """Measured opening: mean of the two fingers [m]."""
        arm = self.arms[side]
        return float(np.mean([state[0] for state in self.client.getJointStates(arm.body, arm.fingers)]))

    def step(self) -> None:
        """Advance by one step; ``SimulationDiverged`` when the object's state is no longer finite."""
        self.images.clear()
        self.client.stepSimulation()
        self.time += physics.STEP
        position = self.client.getBasePositionAndOrientation(self.object)[0]
        if not all(abs(v) < 1e3 for v in position):
            raise SimulationDiverged(f"The simulated object left all bounds after {self.time:.2f} s.")

    def touches(self, side: Side) -> list[Touch]:
        """Contacts between one hand's fingers and the object."""
        arm = self.arms[side]
        return [
            Touch(arm.names[c[3]], self.object_links[c[4]], float(c[9]), -float(c[8]))
            for c in self.client.getContactPoints(arm.body, self.object)
            if c[3] in arm.finger_links
        ]

    def contact_force(self, side: Side) -> float:
        """Sum of the normal forces between one whole arm and the object [N]."""
        return float(sum(c[9] for c in self.client.getContactPoints(self.arms[side].body, self.object)))

    def force_on(self, side: Side) -> Array:
        """Force of the object on one whole arm ``(3,)`` [N], as a sensor in the wrist would feel it without gravity."""
        return self.force_of_object(self.arms[side].body)

    def force_of_object(self, body: int) -> Array:
        """Force of the object on another body ``(3,)`` [N], friction included.

        PyBullet turns normals but not friction directions when the bodies are asked for in the other order than it
        keeps them in, so they are asked for in that order.
        """
        first, second = min(body, self.object), max(body, self.object)
        total = np.zeros(3)
        for c in self.client.getContactPoints(first, second):
            total += c[9] * np.asarray(c[7]) + c[10] * np.asarray(c[11]) + c[12] * np.asarray(c[13])
        return total if first == body else -total

    def supported(self) -> bool:
        """Whether the object touches table or floor."""
        return any(self.client.getContactPoints(self.object, body) for body in (self.table, self.floor))
