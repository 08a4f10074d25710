"""How is a data set collected: so many successes and failures of each column, with nothing lost or doubled by a kill?

Each column has its own series of attempts. They run in parallel but are taken in the order of their numbers, and kept
while their kind is still wanted; so what a data set holds depends on its settings and targets alone, not on the number
of workers, on which episode is faster, or on interruptions. An episode is in a shard before any later one of its column
is counted, so a kill costs only those that were not in a shard: they are played again, with the same seeds.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Protocol

import msgspec
from msgspec import Struct

from robots.cache import write_atomic
from robots.errors import BadRunFolder
from tamp import ledger
from tamp.bench.run import GRACE, SEARCHES
from tamp.data.attempts import Attempt, EpisodeOf, Settings, attempt, play, recording_episode
from tamp.data.pending import Pending
from tamp.data.shards import Entry, entry_name, number_in, outcomes_in, shard_number, shard_paths, write_shard
from tamp.pool import Done, Finished, Raised, run_all
from tamp.record import Recorded

PROGRESS_FILE = "progress.json"
SCRATCH = "running"

PER_SHARD = 25
"""Episodes of a shard; at some 200 kB each a shard is a few MB."""

FAULT_STREAK = 20
"""A column in which so many attempts in a row came to no outcome is given up."""


class Targets(Struct, frozen=True, kw_only=True):
    """How much of each column is wanted; may be raised when a collection goes on."""

    categories: list[str]
    successes: int
    failures: int
    max_attempts: int
    """Of each column, those of earlier calls included."""


class Fault(Struct, frozen=True, kw_only=True):
    """An attempt that came to no outcome."""

    number: int
    detail: str


class ColumnProgress(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What ``progress.json`` says of a column."""

    attempts: int
    """Every attempt below this number is dealt with for good."""
    faults: list[Fault]


@dataclass
class Column:
    """One column's series of attempts.

    Attributes:
        category: The column.
        successes: Kept so far.
        failures: Kept so far.
        attempts: Number of the first attempt that has not been taken yet.
        issued: Number of the next attempt to begin.
        waiting: Attempts that ended before an earlier one did.
        faults: Attempts that came to no outcome.
        streak: How many of the last attempts came to none.
    """

    category: str
    successes: int = 0
    failures: int = 0
    attempts: int = 0
    issued: int = 0
    waiting: dict[int, Finished[Attempt, Recorded]] = field(default_factory=dict)
    faults: list[Fault] = field(default_factory=list)
    streak: int = 0

    def wants(self, success: bool, targets: Targets) -> bool:
        """Whether another success, or failure, is wanted."""
        return self.successes < targets.successes if success else self.failures < targets.failures

    def met(self, targets: Targets) -> bool:
        """Whether nothing more is wanted."""
        return not (self.wants(True, targets) or self.wants(False, targets))

    def exhausted(self, targets: Targets) -> bool:
        """Whether no further attempt is begun, wanted or not."""
        return self.issued >= targets.max_attempts or self.streak >= FAULT_STREAK


class Watch(Protocol):
    """Something that shows how a collection goes on."""

    def begin(self, columns: list[Column], targets: Targets) -> None:
        """It begins, perhaps with what earlier calls collected."""

    def ended(self, column: Column, seconds: float) -> None:
        """An attempt ended after so many seconds of work."""


def collect(
    settings: Settings, targets: Targets, folder: Path, *, workers: int, watch: Watch, episode: EpisodeOf | None = None
) -> list[Column]:
    """Collect what is missing; returns each column's state, which may fall short of the targets.

    Args:
        settings: Which episodes; the folder must be new, or that of a data set with the same settings.
        targets: How many.
        folder: Where the shards are written.
        workers: Episodes at the same time.
        watch: Shows progress.
        episode: Plays an episode, in another process; without it ``tamp.recording.record_episode``.

    Raises:
        BadRunFolder: The folder cannot be used, or a shard in it is damaged.
    """
    with ledger.claimed(folder, settings):
        scratch = (folder / SCRATCH).resolve()
        shutil.rmtree(scratch, ignore_errors=True)
        collection = _Collection(settings, targets, folder)
        watch.begin(collection.columns, targets)
        work = partial(play, settings=settings, scratch=scratch, episode=episode or recording_episode())
        log, limit = (folder / ledger.LOG_FILE).resolve(), SEARCHES * settings.timeout + GRACE
        try:
            with closing(run_all(work, collection.jobs(), workers=workers, limit=limit, log=log)) as endings:
                for finished in endings:
                    watch.ended(collection.take(finished), finished.seconds)
        finally:
            collection.write()
            shutil.rmtree(scratch, ignore_errors=True)
    return collection.columns


