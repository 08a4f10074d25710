"""Whether two convex shapes are further apart than a distance, with a direction that proves it.

A shape is the convex hull of its vertices, a box, a cylinder or a point, grown by a radius. The answer is a lower and
an upper bound of the distance of the cores: for any direction the gap between the two supporting planes is a lower
bound, whatever the iteration did to find it; the length of any vector of the Minkowski difference is an upper one.
Gilbert, Johnson and Keerthi, "A Fast Procedure for Computing the Distance Between Complex Objects in
Three-Dimensional Space", 1988.
"""

from __future__ import annotations

import numpy as np

from planners.compiled.jit import kernel, lanes
from planners.compiled.layout import BOX, CYLINDER, PARAM, POINT, SHAPE_FIRST, SHAPE_KIND, SHAPE_LAST

ITERATIONS = 40
"""Most support points asked for; three to eight are usual."""

CONVERGED = 1e-10
"""Relative gap between the squared bounds at which the iteration ends."""

INSIDE = 1e-24
"""Squared length below which the closest point is the origin itself [m^2]."""


@lanes
def highest(verts, first, last, x, y, z):
    """The largest product of a direction with vertices ``first .. last - 1``."""
    best = -np.inf
    for k in range(first, last):
        best = max(best, x * verts[0, k] + y * verts[1, k] + z * verts[2, k])
    return best


@kernel
def _support(shape_i, shape_f, verts, s, x, y, z, work, row):
    """Write the point of a shape that is furthest along a direction of its own frame to a row of ``work``."""
    kind = shape_i[s, SHAPE_KIND]
    if kind == BOX:
        work[row, 0] = shape_f[s, PARAM] if x >= 0.0 else -shape_f[s, PARAM]
        work[row, 1] = shape_f[s, PARAM + 1] if y >= 0.0 else -shape_f[s, PARAM + 1]
        work[row, 2] = shape_f[s, PARAM + 2] if z >= 0.0 else -shape_f[s, PARAM + 2]
    elif kind == CYLINDER:
        flat = np.sqrt(x * x + y * y)
        scale = shape_f[s, PARAM] / flat if flat > 0.0 else 0.0
        work[row, 0], work[row, 1] = scale * x, scale * y
        work[row, 2] = shape_f[s, PARAM + 1] if z >= 0.0 else -shape_f[s, PARAM + 1]
    elif kind == POINT:
        work[row, 0] = work[row, 1] = work[row, 2] = 0.0
    else:
        first, last = shape_i[s, SHAPE_FIRST], shape_i[s, SHAPE_LAST]
        best, at = -np.inf, first
        for k in range(first, last):
            value = x * verts[0, k] + y * verts[1, k] + z * verts[2, k]
            if value > best:
                best, at = value, k
        work[row, 0], work[row, 1], work[row, 2] = verts[0, at], verts[1, at], verts[2, at]


@kernel
def _extent(shape_i, shape_f, verts, s, x, y, z):
    """The largest product of a direction of a shape's own frame with its points."""
    kind = shape_i[s, SHAPE_KIND]
    if kind == BOX:
        return abs(x) * shape_f[s, PARAM] + abs(y) * shape_f[s, PARAM + 1] + abs(z) * shape_f[s, PARAM + 2]
    if kind == CYLINDER:
        return np.sqrt(x * x + y * y) * shape_f[s, PARAM] + abs(z) * shape_f[s, PARAM + 1]
    if kind == POINT:
        return 0.0
    return highest(verts, shape_i[s, SHAPE_FIRST], shape_i[s, SHAPE_LAST], x, y, z)


@kernel
def gap_along(shape_i, shape_f, verts, a, b, x, y, z, work):
    """Lower bound of the distance of two cores [m]: the gap between planes whose unit normal points from b to a.

    The direction is in the frame of a; rows 12 to 15 of ``work`` hold the pose of b in that frame.
    """
    low = -_extent(shape_i, shape_f, verts, a, -x, -y, -z)
    bx = work[12, 0] * x + work[13, 0] * y + work[14, 0] * z
    by = work[12, 1] * x + work[13, 1] * y + work[14, 1] * z
    bz = work[12, 2] * x + work[13, 2] * y + work[14, 2] * z
    high = _extent(shape_i, shape_f, verts, b, bx, by, bz) + x * work[15, 0] + y * work[15, 1] + z * work[15, 2]
    return low - high


@kernel
def separate(shape_i, shape_f, verts, a, b, axis, pair, enough, little, work):
    """Lower and upper bound of the distance of two cores [m].

    Ends as soon as the lower one exceeds ``enough`` or the upper one falls below ``little``. A negative upper bound
    means that the cores overlap.

    Args:
        shape_i, shape_f, verts: The shapes.
        a: One shape.
        b: The other.
        axis: ``(pairs, 3)`` unit directions from b to a in the frame of a.
        pair: Which of them is tried first; the best one found on return.
        enough: See above [m].
        little: See above [m].
        work: Scratch ``(16, 3)``; rows 12 to 15 hold the rotation and position of b in the frame of a.
    """
    lower = gap_along(shape_i, shape_f, verts, a, b, axis[pair, 0], axis[pair, 1], axis[pair, 2], work)
    if lower > enough:
        return lower, np.inf
    size, upper = 0, np.inf
    x, y, z = axis[pair, 0], axis[pair, 1], axis[pair, 2]
    square = 1.0
    for _ in range(ITERATIONS):
        _difference(shape_i, shape_f, verts, a, b, x, y, z, work)
        along = x * work[4, 0] + y * work[4, 1] + z * work[4, 2]
        length = np.sqrt(square)
        if along / length > lower:
            lower = along / length
            axis[pair, 0], axis[pair, 1], axis[pair, 2] = x / length, y / length, z / length
            if lower > enough:
                return lower, upper
        if size and square - along <= CONVERGED * square:
            return lower, upper
        for k in range(size):
            if work[k, 0] == work[4, 0] and work[k, 1] == work[4, 1] and work[k, 2] == work[4, 2]:
                return lower, upper
        work[size, 0], work[size, 1], work[size, 2] = work[4, 0], work[4, 1], work[4, 2]
        size = _reduce(work, size + 1)
        x, y, z = work[5, 0], work[5, 1], work[5, 2]
        square = x * x + y * y + z * z
        if size == 4 or square < INSIDE:
            return lower, -1.0
        upper = np.sqrt(square)
        if upper < little:
            return lower, upper
    return lower, upper


