"""A job that raises, dies or hangs is one ending among others; no job is lost or done twice."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import pytest

from robots.errors import BadInput
from tamp.pool import Crashed, Done, Finished, Hung, Raised, run_all


def work(job: str) -> str:
    """What the word says."""
    match job.split():
        case ["raise"]:
            raise ValueError("as asked")
        case ["refuse"]:
            raise BadInput("No such thing.")
        case ["exit"]:
            os._exit(7)
        case ["die"]:
            os.kill(os.getpid(), signal.SIGSEGV)
        case ["hang"]:
            time.sleep(3600)
        case ["speak"]:
            os.write(1, b"said on stdout\n")
            os.write(2, b"said on stderr\n")
    return f"{job} done, {os.environ['OMP_NUM_THREADS']} thread"


@pytest.fixture(scope="module")
def endings(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Finished[str, str]]:
    log = tmp_path_factory.mktemp("pool") / "log"
    jobs = ["one", "raise", "exit", "hang", "die", "refuse", "speak", "last"]
    found = {end.job: end for end in run_all(work, iter(jobs), workers=2, limit=8.0, log=log)}
    assert list(sorted(found)) == sorted(jobs)
    assert log.read_text() == "said on stdout\nsaid on stderr\n"
    return found


def test_results_come_back_from_single_threaded_workers(endings: dict[str, Finished[str, str]]) -> None:
    for job in ("one", "speak", "last"):
        assert endings[job].ending == Done(f"{job} done, 1 thread")


def test_an_exception_is_an_ending_with_its_trace(endings: dict[str, Finished[str, str]]) -> None:
    raised = endings["raise"].ending
    assert isinstance(raised, Raised)
    assert raised.text == "ValueError: as asked"
    assert 'raise ValueError("as asked")' in raised.trace
    refused = endings["refuse"].ending
    assert isinstance(refused, Raised)
    assert refused.text == "No such thing."


def test_a_dead_worker_is_an_ending_and_the_pool_goes_on(endings: dict[str, Finished[str, str]]) -> None:
    assert endings["exit"].ending == Crashed(7)
    assert endings["die"].ending == Crashed(-signal.SIGSEGV)
    assert str(endings["die"].ending) == "the worker process was killed by SIGSEGV"


def test_a_hanging_worker_is_killed_at_the_limit(endings: dict[str, Finished[str, str]]) -> None:
    assert endings["hang"].ending == Hung(8.0)
    assert 8.0 <= endings["hang"].seconds < 12.0


def test_jobs_are_drawn_when_a_worker_is_free_and_closing_ends_the_rest(tmp_path: Path) -> None:
    drawn: list[str] = []

    def jobs() -> object:
        for word in ("one", "hang", "two", "three"):
            drawn.append(word)
            yield word

    started = time.monotonic()
    with closing(run_all(work, jobs(), workers=2, limit=100.0, log=tmp_path / "log")) as endings:  # type: ignore[arg-type]
        assert next(endings).job == "one"
        assert drawn == ["one", "hang"]
    assert time.monotonic() - started < 20.0


def test_workers_end_when_their_parent_is_killed(tmp_path: Path) -> None:
    """A ``kill -9`` of the command leaves nothing running."""
    script = (
        "import sys\nfrom pathlib import Path\nfrom tests.tamp.test_pool import work\nfrom tamp.pool import run_all\n"
        f"log = Path({str(tmp_path)!r}) / 'log'\n"
        "for end in run_all(work, iter(['speak', 'hang']), workers=1, limit=3600.0, log=log):\n"
        "    print(end.job, flush=True)\n"
    )
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        assert parent.stdout.readline() == "speak\n"
        children = Path(f"/proc/{parent.pid}/task/{parent.pid}/children").read_text().split()
        assert children
        parent.kill()
        parent.wait()
    until = time.monotonic() + 10.0
    while any(_alive(pid) for pid in children):
        assert time.monotonic() < until, "a worker outlived its parent"
        time.sleep(0.05)


def _alive(pid: str) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False
