"""Other planners on the same problems, each in an environment of its own."""

from __future__ import annotations

import json
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from robots.errors import BadInput
from tamp.motion_bench import panda
from tamp.motion_bench.problems import Box, Cylinder, Problem
from tamp.motion_bench.rows import Row, length_of

FOLDER = Path(".peers")
"""Where ``make peers`` puts the environments."""

PEERS = ("roboplan", "mplib")


def run_peer(name: str, problems: Sequence[Problem], *, seed: int) -> list[Row]:
    """A peer's rows.

    Raises:
        BadInput: It is not installed, or its process failed; the message holds its last words.
    """
    python = (FOLDER / name / "bin" / "python").absolute()
    if not python.is_file():
        raise BadInput(f"The peer {name} is not installed: {python} does not exist. Install the peers with: make peers")
    script = Path(__file__).parent / f"{name}_peer.py"
    with tempfile.TemporaryDirectory() as folder:
        task, result = Path(folder) / "task.json", Path(folder) / "result.json"
        task.write_text(json.dumps(_task(problems, seed)), "utf-8")
        command = [str(python), "-I", str(script), str(task), str(result)]
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder)
        if done.returncode or not result.is_file():
            last = done.stderr.strip().splitlines()[-1:] or ["no message"]
            raise BadInput(f"The peer {name} ended with code {done.returncode}: {last[0]}")
        rows = json.loads(result.read_text("utf-8"))
    return [_row(name, row) for row in rows]


def _task(problems: Sequence[Problem], seed: int) -> dict[str, Any]:
    return {
        "urdf": panda.urdf(),
        "joints": panda.JOINTS,
        "links": panda.LINKS,
        "base": panda.LINKS[0],
        "pairs": panda.SELF_PAIRS,
        "seed": seed,
        "problems": [_problem(problem) for problem in problems],
    }


def _problem(problem: Problem) -> dict[str, Any]:
    return {
        "scene": problem.scene,
        "index": problem.index,
        "start": problem.start,
        "goal": problem.goals[0],
        "obstacles": [_obstacle(obstacle) for obstacle in problem.obstacles],
    }


def _obstacle(obstacle: Any) -> dict[str, Any]:
    pose = pin.XYZQUATToSE3(np.array([*obstacle.position, *obstacle.quat_xyzw])).homogeneous.tolist()
    if isinstance(obstacle, Box):
        return {"type": "box", "pose": pose, "half_extents": obstacle.half_extents}
    if isinstance(obstacle, Cylinder):
        return {"type": "cylinder", "pose": pose, "radius": obstacle.radius, "length": obstacle.length}
    raise BadInput(f"The peers know boxes and cylinders only; {obstacle.name} is neither.")


def _row(method: str, row: dict[str, Any]) -> Row:
    scene, index, setup, plan = row["scene"], int(row["index"]), float(row["setup_ms"]), float(row["plan_ms"])
    if not row["solved"]:
        return Row(method, scene, index, False, setup, plan, reason=str(row["reason"]))
    raw, path = np.array(row["raw"]), np.array(row["path"])
    lengths = length_of(raw), length_of(path)
    return Row(method, scene, index, True, setup, plan, float(row["simplify_ms"]), 0.0, *lengths, path=path)
