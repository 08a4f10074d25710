"""Which pairs of bodies in the cell can collide at all."""

from __future__ import annotations

import pinocchio as pin

FLOOR = "floor"

APART = frozenset(
    frozenset((f"panda_{a}", f"panda_{b}"))
    for a, others in {
        "link0": ("link2", "link3", "link4"),
        "link1": ("link3", "link4"),
        "link2": ("link4",),
        "link3": ("link5", "link6", "link7", "hand", "leftfinger", "rightfinger"),
        "link4": ("link6", "link7", "hand", "leftfinger", "rightfinger"),
        "link6": ("leftfinger", "rightfinger"),
    }.items()
    for b in others
)
"""Links of one Panda that cannot meet within its joint limits: over 30 000 random configurations, a quarter of them
with joints at their limits, the hulls of each pair stay 32 mm or more apart. Leaving them out saves a fifth of the time
of a free state."""


def public_name(shape: str) -> str:
    """A shape's link name: Pinocchio appends a number to it."""
    stem, _, number = shape.rpartition("_")
    return stem if number.isdigit() and stem else shape


def cell_pairs(model: pin.Model, geometry: pin.GeometryModel) -> list[tuple[int, int]]:
    """Pairs among arms, table and floor that can mean something.

    Left out: links of one arm that ride on the same joint or on joints that follow each other, and the fingers of one
    hand (hulls of these overlap by construction); links that cannot meet (``APART``); what never moves with what never
    moves (bases stand on or beside the table by design); and the floor with a link that only turns upon its own base.
    """
    shapes = [(public_name(shape.name), int(shape.parentJoint)) for shape in geometry.geometryObjects]
    parents = [int(parent) for parent in model.parents]
    pairs = []
    for b, (name_b, jb) in enumerate(shapes):
        for a, (name_a, ja) in enumerate(shapes[:b]):
            side_a, side_b = name_a.partition("/")[0], name_b.partition("/")[0]
            links = frozenset((name_a.partition("/")[2], name_b.partition("/")[2]))
            joined = ja == jb or parents[ja] == jb or parents[jb] == ja or (parents[ja] == parents[jb] != 0)
            fixed = ja == jb == 0
            based = FLOOR in (name_a, name_b) and parents[max(ja, jb)] == 0
            if not (fixed or based or (side_a == side_b and (joined or links in APART))):
                pairs.append((a, b))
    return pairs
