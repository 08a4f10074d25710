"""Collect episodes to learn from: so many successes and failures of each column, in parallel, resumable.

Writes HDF5 shards (needs the extra `data`). The same command goes on where an interrupted one ended; larger targets
or further categories add to what is there. `bipre data DIR` counts and checks the result.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from robots.errors import BadInput
from tamp.cli.bench import left_out, worker_count
from tamp.cli.output import Output

if TYPE_CHECKING:
    from tamp.data.attempts import Settings
    from tamp.data.collect import Column, Targets

ATTEMPTS_EACH = 20
"""Attempts for each wanted episode of a column, without --max-attempts."""


@dataclass(frozen=True)
class Arguments:
    """Arguments of ``bipre collect``."""

    categories: str
    """Columns with commas between; all: the paper's eighteen; handover: the handover columns."""
    successes: int
    """Successful episodes wanted of each column."""
    failures: int
    """Failed episodes wanted of each column."""
    out: Path
    """Folder of the data set."""
    workers: int | None = None
    """Episodes at the same time; without it one a CPU core."""
    proposer: str = "heuristic"
    """Where candidates come from."""
    seed: int = 0
    """Decides every column's series of episode seeds."""
    max_attempts: int | None = None
    """Most episodes tried of each column; without it 20 for each wanted one."""
    asset: str = "synthetic"
    """Where the objects come from: synthetic, synthetic:COUNT for more to learn from, partnet:DIR or mesh:DIR."""
    split: Literal["seen", "unseen"] = "seen"
    """Which instances; unseen ones are for testing."""
    timeout: float = 60.0
    """Wall time of one search [s]."""
    json: bool = False
    """One JSON object on stdout, nothing else."""
    debug: bool = False
    """Show tracebacks of input errors."""


def run(arguments: Arguments, output: Output) -> int:
    """Collect what is missing; 0 when every target is met, else 1."""
    workers = worker_count(arguments.workers)
    _check_numbers(arguments)
    settings, targets, absent = plan_of(arguments)
    from tamp.cli.counting import CollectProgress
    from tamp.data.collect import collect

    started = time.monotonic()
    with CollectProgress(output, left_out(arguments.asset, absent)) as progress:
        columns = collect(settings, targets, arguments.out, workers=workers, watch=progress)
    met = all(column.met(targets) for column in columns)
    show(columns, targets, arguments.out, output)
    output.emit(
        {
            "complete": met,
            "out": str(arguments.out),
            "columns": [_told(column, targets) for column in columns],
            "episodes": sum(column.successes + column.failures for column in columns),
            "tried": progress.count,
            "seconds": round(time.monotonic() - started, 1),
            "per_core_hour": round(progress.per_core_hour, 1),
            "absent": absent,
        }
    )
    return 0 if met else 1


def _check_numbers(arguments: Arguments) -> None:
    for name in ("successes", "failures", "seed"):
        if (value := getattr(arguments, name)) < 0:
            raise BadInput(f"--{name} {value} is negative; give 0 or more.")
    if arguments.successes + arguments.failures == 0:
        raise BadInput("--successes 0 and --failures 0: nothing is wanted.")
    if arguments.max_attempts is not None and arguments.max_attempts < 1:
        raise BadInput(f"--max-attempts {arguments.max_attempts}: give 1 or more.")
    if not (math.isfinite(arguments.timeout) and arguments.timeout > 0.0):
        raise BadInput(f"--timeout {arguments.timeout} is not a time; give seconds above 0.")


def plan_of(arguments: Arguments) -> tuple[Settings, Targets, list[str]]:
    """What the arguments ask for, and the columns of a group for which the source has no objects."""
    from tamp.bench.jobs import chosen_categories, required
    from tamp.data.shards import require_h5py

    wanted = chosen_categories(arguments.categories)
    require_h5py()
    from tamp.data.attempts import Settings
    from tamp.data.collect import Targets
    from tamp.proposers import check_proposer

    check_proposer(arguments.proposer)
    found, absent = required(arguments.asset, wanted, [arguments.split], arguments.categories)
    settings = Settings(
        asset=arguments.asset,
        split=arguments.split,
        proposer=arguments.proposer,
        seed=arguments.seed,
        timeout=arguments.timeout,
    )
    limit = arguments.max_attempts or ATTEMPTS_EACH * (arguments.successes + arguments.failures)
    targets = Targets(categories=found, successes=arguments.successes, failures=arguments.failures, max_attempts=limit)
    return settings, targets, absent


def _told(column: Column, targets: Targets) -> dict[str, Any]:
    return {
        "category": column.category,
        "successes": column.successes,
        "failures": column.failures,
        "attempts": column.attempts,
        "complete": column.met(targets),
        "faults": column.faults,
    }


def show(columns: list[Column], targets: Targets, out: Path, output: Output) -> None:
    """The state of every column for people."""
    from rich.markup import escape
    from rich.table import Table

    from tamp.cli.counting import print_table

    console = output.console
    table = Table("category", box=None, header_style="dim")
    for name in ("successes", "failures", "tried", "without outcome"):
        table.add_column(name, justify="right")
    for column in columns:
        table.add_row(
            column.category,
            f"{column.successes}/{targets.successes}",
            f"{column.failures}/{targets.failures}",
            str(column.attempts),
            str(len(column.faults)),
        )
    print_table(table, output)
    for column in columns:
        if not column.met(targets):
            why = "given up after faults in a row" if column.attempts < targets.max_attempts else "--max-attempts"
            console.print(f"[yellow]{column.category} falls short[/yellow]: {why}, {column.attempts} tried")
        if column.faults:
            last = column.faults[-1]
            console.print(f"{column.category}, attempt {last.number}: {escape(last.detail)}")
    console.print(f"saved {out}/   check it with: bipre data {out}")
