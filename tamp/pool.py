"""How are many episodes run at once, so that one that raises, dies or hangs costs nothing but itself?

``concurrent.futures`` declares the whole pool broken when one process dies, and cannot end one that hangs. Here every
worker has its own pipe: its death or silence is seen, is the result of the job it had, and is answered by a new worker.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import connection, get_context, parent_process
from pathlib import Path
from typing import Any, Generic, TypeVar

from robots.errors import TampError

Job = TypeVar("Job")
Result = TypeVar("Result")

SINGLE_THREADED = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Set to 1 in workers: with one process a core, threads inside the libraries only get in each other's way."""

PATIENCE = 2.0
"""How long a worker that was told to end may take before it is killed [s]."""


@dataclass(frozen=True, slots=True)
class Done(Generic[Result]):
    """The job's result."""

    value: Result


@dataclass(frozen=True, slots=True)
class Raised:
    """The job ended in an exception.

    Attributes:
        text: Its type and message.
        trace: The traceback.
    """

    text: str
    trace: str


@dataclass(frozen=True, slots=True)
class Crashed:
    """The worker's process died.

    Attributes:
        code: Its exit code; a negative one is the signal that killed it.
    """

    code: int

    def __str__(self) -> str:
        if self.code >= 0:
            return f"the worker process ended with exit code {self.code}"
        with suppress(ValueError):
            return f"the worker process was killed by {signal.Signals(-self.code).name}"
        return f"the worker process was killed by signal {-self.code}"


@dataclass(frozen=True, slots=True)
class Hung:
    """The job took longer than the limit, and its worker was killed.

    Attributes:
        limit: The limit [s].
    """

    limit: float

    def __str__(self) -> str:
        return f"no answer within {self.limit:g} s; the worker process was killed"


@dataclass(frozen=True, slots=True)
class Finished(Generic[Job, Result]):
    """A job and how it ended.

    Attributes:
        job: The job.
        ending: Its result, or what happened instead.
        seconds: Wall time [s].
    """

    job: Job
    ending: Done[Result] | Raised | Crashed | Hung
    seconds: float


def run_all(
    work: Callable[[Job], Result], jobs: Iterator[Job], *, workers: int, limit: float, log: Path
) -> Generator[Finished[Job, Result], None, None]:
    """Every job with its ending, in the order in which they end; closing the generator kills what still runs.

    Args:
        work: A picklable function; runs in fresh processes.
        jobs: Drawn one by one, when a worker is free.
        workers: Processes at the same time.
        limit: Wall time of one job [s], a new worker's start included.
        log: What workers write to stdout and stderr is appended to this file.
    """
    crew = [_Worker[Job, Result](work, log) for _ in range(workers)]
    try:
        while True:
            for worker in crew:
                if worker.idle and (job := next(jobs, None)) is not None:
                    worker.assign(job)
            busy = [worker for worker in crew if not worker.idle]
            if not busy:
                return
            _wait(busy, limit)
            for worker in busy:
                if (finished := worker.poll(limit)) is not None:
                    yield finished
    finally:
        for worker in crew:
            worker.end()


class _Worker(Generic[Job, Result]):
    """One process and its pipe; the process begins with the first job, and again after a death."""

    def __init__(self, work: Callable[[Job], Result], log: Path) -> None:
        self.work, self.log = work, log
        self.process: Any = None
        self.pipe: connection.Connection[Any, Any] | None = None
        self.job: Job | None = None
        self.started = 0.0

    @property
    def idle(self) -> bool:
        return self.job is None

    def assign(self, job: Job) -> None:
        self.job, self.started = job, time.monotonic()
        if self.pipe is not None:
            with suppress(OSError):
                self.pipe.send(job)
                return
            self._kill()  # it died between two jobs
        self._begin().send(job)

    def poll(self, limit: float) -> Finished[Job, Result] | None:
        """How the job ended, if it did."""
        assert self.job is not None and self.pipe is not None
        job, seconds = self.job, time.monotonic() - self.started
        ending: Done[Result] | Raised | Crashed | Hung
        if self.pipe.poll():
            try:
                ending = self.pipe.recv()
            except (EOFError, OSError):
                ending = self._crashed()
        elif not self.process.is_alive():
            ending = self._crashed()
        elif seconds >= limit:
            self._kill()
            ending = Hung(limit)
        else:
            return None
        self.job = None
        return Finished(job, ending, seconds)

    def end(self) -> None:
        """End an idle process by closing its pipe, any other by force."""
        if self.pipe is not None and self.idle:
            self.pipe.close()
            self.process.join(PATIENCE)
        self._kill()

    def _begin(self) -> connection.Connection[Any, Any]:
        context = get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(self.work, theirs, self.log), daemon=True)
        with _environment(dict.fromkeys(SINGLE_THREADED, "1")):
            self.process.start()
        theirs.close()
        return self.pipe

    def _crashed(self) -> Crashed:
        self.process.join(PATIENCE)
        code = self.process.exitcode
        self._kill()
        return Crashed(-signal.SIGKILL if code is None else code)

    def _kill(self) -> None:
        if self.process is not None:
            self.process.kill()
            self.process.join()
        if self.pipe is not None:
            self.pipe.close()
        self.process = self.pipe = None


def _wait(busy: list[_Worker[Job, Result]], limit: float) -> None:
    """Sleep until one of them has said something, died or reached the limit."""
    first = min(worker.started for worker in busy) + limit - time.monotonic()
    things = [thing for worker in busy for thing in (worker.pipe, worker.process.sentinel)]
    connection.wait([thing for thing in things if thing is not None], timeout=max(0.0, first))


@contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    """Environment variables that new processes inherit."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value


def _serve(work: Callable[[Any], Any], pipe: connection.Connection[Any, Any], log: Path) -> None:
    """The life of a worker: jobs in, endings out, until the pipe closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides what Ctrl-C ends
    _write_to(log)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    while True:
        try:
            job = pipe.recv()
        except EOFError:
            return
        pipe.send(_ending(work, job))


def _ending(work: Callable[[Any], Any], job: Any) -> Done[Any] | Raised:
    try:
        return Done(work(job))
    except Exception as error:  # whatever it is, it belongs to this job and not to the pool
        text = str(error) if isinstance(error, TampError) else f"{type(error).__name__}: {error}"
        return Raised(text, traceback.format_exc())


def _write_to(log: Path) -> None:
    handle = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    sys.stdout.flush()
    sys.stderr.flush()
    os.dup2(handle, 1)
    os.dup2(handle, 2)
    os.close(handle)


def _end_with_parent() -> None:
    """A killed parent leaves no workers behind."""
    parent = parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
