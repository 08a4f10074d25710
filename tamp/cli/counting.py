"""What does a long run show while it counts: a bar on a terminal, a line now and then in a log."""

from __future__ import annotations

import time
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from tamp.cli.output import Output

if TYPE_CHECKING:
    from rich.table import Table

    from tamp.bench.row import Row
    from tamp.data.collect import Column, Targets

LINE_EVERY = 30.0
"""Time between two lines when stderr is no terminal [s]."""


LOG_WIDTH = 120
"""Width of a table when stderr is no terminal [characters]."""


def print_table(table: Table, output: Output) -> None:
    """A table as wide as the terminal, or wide enough to be read in a log."""
    from rich.console import Console

    wide = Console(stderr=True, highlight=False, width=LOG_WIDTH)
    (output.console if output.console.is_terminal else wide).print(table)


class Bars:
    """Progress bars on stderr with counts, rate and remaining time; plain lines when it is no terminal.

    Args:
        output: Where they go.
        note: Said when the run begins.
    """

    def __init__(self, output: Output, note: str = "") -> None:
        self.output, self.note = output, note
        self._bars: Any = None
        self._started = self._said = time.monotonic()
        self.count = 0
        """Episodes that ended since the beginning of this call."""

    def __enter__(self) -> Self:
        if self.output.console.is_terminal:
            from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

            columns = (
                TextColumn("{task.description}"),
                BarColumn(bar_width=30),
                MofNCompleteColumn(),
                TextColumn("{task.fields[note]}"),
                TimeRemainingColumn(),
            )
            self._bars = Progress(*columns, console=self.output.console, speed_estimate_period=600.0)
            self._bars.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bars is not None:
            self._bars.stop()

    def announce(self) -> None:
        """Say the note, if there is one."""
        if self.note:
            self.output.text(self.note)

    def add(self, words: str, total: int, done: int) -> Any:
        """A new bar; the handle is for ``set``."""
        return None if self._bars is None else self._bars.add_task(words, total=total, completed=done, note="")

    def set(self, bar: Any, done: int, note: str) -> None:
        """Move a bar and write beside it."""
        if self._bars is not None:
            self._bars.update(bar, completed=done, note=note)

    def line(self, words: str) -> None:
        """A line about how it goes, unless there are bars or the last one is recent."""
        if self._bars is None and time.monotonic() - self._said >= LINE_EVERY:
            self._said = time.monotonic()
            self.output.text(words)

    @property
    def per_hour(self) -> float:
        """Episodes an hour since the beginning of this call."""
        return 3600 * self.count / max(1e-9, time.monotonic() - self._started)


class BenchProgress(Bars):
    """How a benchmark goes on."""

    def __init__(self, output: Output, note: str = "") -> None:
        super().__init__(output, note)
        self.begun = False
        """Whether the folder was accepted and episodes run."""
        self._rows = self._good = self._total = 0
        self._bar: Any = None

    def begin(self, total: int, done: list[Row]) -> None:
        """So many episodes in all; some may be done already."""
        self.begun = True
        self._rows, self._good, self._total = len(done), sum(row.success for row in done), total
        self.announce()
        if done:
            self.output.text(f"{len(done)} of {total} episodes are done already")
        self._bar = self.add("episodes", total, len(done))

    def row(self, row: Row) -> None:
        """An episode ended."""
        self.count += 1
        self._rows += 1
        self._good += row.success
        rate = f"{self._good} succeeded, {self.per_hour / 60:.1f} a minute"
        self.set(self._bar, self._rows, rate)
        left = (self._total - self._rows) / max(1e-9, self.per_hour) * 60
        self.line(f"{self._rows} of {self._total} episodes, {rate}, {left:.0f} min left")


class CollectProgress(Bars):
    """How a collection goes on: a bar for each column's successes and failures together."""

    def __init__(self, output: Output, note: str = "") -> None:
        super().__init__(output, note)
        self.work_seconds = 0.0
        """Summed wall time of the attempts that ended in this call [s]."""
        self._bars_of: dict[str, Any] = {}
        self._columns: list[Column] = []
        self._wanted = 0

    def begin(self, columns: list[Column], targets: Targets) -> None:
        """It begins, perhaps with what earlier calls collected."""
        self.announce()
        self._columns, self._wanted = columns, targets.successes + targets.failures
        if kept := sum(column.successes + column.failures for column in columns):
            self.output.text(f"{kept} of {self._wanted * len(columns)} episodes are there already")
        for column in columns:
            self._bars_of[column.category] = self.add(column.category, self._wanted, column.successes + column.failures)

    def ended(self, column: Column, seconds: float) -> None:
        """An attempt ended after so many seconds of work."""
        self.count += 1
        self.work_seconds += seconds
        note = (
            f"{column.successes} + {column.failures} of {column.attempts} tried, {self.per_core_hour:.0f} a core-hour"
        )
        self.set(self._bars_of[column.category], column.successes + column.failures, note)
        kept = sum(each.successes + each.failures for each in self._columns)
        left = self._wanted * len(self._columns) - kept
        self.line(
            f"{kept} kept, {left} wanted, {self.count} tried in this call, "
            f"{self.per_core_hour:.0f} a core-hour, last {column.category}"
        )

    @property
    def per_core_hour(self) -> float:
        """Attempts an hour of one worker."""
        return 3600 * self.count / max(1e-9, self.work_seconds)
