"""Which links of one arm can never meet within its joint limits, or never part: looked for once for a kind of arm.

As in MoveIt's setup assistant: such pairs are found by sampling. What samples leave over is then searched for the
configuration in which the pair comes closest.
"""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from planners.compiled.robot import shape_of
from robots.cache import cache_dir, content_hash, write_atomic
from robots.spatial import Array
from robots.workcell import Side

SAMPLES = 6000
"""Random configurations; in every fourth about half of the joints are at a limit."""

ROUND = 100
"""Configurations after which pairs that came close are not looked at any more."""

CLEAR = 0.03
"""Pairs that stay further apart than this in all that was looked at cannot meet [m]."""

TOUCH = 1e-3
"""Pairs that stay closer than this cannot part [m]: their hulls overlap by construction."""

CLIMBS = 6
"""The closest samples of a pair from which it is led still closer."""

STEPS = (0.4, 0.15, 0.05, 0.015)
"""Steps of single joints on the way there [rad], from coarse to fine."""

Pair = tuple[int, int]
"""Two geometry objects."""


def decided(model: pin.Model, geometry: pin.GeometryModel, side: Side, pairs: Sequence[Pair]) -> list[Pair]:
    """Those of ``pairs`` that can never meet or never part, read from the cache where they were found before.

    The answer depends on the arm's shapes, joints and limits, but neither on where it stands nor on which side.

    Args:
        model: Both arms.
        geometry: Their convex shapes.
        side: Which arm.
        pairs: Numbers of geometry objects, all of them of this arm.
    """
    if not pairs:
        return []
    path = cache_dir() / "robots" / f"meetings-{_digest(model, geometry, side, pairs)}.json"
    if path.is_file():
        return [pairs[k] for k in json.loads(path.read_text("utf-8"))]
    found = _decided(_Distances(model, geometry, side, pairs))
    write_atomic(path, json.dumps(found))
    return [pairs[k] for k in found]


def _digest(model: pin.Model, geometry: pin.GeometryModel, side: Side, pairs: Sequence[Pair]) -> str:
    """Of all that the answer depends on, with the base at the origin."""
    joints = _joints(model, side)
    T_base_world = model.jointPlacements[joints[0]].inverse()
    parts: list[bytes | str] = [repr((SAMPLES, ROUND, CLEAR, TOUCH, CLIMBS, STEPS))]
    for k, joint in enumerate(joints):
        placed = pin.SE3.Identity() if k == 0 else model.jointPlacements[joint]
        parent = joints.index(model.parents[joint]) if model.parents[joint] in joints else -1
        parts += [f"{model.joints[joint].shortname()} {parent}", _rounded(placed.homogeneous)]
    slots = _slots(model, joints)
    parts += [_rounded(limit[slots]) for limit in (model.lowerPositionLimit, model.upperPositionLimit)]
    for pair in pairs:
        for number in pair:
            shape = shape_of(geometry.geometryObjects[number])
            placed = shape.T_joint_shape if shape.joint else T_base_world * shape.T_joint_shape
            on = joints.index(shape.joint) if shape.joint else -1
            parts += [f"{on} {shape.kind} {shape.radius:.6f}", _rounded(placed.homogeneous), _rounded(shape.size)]
    return content_hash(*parts)


def _rounded(values: Array) -> bytes:
    """As bytes that do not tell the last digits apart, in which two bases differ."""
    return (np.round(np.asarray(values, dtype=np.float64), 6) + 0.0).tobytes()


def _joints(model: pin.Model, side: Side) -> list[int]:
    """The arm's joints, fingers included."""
    return [k for k, name in enumerate(model.names) if str(name).startswith(f"{side}/")]


def _slots(model: pin.Model, joints: Sequence[int]) -> list[int]:
    """Where they stand in the model's joint positions."""
    return [int(model.joints[joint].idx_q) for joint in joints]


class _Distances:
    """Distances of pairs of one arm."""

    def __init__(self, model: pin.Model, geometry: pin.GeometryModel, side: Side, pairs: Sequence[Pair]) -> None:
        self._model, self._geometry, self.count = model, geometry.copy(), len(pairs)
        self._geometry.removeAllCollisionPairs()
        for pair in pairs:
            self._geometry.addCollisionPair(pin.CollisionPair(*pair))
        self._data, self._geometry_data = model.createData(), self._geometry.createData()
        self._slots, self._q = _slots(model, _joints(model, side)), pin.neutral(model)
        limits = (np.asarray(model.lowerPositionLimit), np.asarray(model.upperPositionLimit))
        self.lower, self.upper = (limit[self._slots] for limit in limits)

    def of(self, q: Array, wanted: Sequence[int]) -> list[float]:
        """Distances [m] of some pairs at the arm's joint positions, fingers included; negative in collision."""
        self._q[self._slots] = q
        pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._geometry_data, self._q)
        return [float(pin.computeDistance(self._geometry, self._geometry_data, k).min_distance) for k in wanted]


def _decided(distances: _Distances) -> list[int]:
    """Which pairs can never meet or never part."""
    rng = np.random.default_rng(0)
    samples = rng.uniform(distances.lower, distances.upper, (SAMPLES, len(distances.lower)))
    ends = np.where(rng.random(samples.shape) < 0.5, distances.lower, distances.upper)
    samples = np.where((np.arange(SAMPLES) % 4 == 0)[:, None] & (rng.random(samples.shape) < 0.5), ends, samples)
    seen = np.full((SAMPLES, distances.count), np.inf)
    open_ = list(range(distances.count))
    for begin in range(0, SAMPLES, ROUND):
        for k in range(begin, min(begin + ROUND, SAMPLES)):
            seen[k, open_] = distances.of(samples[k], open_)
        so_far = seen[: begin + ROUND]
        open_ = [pair for pair in open_ if so_far[:, pair].min() > CLEAR or so_far[:, pair].max() < TOUCH]
    apart = []
    for pair in open_:
        closest = np.argsort(seen[:, pair], kind="stable")[:CLIMBS]
        if seen[:, pair].max() < TOUCH or all(_least(distances, pair, samples[k]) > CLEAR for k in closest):
            apart.append(pair)
    return apart


def _least(distances: _Distances, pair: int, q: Array) -> float:
    """The smallest distance [m] of a pair that steps of single joints lead to from ``q``, or one below ``CLEAR``."""
    best = distances.of(q, [pair])[0]
    for step in STEPS:
        better = True
        while better and best > CLEAR:
            better = False
            for joint in range(len(q)):
                for sign in (-1.0, 1.0):
                    trial = q.copy()
                    trial[joint] = np.clip(q[joint] + sign * step, distances.lower[joint], distances.upper[joint])
                    distance = distances.of(trial, [pair])[0]
                    if distance < best - 1e-6:
                        q, best, better = trial, distance, True
    return best
