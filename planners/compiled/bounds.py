"""How far spheres are from each other and from what stands in the world, for sixteen configurations.

Every sphere has two radii: the larger one, ``less``, contains its part of a shape, so that its gap is a lower bound of
the distance; the smaller one, ``core``, lies inside the shape, so that where it overlaps the shapes certainly touch.
"""

from __future__ import annotations

import numpy as np

from planners.compiled.jit import lanes, part
from planners.compiled.layout import (
    BOX_HALF,
    BOX_POSITION,
    BOX_ROTATION,
    CYLINDER,
    LANES,
    PARAM,
    POINT,
    POSITION,
    RADIUS,
    ROTATION,
)


@lanes
def _to_box(centre, s, shape_f, b, less, core, gap, deep):
    """Distance of a sphere's centres from the oriented box of a shape, less a radius."""
    R, t, h = BOX_ROTATION, BOX_POSITION, BOX_HALF
    r0, r1, r2 = np.float32(shape_f[b, R]), np.float32(shape_f[b, R + 1]), np.float32(shape_f[b, R + 2])
    r3, r4, r5 = np.float32(shape_f[b, R + 3]), np.float32(shape_f[b, R + 4]), np.float32(shape_f[b, R + 5])
    r6, r7, r8 = np.float32(shape_f[b, R + 6]), np.float32(shape_f[b, R + 7]), np.float32(shape_f[b, R + 8])
    t0, t1, t2 = np.float32(shape_f[b, t]), np.float32(shape_f[b, t + 1]), np.float32(shape_f[b, t + 2])
    h0, h1, h2 = np.float32(shape_f[b, h]), np.float32(shape_f[b, h + 1]), np.float32(shape_f[b, h + 2])
    less, core, zero = np.float32(less), np.float32(core), np.float32(0.0)
    for l in range(LANES):
        x, y, z = centre[s, 0, l] - t0, centre[s, 1, l] - t1, centre[s, 2, l] - t2
        u = abs(r0 * x + r3 * y + r6 * z) - h0
        v = abs(r1 * x + r4 * y + r7 * z) - h1
        w = abs(r2 * x + r5 * y + r8 * z) - h2
        p, q, r = max(u, zero), max(v, zero), max(w, zero)
        far = np.sqrt(p * p + q * q + r * r) + min(max(u, max(v, w)), zero)
        gap[l] = min(gap[l], far - less)
        deep[l] = min(deep[l], far - core)


@lanes
def _to_cylinder(centre, s, shape_f, b, less, core, gap, deep):
    """Distance of a sphere's centres from a cylinder, less a radius."""
    t, R = POSITION, ROTATION
    t0, t1, t2 = np.float32(shape_f[b, t]), np.float32(shape_f[b, t + 1]), np.float32(shape_f[b, t + 2])
    z0, z1, z2 = np.float32(shape_f[b, R + 2]), np.float32(shape_f[b, R + 5]), np.float32(shape_f[b, R + 8])
    radius, half = np.float32(shape_f[b, PARAM]), np.float32(shape_f[b, PARAM + 1])
    less, core = np.float32(less + shape_f[b, RADIUS]), np.float32(core + shape_f[b, RADIUS])
    zero = np.float32(0.0)
    for l in range(LANES):
        x, y, z = centre[s, 0, l] - t0, centre[s, 1, l] - t1, centre[s, 2, l] - t2
        along = x * z0 + y * z1 + z * z2
        u, v, w = y * z2 - z * z1, z * z0 - x * z2, x * z1 - y * z0
        side = np.sqrt(u * u + v * v + w * w) - radius
        end = abs(along) - half
        p, q = max(side, zero), max(end, zero)
        far = np.sqrt(p * p + q * q) + min(max(side, end), zero)
        gap[l] = min(gap[l], far - less)
        deep[l] = min(deep[l], far - core)


@lanes
def _to_point(centre, s, shape_f, b, less, core, gap, deep):
    """Distance of a sphere's centres from a sphere of the world, less a radius."""
    t = POSITION
    t0, t1, t2 = np.float32(shape_f[b, t]), np.float32(shape_f[b, t + 1]), np.float32(shape_f[b, t + 2])
    less, core = np.float32(less + shape_f[b, RADIUS]), np.float32(core + shape_f[b, RADIUS])
    for l in range(LANES):
        x, y, z = centre[s, 0, l] - t0, centre[s, 1, l] - t1, centre[s, 2, l] - t2
        far = np.sqrt(x * x + y * y + z * z)
        gap[l] = min(gap[l], far - less)
        deep[l] = min(deep[l], far - core)


@lanes
def to_sphere(centre, s, o, less, core, gap, deep):
    """Lower every gap to the distance between two spheres' centres, less the radii."""
    less, core = np.float32(less), np.float32(core)
    for l in range(LANES):
        x = centre[s, 0, l] - centre[o, 0, l]
        y = centre[s, 1, l] - centre[o, 1, l]
        z = centre[s, 2, l] - centre[o, 2, l]
        far = np.sqrt(x * x + y * y + z * z)
        gap[l] = min(gap[l], far - less)
        deep[l] = min(deep[l], far - core)


