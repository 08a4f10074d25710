"""How is a benchmark run: every episode once, whatever happens to it, to the process or to the machine?"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Protocol

import msgspec

from tamp import ledger
from tamp.bench.classes import failure_class
from tamp.bench.jobs import Job, Settings, jobs_of
from tamp.bench.row import Fault, Row
from tamp.episode import Report, Request, plan_episode
from tamp.pool import Crashed, Done, Finished, Hung, Raised, run_all
from worlds.tasks import task_of

EPISODES_FILE = "episodes.jsonl"
SCRATCH = "running"
"""Folder of the episodes in progress, inside the benchmark's; emptied when it begins and ends."""

SEARCHES = 4.0
"""An episode may take this many times the time limit of one search ..."""

GRACE = 240.0
"""... and so long for the rest [s], before it counts as hung. An execution takes seconds; a first object is built."""


class Watch(Protocol):
    """Something that shows how a benchmark goes on."""

    def begin(self, total: int, done: list[Row]) -> None:
        """So many episodes in all; some may be done already."""

    def row(self, row: Row) -> None:
        """An episode ended."""


Play = Callable[[Job], Row]


def play(job: Job, *, settings: Settings, scratch: Path) -> Row:
    """Run one episode in a folder of its own that is gone afterwards, and keep a row of it."""
    folder = scratch / job.key
    shutil.rmtree(folder, ignore_errors=True)
    try:
        return row_of(job, plan_episode(request_of(job, settings, folder)))
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def request_of(job: Job, settings: Settings, folder: Path) -> Request:
    """The episode of a job."""
    return Request(
        category=job.category,
        asset=settings.asset,
        split=None if job.named else job.split,
        instance=job.named,
        seed=job.seed,
        proposer=job.method,
        mode=job.mode,
        timeout=settings.timeout,
        out=folder,
        page=False,
    )


def row_of(job: Job, report: Report) -> Row:
    """What a report says, as a row."""
    failure = report.failure
    return Row(
        **msgspec.structs.asdict(job),
        task_type=task_of(job.category).type,
        instance=report.instance,
        status=report.status,
        success=report.success,
        stage=None if failure is None else failure.stage,
        reason=None if failure is None else failure.reason,
        detail="" if failure is None else failure.detail,
        failure_class=None
        if failure is None
        else failure_class(job.category, failure.stage, failure.reason, failure.detail),
        plan_seconds=report.plan_seconds,
        execute_seconds=report.execute_seconds,
        seconds=0.0,
        stages=[f"{stage.name}({stage.arm})" for stage in report.stages],
        candidates=sum(stage.candidates_tried for stage in report.stages),
    )


def fault_of(job: Job, fault: Fault, detail: str) -> Row:
    """The row of an episode that came to no outcome: a failure, and counted as one."""
    return Row(
        **msgspec.structs.asdict(job),
        task_type=task_of(job.category).type,
        instance=None,
        status=fault,
        success=False,
        reason=fault,
        detail=detail,
        failure_class="other",
        seconds=0.0,
    )


def run(settings: Settings, folder: Path, *, workers: int, watch: Watch, work: Play | None = None) -> list[Row]:
    """Run what is not done yet of a benchmark; returns every row in the order of the jobs.

    Each row is on disk before the next is waited for, so a killed run loses no more than the running episodes.

    Args:
        settings: What to run; the folder must be new, or that of a run with the same settings.
        folder: Where ``episodes.jsonl`` and ``settings.json`` are.
        workers: Episodes at the same time.
        watch: Shows progress.
        work: Runs one episode; without it ``play``.

    Raises:
        BadRunFolder: The folder cannot be used.
    """
    with ledger.claimed(folder, settings):
        scratch, file = folder / SCRATCH, folder / EPISODES_FILE
        shutil.rmtree(scratch, ignore_errors=True)
        done, wanted = rows_in(folder), jobs_of(settings)
        watch.begin(len(wanted), list(done.values()))
        missing = iter([job for job in wanted if job.key not in done])
        limit = SEARCHES * settings.timeout + GRACE
        task = work or partial(play, settings=settings, scratch=scratch.resolve())
        try:
            with closing(
                run_all(task, missing, workers=workers, limit=limit, log=(folder / ledger.LOG_FILE).resolve())
            ) as endings:
                for finished in endings:
                    row = _row(finished)
                    ledger.append(file, row)
                    done[row.job.key] = row
                    watch.row(row)
        finally:
            shutil.rmtree(scratch, ignore_errors=True)
    return [done[job.key] for job in wanted]


def rows_in(folder: Path) -> dict[str, Row]:
    """The rows that a folder has, by the key of their job."""
    return {row.job.key: row for row in ledger.rows(folder / EPISODES_FILE, Row)}


def _row(finished: Finished[Job, Row]) -> Row:
    match finished.ending:
        case Done(row):
            found = row
        case Raised(text, _):
            found = fault_of(finished.job, "error", text)
        case Crashed():
            found = fault_of(finished.job, "crashed", str(finished.ending))
        case Hung():
            found = fault_of(finished.job, "timed_out", str(finished.ending))
    return msgspec.structs.replace(found, seconds=round(finished.seconds, 3))
