"""How are episodes laid out on disk? HDF5 files of some episodes each, whose names hold their own checksum.

``shard-00007-1f2e3d4c5b6a.h5`` is shard 7; the rest is the beginning of the SHA-256 of the file. So a shard appears by
one rename, whole or not at all, and any later damage to any byte shows. Inside:

```
/                        format, version, settings (JSON)
/EPISODE                 one group an episode, EPISODE as in Bottle-000012: column and number of the attempt
    attributes           seed, category, instance, source, content_hash, split, task_type, instruction, proposer,
                         success, outcome, failure_stage, failure_reason, failure_detail, versions (JSON)
    clouds/MOMENT/       points (n, 3) float32 [m], normals (n, 3) float32, links (n,) uint8; attribute link_names
    poses/MOMENT         (links, 4, 4) float64, world frame; attribute link_names
    actions/             stage, arm, role, kind, T_world_hand (k, 4, 4), contact (k, 3), direction (k, 3), amount,
                         opening, score, outward (k, 3), start (k, 3), T_move (k, 4, 4)
    rejections/          stage, arm, role, cause, detail, blame, skeleton, candidate, amount (nan: none),
                         T_world_hand (m, 4, 4; nan: none), body and other_body that collide (empty: none),
                         checks (m, 5) int8 of ik, collision, path, timing, certificate: 1 passed, 0 failed, -1 unknown
```
"""

from __future__ import annotations

import hashlib
import importlib
import io
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from robots.cache import write_atomic
from robots.errors import BadRunFolder, MissingDependency
from tamp.record import ACTION_ARRAYS, CHECKS, MOMENTS, Action, Cloud, Recorded, check_labels
from tamp.trace import Failure, Rejection

FORMAT, VERSION = "bipremanip-data", 2
NAME = re.compile(r"shard-(\d{5,})-([0-9a-f]{12})\.h5")

COMPRESSION = {"compression": "gzip", "compression_opts": 4, "shuffle": True}
"""Of clouds and rejections, which are most of a shard."""

SHORT = 16
"""Rows below which compression costs more than it saves."""

SCALARS = ("seed", "category", "instance", "source", "content_hash", "split", "task_type", "instruction", "proposer")
ACTION_WORDS, ACTION_NUMBERS = ("stage", "arm", "role", "kind"), ("amount", "opening", "score")
REJECTION_WORDS, REJECTION_COUNTS = ("stage", "arm", "role", "cause", "detail", "blame"), ("skeleton", "candidate")


def require_h5py() -> Any:
    """The library; ``MissingDependency`` with the pip line when it is not installed."""
    try:
        return importlib.import_module("h5py")
    except ImportError as error:
        raise MissingDependency("h5py", "data", "A data set") from error


@dataclass(frozen=True, slots=True, eq=False)
class Entry:
    """An episode of a data set.

    Attributes:
        name: Column and number of the attempt, for example ``Bottle-000012``.
        recorded: The episode.
    """

    name: str
    recorded: Recorded


class DamagedShard(BadRunFolder):
    """A shard that is not what was written."""


def entry_name(category: str, number: int) -> str:
    """The name of an attempt's episode."""
    return f"{category}-{number:06d}"


def number_in(name: str) -> tuple[str, int]:
    """Column and attempt number of an episode's name."""
    category, _, number = name.rpartition("-")
    return category, int(number)


def shard_paths(folder: Path) -> list[Path]:
    """The shards of a folder in order."""
    return sorted(path for path in folder.iterdir() if NAME.fullmatch(path.name))


def shard_number(path: Path) -> int:
    """The number in a shard's name."""
    match = NAME.fullmatch(path.name)
    assert match is not None  # only shard paths come here
    return int(match[1])


# -- writing -----------------------------------------------------------------------------------------------------------