@kernel
def _difference(shape_i, shape_f, verts, a, b, x, y, z, work):
    """Write the point of the Minkowski difference that is furthest against a direction to row 4."""
    _support(shape_i, shape_f, verts, a, -x, -y, -z, work, 4)
    bx = work[12, 0] * x + work[13, 0] * y + work[14, 0] * z
    by = work[12, 1] * x + work[13, 1] * y + work[14, 1] * z
    bz = work[12, 2] * x + work[13, 2] * y + work[14, 2] * z
    _support(shape_i, shape_f, verts, b, bx, by, bz, work, 5)
    x, y, z = work[5, 0], work[5, 1], work[5, 2]
    for i in range(3):
        work[4, i] -= work[12 + i, 0] * x + work[12 + i, 1] * y + work[12 + i, 2] * z + work[15, i]


@kernel
def _flat(work, base, size):
    """Shrink a point, segment or triangle in rows ``base ..`` to what carries its point closest to the origin.

    The point goes to row ``base + 5``. Returns the new size. A triangle's own point is the closest one where the origin
    is on the inner side of all three edges; else the closest one is on an edge that the origin is outside of.
    """
    nx = ny = nz = square = 0.0
    if size == 3:
        ux, uy, uz = _minus(work, base + 1, base)
        vx, vy, vz = _minus(work, base + 2, base)
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        square = nx * nx + ny * ny + nz * nz
    best, first, second, place = np.inf, base, base, 0.0
    for k in range(3 if size == 3 else size - 1):
        i, j = base + k, base + (k + 1) % size
        x, y, z = work[i, 0], work[i, 1], work[i, 2]
        ex, ey, ez = _minus(work, j, i)
        if square > 0.0:
            side = (ez * y - ey * z) * nx + (ex * z - ez * x) * ny + (ey * x - ex * y) * nz
            if side > 0.0:
                continue
        span = ex * ex + ey * ey + ez * ez
        share = min(1.0, max(0.0, -(x * ex + y * ey + z * ez) / span)) if span > 0.0 else 0.0
        px, py, pz = x + share * ex, y + share * ey, z + share * ez
        distance = px * px + py * py + pz * pz
        if distance < best:
            best, first, second, place = distance, i, j, share
    if size == 3 and best == np.inf:
        height = (work[base, 0] * nx + work[base, 1] * ny + work[base, 2] * nz) / square
        work[base + 5, 0], work[base + 5, 1], work[base + 5, 2] = height * nx, height * ny, height * nz
        return 3
    for c in range(3):
        p, q = work[first, c], work[second, c]
        work[base + 5, c] = p + place * (q - p)
        work[base, c] = q if place >= 1.0 else p
        work[base + 1, c] = q
    return 1 if place <= 0.0 or place >= 1.0 else 2


@kernel
def _minus(work, i, j):
    return work[i, 0] - work[j, 0], work[i, 1] - work[j, 1], work[i, 2] - work[j, 2]


@kernel
def _reduce(work, size):
    """Shrink the simplex in rows ``0 .. size - 1`` to what carries its point closest to the origin.

    The point goes to row 5. Returns the new size; 4 when the origin is inside. Of a tetrahedron, the closest point is
    the best one of the faces that the origin is outside of.
    """
    if size < 4:
        return _flat(work, 0, size)
    best, which = np.inf, -1
    for turn in range(5):
        if turn == 4 and which < 0:
            return 4
        face = which if turn == 4 else turn
        i, j, k = (face + 1) % 4, (face + 2) % 4, (face + 3) % 4
        ux, uy, uz = _minus(work, j, i)
        vx, vy, vz = _minus(work, k, i)
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        at = nx * work[i, 0] + ny * work[i, 1] + nz * work[i, 2]
        opposite = nx * work[face, 0] + ny * work[face, 1] + nz * work[face, 2] - at
        if at * opposite > 0.0 or opposite == 0.0:  # the origin is not on the inner side
            for c in range(3):
                work[6, c], work[7, c], work[8, c] = work[i, c], work[j, c], work[k, c]
            kept = _flat(work, 6, 3)
            distance = work[11, 0] * work[11, 0] + work[11, 1] * work[11, 1] + work[11, 2] * work[11, 2]
            if turn == 4:
                for c in range(3):
                    work[0, c], work[1, c], work[2, c] = work[6, c], work[7, c], work[8, c]
                    work[5, c] = work[11, c]
                return kept
            if distance < best:
                best, which = distance, face
    return 4