@lanes
def to_world(kind, shape_f, b, centre, s, less, core, gap, deep):
    """Lower every gap to the distance of a sphere from a shape of the world."""
    if kind == CYLINDER:
        _to_cylinder(centre, s, shape_f, b, less, core, gap, deep)
    elif kind == POINT:
        _to_point(centre, s, shape_f, b, less, core, gap, deep)
    else:
        _to_box(centre, s, shape_f, b, less, core, gap, deep)


@part
def near(centre, grown, a, b, bar):
    """In how many lanes two bounding spheres, grown by all that may move, are within ``bar``: the first test of a pair.

    It asks for neither square root nor kind of shape nor drift, and leaves a few pairs in a hundred to the others.
    """
    close = np.int32(0)
    for l in range(LANES):
        x = centre[a, 0, l] - centre[b, 0, l]
        y = centre[a, 1, l] - centre[b, 1, l]
        z = centre[a, 2, l] - centre[b, 2, l]
        r = grown[a, l] + grown[b, l] + bar
        close += np.int32(x * x + y * y + z * z <= r * r)
    return close


@lanes
def grow(grown, s, bound, sway, still):
    """Write the radius of a shape's bounding sphere, grown by what the shape may move in the world."""
    bound = np.float32(bound)
    for l in range(LANES):
        grown[s, l] = bound if still else bound + sway[s, 0, l]


@part
def nearest_world(kind, shape_s, b, centre, s, less, drift, bar):
    """In how many lanes the gap between a bounding sphere and a shape of the world, less the drift, is within ``bar``.

    ``shape_s`` is ``shape_f`` in single precision. Counts become vector instructions where minima do not.
    """
    close = np.int32(0)
    zero = np.float32(0.0)
    if kind in (CYLINDER, POINT):
        t0, t1, t2 = shape_s[b, POSITION], shape_s[b, POSITION + 1], shape_s[b, POSITION + 2]
        z0, z1, z2 = shape_s[b, ROTATION + 2], shape_s[b, ROTATION + 5], shape_s[b, ROTATION + 8]
        radius, half, grown = shape_s[b, PARAM], shape_s[b, PARAM + 1], less + shape_s[b, RADIUS]
        for l in range(LANES):
            x, y, z = centre[s, 0, l] - t0, centre[s, 1, l] - t1, centre[s, 2, l] - t2
            along = x * z0 + y * z1 + z * z2
            p = max(np.sqrt(max(x * x + y * y + z * z - along * along, zero)) - radius, zero)
            q = max(abs(along) - half, zero)
            close += np.int32(np.sqrt(p * p + q * q) - grown - drift[l] <= bar)
    else:
        R, t, h = BOX_ROTATION, BOX_POSITION, BOX_HALF
        r0, r1, r2, r3, r4 = shape_s[b, R], shape_s[b, R + 1], shape_s[b, R + 2], shape_s[b, R + 3], shape_s[b, R + 4]
        r5, r6, r7, r8 = shape_s[b, R + 5], shape_s[b, R + 6], shape_s[b, R + 7], shape_s[b, R + 8]
        t0, t1, t2 = shape_s[b, t], shape_s[b, t + 1], shape_s[b, t + 2]
        h0, h1, h2 = shape_s[b, h], shape_s[b, h + 1], shape_s[b, h + 2]
        for l in range(LANES):
            x, y, z = centre[s, 0, l] - t0, centre[s, 1, l] - t1, centre[s, 2, l] - t2
            u = max(abs(r0 * x + r3 * y + r6 * z) - h0, zero)
            v = max(abs(r1 * x + r4 * y + r7 * z) - h1, zero)
            w = max(abs(r2 * x + r5 * y + r8 * z) - h2, zero)
            close += np.int32(np.sqrt(u * u + v * v + w * w) - less - drift[l] <= bar)
    return close


@part
def nearest_sphere(centre, s, o, less, drift, bar):
    """In how many lanes the gap between two bounding spheres, less the drift, is within ``bar``."""
    close = np.int32(0)
    for l in range(LANES):
        x = centre[s, 0, l] - centre[o, 0, l]
        y = centre[s, 1, l] - centre[o, 1, l]
        z = centre[s, 2, l] - centre[o, 2, l]
        close += np.int32(np.sqrt(x * x + y * y + z * z) - less - drift[l] <= bar)
    return close


@lanes
def widen(gap, deep):
    """Forget the gaps."""
    for l in range(LANES):
        gap[l] = deep[l] = np.float32(np.inf)


@lanes
def below(values, bar):
    """In how many lanes a value is below ``bar``."""
    found = np.int32(0)
    for l in range(LANES):
        found += np.int32(values[l] < bar)
    return found


@lanes
def take(gap, drift, bar):
    """Take the drift from every gap; in how many lanes it is then within ``bar``."""
    found = np.int32(0)
    for l in range(LANES):
        gap[l] -= drift[l]
        found += np.int32(gap[l] <= bar)
    return found


@part
def drift_of(sway, a, b, fixed, common, slack, drift):
    """How far two shapes may come closer inside the cells, less the slack [m]."""
    slack, zero = np.float32(slack), np.float32(0.0)
    if fixed:
        for l in range(LANES):
            drift[l] = max(zero, sway[a, 0, l] - slack)
    else:
        for l in range(LANES):
            drift[l] = max(zero, sway[a, common, l] + sway[b, common, l] - slack)
