"""How this project plans a benchmark problem: compiled proofs, with its own tree or with OMPL's planners."""

from __future__ import annotations

import time
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from planners import ompl_search
from planners.compiled import layout as at
from planners.compiled.cell import Cell, Motion
from planners.compiled.pieces import surface_pieces
from planners.compiled.robot import Robot, robot, robot_of_shapes, shape_of
from planners.compiled.tables import Shape
from planners.meshes import MeshRobot, MeshWorld, load_robot
from robots.cache import cache_dir, content_hash, write_atomic
from robots.spatial import Array
from tamp.motion_bench import panda
from tamp.motion_bench.problems import Box, Cylinder, Problem, Sphere
from tamp.motion_bench.rows import Row, length_of

BOUNDS = np.stack([panda.LOWER, panda.UPPER])

ATTEMPTS = 60
"""Tries to cut a detour."""

CLOSER = 24
"""Most convex pieces of a link where one hull is too coarse for the start or the goal."""

PLAIN_STEP = 1.0 / 32.0
"""Distance of the states that the plain method checks, L2 [rad]."""

TIME_LIMIT = 5.0
"""Of OMPL's search with the plain check, and of any other method [s]."""


class Panda:
    """The benchmark's robot, made once."""

    @cached_property
    def meshes(self) -> MeshRobot:
        """As Pinocchio sees it."""
        return load_robot(str(urdf_file()), panda.SELF_PAIRS)

    @cached_property
    def hulls(self) -> Robot:
        """As the kernels see it: a convex hull for each link."""
        return robot(self.meshes.model, self.meshes.geometry, self.meshes.pairs)

    @cached_property
    def _owners(self) -> list[int]:
        """The link of each closer piece."""
        return [k for k, pieces in enumerate(self._pieces) for _ in pieces]

    @cached_property
    def _pieces(self) -> list[list[Shape]]:
        """Convex pieces of every link."""
        return [_pieces(thing) for thing in self.meshes.geometry.geometryObjects]

    @cached_property
    def closer(self) -> Robot:
        """As the kernels see it where hulls are too coarse: several pieces for each link."""
        owners, pairs = self._owners, set(self.meshes.pairs)
        chosen = [(i, k) for i, a in enumerate(owners) for k, b in enumerate(owners) if (a, b) in pairs]
        shapes = [shape for pieces in self._pieces for shape in pieces]
        return robot_of_shapes(self.meshes.model, shapes, chosen, grids=False)

    def motion(self, problem: Problem, *, closer: bool = False) -> Motion:
        """The arm among the problem's obstacles."""
        chosen = self.closer if closer else self.hulls
        owners = self._owners if closer else range(len(chosen.rows.names))
        others, count = shapes_of(problem), len(chosen.rows.names)
        movers = [k for k, owner in enumerate(owners) if owner not in self.meshes.fixed]
        cell = Cell(chosen, others, [(k, count + m) for k in movers for m in range(len(others))])
        return cell.motion(range(7), np.zeros(7))

    def world(self, problem: Problem) -> MeshWorld:
        """The exact meshes among the problem's obstacles."""
        return MeshWorld(self.meshes, shapes_of(problem))


def urdf_file() -> Path:
    """The benchmark robot's URDF as a file in the cache."""
    text = panda.urdf()
    path = cache_dir() / "robots" / f"mbm-{content_hash(text)}.urdf"
    return path if path.is_file() else write_atomic(path, text)


def shapes_of(problem: Problem) -> list[Shape]:
    """The problem's obstacles as convex shapes."""
    return [_shape(obstacle) for obstacle in problem.obstacles]


def _shape(obstacle: Box | Cylinder | Sphere) -> Shape:
    quaternion = np.array(obstacle.quat_xyzw)
    T = pin.XYZQUATToSE3(np.concatenate([obstacle.position, quaternion / np.linalg.norm(quaternion)]))
    if isinstance(obstacle, Box):
        return Shape(obstacle.name, 0, at.BOX, T, np.array(obstacle.half_extents))
    if isinstance(obstacle, Cylinder):
        return Shape(obstacle.name, 0, at.CYLINDER, T, np.array([obstacle.radius, obstacle.length / 2, 0.0]))
    return Shape(obstacle.name, 0, at.POINT, T, np.zeros(3), obstacle.radius)


def _pieces(thing: Any) -> list[Shape]:
    """Convex pieces that contain a link's mesh."""
    mesh = thing.geometry
    triangles = np.array([[int(n) for n in (t[0], t[1], t[2])] for t in map(mesh.tri_indices, range(mesh.num_tris))])
    whole = shape_of(thing)
    found = surface_pieces(np.array(mesh.vertices()), triangles, CLOSER)
    return [Shape(whole.name, whole.joint, at.HULL, whole.T_joint_shape, piece) for piece in found]