def write_shard(folder: Path, number: int, entries: list[Entry], settings: str) -> Path:
    """Write episodes as one shard; it appears whole or not at all.

    Args:
        folder: Where shards are.
        number: Of the shard.
        entries: The episodes.
        settings: The settings of the data set as JSON.
    """
    h5py = require_h5py()
    memory = io.BytesIO()
    with h5py.File(memory, "w") as file:
        file.attrs.update(format=FORMAT, version=VERSION, settings=settings)
        for entry in entries:
            _put(file.create_group(entry.name), entry.recorded)
    data = memory.getvalue()
    return write_atomic(folder / f"shard-{number:05d}-{hashlib.sha256(data).hexdigest()[:12]}.h5", data)


def _put(group: Any, recorded: Recorded) -> None:
    for name in SCALARS:
        group.attrs[name] = getattr(recorded, name)
    failure = recorded.failure
    group.attrs["success"] = recorded.success
    group.attrs["outcome"] = recorded.outcome
    group.attrs["failure_stage"] = "" if failure is None else failure.stage
    group.attrs["failure_reason"] = "" if failure is None else failure.reason
    group.attrs["failure_detail"] = "" if failure is None else failure.detail
    group.attrs["versions"] = msgspec.json.encode(recorded.versions).decode()
    for moment, cloud in recorded.clouds.items():
        where = group.create_group(f"clouds/{moment}")
        where.attrs["link_names"] = list(cloud.link_names)
        for name in ("points", "normals", "links"):
            _put_array(where, name, getattr(cloud, name))
    for moment, poses in recorded.link_poses.items():
        stack = np.array(list(poses.values()), dtype=np.float64).reshape(-1, 4, 4)
        group.create_dataset(f"poses/{moment}", data=stack).attrs["link_names"] = list(poses)
    _put_actions(group.create_group("actions"), recorded.actions)
    _put_rejections(group.create_group("rejections"), recorded.rejections)


def _put_actions(group: Any, actions: tuple[Action, ...]) -> None:
    for name in ACTION_WORDS:
        _put_words(group, name, [getattr(action, name) for action in actions])
    for name in ACTION_NUMBERS:
        group.create_dataset(name, data=np.array([getattr(action, name) for action in actions], dtype=np.float64))
    for name, shape in ACTION_ARRAYS.items():
        stack = np.array([getattr(action, name) for action in actions], dtype=np.float64).reshape(-1, *shape)
        group.create_dataset(name, data=stack)


def _put_rejections(group: Any, rejections: tuple[Rejection, ...]) -> None:
    for name in REJECTION_WORDS:
        _put_words(group, name, [getattr(rejection, name) for rejection in rejections])
    for name in REJECTION_COUNTS:
        _put_array(group, name, np.array([getattr(r, name) for r in rejections], dtype=np.int32))
    amounts = [np.nan if r.amount is None else r.amount for r in rejections]
    poses = [np.full(16, np.nan) if r.approach is None else r.approach for r in rejections]
    checks = [check_labels(r.cause) for r in rejections]
    _put_array(group, "amount", np.array(amounts, dtype=np.float64))
    _put_array(group, "T_world_hand", np.array(poses, dtype=np.float64).reshape(-1, 4, 4))
    _put_array(group, "checks", np.array(checks, dtype=np.int8).reshape(-1, len(CHECKS)))
    for k, name in enumerate(("body", "other_body")):
        _put_words(group, name, ["" if r.bodies is None else r.bodies[k] for r in rejections])


def _put_words(group: Any, name: str, words: list[str]) -> None:
    """Words of one length, padded: unlike words of any length they can be compressed."""
    encoded = [word.encode() for word in words]
    kind = require_h5py().string_dtype(length=max([1, *map(len, encoded)]))
    group.create_dataset(name, data=np.array(encoded, dtype=kind), **(COMPRESSION if len(words) >= SHORT else {}))


def _put_array(group: Any, name: str, array: Any) -> None:
    group.create_dataset(name, data=array, **(COMPRESSION if len(array) >= SHORT else {}))


# -- reading -----------------------------------------------------------------------------------------------------------


