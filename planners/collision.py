"""Whether a configuration of both arms touches anything: Coal on convex hulls behind Pinocchio's broadphase."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin

from robots.errors import UnknownName
from robots.model import arm_urdf_file
from robots.spatial import Array, pose
from robots.workcell import SIDES, Side, Workcell

OBJECT = "object"
TABLE = "table"
FLOOR = "floor"

MARGIN = 0.002
"""Distance that counts as contact [m]: covers the 1 mm by which other checkers inflate hulls, and sampling."""

REACH_CAP = 1.0
"""Distances beyond this are not told apart [m]."""


@dataclass(frozen=True, slots=True)
class Contact:
    """Two bodies closer than the margin.

    Attributes:
        a: World-unique name, such as ``left/panda_link5``.
        b: The other.
        depth: Penetration [m]; 0 when they are only inside the margin.
    """

    a: str
    b: str
    depth: float

    def __str__(self) -> str:
        if self.depth > 0.0:
            return f"{self.a} hits {self.b}, {1e3 * self.depth:.1f} mm deep"
        return f"{self.a} comes closer to {self.b} than the margin"


class CollisionWorld:
    """Both arms, table, floor and one object of convex pieces, mutated in place between queries.

    Joint positions are ``(14,)``, left then right [rad]. The object is absent, rests in the world or moves with a hand.

    Attributes:
        margin: Distance that counts as contact [m].
    """

    def __init__(self, workcell: Workcell, *, margin: float = MARGIN) -> None:
        self.workcell, self.margin = workcell, margin
        self._model, self._cell = _cell_geometry(workcell)
        self._pairs_of_arms = _arm_pairs(workcell, self._model, self._cell)
        self._hands = {side: _hand(self._model, workcell, side) for side in SIDES}
        self._q = pin.neutral(self._model)
        self._arm_slots = {side: _slots(self._model, side, workcell.arm(side).joints) for side in SIDES}
        self._finger_slots = {side: _slots(self._model, side, workcell.arm(side).gripper.finger_joints) for side in SIDES}
        for side in SIDES:
            self.set_fingers(side, workcell.arm(side).gripper.finger_travel)
        self._allowed: frozenset[frozenset[str]] = frozenset()
        self._present = False
        self.set_object(())

    @property
    def names(self) -> frozenset[str]:
        """Every name that may stand in a contact."""
        return frozenset(self._names) | {OBJECT}

    def set_object(self, hulls: Sequence[Array]) -> None:
        """Replace the object by convex pieces, each ``(k, 3)`` vertices in the object frame [m]; it is absent at first."""
        geometry = self._cell.copy()
        pieces = [geometry.addGeometryObject(_piece(number, hull)) for number, hull in enumerate(hulls)]
        for a, b in self._pairs_of_arms:
            geometry.addCollisionPair(pin.CollisionPair(a, b))
        for piece in pieces:
            for other in range(self._cell.ngeoms):
                geometry.addCollisionPair(pin.CollisionPair(other, int(piece)))
        self._geometry, self._pieces = geometry, [int(piece) for piece in pieces]
        self._data = self._model.createData()
        self._geometry_data = geometry.createData()
        for request in self._geometry_data.collisionRequests:
            request.enable_contact = False
            request.security_margin = self.margin
        self._names = [_public_name(shape.name) for shape in geometry.geometryObjects]
        self._pair_names = [
            frozenset((self._names[pair.first], self._names[pair.second])) for pair in geometry.collisionPairs
        ]
        self._active = np.ones(len(self._pair_names), dtype=bool)
        self._broadphase = pin.BroadPhaseManager_NaiveCollisionManager(self._model, geometry, self._geometry_data)
        self._callback = pin.CollisionCallBackDefault(geometry, self._geometry_data, True)
        self._present = False
        self._activate()

    def place_object(self, T_world_object: pin.SE3) -> None:
        """Let the object rest in the world."""
        self._put(0, T_world_object)

    def attach_object(self, side: Side, T_hand_object: pin.SE3) -> None:
        """Let the object move rigidly with a hand."""
        joint, T_joint_hand = self._hands[side]
        self._put(joint, T_joint_hand * T_hand_object)

    def remove_object(self) -> None:
        """Leave the object out of every query."""
        self._present = False
        self._activate()

    def _put(self, joint: int, placement: pin.SE3) -> None:
        for piece in self._pieces:
            self._geometry.geometryObjects[piece].parentJoint = joint
            self._geometry.geometryObjects[piece].placement = placement
        if not self._present:
            self._present = True
            self._activate()

    def set_fingers(self, side: Side, opening: float) -> None:
        """Set both fingers of a hand to an opening of one finger [m]."""
        self._q[self._finger_slots[side]] = opening

    def allow(self, pairs: Iterable[tuple[str, str]]) -> None:
        """Replace the set of pairs that may touch; ``UnknownName`` for a name nothing has."""
        wanted = frozenset(frozenset(pair) for pair in pairs)
        for name in {name for pair in wanted for name in pair} - self.names:
            raise UnknownName("body", name, self.names)
        if wanted != self._allowed:
            self._allowed = wanted
            self._activate()

    def _activate(self) -> None:
        """Bring Pinocchio's active pairs in line with the allowed ones and the object's presence."""
        for k, names in enumerate(self._pair_names):
            active = names not in self._allowed and (self._present or OBJECT not in names)
            if active != self._active[k]:
                switch = self._geometry_data.activateCollisionPair if active else self._geometry_data.deactivateCollisionPair
                switch(k)
                self._active[k] = active

    def _full(self, q: Array) -> Array:
        self._q[self._arm_slots["left"]] = q[:7]
        self._q[self._arm_slots["right"]] = q[7:]
        return self._q

    def free(self, q: Array) -> bool:
        """Whether every active pair keeps more than the margin."""
        return not pin.computeCollisions(self._model, self._data, self._broadphase, self._callback, self._full(q))

    def contact(self, q: Array) -> Contact | None:
        """The deepest contact, or ``None`` when the configuration is free."""
        if self.free(q):
            return None
        distance, a, b = self._nearest(q, among_hits=True)
        return Contact(a, b, max(0.0, -distance))

    def clearance(self, q: Array) -> tuple[float, str, str]:
        """The smallest distance [m] over active pairs, negative for penetration, and its two names."""
        return self._nearest(q, among_hits=False)

    def _nearest(self, q: Array, *, among_hits: bool) -> tuple[float, str, str]:
        pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._geometry_data, self._full(q))
        lows, highs = self._boxes()
        best = (REACH_CAP, "", "")
        for k in np.flatnonzero(self._active):
            pair = self._geometry.collisionPairs[int(k)]
            gap = np.maximum(lows[pair.first] - highs[pair.second], lows[pair.second] - highs[pair.first]).max()
            if gap >= best[0] or (among_hits and gap > self.margin):
                continue
            distance = float(pin.computeDistance(self._geometry, self._geometry_data, int(k)).min_distance)
            if distance < best[0]:
                best = (distance, self._names[pair.first], self._names[pair.second])
        return best

    def _boxes(self) -> tuple[Array, Array]:
        """Corners of every shape's bounding box in the world frame [m]."""
        found = [shape.geometry.aabb_local for shape in self._geometry.geometryObjects]
        centres = np.array([(np.asarray(box.min_) + np.asarray(box.max_)) / 2 for box in found])
        halves = np.array([(np.asarray(box.max_) - np.asarray(box.min_)) / 2 for box in found])
        poses = self._geometry_data.oMg
        rotations = np.array([T.rotation for T in poses])
        middle = np.einsum("nij,nj->ni", rotations, centres) + np.array([T.translation for T in poses])
        reach = np.einsum("nij,nj->ni", np.abs(rotations), halves)
        return middle - reach, middle + reach


