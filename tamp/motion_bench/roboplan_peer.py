"""Stands alone: roboplan on problems read from a file, run by that package's own interpreter.

Usage: python roboplan_peer.py TASK.json RESULT.json. The task holds the robot's URDF file, its links, the pairs that
can meet, its joint limits and the problems; the result one row for each problem.
"""

from __future__ import annotations

import json
import sys
import time
from itertools import combinations
from pathlib import Path
from typing import Any

STEP, RANGE, LIMIT = 1.0 / 32.0, 1.0, 5.0
"""Distance of checked states and longest extension [rad]; time limit [s]."""


def main(task_file: str, result_file: str) -> None:
    """Plan every problem of a task."""
    task = json.loads(Path(task_file).read_text("utf-8"))
    rows = [_solve(task, problem) for problem in task["problems"]]
    Path(result_file).write_text(json.dumps(rows), "utf-8")


def _scene(task: dict[str, Any], problem: dict[str, Any]) -> Any:
    import numpy as np
    from roboplan import core

    description = core.loadUrdfSceneDescriptionFromXml(task["urdf"], [])
    scene = core.Scene("bench", description)
    scene.addGroup("arm", task["joints"])
    meeting = {tuple(sorted(pair)) for pair in task["pairs"]}
    apart = [pair for pair in combinations(sorted(task["links"]), 2) if pair not in meeting]
    scene.setCollisions(apart, False)
    for number, obstacle in enumerate(problem["obstacles"]):
        name = f"obstacle{number}"
        pose = np.asfortranarray(np.array(obstacle["pose"], dtype=float))
        colour = np.array([0.5, 0.5, 0.5, 1.0])
        if obstacle["type"] == "box":
            box = core.Box(*(2.0 * half for half in obstacle["half_extents"]))
            scene.addBoxGeometry(name, "universe", box, pose, colour)
        else:
            cylinder = core.Cylinder(obstacle["radius"], obstacle["length"])
            scene.addCylinderGeometry(name, "universe", cylinder, pose, colour)
        still = [task["base"], *(f"obstacle{k}" for k in range(number))]
        scene.setCollisions([(other, name) for other in still], False)
    return scene


def _solve(task: dict[str, Any], problem: dict[str, Any]) -> dict[str, Any]:
    import numpy as np
    from roboplan import core, rrt

    t0 = time.thread_time()
    scene = _scene(task, problem)
    options = rrt.RRTOptions(
        group_name="arm",
        max_nodes=200000,
        max_connection_distance=RANGE,
        collision_check_step_size=STEP,
        max_planning_time=LIMIT,
        rrt_connect=True,
    )
    planner = rrt.RRT(scene, options)
    planner.setRngSeed(task["seed"])
    ends = [
        core.JointConfiguration(task["joints"], np.array(q, dtype=float)) for q in (problem["start"], problem["goal"])
    ]
    t1 = time.thread_time()
    row = {"scene": problem["scene"], "index": problem["index"], "setup_ms": 1e3 * (t1 - t0)}
    try:
        raw = planner.plan(*ends)
    except RuntimeError as error:
        return {**row, "solved": False, "plan_ms": 1e3 * (time.thread_time() - t1), "reason": str(error)}
    t2 = time.thread_time()
    cut = core.PathShortcuttingOptions(group_name="arm", max_step_size=STEP, seed=task["seed"])
    path = core.PathShortcutter(scene, cut).shortcut(raw)
    t3 = time.thread_time()
    return {
        **row,
        "solved": True,
        "plan_ms": 1e3 * (t2 - t1),
        "simplify_ms": 1e3 * (t3 - t2),
        "raw": [list(map(float, q)) for q in raw.positions],
        "path": [list(map(float, q)) for q in path.positions],
    }


if __name__ == "__main__":
    main(*sys.argv[1:3])
