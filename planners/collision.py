"""Whether a configuration of both arms touches anything: Coal on convex hulls behind Pinocchio's broadphase."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin

from planners.compiled.cell import Motion
from planners.mirror import Mirror
from planners.pairs import FLOOR, cell_pairs, public_name
from robots.errors import UnknownName
from robots.model import arm_urdf_file
from robots.spatial import Array, pose
from robots.workcell import SIDES, Side, Workcell

OBJECT = "object"
TABLE = "table"

MARGIN = 0.003
"""Distance that counts as contact [m]: covers the 1 mm by which other checkers inflate hulls, and sampling."""

REACH_CAP = 1.0
"""Distances beyond this are not told apart [m]."""

FLOOR_SIZE, FLOOR_DEPTH = 20.0, 2.0
"""The floor is a box of this width and depth [m], deep enough that nothing falls through between two samples."""

FLAT = 1e-6
"""Spread across its thinnest direction [m] below which a piece has no volume: Coal's hull crashes on one."""


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
        if self.depth <= 0.0:
            return f"{self.a} is closer than the margin to {self.b}"
        return f"{self.a} hits {self.b}, {1e3 * self.depth:.{0 if self.depth >= 1.5e-3 else 1}f} mm deep"


class CollisionWorld:
    """Both arms, table, floor and one object of convex pieces, mutated in place between queries.

    Joint positions are ``(14,)``, left then right [rad]. The object is absent, rests in the world or moves with a hand.

    Attributes:
        workcell: The cell.
        margin: Distance that counts as contact [m].
    """

    def __init__(self, workcell: Workcell, *, margin: float = MARGIN) -> None:
        self.workcell, self.margin = workcell, margin
        self._model, self._cell = _cell_geometry(workcell)
        self._cell_pairs = cell_pairs(self._model, self._cell)
        self._mirror = Mirror(self._model, self._cell, self._cell_pairs)
        self._hands = {side: _hand(self._model, workcell, side) for side in SIDES}
        self._q: Array = pin.neutral(self._model)
        arms = {side: workcell.arm(side) for side in SIDES}
        left, right = (_slots(self._model, side, arms[side].joints) for side in SIDES)
        self._left, self._right = _as_slice(left), _as_slice(right)
        self._slots: dict[Side, list[int]] = {"left": left, "right": right}
        self._fingers = {side: _slots(self._model, side, arms[side].gripper.finger_joints) for side in SIDES}
        for side in SIDES:
            self.set_fingers(side, arms[side].gripper.finger_travel)
        self._allowed: frozenset[frozenset[str]] = frozenset()
        self.set_object(())

    @property
    def names(self) -> frozenset[str]:
        """Every name that may stand in a contact."""
        return frozenset(self._names) | {OBJECT}

    # -- what stands where -----------------------------------------------------------------------------------------

    def set_object(self, hulls: Sequence[Array]) -> None:
        """Replace the object by convex pieces; it is absent until placed or attached.

        Args:
            hulls: Vertices ``(k, 3)`` of each piece in the object frame [m]; ``ValueError`` for one without volume.
        """
        geometry = self._cell.copy()
        self._pieces = [int(geometry.addGeometryObject(_piece(k, hull))) for k, hull in enumerate(hulls)]
        pairs = self._cell_pairs + [(k, piece) for piece in self._pieces for k in range(self._cell.ngeoms)]
        for a, b in pairs:
            geometry.addCollisionPair(pin.CollisionPair(a, b))
        self._geometry = geometry
        self._names = [public_name(shape.name) for shape in geometry.geometryObjects]
        self._ends = np.array(pairs, dtype=np.intp).T
        self._pair_names = [frozenset((self._names[a], self._names[b])) for a, b in pairs]
        self._centres, self._halves = _local_boxes(geometry)
        self._mirror.set_object(OBJECT, [np.asarray(hull, dtype=np.float64) for hull in hulls])
        self._index()

    def _index(self) -> None:
        """Make the data and the broadphase of the present geometry; all later changes are made in place."""
        self._data, self._geometry_data = self._model.createData(), self._geometry.createData()
        for request in self._geometry_data.collisionRequests:
            request.enable_contact = False
            request.security_margin = self.margin
        self._broadphase = pin.BroadPhaseManager_NaiveCollisionManager(self._model, self._geometry, self._geometry_data)
        self._callback = pin.CollisionCallBackDefault(self._geometry, self._geometry_data, True)
        self._active = np.ones(len(self._pair_names), dtype=bool)
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
        self._mirror.place(None)
        self._activate()

    def _put(self, joint: int, T_joint_object: pin.SE3) -> None:
        for piece in self._pieces:
            self._geometry.geometryObjects[piece].parentJoint = joint
            self._geometry.geometryObjects[piece].placement = T_joint_object
        self._mirror.place((joint, T_joint_object))
        if not self._present:
            self._present = True
            self._activate()

    def set_fingers(self, side: Side, opening: float) -> None:
        """Set both fingers of a hand to an opening of one finger [m]; ``ValueError`` outside its travel."""
        travel = self.workcell.arm(side).gripper.finger_travel
        if not -1e-6 <= opening <= travel + 1e-6:
            raise ValueError(f"a {side} finger opens from 0 to {travel} m, not to {opening} m")
        self._q[self._fingers[side]] = opening

    def allow(self, pairs: Iterable[tuple[str, str]]) -> None:
        """Replace the set of pairs that may touch; ``UnknownName`` for a name nothing has."""
        wanted = frozenset(frozenset(pair) for pair in pairs)
        for name in sorted({name for pair in wanted for name in pair} - self.names):
            raise UnknownName("body", name, self.names)
        if wanted != self._allowed:
            self._allowed = wanted
            self._mirror.allow(wanted)
            self._activate()

    def _activate(self) -> None:
        """Bring Pinocchio's active pairs in line with the allowed ones and the object's presence."""
        data = self._geometry_data
        for k, names in enumerate(self._pair_names):
            active = names not in self._allowed and (self._present or OBJECT not in names)
            if active != self._active[k]:
                (data.activateCollisionPair if active else data.deactivateCollisionPair)(k)
                self._active[k] = active

    # -- queries ---------------------------------------------------------------------------------------------------

    def free(self, q: Array) -> bool:
        """Whether every active pair keeps more than the margin at ``q`` ``(14,)`` [rad]."""
        return not pin.computeCollisions(self._model, self._data, self._broadphase, self._callback, self._full(q))

    def motion(self, sides: Sequence[Side], q: Array) -> Motion:
        """Compiled checks of the arms on ``sides``, seven joints each in that order, while all else is as at ``q``.

        They know the world's present state: ask anew after a change. ``q`` is ``(14,)`` [rad].
        """
        slots = [slot for side in sides for slot in self._slots[side]]
        return self._mirror.motion(slots, self._full(q))

    def contact(self, q: Array) -> Contact | None:
        """The deepest contact at ``q`` ``(14,)`` [rad], or ``None`` when the configuration is free."""
        if self.free(q):
            return None
        # GJK stops within its tolerance, so a pair that collides may measure a hair more than the margin.
        distance, a, b = self._nearest(q, self.margin + 1e-4)
        return Contact(a, b, max(0.0, -distance))

    def clearance(self, q: Array) -> tuple[float, str, str]:
        """The smallest distance over active pairs at ``q`` ``(14,)`` [rad], and the names of that pair.

        The distance [m] is negative for penetration and at most ``REACH_CAP``, then with empty names.
        """
        return self._nearest(q, REACH_CAP)

    def _full(self, q: Array) -> Array:
        """Joint positions of the whole model, fingers included."""
        self._q[self._left] = q[:7]
        self._q[self._right] = q[7:]
        return self._q

    def _nearest(self, q: Array, cap: float) -> tuple[float, str, str]:
        """The smallest distance below ``cap``.

        The gap between two bounding boxes is a lower bound of the signed distance of what they hold, also when they
        overlap: the smallest overlap along an axis is a translation that separates them.
        """
        pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._geometry_data, self._full(q))
        gaps = np.where(self._active, self._gaps(), np.inf)
        best = (cap, "", "")
        for k in np.argsort(gaps, kind="stable").tolist():
            if gaps[k] >= best[0]:
                break
            distance = float(pin.computeDistance(self._geometry, self._geometry_data, k).min_distance)
            if distance < best[0]:
                a, b = self._ends[:, k]
                best = (distance, self._names[a], self._names[b])
        return best

    def _gaps(self) -> Array:
        """Gap between the world-aligned bounding boxes of every pair [m]; negative where they overlap."""
        poses = self._geometry_data.oMg.tolist()
        R = np.array([T.rotation for T in poses])
        middle = np.einsum("nij,nj->ni", R, self._centres) + np.array([T.translation for T in poses])
        reach = np.einsum("nij,nj->ni", np.abs(R), self._halves)
        a, b = self._ends
        gaps: Array = (np.abs(middle[a] - middle[b]) - reach[a] - reach[b]).max(axis=1)
        return gaps


