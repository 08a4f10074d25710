"""The paper's rules for objects that are pushed over an edge or pressed on a rim, on a known surface.

Push: the hand points down within 10 deg, its fingers open along the table's edge, one straight push. Thin things are
grasped horizontally, across the exposed edge, the fingers opening vertically; a rim from underneath or from outside.
Plate: the grasp is on the highest tenth; the press that raises it has a file of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.spatial import ConvexHull

from affordance.candidates import ContactCandidate, GoalCandidate
from affordance.grip import FINGER_LENGTH, PALM, PALM_LENGTH, grip_at
from robots.spatial import Array, hand_rotation, rotation_about, unit
from robots.workcell import Gripper, Table

WANTED_OVERHANG = (0.045, 0.075)
"""How far an object should reach over the edge [m]: as deep as fingers reach."""

KEPT_BACK = 0.014
"""How far the centre of mass must stay inside the edge [m]."""

LEAST_OVERHANG = 0.014
"""Least overhang that is aimed at [m]."""

ON_TABLE = 0.016
"""How far the pushing fingers must stay inside the edge [m]."""

BESIDE = 0.012
"""Distance of the middle of a finger from what it pushes with its side [m]."""

BEHIND = 0.022
"""How far behind the object the fingers come down before they push it from the side [m]."""

LEAST_PUSH = 0.004
"""Shortest push [m]."""

FOOT = 0.004
"""Points lower than this above the table are what the object stands on [m]."""

LEVEL = 0.0015
"""Height differences under the finger tips that still count as level [m]."""

TIP = 0.010
"""Radius of the area under a finger tip [m]."""

TILT = np.radians(4.0)
"""Spread of the hand's tilt when it pushes or presses [rad]; the paper allows 10 deg."""

PITCHES = (0.0, 0.0, 0.0, 0.2, 0.4, 0.7, 1.0, 1.3, -0.2, -0.5, -0.9, -1.3)
"""From how far below the horizon the hand comes [rad]: level for thin things, from underneath or above for rims."""

DEEP = 8.0
"""Worth of a grasp's depth [1/m]: the object may lie a centimetre from where it was pushed to."""

THIN = 0.030
"""Widths above this count against a grasp [m]: wide grips close on slopes and slide off."""

TIGHT = 0.15
"""Least share of the pads that must meet the object."""

LIFT = 0.17
"""How far the object is lifted [m]: 10 cm are needed, and it may sag."""

TOP_TENTH = 0.10
"""Share of a plate's highest points among which the grasp is chosen; the paper's value."""

DRAWS = 220
"""Grasps tried geometrically for one list of candidates."""

KEPT = 24
"""Longest list of candidates."""


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """An object's surface where it is or is predicted to be, in the world frame.

    Attributes:
        surface: ``(n, 3)`` points [m].
        normals: ``(n, 3)`` outward unit normals.
        centre: Centre of mass ``(3,)`` [m].
    """

    surface: Array
    normals: Array
    centre: Array


@dataclass(frozen=True, slots=True, eq=False)
class Edge:
    """The table's edge over which things are pushed.

    Attributes:
        outward: Horizontal unit vector ``(3,)`` from the table past the edge.
        along: Horizontal unit vector ``(3,)`` along the edge.
        at: Where the edge is along ``outward`` [m].
        top: Height of the table top [m].
        thickness: Thickness of the table top [m].
    """

    outward: Array
    along: Array
    at: float
    top: float
    thickness: float


def near_edge(table: Table) -> Edge:
    """The edge that both arms reach: the one towards -y, where nothing stands."""
    outward = np.array([0.0, -1.0, 0.0])
    at = -(table.centre[1] - 0.5 * table.size[1])
    return Edge(outward, np.array([1.0, 0.0, 0.0]), at, table.top, table.thickness)


# -- push ----------------------------------------------------------------------------------------------------------


def pushes(body: Body, edge: Edge, gripper: Gripper, rng: np.random.Generator) -> list[ContactCandidate]:
    """One straight push towards the edge, best first: from above near the centre of mass, else low from behind."""
    return (_top_pushes(body, edge, gripper, rng) + _side_pushes(body, edge, gripper, rng))[:KEPT]


