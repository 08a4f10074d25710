"""What a file of motion planning problems says: start, goals and obstacles of each, checked on reading."""

from __future__ import annotations

import gzip
import json
import zlib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta, Struct

from robots.errors import BadInput

Vec3 = tuple[float, float, float]
Joints = tuple[float, ...]
Positive = Annotated[float, Meta(gt=0.0)]


class Obstacle(Struct, frozen=True, tag_field="type", kw_only=True):
    """A primitive of the world.

    Attributes:
        name: Its name.
        position: Of its centre in the world frame [m].
        quat_xyzw: Its orientation.
    """

    name: str
    position: Vec3
    quat_xyzw: tuple[float, float, float, float]


class Box(Obstacle, frozen=True, tag="box", kw_only=True):
    """A box; half extents [m]."""

    half_extents: tuple[Positive, Positive, Positive]


class Cylinder(Obstacle, frozen=True, tag="cylinder", kw_only=True):
    """A cylinder about its z axis; radius and full length [m]."""

    radius: Positive
    length: Positive


class Sphere(Obstacle, frozen=True, tag="sphere", kw_only=True):
    """A sphere; radius [m]."""

    radius: Positive


class Problem(Struct, frozen=True, kw_only=True):
    """One query.

    Attributes:
        scene: Name of its scene.
        index: Its number in the scene.
        start: Joint positions [rad].
        goals: Joint positions, any of which will do [rad].
        fingers: Opening of each finger [m].
        obstacles: What stands in the world.
    """

    scene: str
    index: int
    start: Joints
    goals: Annotated[tuple[Joints, ...], Meta(min_length=1)]
    fingers: tuple[float, float]
    obstacles: tuple[Box | Cylinder | Sphere, ...]


class _File(Struct, frozen=True):
    robot: str
    joints: tuple[str, ...]
    format: int
    problems: Annotated[tuple[Problem, ...], Meta(min_length=1)]


def load_problems(path: Path) -> tuple[Problem, ...]:
    """The problems of a ``.json`` or ``.json.gz`` file.

    Raises:
        BadInput: The file is missing, damaged or of another format; the message says where.
    """
    try:
        data = path.read_bytes()
        if data[:2] == b"\x1f\x8b":
            data = gzip.decompress(data)
    except (OSError, EOFError, zlib.error) as error:
        raise BadInput(f"Problem file {path} cannot be read: {error}") from error
    try:
        found = msgspec.json.decode(data, type=_File)
    except msgspec.MsgspecError as error:
        raise BadInput(f"Problem file {path} is not a motion problem file: {error}") from error
    if found.robot != "panda" or found.format != 1:
        raise BadInput(f"Problem file {path}: robot {found.robot!r}, format {found.format}; only panda, 1 is known.")
    for problem in found.problems:
        _check(problem, path)
    return found.problems


def _check(problem: Problem, path: Path) -> None:
    """Refuse joint positions that are not seven, and orientations that are none."""
    where = f"Problem file {path}: {problem.scene}/{problem.index}"
    for which, values in (("start", problem.start), *(("goal", goal) for goal in problem.goals)):
        if len(values) != 7:
            raise BadInput(f"{where}: the {which} has {len(values)} joint positions; 7 are needed.")
    for obstacle in problem.obstacles:
        length = sum(value * value for value in obstacle.quat_xyzw)
        if not 0.99 < length < 1.01:
            raise BadInput(f"{where}: the orientation of {obstacle.name} has length {length**0.5:.3f}, not 1.")


def spread(problems: Sequence[Problem], limit: int) -> tuple[Problem, ...]:
    """So many problems, taken in turn from every scene, in the file's order."""
    turn: Counter[str] = Counter()
    turns = []
    for problem in problems:
        turns.append(turn[problem.scene])
        turn[problem.scene] += 1
    chosen = sorted(range(len(problems)), key=lambda k: (turns[k], k))[:limit]
    return tuple(problems[k] for k in sorted(chosen))


def dump_paths(rows: list[dict[str, Any]]) -> str:
    """The text of a file of paths."""
    return json.dumps(rows, separators=(",", ":"))
