"""A cell that only shows: bodies are placed, nothing is simulated, and PyBullet says what touches what."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from robots.model import arm_urdf_file
from robots.spatial import Array
from robots.workcell import SIDES, Side, Workcell
from worlds.assets.asset import Asset
from worlds.bullet.client import Client, bullet_pose, from_bullet, joint_numbers

SEEN = 0.02
"""Distances beyond this are not told apart by ``distance`` [m]."""

Names = tuple[str, str]
"""Two body names in alphabetical order: ``left/panda_link5``, ``object``, ``table``, ``floor``."""


class _Arm:
    """Body and joint numbers of one placed arm."""

    def __init__(self, client: Client, workcell: Workcell, side: Side) -> None:
        model = workcell.arm(side)
        flags = client.URDF_USE_SELF_COLLISION
        self.body = client.load_urdf(arm_urdf_file(workcell, side), pin.SE3.Identity(), fixed=True, flags=flags)
        joints, links = joint_numbers(client, self.body)
        self.joints = [joints[f"{side}/{name}"] for name in model.joints]
        self.fingers = [joints[f"{side}/{name}"] for name in model.gripper.finger_joints]
        self.hand = links[f"{side}/{model.gripper.hand_link}"]
        self.names = {number: name for name, number in links.items()}
        self.parents = {k: int(client.getJointInfo(self.body, k)[16]) for k in range(client.getNumJoints(self.body))}
        self.moving = {*self.joints, *self.fingers}

    def group(self, link: int) -> int:
        """The link at the root of the rigid group that ``link`` belongs to; -1 for the fixed base."""
        while link >= 0 and link not in self.moving:
            link = self.parents[link]
        return link

    def joined(self, a: int, b: int) -> bool:
        """Whether two links are one rigid group, follow each other, or are the fingers of one hand."""
        ga, gb = self.group(a), self.group(b)
        before = {g: self.group(self.parents[g]) if g >= 0 else None for g in (ga, gb)}
        return ga == gb or before[ga] == gb or before[gb] == ga or {ga, gb} == set(self.fingers)


class GhostCell:
    """Two arms, table, floor and the true object, placed at will. Owns a PyBullet server; close it when done."""

    def __init__(self, workcell: Workcell, asset: Asset) -> None:
        self.workcell, self.asset = workcell, asset
        self.client = client = Client()
        table = workcell.table
        self.table = self._slab(table.centre, table.size, table.top, table.thickness)
        self.floor = self._slab((0.0, 0.0), (20.0, 20.0), workcell.floor, 2.0)
        self.arms = {side: _Arm(client, workcell, side) for side in SIDES}
        self.object = client.load_urdf(asset.urdf, pin.SE3.Identity(), fixed=False)
        self.object_joints, _ = joint_numbers(client, self.object)
        for name, joint in asset.joints.items():
            client.resetJointState(self.object, self.object_joints[name], joint.start)
        info = client.getDynamicsInfo(self.object, -1)
        self._T_body_inertia = from_bullet(info[3], info[4])
        self._bodies = {self.arms[side].body: self.arms[side] for side in SIDES}
        self._plain = {self.table: "table", self.floor: "floor", self.object: "object"}
        self._ignore_joined()

    def __enter__(self) -> GhostCell:
        return self

    def __exit__(self, *_: object) -> None:
        self.client.close()

    def _slab(self, centre: tuple[float, float], size: tuple[float, float], top: float, thickness: float) -> int:
        half = [size[0] / 2, size[1] / 2, thickness / 2]
        shape = self.client.createCollisionShape(self.client.GEOM_BOX, halfExtents=half)
        return int(self.client.createMultiBody(0.0, shape, basePosition=[*centre, top - thickness / 2]))

    def _ignore_joined(self) -> None:
        """Leave out pairs that touch by construction: neighbours in an arm, and its base with what it stands on."""
        client = self.client
        for arm in self.arms.values():
            links = sorted(arm.names)
            for a in links:
                for b in links:
                    if a < b and arm.joined(a, b):
                        client.setCollisionFilterPair(arm.body, arm.body, a, b, 0)
            for body in (self.table, self.floor):
                for link in links:
                    if self._stands(arm.body, link, body):
                        client.setCollisionFilterPair(arm.body, body, link, -1, 0)

    # -- placing ---------------------------------------------------------------------------------------------------

    def place_arm(self, side: Side, q: Array) -> None:
        """Put an arm's joints at ``q`` ``(7,)`` [rad]."""
        arm = self.arms[side]
        self.client.resetJointStatesMultiDof(arm.body, arm.joints, [[float(v)] for v in q])

    def place_fingers(self, side: Side, openings: tuple[float, float]) -> None:
        """Put each finger at an opening of its own [m]."""
        arm = self.arms[side]
        self.client.resetJointStatesMultiDof(arm.body, arm.fingers, [[float(v)] for v in openings])

    def place_object(self, T_world_body: pin.SE3) -> None:
        """Put the object's body link somewhere."""
        self.client.resetBasePositionAndOrientation(self.object, *bullet_pose(T_world_body * self._T_body_inertia))

    def place_part(self, position: float) -> None:
        """Put the functional joint at a position [m] or [rad]."""
        self.client.resetJointState(self.object, self.object_joints[self.asset.part.joint], position)

    # -- asking ----------------------------------------------------------------------------------------------------

    def hand(self, side: Side) -> pin.SE3:
        """``T_world_hand`` by PyBullet's forward kinematics."""
        arm = self.arms[side]
        state = self.client.getLinkState(arm.body, arm.hand, computeForwardKinematics=1)
        return from_bullet(state[4], state[5])

    def near(self) -> dict[Names, float]:
        """Every pair of bodies that touches, or nearly does, with the distance [m], negative in penetration.

        How near is left to PyBullet, which goes by the size of the bodies; it may be less than a millimetre.

        PyBullet rounds hulls by 1 mm, so distances between two meshes are up to 2 mm too small.
        """
        self.client.performCollisionDetection()
        found: dict[Names, float] = {}
        for point in self.client.getContactPoints():
            a, b = self._name(point[1], point[3]), self._name(point[2], point[4])
            if a != b:
                pair = (a, b) if a < b else (b, a)
                found[pair] = min(found.get(pair, SEEN), float(point[8]))
        return found

    def around(self, cap: float) -> dict[Names, float]:
        """Pairs of different bodies (arms, object, table, floor) up to ``cap`` apart [m]: slower, but sees further.

        Left out is what ``near`` leaves out: two links of one arm, and an arm's base with what it stands on.
        """
        bodies = [*self._bodies, self.object, self.table, self.floor]
        found: dict[Names, float] = {}
        for k, a in enumerate(bodies):
            for b in bodies[k + 1 :]:
                if {a, b} == {self.table, self.floor}:
                    continue
                for point in self.client.getClosestPoints(a, b, cap):
                    if not self._stands(a, point[3], b):
                        names = self._name(a, point[3]), self._name(b, point[4])
                        pair = names if names[0] < names[1] else names[::-1]
                        found[pair] = min(found.get(pair, cap), float(point[8]))
        return found

    def _stands(self, body: int, link: int, on: int) -> bool:
        """Whether a link of an arm rests on or above table or floor by construction."""
        if body not in self._bodies or on not in (self.table, self.floor):
            return False
        group = self._bodies[body].group(link)
        return group == -1 or (on == self.floor and group == self._bodies[body].joints[0])

    def distance(self, pair: Names) -> float:
        """Distance of two bodies computed afresh [m], at most ``SEEN``."""
        (body_a, link_a), (body_b, link_b) = (self._find(name) for name in pair)
        points = self.client.getClosestPoints(
            body_a, body_b, SEEN, **self._links("A", link_a), **self._links("B", link_b)
        )
        return min((float(point[8]) for point in points), default=SEEN)

    def finger_gap(self, side: Side, finger: int) -> float:
        """Distance from one finger (0 or 1) to the object [m], at most ``SEEN``."""
        return self.distance((self.arms[side].names[self.arms[side].fingers[finger]], "object"))

    def _name(self, body: int, link: int) -> str:
        return self._plain[body] if body in self._plain else self._bodies[body].names[link]

    def _find(self, name: str) -> tuple[int, int | None]:
        for body, plain in self._plain.items():
            if plain == name:
                return body, None
        for body, arm in self._bodies.items():
            for link, mine in arm.names.items():
                if mine == name:
                    return body, link
        raise KeyError(name)

    @staticmethod
    def _links(which: str, link: int | None) -> dict[str, int]:
        return {} if link is None else {f"linkIndex{which}": link}