def _top_pushes(body: Body, edge: Edge, gripper: Gripper, rng: np.random.Generator) -> list[ContactCandidate]:
    """Pushes by pressing on the upper surface and dragging."""
    along_push, across = body.surface @ edge.outward, body.surface @ edge.along
    reach, centre = float(along_push.max()), float(body.centre @ edge.outward)
    room = reach - centre - KEPT_BACK
    found = []
    spots = np.flatnonzero(body.normals[:, 2] > 0.97)
    inside = _supported(body, edge.top)
    spots = spots[inside(body.surface[spots])]
    if not len(spots):
        return []
    for k in rng.choice(spots, size=min(len(spots), 160), replace=False):
        spot = body.surface[k]
        wanted = float(np.clip(min(rng.uniform(*WANTED_OVERHANG), room), LEAST_OVERHANG, None))
        length = edge.at - reach + wanted
        if length < LEAST_PUSH or along_push[k] + length > edge.at - ON_TABLE:
            continue
        aside = float(across[k] - body.centre @ edge.along)
        behind = float(along_push[k] - centre)
        for opening in (0.022, 0.0):
            footing = _footing(body.surface, spot, edge.along, opening)
            if footing is None or not _room_above(body.surface, spot, footing, edge.along, opening):
                continue
            score = -abs(aside) / 0.02 - abs(behind) / 0.08 + (0.3 if opening else 0.0) + rng.uniform(0.0, 0.2)
            tilt = rotation_about(edge.along, rng.normal(0.0, TILT))
            approach = tilt @ np.array([0.0, 0.0, -1.0])
            R = hand_rotation(approach, edge.along * rng.choice([-1.0, 1.0]))
            at = np.array([spot[0], spot[1], footing])
            T_world_hand = pin.SE3(R, at - gripper.tip_offset * approach)
            travel = length * edge.outward
            found.append(ContactCandidate(T_world_hand, opening, travel, pin.SE3(np.eye(3), travel), float(score)))
            break
    return sorted(found, key=lambda candidate: -candidate.score)[: KEPT // 2]


def _supported(body: Body, top: float) -> Callable[[Array], Array]:
    """Which points ``(k, 3)`` stand above what the object stands on: pressed elsewhere it would tip."""
    feet = body.surface[body.surface[:, 2] < top + FOOT, :2]
    if len(feet) < 3 or np.linalg.svd(feet - feet.mean(axis=0), compute_uv=False)[-1] < 1e-3:
        return lambda spots: np.zeros(len(spots), dtype=bool)
    sides = ConvexHull(feet).equations
    return lambda spots: np.asarray((spots[:, :2] @ sides[:, :2].T + sides[:, 2]).max(axis=1) <= 0.0)


def _room_above(surface: Array, spot: Array, footing: float, opening_axis: Array, opening: float) -> bool:
    """Whether nothing of the object stands in the way of the fingers and the palm that come straight down."""
    aside = np.abs((surface - spot) @ opening_axis)
    across = np.abs((surface - spot) @ np.cross([0.0, 0.0, 1.0], opening_axis))
    fingers = (aside < opening + 0.02) & (across < 0.014) & (surface[:, 2] > footing + 2 * LEVEL)
    palm = (aside < 0.105) & (across < 0.036) & (surface[:, 2] > footing + 0.042)
    return not (fingers.any() or palm.any())


def _side_pushes(body: Body, edge: Edge, gripper: Gripper, rng: np.random.Generator) -> list[ContactCandidate]:
    """Pushes by two low fingers behind the object, like a fork: for what is hollow, round or not level."""
    along_push, across = body.surface @ edge.outward, (body.surface - body.centre) @ edge.along
    reach, room = float(along_push.max()), float(along_push.max() - body.centre @ edge.outward) - KEPT_BACK
    found = []
    for _ in range(KEPT):
        opening, aside = float(rng.choice([0.034, 0.022, 0.010])), float(rng.normal(0.0, 0.006))
        height = edge.top + rng.uniform(0.006, max(0.010, float(body.surface[:, 2].max()) - edge.top - 0.008))
        low = (body.surface[:, 2] > height - 0.002) & (body.surface[:, 2] < height + FINGER_LENGTH)
        under = np.abs(np.abs(across - aside) - opening - 0.008) < 0.011
        if not (low & under).any():
            continue
        back = float(along_push[low & under].min()) - BESIDE
        wanted = float(np.clip(min(rng.uniform(*WANTED_OVERHANG), room), LEAST_OVERHANG, None))
        length = edge.at - reach + wanted
        if length < LEAST_PUSH or back + length > edge.at - ON_TABLE:
            continue
        palm = (body.surface[:, 2] > height + FINGER_LENGTH - 0.003) & (np.abs(across - aside) < 0.105)
        if (palm & (np.abs(along_push - back) < 0.036)).any():
            continue
        tip = back * edge.outward + (body.centre @ edge.along + aside) * edge.along + height * np.array([0.0, 0.0, 1.0])
        R = hand_rotation([0.0, 0.0, -1.0], edge.along * rng.choice([-1.0, 1.0]))
        T_world_hand = pin.SE3(R, tip + gripper.tip_offset * np.array([0.0, 0.0, 1.0]))
        travel, start = length * edge.outward, -BEHIND * edge.outward
        score = opening / 0.034 - abs(aside) / 0.01 - 10.0 * (height - edge.top) - 3.0
        found.append(ContactCandidate(T_world_hand, opening, travel, pin.SE3(np.eye(3), travel), score, start))
    return sorted(found, key=lambda candidate: -candidate.score)[: KEPT // 2]


def _footing(surface: Array, spot: Array, opening_axis: Array, opening: float) -> float | None:
    """Height at which open finger tips over ``spot`` meet the surface, both at once; ``None`` where they do not."""
    heights = []
    for sign in (-1.0, 1.0) if opening else (0.0,):
        centre = spot + sign * (opening + 0.5 * TIP * bool(opening)) * opening_axis
        under = np.linalg.norm(surface[:, :2] - centre[:2], axis=1) < TIP
        if not under.any():
            return None
        top = float(surface[under, 2].max())
        level = under & (surface[:, 2] > top - LEVEL)
        if level.sum() < 0.25 * under.sum():
            return None
        heights.append(top)
    return max(heights) if max(heights) - min(heights) <= LEVEL else None


# -- grasp at an edge ----------------------------------------------------------------------------------------------


def edge_grasps(body: Body, edge: Edge, gripper: Gripper, rng: np.random.Generator) -> list[GoalCandidate]:
    """Grasps on what reaches over the edge, or would after a push, best first."""
    along_push = body.surface @ edge.outward
    reach = float(along_push.max())
    over = reach - edge.at
    centre = float(body.centre @ edge.outward)
    if over < 0.5 * LEAST_OVERHANG:  # nothing does yet: anticipate what a push would expose
        over = float(np.clip(reach - centre - KEPT_BACK, LEAST_OVERHANG, WANTED_OVERHANG[1]))
    limit = reach - over
    exposed = np.flatnonzero(along_push > limit + 0.002)
    found: list[tuple[float, GoalCandidate]] = []
    for _ in range(DRAWS):
        spot = body.surface[rng.choice(exposed)]
        pitch = rng.choice(PITCHES) + rng.normal(0.0, 0.04)
        yaw = rng.normal(0.0, 0.2)
        level = rotation_about([0.0, 0.0, 1.0], yaw) @ -edge.outward
        up = np.array([0.0, 0.0, 1.0])
        approach = np.cos(pitch) * level + np.sin(pitch) * up
        sideways = np.cross(approach, up) if abs(pitch) < 1.2 else edge.along
        opening_axis = np.cross(sideways, approach) if rng.random() < 0.75 else sideways
        depth = rng.uniform(0.010, 0.036)
        grip = grip_at(body.surface, spot, approach, opening_axis, depth, gripper)
        if grip is None or grip.cover < TIGHT or _meets_table(grip.T_world_hand, grip.opening, edge, limit, gripper):
            continue
        lever = float(np.linalg.norm((grip.middle - body.centre)[:2]))
        score = min(grip.cover, 0.8) - 2.5 * lever - 0.1 * abs(pitch) - (0.15 if grip.cover < 0.3 else 0.0)
        score += DEEP * min(depth, 0.030) - 8.0 * max(0.0, grip.width - THIN)
        goal = _grasp(grip.T_world_hand, grip.opening, grip.middle, -approach, score)
        found.append((score, goal))
    return _distinct(found)


def _meets_table(T_world_hand: pin.SE3, opening: float, edge: Edge, limit: float, gripper: Gripper) -> bool:
    """Whether a finger or the palm would be inside the table, its edge taken at ``limit``."""
    wide = opening + 0.016
    box = np.array(
        [[x, y, z] for x in (-0.011, 0.011) for y in (-wide, wide) for z in (gripper.tip_offset, 0.07)]
        + [[x, y, PALM_LENGTH] for x in (-PALM[0], PALM[0]) for y in (-PALM[1], PALM[1])]
    )  # fmt: skip
    corners = box @ T_world_hand.rotation.T + T_world_hand.translation
    beside = corners @ edge.outward < limit + 0.004
    low = (corners[:, 2] < edge.top + 0.004) & (corners[:, 2] > edge.top - edge.thickness - 0.004)
    return bool((beside & low).any())


# -- plate ---------------------------------------------------------------------------------------------------------


def rim_grasps(body: Body, gripper: Gripper, rng: np.random.Generator) -> list[GoalCandidate]:
    """Grasps of a raised rim: towards the middle in the plate's plane, the fingers opening across it, best first."""
    tilt = _plane(body)
    height = body.surface[:, 2]
    raised = np.flatnonzero(height >= np.quantile(height, 1.0 - TOP_TENTH))
    found: list[tuple[float, GoalCandidate]] = []
    for _ in range(DRAWS):
        spot = body.surface[rng.choice(raised)]
        inward = body.centre - spot
        inward = unit(inward - (inward @ tilt) * tilt)
        side = np.cross(tilt, inward)
        approach = rotation_about(side, rng.normal(0.0, 0.2)) @ rotation_about(tilt, rng.normal(0.0, 0.1)) @ inward
        opening_axis = np.cross(approach, side)
        grip = grip_at(body.surface, spot, approach, opening_axis, rng.uniform(0.012, 0.030), gripper)
        if grip is None or grip.cover < TIGHT:
            continue
        score = min(grip.cover, 0.8) + 0.3 * rng.random()
        found.append((score, _grasp(grip.T_world_hand, grip.opening, grip.middle, -approach, score)))
    return _distinct(found)


def _plane(body: Body) -> Array:
    """The upward normal of the flat object's plane."""
    normal = np.linalg.svd(body.surface - body.surface.mean(axis=0), full_matrices=False)[2][2]
    return np.asarray(normal if normal[2] > 0.0 else -normal)


# -- shared --------------------------------------------------------------------------------------------------------


def _grasp(T_world_hand: pin.SE3, opening: float, point: Array, outward: Array, score: float) -> GoalCandidate:
    up = np.array([0.0, 0.0, 1.0])
    return GoalCandidate("grasp", T_world_hand, opening, up, point, LIFT, outward, float(score))


def _distinct(found: list[tuple[float, GoalCandidate]]) -> list[GoalCandidate]:
    """The best candidates, none within 8 mm and 15 deg of a better one."""
    kept: list[GoalCandidate] = []
    for _, goal in sorted(found, key=lambda pair: -pair[0]):
        T = goal.T_world_hand
        near = any(
            np.linalg.norm(T.translation - other.T_world_hand.translation) < 0.008
            and T.rotation[:, 2] @ other.T_world_hand.rotation[:, 2] > np.cos(np.radians(15.0))
            for other in kept
        )
        if not near:
            kept.append(goal)
        if len(kept) == KEPT:
            break
    return kept