def _cell_geometry(workcell: Workcell) -> tuple[pin.Model, pin.GeometryModel]:
    """Both arms with fingers as one model, their links as convex hulls, and the table and floor as boxes."""
    models, geometries = [], []
    for side in SIDES:
        path = str(arm_urdf_file(workcell, side))
        models.append(pin.buildModelFromUrdf(path))
        geometries.append(pin.buildGeomFromUrdf(models[-1], path, pin.GeometryType.COLLISION))
    model, geometry = pin.appendModel(models[0], models[1], geometries[0], geometries[1], 0, pin.SE3.Identity())
    geometry.removeAllCollisionPairs()
    for shape in geometry.geometryObjects:
        if hasattr(shape.geometry, "buildConvexHull"):
            shape.geometry.buildConvexHull(True, "Qt")
            shape.geometry = shape.geometry.convex
    table = workcell.table
    top = pose((*table.centre, table.top - table.thickness / 2))
    geometry.addGeometryObject(pin.GeometryObject(TABLE, 0, 0, top, coal.Box(*table.size, table.thickness)))
    ground = pose((0.0, 0.0, workcell.floor - FLOOR_DEPTH / 2))
    box = coal.Box(FLOOR_SIZE, FLOOR_SIZE, FLOOR_DEPTH)
    geometry.addGeometryObject(pin.GeometryObject(FLOOR, 0, 0, ground, box))
    for shape in geometry.geometryObjects:
        shape.geometry.computeLocalAABB()
    return model, geometry