def _cell_geometry(workcell: Workcell) -> tuple[pin.Model, pin.GeometryModel]:
    """Both arms with fingers as one model, their links as convex hulls, and the table and floor as boxes."""
    models, geometries = [], []
    for side in SIDES:
        path = str(arm_urdf_file(workcell, side))
        model = pin.buildModelFromUrdf(path)
        models.append(model)
        geometries.append(pin.buildGeomFromUrdf(model, path, pin.GeometryType.COLLISION))
    model, geometry = pin.appendModel(models[0], models[1], geometries[0], geometries[1], 0, pin.SE3.Identity())
    for shape in geometry.geometryObjects:
        if hasattr(shape.geometry, "buildConvexHull"):
            shape.geometry.buildConvexHull(True, "Qt")
            shape.geometry = shape.geometry.convex
    while len(geometry.collisionPairs):
        geometry.removeCollisionPair(geometry.collisionPairs[0])
    table = workcell.table
    top = pose((*table.centre, table.top - table.thickness / 2))
    geometry.addGeometryObject(pin.GeometryObject(TABLE, 0, 0, top, coal.Box(*table.size, table.thickness)))
    ground = pose((0.0, 0.0, workcell.floor - 0.05))
    geometry.addGeometryObject(pin.GeometryObject(FLOOR, 0, 0, ground, coal.Box(6.0, 6.0, 0.1)))
    for shape in geometry.geometryObjects:
        shape.geometry.computeLocalAABB()
    return model, geometry


