"""Which column of the compiled tables holds what.

Numba passes an array in a fifth of a microsecond: few wide arrays are cheaper than many narrow ones.
"""

from __future__ import annotations

LANES = 16
"""Configurations that are looked at together."""

HULL, BOX, CYLINDER, POINT = 0, 1, 2, 3
"""Kinds of core."""

REVOLUTE, PRISMATIC, FIXED = 0, 1, 2
"""Kinds of joint; every axis is z of the joint's frame."""

JOINT_PARENT, JOINT_KIND, JOINT_SLOT, JOINT_DEPTH = 0, 1, 2, 3
"""Columns of ``joint_i``: parent joint, kind, place in the joint positions, number of movable joints up to it."""

SHAPE_JOINT, SHAPE_KIND, SHAPE_FIRST, SHAPE_LAST, FINE_FIRST, FINE_LAST = 0, 1, 2, 3, 4, 5
"""Columns of ``shape_i``: joint it rides on, kind, range of vertices, range of fine spheres."""

ROTATION, POSITION, PARAM, RADIUS, CENTRE, BOUND, BOX_ROTATION, BOX_POSITION, BOX_HALF = (
    0,
    9,
    12,
    15,
    16,
    19,
    20,
    29,
    32,
)
"""First columns of ``shape_f``: pose on the joint; half extents, or radius and half length; radius added; bounding
sphere in the joint frame; an oriented box that contains the shape, in the joint frame [m]."""

SHAPE_WIDTH = 35

PAIR_A, PAIR_B, PAIR_COMMON, PAIR_TABLE = 0, 1, 2, 3
"""Columns of ``pair_i``: two shapes, number of movable joints that carry both, number of a distance table or -1."""

GRID_FIRST, GRID_ROWS, GRID_COLUMNS, GRID_SLOT_A, GRID_SLOT_B = 0, 1, 2, 3, 4
"""Columns of ``grid_i``: place of the first value, sizes, and the places of both joints in the joint positions."""

FREE, UNSURE, HIT = 2, 1, 0
"""Verdicts: proven free; not proven either way; the shapes certainly touch at the centre."""
