"""Which pairs of bodies in the cell can collide at all."""

from __future__ import annotations

import pinocchio as pin

from planners.meetings import decided
from robots.workcell import SIDES

FLOOR = "floor"


def public_name(shape: str) -> str:
    """A shape's link name: Pinocchio appends a number to it."""
    stem, _, number = shape.rpartition("_")
    return stem if number.isdigit() and stem else shape


def cell_pairs(model: pin.Model, geometry: pin.GeometryModel) -> list[tuple[int, int]]:
    """Pairs among arms, table and floor that can mean something.

    Left out: links of one arm that ride on the same joint or on joints that follow each other, and the fingers of one
    hand (hulls of these overlap by construction); links of one arm that cannot meet or cannot part, as ``meetings``
    finds for its kind of arm; what never moves with what never moves (bases stand on or beside the table by design);
    and the floor with a link that only turns upon its own base.
    """
    shapes = [(public_name(shape.name), int(shape.parentJoint)) for shape in geometry.geometryObjects]
    parents = [int(parent) for parent in model.parents]
    pairs = []
    for b, (name_b, jb) in enumerate(shapes):
        for a, (name_a, ja) in enumerate(shapes[:b]):
            side_a, side_b = _side(name_a), _side(name_b)
            joined = ja == jb or parents[ja] == jb or parents[jb] == ja or (parents[ja] == parents[jb] != 0)
            fixed = ja == jb == 0
            based = FLOOR in (name_a, name_b) and parents[max(ja, jb)] == 0
            if not (fixed or based or (side_a == side_b and joined)):
                pairs.append((a, b))
    own = {side: [p for p in pairs if side == _side(shapes[p[0]][0]) == _side(shapes[p[1]][0])] for side in SIDES}
    settled = {pair for side in SIDES for pair in decided(model, geometry, side, own[side])}
    return [pair for pair in pairs if pair not in settled]


def _side(name: str) -> str:
    return name.partition("/")[0]