def _piece(number: int, vertices: Array) -> pin.GeometryObject:
    """One convex piece of the object."""
    cloud = coal.StdVec_Vec3s()
    for vertex in np.asarray(vertices, dtype=np.float64):
        cloud.append(vertex)
    hull = coal.Convex.convexHull(cloud, True, "Qt")
    hull.computeLocalAABB()
    return pin.GeometryObject(f"{OBJECT}_{number}", 0, 0, pin.SE3.Identity(), hull)


def _public_name(shape: str) -> str:
    """A shape's link name: Pinocchio appends a number to it."""
    stem, _, number = shape.rpartition("_")
    return stem if number.isdigit() and stem else shape


def _hand(model: pin.Model, workcell: Workcell, side: Side) -> tuple[int, pin.SE3]:
    frame = model.frames[model.getFrameId(f"{side}/{workcell.arm(side).gripper.hand_link}")]
    return int(frame.parentJoint), frame.placement.copy()


def _slots(model: pin.Model, side: Side, joints: Iterable[str]) -> list[int]:
    return [int(model.joints[model.getJointId(f"{side}/{name}")].idx_q) for name in joints]


def _arm_pairs(workcell: Workcell, model: pin.Model, geometry: pin.GeometryModel) -> list[tuple[int, int]]:
    """Pairs among arms, table and floor that can mean something.

    Left out: links of one arm that a joint connects or that ride on the same joint, and a hand with its own fingers
    and the fingers with each other (they overlap by construction: of 3000 random configurations of the Panda's hulls these and
    no other pairs touch in more than 7 %); anything fixed with anything fixed.
    """
    shapes = geometry.geometryObjects
    pairs = []
    for a in range(len(shapes)):
        for b in range(a + 1, len(shapes)):
            ja, jb = int(shapes[a].parentJoint), int(shapes[b].parentJoint)
            fixed = ja == 0 and jb == 0
            joined = ja == jb or model.parents[ja] == jb or model.parents[jb] == ja
            siblings = ja > 0 and jb > 0 and model.parents[ja] == model.parents[jb]
            same_arm = shapes[a].name.partition("/")[0] == shapes[b].name.partition("/")[0]
            bases = ja == 0 or jb == 0
            if fixed or (same_arm and siblings) or (joined and same_arm) or (bases and _rests_on_floor(shapes, a, b, model)):
                continue
            pairs.append((a, b))
    return pairs


def _rests_on_floor(shapes: Sequence[pin.GeometryObject], a: int, b: int, model: pin.Model) -> bool:
    """Whether the pair is the floor with a link that only turns above its own mount."""
    names = {shapes[a].name, shapes[b].name}
    moving = shapes[b] if int(shapes[a].parentJoint) == 0 else shapes[a]
    return FLOOR in names and int(model.parents[int(moving.parentJoint)]) == 0
