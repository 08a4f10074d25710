"""Where joints, spheres and axes are for sixteen configurations together."""

from __future__ import annotations

import numpy as np

from planners.compiled.jit import lanes
from planners.compiled.layout import JOINT_DEPTH, JOINT_KIND, JOINT_PARENT, JOINT_SLOT, LANES, REVOLUTE

_TWO_OVER_PI = 2.0 / np.pi
_HALF_PI_HIGH = 1.5707963267341256  # pi / 2 in two parts, the first with a short mantissa: products with it are exact
_HALF_PI_LOW = 6.077100506506192e-11


@lanes
def _turn(rot, pos, p, j, q, slot, joint_f):
    """Pose of a revolute joint from its parent's; sine and cosine by their series within a quarter turn."""
    f0, f1, f2, f3, f4, f5 = joint_f[j, 0], joint_f[j, 1], joint_f[j, 2], joint_f[j, 3], joint_f[j, 4], joint_f[j, 5]
    f6, f7, f8, t0, t1, t2 = joint_f[j, 6], joint_f[j, 7], joint_f[j, 8], joint_f[j, 9], joint_f[j, 10], joint_f[j, 11]
    for l in range(LANES):
        k = np.floor(q[slot, l] * _TWO_OVER_PI + 0.5)
        x = (q[slot, l] - k * _HALF_PI_HIGH) - k * _HALF_PI_LOW
        y = x * x
        s = -1 / 6 + y * (1 / 120 + y * (-1 / 5040 + y * (1 / 362880 + y * (-1 / 39916800 + y / 6227020800))))
        s = x + x * y * s
        c = 1 / 24 + y * (-1 / 720 + y * (1 / 40320 + y * (-1 / 3628800 + y * (1 / 479001600 - y / 87178291200))))
        c = 1.0 - 0.5 * y + y * y * c
        quarter = k - 4.0 * np.floor(0.25 * k)
        odd = quarter == 1.0 or quarter == 3.0
        sine, cosine = (c if odd else s), (s if odd else c)
        sine = -sine if quarter >= 2.0 else sine
        cosine = -cosine if quarter == 1.0 or quarter == 2.0 else cosine
        for i in range(3):
            a, b, d = rot[p, 3 * i, l], rot[p, 3 * i + 1, l], rot[p, 3 * i + 2, l]
            u = a * f0 + b * f3 + d * f6
            v = a * f1 + b * f4 + d * f7
            rot[j, 3 * i, l] = cosine * u + sine * v
            rot[j, 3 * i + 1, l] = cosine * v - sine * u
            rot[j, 3 * i + 2, l] = a * f2 + b * f5 + d * f8
            pos[j, i, l] = pos[p, i, l] + a * t0 + b * t1 + d * t2


@lanes
def _slide(rot, pos, p, j, q, slot, joint_f):
    """Pose of a prismatic joint from its parent's."""
    for i in range(3):
        for k in range(3):
            f0, f1, f2 = joint_f[j, k], joint_f[j, 3 + k], joint_f[j, 6 + k]
            for l in range(LANES):
                a, b, d = rot[p, 3 * i, l], rot[p, 3 * i + 1, l], rot[p, 3 * i + 2, l]
                rot[j, 3 * i + k, l] = a * f0 + b * f1 + d * f2
        t0, t1, t2 = joint_f[j, 9], joint_f[j, 10], joint_f[j, 11]
        for l in range(LANES):
            a, b, d = rot[p, 3 * i, l], rot[p, 3 * i + 1, l], rot[p, 3 * i + 2, l]
            pos[j, i, l] = pos[p, i, l] + a * t0 + b * t1 + d * t2 + q[slot, l] * rot[j, 3 * i + 2, l]


@lanes
def place_joints(joint_i, joint_f, q, rot, pos):
    """Poses of all joints at joint positions ``q`` ``(slots, 16)``."""
    for j in range(1, joint_i.shape[0]):
        parent, slot = joint_i[j, JOINT_PARENT], joint_i[j, JOINT_SLOT]
        if joint_i[j, JOINT_KIND] == REVOLUTE:
            _turn(rot, pos, parent, j, q, slot, joint_f)
        else:
            _slide(rot, pos, parent, j, q, slot, joint_f)


@lanes
def place_sphere(rot, pos, j, x, y, z, centre, s):
    """Where a point of a joint's frame is, to row ``s`` of ``centre`` ``(n, 3, 16)``."""
    for i in range(3):
        for l in range(LANES):
            value = rot[j, 3 * i, l] * x + rot[j, 3 * i + 1, l] * y + rot[j, 3 * i + 2, l] * z + pos[j, i, l]
            centre[s, i, l] = np.float32(value)


@lanes
def _sway(rot, pos, j, centre, s, bound, e, slot, reach, turns, beyond, sway, i):
    """Add what one joint can move a shape: its play times the furthest that a point can be from its axis.

    That distance is the one at the centre of the cell, plus how far the joints beyond can carry the point.
    """
    bound, reach = np.float32(bound), np.float32(reach)
    for l in range(LANES):
        x = centre[s, 0, l] - np.float32(pos[j, 0, l])
        y = centre[s, 1, l] - np.float32(pos[j, 1, l])
        z = centre[s, 2, l] - np.float32(pos[j, 2, l])
        a, b, c = np.float32(rot[j, 2, l]), np.float32(rot[j, 5, l]), np.float32(rot[j, 8, l])
        u, v, w = y * c - z * b, z * a - x * c, x * b - y * a
        play = np.float32(e[slot, l])
        arm = np.sqrt(u * u + v * v + w * w) + bound + beyond[l] if turns else np.float32(1.0)
        sway[s, i, l] = sway[s, i + 1, l] + play * arm
        beyond[l] += play * reach


@lanes
def place_sway(joint_i, chain, reach, joint, s, bound, e, rot, pos, centre, sway, beyond):
    """How far any point of a shape may be from where it is at the centre of the cell, by depth of the joint [m].

    Row ``i`` counts the joints from the ``i``-th of the shape's chain on, so row 0 is the motion in the world.
    """
    depth = joint_i[joint, JOINT_DEPTH]
    for l in range(LANES):
        sway[s, depth, l] = np.float32(0.0)
        beyond[l] = np.float32(0.0)
    for i in range(depth - 1, -1, -1):
        j = chain[joint, i]
        turns = joint_i[j, JOINT_KIND] == REVOLUTE
        far = reach[s, i] if turns else 1.0
        _sway(rot, pos, j, centre, s, bound, e, joint_i[j, JOINT_SLOT], far, turns, beyond, sway, i)