def read_shard(path: Path) -> Iterator[Entry]:
    """The episodes of a shard.

    Raises:
        DamagedShard: The file is cut off, changed, or of another format or version.
    """
    h5py = require_h5py()
    data = path.read_bytes()
    match = NAME.fullmatch(path.name)
    if match is None or hashlib.sha256(data).hexdigest()[:12] != match[2]:
        raise DamagedShard(f"{path} is not what was written: its checksum is not the one in its name.")
    try:
        with h5py.File(io.BytesIO(data), "r") as file:
            found = (str(file.attrs["format"]), int(file.attrs["version"]))
            if found != (FORMAT, VERSION):
                raise DamagedShard(f"{path} is a {found[0]} of version {found[1]}; version {VERSION} is read.")
            for name in sorted(file):
                yield Entry(name, _get(file[name]))
    except (OSError, KeyError, ValueError, TypeError, msgspec.DecodeError) as error:
        raise DamagedShard(f"{path} cannot be read as a shard: {error}.") from error


def outcomes_in(path: Path) -> dict[str, bool]:
    """Whether each of a shard's episodes was a success, by name, without reading or checking the rest.

    Raises:
        DamagedShard: The file cannot be read.
    """
    try:
        with require_h5py().File(path, "r") as file:
            return {name: bool(file[name].attrs["success"]) for name in sorted(file)}
    except (OSError, KeyError, ValueError) as error:
        raise DamagedShard(
            f"{path} cannot be read as a shard: {error}. `bipre data {path.parent}` sets damaged shards aside."
        ) from error


def _get(group: Any) -> Recorded:
    attributes = group.attrs
    scalars: dict[str, Any] = {name: attributes[name] for name in SCALARS}
    failure = None
    if attributes["failure_reason"]:
        failure = msgspec.convert(
            {name: attributes[f"failure_{name}"] for name in ("stage", "reason", "detail")}, type=Failure
        )
    clouds, poses = group.get("clouds", {}), group.get("poses", {})
    return Recorded(
        **{**scalars, "seed": int(scalars["seed"])},
        clouds={moment: _get_cloud(clouds[moment]) for moment in MOMENTS if moment in clouds},
        link_poses={moment: _get_poses(poses[moment]) for moment in MOMENTS if moment in poses},
        actions=_get_actions(group["actions"]),
        rejections=_get_rejections(group["rejections"]),
        success=bool(attributes["success"]),
        outcome=attributes["outcome"],
        failure=failure,
        versions=msgspec.json.decode(attributes["versions"], type=dict[str, str]),
    )


def _get_cloud(group: Any) -> Cloud:
    names = tuple(str(name) for name in group.attrs["link_names"])
    return Cloud(group["points"][()], group["normals"][()], group["links"][()], names)


def _get_poses(dataset: Any) -> dict[str, Any]:
    return {str(name): T for name, T in zip(dataset.attrs["link_names"], dataset[()], strict=True)}


def _get_actions(group: Any) -> tuple[Action, ...]:
    words = {name: _get_words(group[name]) for name in ACTION_WORDS}
    numbers = {name: group[name][()].tolist() for name in ACTION_NUMBERS}
    arrays = {name: group[name][()] for name in ACTION_ARRAYS}
    columns: dict[str, Any] = {**words, **numbers, **arrays}
    return tuple(Action(**{name: values[k] for name, values in columns.items()}) for k in range(len(words["stage"])))


def _get_rejections(group: Any) -> tuple[Rejection, ...]:
    columns: dict[str, Any] = {name: _get_words(group[name]) for name in REJECTION_WORDS}
    columns |= {name: group[name][()].tolist() for name in REJECTION_COUNTS}
    columns["amount"] = [None if np.isnan(value) else value for value in group["amount"][()].tolist()]
    flat = group["T_world_hand"][()].reshape(-1, 16)
    columns["approach"] = [None if np.isnan(row[0]) else row.tolist() for row in flat]
    pairs = zip(_get_words(group["body"]), _get_words(group["other_body"]), strict=True)
    columns["bodies"] = [pair if pair[0] else None for pair in pairs]
    count = len(columns["stage"])
    return tuple(
        msgspec.convert({name: values[k] for name, values in columns.items()}, type=Rejection) for k in range(count)
    )


def _get_words(dataset: Any) -> list[str]:
    return [str(word) for word in dataset.asstr()[()]]