def _piece(number: int, vertices: Array) -> pin.GeometryObject:
    """One convex piece of the object."""
    vertices = np.asarray(vertices, dtype=np.float64)
    if len(vertices) < 4 or np.linalg.svd(vertices - vertices.mean(axis=0), compute_uv=False)[-1] < FLAT:
        raise ValueError(f"piece {number} of the object has no volume: {len(vertices)} vertices in one plane")
    cloud = coal.StdVec_Vec3s()
    for vertex in vertices:
        cloud.append(vertex)
    hull = coal.Convex.convexHull(cloud, True, "Qt")
    hull.computeLocalAABB()
    return pin.GeometryObject(f"{OBJECT}_{number}", 0, 0, pin.SE3.Identity(), hull)


def _local_boxes(geometry: pin.GeometryModel) -> tuple[Array, Array]:
    """Centres and half extents ``(n, 3)`` [m] of every shape's bounding box in its own frame."""
    boxes = [shape.geometry.aabb_local for shape in geometry.geometryObjects]
    low, high = (np.array([getattr(box, end) for box in boxes]).reshape(-1, 3) for end in ("min_", "max_"))
    return (low + high) / 2, (high - low) / 2


def _hand(model: pin.Model, workcell: Workcell, side: Side) -> tuple[int, pin.SE3]:
    """The joint that carries a hand and the hand's pose on it."""
    frame = model.frames[model.getFrameId(f"{side}/{workcell.arm(side).gripper.hand_link}")]
    return int(frame.parentJoint), frame.placement.copy()


def _slots(model: pin.Model, side: Side, joints: Iterable[str]) -> list[int]:
    """Where joints stand in the model's joint positions."""
    return [int(model.joints[model.getJointId(f"{side}/{name}")].idx_q) for name in joints]


def _as_slice(slots: list[int]) -> slice | list[int]:
    """The slots as a slice where they follow each other: several times faster to assign to."""
    contiguous = slots == list(range(slots[0], slots[0] + len(slots)))
    return slice(slots[0], slots[0] + len(slots)) if contiguous else slots
