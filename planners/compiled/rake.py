"""Whether sixteen cells of joint space are free: spheres first, then separating axes for what they leave open.

A cell is a configuration and how far each joint may be from it. It is proven free when, at its centre, every pair of
shapes is further apart than the margin plus all that the cell's motion can take from it.
"""

from __future__ import annotations

import numpy as np

from planners.compiled.bounds import (
    below,
    drift_of,
    grow,
    near,
    nearest_sphere,
    nearest_world,
    take,
    to_sphere,
    to_world,
    widen,
)
from planners.compiled.jit import kernel, lanes, part
from planners.compiled.kinematics import place_joints, place_sphere, place_sway
from planners.compiled.layout import (
    BOUND,
    CENTRE,
    FINE_FIRST,
    FINE_LAST,
    FREE,
    GRID_COLUMNS,
    GRID_FIRST,
    GRID_ROWS,
    GRID_SLOT_A,
    GRID_SLOT_B,
    HIT,
    HULL,
    LANES,
    PAIR_A,
    PAIR_B,
    PAIR_COMMON,
    PAIR_TABLE,
    POSITION,
    RADIUS,
    ROTATION,
    SHAPE_JOINT,
    SHAPE_KIND,
    UNSURE,
)
from planners.compiled.narrow import separate

SINGLE_PAD = 1e-5
"""Added to every gap between spheres [m]: single precision errs by a few 1e-7 of coordinates of up to ten metres."""

DOUBLE_PAD = 1e-5
"""Added to every gap between separating planes [m]. These are exact to 1e-12; but Coal calls bodies a millionth of a
metre apart a collision, and nothing that Coal calls a collision may be called free."""


@kernel
def relative(shape_i, shape_f, rot, pos, narrow, a, b, l):
    """Write the pose of shape b in the frame of shape a, in one lane, to rows 12 to 15 of ``narrow``."""
    ja, jb = shape_i[a, SHAPE_JOINT], shape_i[b, SHAPE_JOINT]
    for i in range(3):
        for k in range(3):
            u = v = 0.0
            for m in range(3):
                u += rot[ja, 3 * i + m, l] * shape_f[a, ROTATION + 3 * m + k]
                v += rot[jb, 3 * i + m, l] * shape_f[b, ROTATION + 3 * m + k]
            narrow[i, k], narrow[3 + i, k] = u, v
        d = pos[jb, i, l] - pos[ja, i, l]
        for m in range(3):
            d += rot[jb, 3 * i + m, l] * shape_f[b, POSITION + m] - rot[ja, 3 * i + m, l] * shape_f[a, POSITION + m]
        narrow[6, i] = d
    for i in range(3):
        x, y, z = narrow[0, i], narrow[1, i], narrow[2, i]
        narrow[15, i] = x * narrow[6, 0] + y * narrow[6, 1] + z * narrow[6, 2]
        for k in range(3):
            narrow[12 + i, k] = x * narrow[3, k] + y * narrow[4, k] + z * narrow[5, k]


@kernel
def start_axis(axis, pair, narrow):
    """Begin with the direction between the origins where no direction is known yet."""
    if axis[pair, 0] != 0.0 or axis[pair, 1] != 0.0 or axis[pair, 2] != 0.0:
        return
    x, y, z = -narrow[15, 0], -narrow[15, 1], -narrow[15, 2]
    length = np.sqrt(x * x + y * y + z * z)
    if length > 0.0:
        axis[pair, 0], axis[pair, 1], axis[pair, 2] = x / length, y / length, z / length
    else:
        axis[pair, 2] = 1.0


@part
def _exact(shape_i, shape_f, verts, rot, pos, narrow, axis, pair, a, b, l, drift, margin):
    """The verdict on one pair in one lane."""
    relative(shape_i, shape_f, rot, pos, narrow, a, b, l)
    start_axis(axis, pair, narrow)
    grown = margin + shape_f[a, RADIUS] + shape_f[b, RADIUS]
    enough = grown + drift + DOUBLE_PAD
    lower, upper = separate(shape_i, shape_f, verts, a, b, axis, pair, enough, grown - DOUBLE_PAD, narrow)
    if lower > enough:
        return FREE
    return HIT if upper < grown - DOUBLE_PAD else UNSURE


@lanes
def _look_up(grid_i, grid_f, grid, number, q, gap):
    """The gaps that a distance table knows; nothing is known outside of it."""
    rows, columns = grid_i[number, GRID_ROWS], grid_i[number, GRID_COLUMNS]
    first, a, b = grid_i[number, GRID_FIRST], grid_i[number, GRID_SLOT_A], grid_i[number, GRID_SLOT_B]
    for l in range(LANES):
        i = int(np.floor((q[a, l] - grid_f[number, 0]) * grid_f[number, 1]))
        k = int(np.floor((q[b, l] - grid_f[number, 2]) * grid_f[number, 3]))
        inside = 0 <= i < rows and 0 <= k < columns
        gap[l] = grid[first + i * columns + k] if inside else -np.float32(np.inf)