def split_openings(cell: GhostCell, side: Side, widest: float) -> tuple[float, float] | None:
    """How far each finger closes until it meets the object [m]; ``None`` when neither meets it.

    The fingers are left where they meet it. A finger that meets nothing closes to the middle. The width is found to
    a tenth of a millimetre by marching inwards, then halving.
    """
    found: list[float | None] = []
    for finger in (0, 1):

        def gap(opening: float, finger: int = finger) -> float:
            cell.place_fingers(side, (opening, widest) if finger == 0 else (widest, opening))
            return cell.finger_gap(side, finger)

        found.append(_first_touch(gap, widest))
    if found == [None, None]:
        return None
    openings = (found[0] or 0.0, found[1] or 0.0)
    cell.place_fingers(side, openings)
    return openings


def _first_touch(gap: Callable[[float], float], widest: float) -> float | None:
    """The largest opening at which a finger touches, or ``None``."""
    free = widest
    for opening in np.linspace(widest, 0.0, max(2, int(np.ceil(widest / 0.001)) + 1)):
        if gap(float(opening)) <= 0.0:
            touching = float(opening)
            while free - touching > 1e-4:
                middle = (free + touching) / 2
                free, touching = (free, middle) if gap(middle) <= 0.0 else (middle, touching)
            return touching
        free = float(opening)
    return None
