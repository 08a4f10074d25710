"""Whether one arm with its exact meshes touches primitives: Pinocchio's plain loop over pairs, without any filter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin

from planners.collision import Contact
from planners.compiled import layout as at
from planners.compiled.tables import Shape
from planners.pairs import public_name
from robots.errors import BadInput, UnknownName
from robots.spatial import Array


@dataclass(frozen=True, slots=True, eq=False)
class MeshRobot:
    """One arm as Pinocchio sees it.

    Attributes:
        model: Its joints.
        geometry: Its collision meshes.
        pairs: Numbers of its shapes that can meet.
        fixed: Numbers of its shapes that never move; they are not checked against obstacles, which do not move either.
    """

    model: pin.Model
    geometry: pin.GeometryModel
    pairs: tuple[tuple[int, int], ...]
    fixed: frozenset[int]


def load_robot(urdf_file: str, named_pairs: Sequence[tuple[str, str]]) -> MeshRobot:
    """The robot of a URDF file.

    Raises:
        UnknownName: A pair names a link without a collision shape.
    """
    model = pin.buildModelFromUrdf(urdf_file)
    geometry = pin.buildGeomFromUrdf(model, urdf_file, pin.GeometryType.COLLISION)
    numbers = {public_name(shape.name): k for k, shape in enumerate(geometry.geometryObjects)}
    for name in (name for pair in named_pairs for name in pair):
        if name not in numbers:
            raise UnknownName("link", name, numbers)
    fixed = frozenset(k for k, shape in enumerate(geometry.geometryObjects) if shape.parentJoint == 0)
    pairs = tuple((numbers[a], numbers[b]) for a, b in named_pairs)
    return MeshRobot(model, geometry, pairs, fixed)


class MeshWorld:
    """A robot among obstacles; joint positions are ``(model.nq,)`` [rad]."""

    def __init__(self, robot: MeshRobot, obstacles: Sequence[Shape]) -> None:
        self._model = robot.model
        self._geometry = robot.geometry.copy()
        links = self._geometry.ngeoms
        for obstacle in obstacles:
            placed = pin.GeometryObject(obstacle.name, 0, 0, obstacle.T_joint_shape, _solid(obstacle))
            self._geometry.addGeometryObject(placed)
        meeting = [(k, links + m) for k in range(links) if k not in robot.fixed for m in range(len(obstacles))]
        for a, b in (*robot.pairs, *meeting):
            self._geometry.addCollisionPair(pin.CollisionPair(a, b))
        self._data, self._geometry_data = self._model.createData(), self._geometry.createData()
        for request in self._geometry_data.collisionRequests:
            request.enable_contact = False

    def free(self, q: Array) -> bool:
        """Whether nothing touches at ``q``."""
        return not pin.computeCollisions(self._model, self._data, self._geometry, self._geometry_data, q, True)

    def contact(self, q: Array) -> Contact | None:
        """The first pair that touches at ``q``, with the depth of its penetration, or ``None``."""
        if self.free(q):
            return None
        for k, result in enumerate(self._geometry_data.collisionResults):
            if result.isCollision():
                distance = float(pin.computeDistance(self._geometry, self._geometry_data, k).min_distance)
                pair = self._geometry.collisionPairs[k]
                names = [self._geometry.geometryObjects[int(n)].name for n in (pair.first, pair.second)]
                return Contact(public_name(names[0]), names[1], max(0.0, -distance))
        return None


def _solid(shape: Shape) -> object:
    """A primitive as Coal's shape."""
    size = np.ravel(shape.size)
    if shape.kind == at.BOX:
        return coal.Box(*(2.0 * size).tolist())
    if shape.kind == at.CYLINDER:
        return coal.Cylinder(float(size[0]), 2.0 * float(size[1]))
    if shape.kind == at.POINT:
        return coal.Sphere(shape.radius)
    raise BadInput(f"The obstacle {shape.name} is no box, cylinder or sphere.")
