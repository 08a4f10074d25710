"""Is a data set what it should be: whole, free of doubles, without test objects among those that are trained on?"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from msgspec import Struct

from robots.errors import BadRunFolder
from tamp.bench.seeds import every_benchmark_seed
from tamp.data.pending import FOLDER as PENDING
from tamp.data.shards import DamagedShard, Entry, outcomes_in, read_shard, shard_paths
from tamp.record import Cloud, Recorded
from worlds.assets.asset import Split

QUARANTINE = "quarantine"

ROTATION_TOLERANCE = 1e-5
"""Largest deviation of ``R^T R`` from the identity that rounding explains."""

ProblemKind = Literal["damaged", "duplicate", "leakage", "values"]


class Problem(Struct, frozen=True, kw_only=True):
    """Something that is wrong."""

    kind: ProblemKind
    where: str
    """Shard or episode."""
    detail: str


class ColumnCount(Struct, frozen=True, kw_only=True):
    """What a data set has of a column."""

    category: str
    episodes: int
    successes: int
    failures: int
    instances: int
    outcomes: dict[str, int]
    """Episodes by outcome."""
    failing_stages: dict[str, int]
    """Failures by stage."""
    splits: dict[str, int]
    """Episodes by split."""
    rejections: int
    """Labelled candidates that the planner dropped."""


class Examination(Struct, frozen=True, kw_only=True):
    """The JSON object of ``bipre data``."""

    ok: bool
    folder: str
    shards: int
    episodes: int
    pending: int
    """Episodes more that are in no shard yet; `bipre collect` goes on with them."""
    columns: list[ColumnCount]
    problems: list[Problem]
    quarantined: list[str]
    """Damaged shards, and where they are now."""


@dataclass
class _Seen:
    """What was seen of the episodes until now, without their clouds."""

    names: dict[str, str] = field(default_factory=dict)
    seeds: dict[tuple[str, str, int], str] = field(default_factory=dict)
    hashes: dict[str, dict[Split, str]] = field(default_factory=dict)


def examine(folder: Path) -> Examination:
    """Read everything, count it and check it; damaged shards are moved to ``quarantine/``.

    Raises:
        BadRunFolder: There is no data set.
    """
    if not folder.is_dir():
        raise BadRunFolder(f"Data set {folder} does not exist.")
    paths, pending = shard_paths(folder), _pending(folder)
    if not paths and not pending:
        held = ", ".join(sorted(entry.name for entry in folder.iterdir())[:5]) or "nothing"
        raise BadRunFolder(f"{folder} has no shards (shard-NUMBER-CHECKSUM.h5); it holds {held}.")
    problems: list[Problem] = []
    quarantined: list[str] = []
    counts: dict[str, _Count] = {}
    seen = _Seen()
    for path in (*paths, *pending):
        try:
            entries = list(read_shard(path))
        except DamagedShard as error:
            aside = folder / QUARANTINE / path.name
            aside.parent.mkdir(exist_ok=True)
            path.replace(aside)
            quarantined.append(str(aside))
            problems.append(Problem(kind="damaged", where=path.name, detail=f"{error} It is now {aside}."))
            continue
        for entry in entries if path in paths else ():
            problems += _problems(entry, path, seen)
            counts.setdefault(entry.recorded.category, _Count()).add(entry.recorded)
    problems += _leakage(seen)
    return Examination(
        ok=not problems,
        folder=str(folder),
        shards=len(shard_paths(folder)),
        episodes=len(seen.names),
        pending=len(_pending(folder)),
        columns=[count.told(category) for category, count in sorted(counts.items())],
        problems=problems,
        quarantined=quarantined,
    )


def find(folder: Path, name: str) -> Entry:
    """The episode of that name.

    Raises:
        BadRunFolder: There is no data set, no such episode, or its shard is damaged.
    """
    if not folder.is_dir():
        raise BadRunFolder(f"Data set {folder} does not exist.")
    names: list[str] = []
    for path in shard_paths(folder):
        held = outcomes_in(path)
        if name in held:
            return next(entry for entry in read_shard(path) if entry.name == name)
        names += held
    listed = f"{names[0]} to {names[-1]}, {len(names)} in all" if names else "none"
    raise BadRunFolder(f'{folder} has no episode "{name}"; it has {listed}.')


def _pending(folder: Path) -> list[Path]:
    return shard_paths(folder / PENDING) if (folder / PENDING).is_dir() else []


def _problems(entry: Entry, path: Path, seen: _Seen) -> Iterator[Problem]:
    name, recorded = entry.name, entry.recorded
    key = (recorded.category, recorded.proposer, recorded.seed)
    if name in seen.names:
        yield Problem(kind="duplicate", where=name, detail=f"it is in {seen.names[name]} and in {path.name}")
    elif key in seen.seeds:
        yield Problem(kind="duplicate", where=name, detail=f"it has the seed of {seen.seeds[key]}, {recorded.seed}")
    seen.names.setdefault(name, path.name)
    seen.seeds.setdefault(key, name)
    seen.hashes.setdefault(recorded.content_hash, {}).setdefault(recorded.split, name)
    if recorded.seed in every_benchmark_seed():
        yield Problem(kind="leakage", where=name, detail=f"its seed {recorded.seed} is one of the benchmark's")
    if wrong := _wrong_value(recorded):
        yield Problem(kind="values", where=name, detail=wrong)


def _leakage(seen: _Seen) -> Iterator[Problem]:
    """Objects that are in both splits, whatever they are called."""
    for digest, splits in seen.hashes.items():
        if len(splits) > 1:
            both = ", ".join(f"{split} in {name}" for split, name in splits.items())
            yield Problem(kind="leakage", where=digest, detail=f"the object with this content hash is {both}")


def _wrong_value(recorded: Recorded) -> str | None:
    """The first value that cannot be."""
    if "initial" not in recorded.clouds:
        return "it has no initial cloud"
    for moment, cloud in recorded.clouds.items():
        if (wrong := _wrong_cloud(cloud)) is not None:
            return f"its {moment} cloud {wrong}"
    for moment, poses in recorded.link_poses.items():
        for link, T in poses.items():
            if not np.allclose(T[:3, :3].T @ T[:3, :3], np.eye(3), atol=ROTATION_TOLERANCE):
                return f"the pose of {link} at {moment} is no rigid motion"
    if recorded.success and not recorded.actions:
        return "it succeeded without an action"
    return None


def _wrong_cloud(cloud: Cloud) -> str | None:
    if not len(cloud.points):
        return "is empty"
    if not (np.isfinite(cloud.points).all() and np.isfinite(cloud.normals).all()):
        return "has values that are not finite"
    if int(cloud.links.max()) >= len(cloud.link_names):
        return f"has a link number {cloud.links.max()} but {len(cloud.link_names)} link names"
    return None


@dataclass
class _Count:
    """Counts of one column."""

    outcomes: Counter[str] = field(default_factory=Counter)
    stages: Counter[str] = field(default_factory=Counter)
    splits: Counter[str] = field(default_factory=Counter)
    instances: set[str] = field(default_factory=set)
    rejections: int = 0

    def add(self, recorded: Recorded) -> None:
        self.outcomes[recorded.outcome] += 1
        self.splits[recorded.split] += 1
        self.instances.add(recorded.instance)
        self.rejections += len(recorded.rejections)
        if recorded.failure is not None:
            self.stages[recorded.failure.stage] += 1

    def told(self, category: str) -> ColumnCount:
        return ColumnCount(
            category=category,
            episodes=self.outcomes.total(),
            successes=self.outcomes["ok"],
            failures=self.outcomes.total() - self.outcomes["ok"],
            instances=len(self.instances),
            outcomes=dict(self.outcomes.most_common()),
            failing_stages=dict(self.stages.most_common()),
            splits=dict(self.splits),
            rejections=self.rejections,
        )
