"""Which arrangement of the two bases reaches most: the study that chose ``panda_pair``.

Run it with ``python -m tests.benchmarks.reachability [--samples N]``. For each arrangement and each role assignment it
draws random tasks and reports the share of hand poses that inverse kinematics reaches:

* down: the assistant picks from above, anywhere in the spawn area, any turn;
* both: the assistant holds an object in the shared space and the primary reaches the face turned towards it;
* edge: the primary grasps what overhangs the near edge of the table, horizontally;
* under: the same, obliquely from below;
* push: the assistant presses down on top, 5 to 25 cm inside that edge.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass

import msgspec
import numpy as np
import pinocchio as pin

from planners import ik
from robots.model import ArmKinematics, DualArm
from robots.spatial import Array, hand_rotation, perpendicular, rotation_about, unit
from robots.workcell import SIDES, Workcell, load_workcell, other

Arrangement = tuple[
    tuple[float, float, float], float, tuple[float, float], tuple[tuple[float, float], tuple[float, float]]
]
"""Left base position [m] and yaw [rad], mirrored for the right; shared middle; near edge: a point and its normal."""

FACING_EDGE = ((0.0, -0.20), (0.0, -1.0))
SIDE_EDGE = ((-0.10, 0.0), (-1.0, 0.0))
ARRANGEMENTS: dict[str, tuple[str, Arrangement]] = {
    "facing, bases level with the table": ("x", ((-0.55, 0.0, 0.0), 0.0, (0.0, 0.0), ((0.0, -0.30), (0.0, -1.0)))),
    "facing, bases 20 cm lower": ("x", ((-0.55, 0.0, -0.20), 0.0, (0.0, 0.0), ((0.0, -0.30), (0.0, -1.0)))),
    "facing, 20 cm lower, 10 cm towards the edge": ("x", ((-0.55, -0.10, -0.20), 0.2, (0.0, 0.0), FACING_EDGE)),
    "facing, 10 cm lower, 20 cm towards the edge": ("x", ((-0.55, -0.20, -0.10), 0.2, (0.0, 0.0), FACING_EDGE)),
    "facing, 20 cm lower, 130 cm apart": ("x", ((-0.65, 0.0, -0.20), 0.0, (0.0, 0.0), ((0.0, -0.30), (0.0, -1.0)))),
    "side by side, 60 cm apart": ("y", ((-0.50, 0.30, 0.0), 0.0, (0.05, 0.0), SIDE_EDGE)),
    "side by side, turned in": ("y", ((-0.45, 0.45, -0.10), -0.5, (0.05, 0.0), SIDE_EDGE)),
    "side by side, 20 cm lower, turned in": ("y", ((-0.25, 0.50, -0.20), -0.9, (0.05, 0.0), SIDE_EDGE)),
}


def arranged(mirror: str, arrangement: Arrangement) -> DualArm:
    """Both arms with the left base as given and the right one mirrored about ``x = 0`` or ``y = 0``."""
    (x, y, z), yaw, _, _ = arrangement
    right = ((-x, y, z), np.pi - yaw) if mirror == "x" else ((x, -y, z), -yaw)
    cell = msgspec.to_builtins(load_workcell("panda_pair"))
    cell["arms"]["left"] |= {"base_xyz": (x, y, z), "base_rpy": (0.0, 0.0, yaw)}
    cell["arms"]["right"] |= {"base_xyz": right[0], "base_rpy": (0.0, 0.0, right[1])}
    return DualArm(msgspec.convert(cell, Workcell))


def reaches(arm: ArmKinematics, R: Array, tcp: Array, rng: np.random.Generator) -> bool:
    """Whether inverse kinematics puts the tool centre point at ``tcp`` with hand rotation ``R``."""
    T_world_tcp = pin.SE3(R, np.asarray(tcp, dtype=np.float64))
    return isinstance(
        ik.solve(arm, T_world_tcp * arm.T_hand_tcp.inverse(), rng=rng, seeds=[arm.home], restarts=6, wanted=1),
        ik.Reached,
    )


def shares(arms: DualArm, arrangement: Arrangement, samples: int, seed: int = 1) -> dict[str, dict[str, float]]:
    """Share reached of each task, by which side is primary."""
    _, _, middle, (edge, outward) = arrangement
    found: dict[str, dict[str, float]] = {}
    for primary in SIDES:
        rng = np.random.default_rng(seed)
        cell = _Cell(arms[primary], arms[other(primary)], np.asarray(middle), edge, outward)
        found[f"primary {primary}"] = {
            name: float(np.mean([task(cell, rng) for _ in range(samples)])) for name, task in TASKS.items()
        }
    return found


@dataclass(frozen=True)
class _Cell:
    """Who acts where: kinematics of both roles, the shared middle, a point of the near edge and its outward normal."""

    primary: ArmKinematics
    assistant: ArmKinematics
    middle: Array
    edge: tuple[float, float]
    out: tuple[float, float]

    def overhanging(self, rng: np.random.Generator) -> tuple[Array, Array]:
        """A point of an object that reaches over the edge, and the outward direction."""
        outward = np.array([*self.out, 0.0])
        along = np.cross([0, 0, 1], outward) * rng.uniform(-0.12, 0.12)
        return np.array([*self.edge, rng.uniform(0.0, 0.03)]) + along + outward * rng.uniform(0.0, 0.04), outward


def _down(cell: _Cell, rng: np.random.Generator) -> bool:
    yaw = rng.uniform(0.0, np.pi)
    spot = np.array([*(cell.middle + rng.uniform(-0.12, 0.12, 2)), 0.03])
    return reaches(cell.assistant, hand_rotation([0, 0, -1], [np.cos(yaw), np.sin(yaw), 0]), spot, rng)


def _both(cell: _Cell, rng: np.random.Generator) -> bool:
    held = np.array([*(cell.middle + rng.uniform(-0.05, 0.05, 2)), rng.uniform(0.25, 0.40)])
    towards = cell.primary.base - held
    facing = rotation_about([0, 0, 1], rng.uniform(-0.5, 0.5)) @ unit([towards[0], towards[1], 0.0])
    across = rng.choice([-1.0, 1.0]) * np.cross([0, 0, 1], facing)
    opening = rotation_about(facing, rng.uniform(0, 2 * np.pi)) @ perpendicular(facing)
    return reaches(cell.assistant, hand_rotation([0, 0, -1], across), held, rng) and reaches(
        cell.primary, hand_rotation(-facing, opening), held + 0.12 * facing, rng
    )


def _edge(cell: _Cell, rng: np.random.Generator) -> bool:
    spot, outward = cell.overhanging(rng)
    return reaches(cell.primary, hand_rotation(-outward, [0, 0, 1]), spot, rng)


def _under(cell: _Cell, rng: np.random.Generator) -> bool:
    spot, outward = cell.overhanging(rng)
    return reaches(cell.primary, hand_rotation([*(-outward[:2]), 1.0], [*outward[:2], 1.0]), spot, rng)


def _push(cell: _Cell, rng: np.random.Generator) -> bool:
    spot, outward = cell.overhanging(rng)
    down = hand_rotation([0, 0, -1], np.cross([0, 0, 1], outward))
    return reaches(cell.assistant, down, spot - outward * rng.uniform(0.09, 0.29), rng)


TASKS: dict[str, Callable[[_Cell, np.random.Generator], bool]] = {
    "down": _down,
    "both": _both,
    "edge": _edge,
    "under": _under,
    "push": _push,
}


def main() -> None:
    """Print one row an arrangement and role assignment."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=40, help="random tasks of each kind")
    samples = parser.parse_args().samples
    out = sys.stdout
    out.write(f"{'arrangement':46} {'roles':14} " + " ".join(f"{name:>6}" for name in TASKS) + "\n")
    for name, (mirror, arrangement) in ARRANGEMENTS.items():
        for roles, row in shares(arranged(mirror, arrangement), arrangement, samples).items():
            out.write(f"{name:46} {roles:14} " + " ".join(f"{row[task]:6.2f}" for task in TASKS) + "\n")
            out.flush()


if __name__ == "__main__":
    main()
