"""Does an episode of a data set come out the same when it is played again?"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from msgspec import Struct

from robots.errors import BadRunFolder
from tamp import ledger
from tamp.data.attempts import Attempt, EpisodeOf, Settings, play, recording_episode
from tamp.data.check import find
from tamp.data.shards import number_in
from tamp.record import Recorded
from tamp.trace import Failure


class Told(Struct, frozen=True, kw_only=True):
    """How an episode came out."""

    instance: str
    content_hash: str
    outcome: str
    success: bool
    failure: Failure | None
    versions: dict[str, str]


class Replay(Struct, frozen=True, kw_only=True):
    """The JSON object of ``bipre data DIR --replay EPISODE``."""

    episode: str
    same: bool
    """The outcome, the failure's stage and reason, and the actions are those that are stored."""
    differences: list[str]
    stored: Told
    now: Told


def replay(folder: Path, name: str, episode: EpisodeOf | None = None) -> Replay:
    """Play an episode again and compare.

    Args:
        folder: The data set.
        name: Of the episode, as ``bipre data`` and the shards have it.
        episode: Plays it; without it ``tamp.recording.record_episode``.

    Raises:
        BadRunFolder: There is no such episode, or its object has changed since.
    """
    stored = find(folder, name).recorded
    settings = ledger.read_settings(folder, Settings)
    category, number = number_in(name)
    again = Attempt(category=category, number=number, seed=stored.seed)
    with TemporaryDirectory(prefix="bipre-") as scratch:
        now = play(again, settings=settings, scratch=Path(scratch), episode=episode or recording_episode())
    if now.content_hash != stored.content_hash:
        raise BadRunFolder(
            f"{name} was played with {stored.instance} ({stored.content_hash}), now the seed gives {now.instance} "
            f"({now.content_hash}): the objects have changed since, and the episode cannot be played again."
        )
    differences = _differences(stored, now)
    return Replay(episode=name, same=not differences, differences=differences, stored=_told(stored), now=_told(now))


def _differences(stored: Recorded, now: Recorded) -> list[str]:
    found = []
    if stored.outcome != now.outcome:
        found.append(f"outcome {stored.outcome}, now {now.outcome}")
    was, is_now = _where(stored.failure), _where(now.failure)
    if was != is_now:
        found.append(f"failure {was}, now {is_now}")
    if [(a.stage, a.arm) for a in stored.actions] != [(a.stage, a.arm) for a in now.actions]:
        found.append("the actions are others")
    elif any(
        not np.array_equal(a.T_world_hand, b.T_world_hand) for a, b in zip(stored.actions, now.actions, strict=True)
    ):
        found.append("the actions are at other poses")
    return found


def _where(failure: Failure | None) -> str:
    return "none" if failure is None else f"{failure.reason} at {failure.stage}"


def _told(recorded: Recorded) -> Told:
    return Told(
        instance=recorded.instance,
        content_hash=recorded.content_hash,
        outcome=recorded.outcome,
        success=recorded.success,
        failure=recorded.failure,
        versions=recorded.versions,
    )