def plan(arm: Panda, problem: Problem, *, seed: int, planner: str | None = None) -> Row:
    """The compiled tree on a problem, or an OMPL planner with the compiled check of edges."""
    method = "ours" if planner is None else "ours-ompl"
    began = time.thread_time()
    start, goals = np.array(problem.start), np.array(problem.goals)
    motion = arm.motion(problem)
    made = time.thread_time()
    motion, reason = _checked(arm, problem, motion, start, goals)
    if reason:
        return Row(method, problem.scene, problem.index, False, _ms(began, made), _ms(made), reason=reason)
    free = [goal for goal, verdict in zip(goals, motion.states(goals), strict=True) if verdict == at.FREE]
    free.sort(key=lambda goal: float(np.linalg.norm(goal - start)))
    points, states = _search(motion, start, np.array(free), seed, planner)
    planned = time.thread_time()
    if not len(points):
        reason = f"no path after {states} configurations"
        return Row(method, problem.scene, problem.index, False, _ms(began, made), _ms(made, planned), reason=reason)
    path = motion.shorten(points, seed=seed, attempts=ATTEMPTS)
    shortened = time.thread_time()
    edge, verdict = motion.path(path)
    certified = time.thread_time()
    if verdict != at.FREE:
        reason = f"edge {edge} of the final path is not proven free"
    return Row(
        method,
        problem.scene,
        problem.index,
        verdict == at.FREE,
        _ms(began, made),
        _ms(made, planned),
        _ms(planned, shortened),
        _ms(shortened, certified),
        length_of(points),
        length_of(path),
        states,
        reason,
        path,
    )


def _ms(begin: float, end: float | None = None) -> float:
    return 1e3 * ((time.thread_time() if end is None else end) - begin)


def _checked(arm: Panda, problem: Problem, motion: Motion, start: Array, goals: Array) -> tuple[Motion, str]:
    """The motion with which start and a goal are proven free, or why there is none; closer pieces where hulls fail."""
    for name, rows in (("start", start[None]), ("goal", goals)):
        if problem_with := _outside(name, rows):
            return motion, problem_with
    if _ends_free(motion, start, goals):
        return motion, ""
    world = arm.world(problem)
    if contact := world.contact(start):
        return motion, f"the start is in collision: {contact}"
    contacts = [world.contact(goal) for goal in goals]
    if all(contacts):
        return motion, f"the goal is in collision: {contacts[0]}"
    closer = arm.motion(problem, closer=True)
    if _ends_free(closer, start, goals):
        return closer, ""
    return motion, "the start or the goal is free by less than its convex pieces can tell"


def _ends_free(motion: Motion, start: Array, goals: Array) -> bool:
    verdicts = motion.states(np.vstack([start, goals]))
    return bool(verdicts[0] == at.FREE and (verdicts[1:] == at.FREE).any())


def _outside(which: str, rows: Array) -> str:
    """Why no row can be used; nothing when one can."""
    if not np.isfinite(rows).all():
        return f"the {which} holds a value that is not finite"
    over = np.maximum(panda.LOWER - rows, rows - panda.UPPER)
    if (over.max(axis=1) <= 1e-9).any():
        return ""
    k = int(np.argmax(over[0]))
    low, high = panda.LOWER[k], panda.UPPER[k]
    return f"the {which} is out of limits: {panda.JOINTS[k]} at {rows[0, k]:.3f} rad, range {low:.3f} to {high:.3f} rad"


def _search(motion: Motion, start: Array, goals: Array, seed: int, planner: str | None) -> tuple[Array, int]:
    """A path, empty when there is none, and how many configurations were looked at."""
    if planner is None:
        found = motion.connect(start, goals, BOUNDS, seed=seed)
        return found.points, found.states
    calls = 0

    def edge(a: Array, b: Array) -> bool:
        nonlocal calls
        calls += 1
        return motion.path(np.stack([a, b]))[1] == at.FREE

    def free(q: Array) -> bool:
        return bool(motion.states(q[None])[0] == at.FREE)

    for goal in goals:
        if edge(start, goal):
            return np.stack([start, goal]), calls
    raw, _ = ompl_search.search(free, edge, start, goals, BOUNDS, seed=seed, stop=TIME_LIMIT, planner=planner)
    return (np.zeros((0, 7)) if raw is None else raw), calls


def plan_plain(arm: Panda, problem: Problem, *, seed: int) -> Row:
    """The straightforward way: OMPL with Pinocchio's loop over all pairs of meshes, and OMPL's simplifier."""
    began = time.thread_time()
    start, goals = np.array(problem.start), np.array(problem.goals)
    world = arm.world(problem)
    made = time.thread_time()
    bad = _outside("start", start[None]) or _outside("goal", goals)
    if bad or not world.free(start) or not any(world.free(goal) for goal in goals):
        reason = bad or "start or goal in collision"
        return Row("ompl-plain", problem.scene, problem.index, False, _ms(began, made), _ms(made), reason=reason)

    def edge(a: Array, b: Array) -> bool:
        steps = max(1, int(np.ceil(np.linalg.norm(b - a) / PLAIN_STEP)))
        return all(world.free(a + (b - a) * (k / steps)) for k in range(1, steps + 1))

    usable = np.array([goal for goal in goals if world.free(goal)])
    simplified_at = [0.0]
    raw, path = ompl_search.search(
        world.free, edge, start, usable, BOUNDS, seed=seed, stop=TIME_LIMIT, simplify=2.0, clock=simplified_at
    )
    done = time.thread_time()
    if raw is None or path is None:
        reason = f"no path in {TIME_LIMIT:g} s"
        return Row("ompl-plain", problem.scene, problem.index, False, _ms(began, made), _ms(made), reason=reason)
    return Row(
        "ompl-plain",
        problem.scene,
        problem.index,
        True,
        _ms(began, made),
        _ms(made, simplified_at[0]),
        _ms(simplified_at[0], done),
        0.0,
        length_of(raw),
        length_of(path),
        path=path,
    )
