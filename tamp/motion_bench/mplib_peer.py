"""Stands alone: mplib on problems read from a file, run by an interpreter of its own, whose numpy is older than 2.

Usage: python mplib_peer.py TASK.json RESULT.json. The task holds the robot's URDF file, its links, the pairs that can
meet, its joint limits and the problems; the result one row for each problem. Planned is with mplib's own OMPL planner
on its world; its resolution of edges, OMPL's default of a hundredth of the space, cannot be changed.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
import xml.etree.ElementTree as ET
from itertools import combinations
from pathlib import Path
from typing import Any

RANGE, LIMIT = 1.0, 5.0
"""Longest extension [rad]; time limit [s]."""

HAND = "panda_hand"
"""Link that is moved."""


def main(task_file: str, result_file: str) -> None:
    """Plan every problem of a task."""
    task = json.loads(Path(task_file).read_text("utf-8"))
    with tempfile.TemporaryDirectory() as folder:
        files = _files(task, Path(folder))
        rows = [_solve(task, files, problem) for problem in task["problems"]]
    Path(result_file).write_text(json.dumps(rows), "utf-8")


def _files(task: dict[str, Any], folder: Path) -> tuple[str, str]:
    """The robot's URDF file, and the semantic description that names the pairs which cannot meet."""
    meeting = {tuple(sorted(pair)) for pair in task["pairs"]}
    apart = [pair for pair in combinations(sorted(task["links"]), 2) if pair not in meeting]
    lines = "".join(f'<disable_collisions link1="{a}" link2="{b}" reason="Never"/>' for a, b in apart)
    urdf, srdf = folder / "robot.urdf", folder / "robot.srdf"
    root = ET.fromstring(task["urdf"])
    for number, mesh in enumerate(root.iter("mesh")):
        name = f"mesh{number}.obj"
        (folder / name).write_text(_triangles(Path(str(mesh.get("filename")))), "utf-8")
        mesh.set("filename", name)
    urdf.write_text(ET.tostring(root, encoding="unicode"), "utf-8")
    srdf.write_text(f'<?xml version="1.0"?><robot name="panda">{lines}</robot>', "utf-8")
    return str(urdf), str(srdf)


def _triangles(mesh: Path) -> str:
    """A mesh file without the edges between two vertices that some hold, at which mplib's reader ends."""
    lines = mesh.read_text("utf-8").splitlines(keepends=True)
    return "".join(line for line in lines if line[:2] == "v " or (line[:2] == "f " and len(line.split()) > 3))


def _planner(task: dict[str, Any], files: tuple[str, str], problem: dict[str, Any]) -> Any:
    import mplib
    import numpy as np
    from mplib.collision_detection import fcl

    urdf, srdf = files
    robot = mplib.ArticulatedModel(urdf, srdf, link_names=task["links"], joint_names=task["joints"])
    robot.set_move_group(HAND)
    world = mplib.PlanningWorld([robot], [])
    for number, obstacle in enumerate(problem["obstacles"]):
        if obstacle["type"] == "box":
            shape = fcl.Box(*(2.0 * half for half in obstacle["half_extents"]))
        else:
            shape = fcl.Cylinder(obstacle["radius"], obstacle["length"])
        pose = mplib.Pose(np.array(obstacle["pose"], dtype=float))
        name = f"obstacle{number}"
        world.add_object(name, fcl.CollisionObject(shape, pose))
        world.get_allowed_collision_matrix().set_entry(task["base"], name, True)
    return world, mplib.planning.ompl.OMPLPlanner(world)


def _solve(task: dict[str, Any], files: tuple[str, str], problem: dict[str, Any]) -> dict[str, Any]:
    import mplib
    import numpy as np

    mplib.set_global_seed(task["seed"])
    t0 = time.thread_time()
    world, planner = _planner(task, files, problem)
    start, goal = (np.array(problem[key], dtype=float) for key in ("start", "goal"))
    t1 = time.thread_time()
    status, raw = planner.plan(start, [goal], time=LIMIT, range=RANGE, simplify=False)
    t2 = time.thread_time()
    row = {
        "scene": problem["scene"],
        "index": problem["index"],
        "setup_ms": 1e3 * (t1 - t0),
        "plan_ms": 1e3 * (t2 - t1),
    }
    if status != "Exact solution":
        return {**row, "solved": False, "reason": f"{status}; {len(world.check_collision())} contacts"}
    path = planner.simplify_path(raw)
    t3 = time.thread_time()
    return {
        **row,
        "solved": True,
        "simplify_ms": 1e3 * (t3 - t2),
        "raw": np.asarray(raw).tolist(),
        "path": np.asarray(path).tolist(),
    }


if __name__ == "__main__":
    main(*sys.argv[1:3])
