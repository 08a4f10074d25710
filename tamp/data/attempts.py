"""Which episodes does a data set try, in which order, and what does one of them give?"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

from msgspec import Struct

from tamp.bench.seeds import every_benchmark_seed, seed_at
from tamp.episode import Request
from tamp.record import Recorded
from worlds.assets.asset import Split

EpisodeOf = Callable[[Request], Recorded]
"""Plays an episode and keeps all that is learned from."""


class Settings(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All that decides which episodes a data set has; the names are those of the command line's flags."""

    asset: str
    split: Split
    proposer: str
    seed: int
    timeout: float
    """Wall time of one search [s]."""


class Attempt(Struct, frozen=True, kw_only=True):
    """One episode that is tried."""

    category: str
    number: int
    """In the column's own series, from 0."""
    seed: int


def attempt(settings: Settings, category: str, number: int) -> Attempt:
    """Attempt ``number`` of a column; its seed depends on nothing else, and is none of the benchmark's."""
    topic = f"bipremanip data {settings.seed}/{category}"
    while (seed := seed_at(topic, number)) in every_benchmark_seed():
        topic += "/again"
    return Attempt(category=category, number=number, seed=seed)


def request_of(tried: Attempt, settings: Settings, folder: Path) -> Request:
    """The episode of an attempt."""
    return Request(
        category=tried.category,
        asset=settings.asset,
        split=settings.split,
        seed=tried.seed,
        proposer=settings.proposer,
        timeout=settings.timeout,
        out=folder,
        page=False,
    )


def play(tried: Attempt, *, settings: Settings, scratch: Path, episode: EpisodeOf) -> Recorded:
    """Play one attempt in a folder of its own that is gone afterwards.

    Raises:
        ValueError: What was played is not what was asked for.
    """
    folder = scratch / f"{tried.category}-{tried.number}"
    shutil.rmtree(folder, ignore_errors=True)
    try:
        recorded = episode(request_of(tried, settings, folder))
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    if (recorded.category, recorded.seed) != (tried.category, tried.seed):
        raise ValueError(f"asked for {tried.category} {tried.seed}, got {recorded.category} {recorded.seed}")
    return recorded


def recording_episode() -> EpisodeOf:
    """What plays episodes outside of tests."""
    from tamp.recording import record_episode

    return record_episode
