"""An oracle for the benchmark's problems that shares no code with the planners: exact meshes in Coal, plain loops.

It reads the problem file itself, keeps the fingers as joints set to 0.065 m, and steps along edges by the largest joint
change. Nothing of ``planners`` or ``tamp`` is imported here.
"""

from __future__ import annotations

import gzip
import itertools
import json
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pybullet_data


class MeshOracle:
    """The benchmark's Panda with exact meshes among one problem's obstacles."""

    def __init__(self, problem: dict[str, Any]) -> None:
        folder = Path(pybullet_data.getDataPath()) / "franka_panda"
        text = (folder / "panda.urdf").read_text().replace("package://", f"{folder}/")
        self.model = pin.buildModelFromXML(text)
        self.geometry = pin.buildGeomFromUrdfString(self.model, text, pin.GeometryType.COLLISION)
        links = [shape.name.rpartition("_")[0].removeprefix("panda_") for shape in self.geometry.geometryObjects]
        tips = {"link5", "link6", "link7", "hand", "leftfinger", "rightfinger"}
        for a, b in itertools.combinations(range(len(links)), 2):
            names = {links[a], links[b]}
            near_base = bool(names & {"link0", "link1", "link2"}) and bool(names & tips)
            wrist = "link5" in names and bool(names & (tips - {"link5", "link6"}))
            if near_base or wrist:
                self.geometry.addCollisionPair(pin.CollisionPair(a, b))
        for obstacle in problem["obstacles"]:
            x, y, z, w = obstacle["quat_xyzw"]
            place = pin.SE3(pin.Quaternion(w, x, y, z).normalized().matrix(), np.array(obstacle["position"]))
            if obstacle["type"] == "box":
                solid = coal.Box(*(2.0 * np.array(obstacle["half_extents"])))
            else:
                solid = coal.Cylinder(obstacle["radius"], obstacle["length"])
            number = self.geometry.addGeometryObject(pin.GeometryObject(obstacle["name"], 0, 0, place, solid))
            for k, link in enumerate(links):
                if link != "link0":
                    self.geometry.addCollisionPair(pin.CollisionPair(k, int(number)))
        self.data, self.geometry_data = self.model.createData(), self.geometry.createData()
        self.manager = pin.BroadPhaseManager_NaiveCollisionManager(self.model, self.geometry, self.geometry_data)
        self.callback = pin.CollisionCallBackDefault(self.geometry, self.geometry_data, True)
        self.full = np.concatenate([np.zeros(7), [0.065, 0.065]])

    def touches(self, q: np.ndarray) -> bool:
        """Whether anything touches at ``q`` ``(7,)``."""
        self.full[:7] = q
        return bool(pin.computeCollisions(self.model, self.data, self.manager, self.callback, self.full))

    def edge_touches(self, a: np.ndarray, b: np.ndarray, step: float) -> bool:
        """Whether anything touches on a straight line, looked at every ``step`` of its L2 length."""
        count = max(1, int(np.ceil(np.linalg.norm(b - a) / step)))
        return any(self.touches(a + (b - a) * (k / count)) for k in range(count + 1))

    def path_touches(self, path: np.ndarray, step: float) -> bool:
        """Whether anything touches on a path ``(n, 7)``."""
        return any(self.edge_touches(a, b, step) for a, b in itertools.pairwise(path))


def read_problems(path: Path) -> list[dict[str, Any]]:
    """The problems of a file."""
    with gzip.open(path, "rt") as file:
        return list(json.load(file)["problems"])
