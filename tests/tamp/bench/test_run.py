"""No episode of a benchmark is lost, doubled or left out, whatever it or the machine does."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from robots.errors import BadRunFolder
from tamp.bench.jobs import Job, jobs_of
from tamp.bench.results import summarise
from tamp.bench.row import Row
from tamp.bench.run import EPISODES_FILE, rows_in, run
from tests.tamp.bench.rows import row, settings

WANTED = settings(methods=["heuristic", "uniform"], episodes=5)


def steady(job: Job) -> Row:
    """Follows from the seed; takes a moment."""
    time.sleep(0.05)
    return row(job, None if job.seed % 2 else "unreachable")


def unsteady(job: Job) -> Row:
    """As above, but some raise and some kill their process."""
    number = [each.key for each in jobs_of(WANTED)].index(job.key)
    if number % 7 == 2:
        raise RuntimeError("a bug")
    if number % 7 == 5:
        os.kill(os.getpid(), signal.SIGKILL)
    return steady(job)


def forbidden(job: Job) -> Row:
    """Nothing may be left to do."""
    raise AssertionError(job.key)


@dataclass
class Seen:
    """A watch that remembers."""

    done: int = -1
    rows: list[Row] = field(default_factory=list)

    def begin(self, total: int, done: list[Row]) -> None:
        assert total == len(jobs_of(WANTED))
        self.done = len(done)

    def row(self, row: Row) -> None:
        self.rows.append(row)


def test_every_job_has_one_row_even_when_it_raises_or_dies(tmp_path: Path) -> None:
    watch = Seen()
    rows = run(WANTED, tmp_path, workers=2, watch=watch, work=unsteady)
    assert [each.job for each in rows] == jobs_of(WANTED)
    for number, each in enumerate(rows):
        expected = {2: "error", 5: "crashed"}.get(number % 7)
        assert each.reason == (expected or (None if each.seed % 2 else "unreachable"))
        assert each.success == (each.reason is None)
        assert each.seconds > 0.0
    assert watch.done == 0
    assert sorted(each.job.key for each in watch.rows) == sorted(job.key for job in jobs_of(WANTED))
    results = summarise(WANTED, rows, [], "out")
    assert len(results.faults) == sum(k % 7 in (2, 5) for k in range(20))
    assert {fault.detail for fault in results.faults} == {
        "RuntimeError: a bug",
        "the worker process was killed by SIGKILL",
    }
    lines = (tmp_path / EPISODES_FILE).read_bytes()
    assert run(WANTED, tmp_path, workers=1, watch=Seen(), work=forbidden) == rows
    assert (tmp_path / EPISODES_FILE).read_bytes() == lines


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_a_killed_run_goes_on_where_it_ended(how: signal.Signals, tmp_path: Path) -> None:
    script = (
        "import signal\nsignal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from pathlib import Path\nfrom tamp.bench.run import run\nfrom tests.tamp.bench import test_run as t\n"
        f"run(t.WANTED, Path({str(tmp_path)!r}), workers=2, watch=t.Seen(), work=t.steady)\n"
    )
    file = tmp_path / EPISODES_FILE
    with subprocess.Popen([sys.executable, "-c", script], stderr=subprocess.DEVNULL) as process:
        while not file.is_file() or file.read_bytes().count(b"\n") < 4:
            assert process.poll() is None
            time.sleep(0.01)
        process.send_signal(how)
    before = rows_in(tmp_path)
    assert 4 <= len(before) < 20
    watch = Seen()
    rows = run(WANTED, tmp_path, workers=2, watch=watch, work=steady)
    assert [each.job for each in rows] == jobs_of(WANTED)
    assert watch.done == len(before)
    assert len(watch.rows) == 20 - len(before)
    assert {key: each for key, each in rows_in(tmp_path).items() if key in before} == before
    assert file.read_bytes().count(b"\n") == 20
    assert not list(tmp_path.glob("running/*"))


def test_other_settings_are_refused_and_change_nothing(tmp_path: Path) -> None:
    run(WANTED, tmp_path, workers=2, watch=Seen(), work=steady)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(BadRunFolder, match=r"begun with --methods heuristic,uniform, not heuristic;"):
        run(settings(episodes=5), tmp_path, workers=1, watch=Seen(), work=forbidden)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