@part
def _spheres_prove(
    shape_i, shape_f, shape_s, fine, rot, pos, centre, spheres, known, a, b, ja, jb, drift, gap, deep, bar
):
    """Whether spheres alone prove a pair apart in every lane; the gaps stay in ``gap`` and ``deep``."""
    fixed, kind = jb == 0, shape_i[b, SHAPE_KIND]
    if fixed:
        if nearest_world(kind, shape_s, b, centre, a, shape_s[a, BOUND], drift, bar) == 0:
            return True
    elif nearest_sphere(centre, a, b, shape_s[a, BOUND] + shape_s[b, BOUND], drift, bar) == 0:
        return True
    widen(gap, deep)
    a0, a1 = shape_i[a, FINE_FIRST], shape_i[a, FINE_LAST]
    b0, b1 = shape_i[b, FINE_FIRST], shape_i[b, FINE_LAST]
    for turn in range(1 if fixed else 2):
        s, j, k0, k1 = (a, ja, a0, a1) if turn == 0 else (b, jb, b0, b1)
        if not known[s, 1]:
            known[s, 1] = 1
            for k in range(k0, k1):
                place_sphere(rot, pos, j, fine[0, k], fine[1, k], fine[2, k], spheres, k)
    for k in range(a0, a1):
        if fixed:
            to_world(kind, shape_f, b, spheres, k, fine[3, k], fine[4, k], gap, deep)
        else:
            for m in range(b0, b1):
                to_sphere(spheres, k, m, fine[3, k] + fine[3, m], fine[4, k] + fine[4, m], gap, deep)
    return take(gap, drift, bar) == 0


@kernel
def _touched(deep, bar, verdict):
    """Mark the lanes in which spheres inside both shapes overlap; whether there is one."""
    if below(deep, bar) == 0:
        return False
    for l in range(LANES):
        if deep[l] < bar:
            verdict[l] = HIT
    return True


@kernel
def _first(order, n):
    """Move one pair to the front: what touched once often touches again."""
    pair = order[n]
    for k in range(n, 0, -1):
        order[k] = order[k - 1]
    order[0] = pair


@lanes
def rake(tables, work, pairs, still, margin, slack, stop):
    """Judge the sixteen cells in ``work.q`` and ``work.e``; verdicts go to ``work.verdict``.

    Args:
        tables: The cell.
        work: Scratch.
        pairs: How many pairs of ``work.order`` to look at, from its beginning.
        still: The cells are points.
        margin: Distance to keep [m].
        slack: How much of it may be lost inside a cell [m].
        stop: Return at the first certain contact.

    Returns:
        Whether a certain contact was found; with ``stop`` its pair is then the first of ``work.order``.
    """
    joint_i, joint_f, chain, reach, shape_i, shape_f, verts, fine, pair_i, grid_i, grid_f, grid = tables
    (
        q,
        e,
        rot,
        pos,
        centre,
        grown,
        sway,
        spheres,
        known,
        drift,
        gap,
        deep,
        axis,
        narrow,
        order,
        left,
        verdict,
        _,
        _,
        count,
        shape_s,
    ) = work
    count[0] += 1
    place_joints(joint_i, joint_f, q, rot, pos)
    for s in range(known.shape[0]):
        known[s, 0] = known[s, 1] = shape_i[s, SHAPE_JOINT] == 0
    for l in range(LANES):
        verdict[l] = FREE
        drift[l] = np.float32(0.0)
    bar = np.float32(margin + SINGLE_PAD)
    found = False
    for n in range(pairs):
        pair = np.int64(order[n])
        a, b = pair_i[pair, PAIR_A], pair_i[pair, PAIR_B]
        ja, jb = shape_i[a, SHAPE_JOINT], shape_i[b, SHAPE_JOINT]
        fixed, kind = jb == 0, shape_i[b, SHAPE_KIND]
        for turn in range(1 if fixed else 2):
            s, j = (a, ja) if turn == 0 else (b, jb)
            if not known[s, 0]:
                known[s, 0] = 1
                place_sphere(rot, pos, j, shape_f[s, CENTRE], shape_f[s, CENTRE + 1], shape_f[s, CENTRE + 2], centre, s)
                if not still:
                    place_sway(joint_i, chain, reach, j, s, shape_f[s, BOUND], e, rot, pos, centre, sway, gap)
                grow(grown, s, shape_f[s, BOUND], sway, still)
        if near(centre, grown, a, b, bar) == 0:
            continue
        if not still:
            drift_of(sway, a, b, fixed, pair_i[pair, PAIR_COMMON], slack, drift)
        number = pair_i[pair, PAIR_TABLE]
        if number >= 0:
            _look_up(grid_i, grid_f, grid, number, q, gap)
            if take(gap, drift, bar) == 0:
                continue
        elif _spheres_prove(
            shape_i, shape_f, shape_s, fine, rot, pos, centre, spheres, known, a, b, ja, jb, drift, gap, deep, bar
        ):
            continue
        elif (kind != HULL or not fixed) and _touched(deep, np.float32(margin - SINGLE_PAD), verdict):
            found = True
            if stop:
                _first(order, n)
                return True
        worst = 0
        for l in range(LANES):
            if gap[l] < gap[worst]:
                worst = l
        for turn in range(-1, LANES):
            l = worst if turn < 0 else turn
            if turn == worst or gap[l] > bar or verdict[l] == HIT:
                continue
            judged = _exact(shape_i, shape_f, verts, rot, pos, narrow, axis, pair, a, b, l, drift[l], margin)
            if judged == FREE:
                continue
            left[pair] = 1
            verdict[l] = judged
            if judged == HIT:
                found = True
                if stop:
                    _first(order, n)
                    return True
    return found
