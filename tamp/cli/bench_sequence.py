"""Measure planning time, duration and clearance of whole sequences: each is planned and verified, none executed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from robots.errors import BadInput
from tamp.cli.output import Output, Progress

if TYPE_CHECKING:
    from tamp.bench.sequence import SequenceRow


@dataclass(frozen=True)
class Arguments:
    """Arguments of ``bipre bench sequence``."""

    categories: str = "Bottle,Dispenser"
    """Columns with commas between, all, or handover."""
    seeds: int = 20
    """Episodes of each category: the first so many seeds of its list of seen objects."""
    proposer: str = "heuristic"
    """Where candidates come from."""
    timeout: float = 60.0
    """Wall time of one search [s]."""
    json: bool = False
    """One JSON object on stdout, nothing else."""
    debug: bool = False
    """Show tracebacks of input errors."""


def run(arguments: Arguments, output: Output) -> int:
    """Plan and verify; 0 when every episode has a plan and every plan is free of faults, else 1."""
    from tamp.bench.jobs import check_episodes, chosen_categories

    if arguments.seeds < 1:
        raise BadInput(f"--seeds {arguments.seeds}: give 1 or more.")
    check_episodes(arguments.seeds)
    if not (math.isfinite(arguments.timeout) and arguments.timeout > 0.0):
        raise BadInput(f"--timeout {arguments.timeout} is not a time; give seconds above 0.")
    categories = chosen_categories(arguments.categories)
    from tamp.bench.sequence import measure
    from tamp.proposers import check_proposer

    check_proposer(arguments.proposer)
    rows: list[SequenceRow] = []
    with TemporaryDirectory(prefix="bipre-") as scratch, Progress(output) as progress:
        for category in categories:
            progress.note(f"{category}: {arguments.seeds} sequences")
            rows.append(measure(category, arguments.seeds, arguments.proposer, arguments.timeout, Path(scratch)))
    show(rows, output)
    output.emit({"rows": rows})
    return 0 if all(row.verified == row.episodes for row in rows) else 1


def show(rows: list[SequenceRow], output: Output) -> None:
    """The measurements for people."""
    from rich.table import Table

    from tamp.cli.counting import print_table

    table = Table("category", box=None, header_style="dim")
    for name in ("planned", "verified", "plan, median", "p95", "makespan, median", "clearance, least", "median"):
        table.add_column(name, justify="right")
    for row in rows:
        table.add_row(
            row.category,
            f"{row.planned}/{row.episodes}",
            f"{row.verified}/{row.episodes}",
            _said(row.plan_seconds_median, 1.0, 2, "s"),
            _said(row.plan_seconds_p95, 1.0, 2, "s"),
            _said(row.makespan_median, 1.0, 1, "s"),
            _said(row.min_clearance, 1e3, 1, "mm"),
            _said(row.min_clearance_median, 1e3, 1, "mm"),
        )
    print_table(table, output)
    for row in rows:
        for fault in row.faults:
            output.console.print(f"{row.category}, seed {fault.seed}: {fault.detail}", markup=False)


def _said(value: float | None, scale: float, digits: int, unit: str) -> str:
    return "-" if value is None else f"{scale * value:.{digits}f} {unit}"