class _Collection:
    """What has been collected, and what is not yet in a shard.

    Attributes:
        ready: Dealt with and wanted, for the next shard.
        unwanted: Dealt with; their files stay until progress beyond them is written down.
    """

    def __init__(self, settings: Settings, targets: Targets, folder: Path) -> None:
        self.settings, self.targets, self.folder = settings, targets, folder
        self.progress = _progress(folder)
        self.encoded = msgspec.json.encode(settings).decode()
        self.ready: list[Entry] = []
        self.unwanted: list[str] = []
        self.pending = Pending(folder, self.encoded)
        self.next_shard = 1 + max((shard_number(path) for path in _all_shards(folder)), default=-1)
        stored: dict[str, dict[int, bool]] = {}
        for path in shard_paths(folder):
            for name, success in outcomes_in(path).items():
                category, number = number_in(name)
                stored.setdefault(category, {})[number] = success
        self.columns = [
            _column(category, stored.get(category, {}), self.progress.get(category)) for category in targets.categories
        ]
        self._take_up(stored)

    def _take_up(self, stored: dict[str, dict[int, bool]]) -> None:
        """Treat what an earlier call played, but had in no shard, as if it ended now."""
        columns = {column.category: column for column in self.columns}
        for entry in self.pending.left:
            category, number = number_in(entry.name)
            column = columns.get(category)
            if number in stored.get(category, {}) or (column is not None and number < column.attempts):
                self.pending.drop([entry.name])  # it was dealt with, and the kill came before this
            elif column is not None:
                job = attempt(self.settings, category, number)
                column.waiting[number] = Finished(job, Done(entry.recorded), 0.0)
        for column in self.columns:
            self._advance(column)

    def jobs(self) -> Iterator[Attempt]:
        """Attempts as long as any are wanted, of the columns in turn."""
        while open_columns := [c for c in self.columns if not c.met(self.targets) and not c.exhausted(self.targets)]:
            column = min(open_columns, key=lambda c: c.issued)
            column.issued += 1
            if column.issued - 1 not in column.waiting:
                yield attempt(self.settings, column.category, column.issued - 1)

    def take(self, finished: Finished[Attempt, Recorded]) -> Column:
        """An attempt ended: deal with it, and with those that waited for it."""
        column = next(c for c in self.columns if c.category == finished.job.category)
        column.waiting[finished.job.number] = finished
        if isinstance(finished.ending, Done):
            self.pending.keep(Entry(entry_name(column.category, finished.job.number), finished.ending.value))
        self._advance(column)
        if len(self.ready) >= PER_SHARD:
            self.write()
        else:
            self._save_progress()
        return column

    def _advance(self, column: Column) -> None:
        """Deal with the attempts whose turn it is."""
        while (finished := column.waiting.pop(column.attempts, None)) is not None:
            column.attempts += 1
            self._deal_with(column, finished)
        column.issued = max(column.issued, column.attempts)

    def _deal_with(self, column: Column, finished: Finished[Attempt, Recorded]) -> None:
        number = finished.job.number
        if not isinstance(finished.ending, Done):
            said = finished.ending.text if isinstance(finished.ending, Raised) else str(finished.ending)
            column.faults.append(Fault(number=number, detail=said))
            column.streak += 1
            return
        column.streak, recorded = 0, finished.ending.value
        name = entry_name(column.category, number)
        if not column.wants(recorded.success, self.targets):
            self.unwanted.append(name)
            return
        if recorded.success:
            column.successes += 1
        else:
            column.failures += 1
        self.ready.append(Entry(name, recorded))

    def write(self) -> None:
        """Put what is ready into a shard."""
        done = [*self.unwanted, *(entry.name for entry in self.ready)]
        if self.ready:
            write_shard(self.folder, self.next_shard, self.ready, self.encoded)
            self.next_shard += 1
        self.ready, self.unwanted = [], []
        self._save_progress()
        self.pending.drop(done)

    def _save_progress(self) -> None:
        """Say how far each column is; attempts from the first that is not yet in a shard on may be needed again."""
        first: dict[str, int] = {}
        for entry in self.ready:
            category, number = number_in(entry.name)
            first[category] = min(number, first.get(category, number))
        for column in self.columns:
            safe = min(column.attempts, first.get(column.category, column.attempts))
            faults = [fault for fault in column.faults if fault.number < safe]
            self.progress[column.category] = ColumnProgress(attempts=safe, faults=faults)
        encoded = msgspec.json.format(msgspec.json.encode(self.progress), indent=1)
        write_atomic(self.folder / PROGRESS_FILE, encoded + b"\n")


def _all_shards(folder: Path) -> list[Path]:
    """Shards, those that were set aside included, so that no number is used twice."""
    aside = folder / "quarantine"
    return shard_paths(folder) + (shard_paths(aside) if aside.is_dir() else [])


def _progress(folder: Path) -> dict[str, ColumnProgress]:
    path = folder / PROGRESS_FILE
    if not path.is_file():
        return {}
    try:
        return msgspec.json.decode(path.read_bytes(), type=dict[str, ColumnProgress])
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise BadRunFolder(
            f"{path} cannot be read: {error}. Remove it; attempts that gave nothing run again."
        ) from error


def _column(category: str, stored: dict[int, bool], progress: ColumnProgress | None) -> Column:
    """A column as earlier calls left it: behind the last attempt that a shard has or that is known to be dealt with."""
    begun = max([0 if progress is None else progress.attempts, *(number + 1 for number in stored)])
    return Column(
        category=category,
        successes=sum(stored.values()),
        failures=len(stored) - sum(stored.values()),
        attempts=begun,
        issued=begun,
        faults=[] if progress is None else list(progress.faults),
    )
