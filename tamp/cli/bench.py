"""Measure success rates over the benchmark's columns: fixed seeds, every failure counted, resumable.

Each column and split has 100 committed seeds (tamp/bench/seeds.json). Writes episodes.jsonl (a line an episode),
results.json, results.csv and report.html. The same command goes on where an interrupted one ended.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robots.errors import BadInput
from tamp.cli.output import Output

if TYPE_CHECKING:
    from tamp.bench.jobs import Settings
    from tamp.bench.results import Results

FAULTS_NAMED = 10
"""Faults that are spelt out on the terminal."""


@dataclass(frozen=True)
class Arguments:
    """Arguments of ``bipre bench``."""

    methods: str = "all"
    """Proposers, with commas between, or all: those without networks, and those whose weights are here."""
    mode: str = "E2"
    """E1: the best candidate of each stage only. E2: resampling. E3: closed loop. Several with commas between."""
    categories: str = "all"
    """Columns with commas between; all: the paper's eighteen; handover: the handover columns."""
    split: str = "seen,unseen"
    """seen, unseen or both."""
    asset: str = "synthetic"
    """Where the objects come from: synthetic, partnet:DIR or mesh:DIR."""
    episodes: int = 100
    """Of each method, mode, category and split: the first so many seeds of its list."""
    every_instance: bool = False
    """Try each usable instance --episodes times, instead of the one that the seed chooses."""
    workers: int | None = None
    """Episodes at the same time; without it one a CPU core."""
    timeout: float = 60.0
    """Wall time of one search [s]."""
    out: Path = Path("runs/bench")
    """Folder of the results."""
    json: bool = False
    """One JSON object on stdout, nothing else."""
    debug: bool = False
    """Show tracebacks of input errors."""


def run(arguments: Arguments, output: Output) -> int:
    """Run what is not done yet; 0 when every episode came to an outcome, good or bad, else 1."""
    workers = worker_count(arguments.workers)
    settings, absent = settings_of(arguments)
    from tamp.bench.report import write
    from tamp.bench.results import summarise
    from tamp.bench.run import rows_in
    from tamp.bench.run import run as run_benchmark
    from tamp.cli.counting import BenchProgress

    with BenchProgress(output, left_out(arguments.asset, absent)) as progress:
        try:
            rows = run_benchmark(settings, arguments.out, workers=workers, watch=progress)
        except KeyboardInterrupt:
            if progress.begun:
                rows = list(rows_in(arguments.out).values())
                write(summarise(settings, rows, absent, str(arguments.out)), arguments.out)
            raise
    results = summarise(settings, rows, absent, str(arguments.out))
    write(results, arguments.out)
    show(results, output)
    output.emit(results)
    return 1 if results.faults else 0


def worker_count(asked: int | None) -> int:
    """How many worker processes to use."""
    if asked is None:
        return len(os.sched_getaffinity(0))
    if asked < 1:
        raise BadInput(f"--workers {asked}: give 1 or more.")
    return asked


def left_out(asset: str, absent: list[str]) -> str:
    """A line about columns that a source does not have."""
    return f"not in {asset}, left out: {', '.join(absent)}" if absent else ""


def settings_of(arguments: Arguments) -> tuple[Settings, list[str]]:
    """What the arguments ask for, and the columns of a group for which the source has no objects.

    Raises:
        BadInput: Something cannot be used; nothing has been written then.
    """
    from tamp.bench.jobs import MODES, SPLITS, Settings, check_episodes, chosen, chosen_categories

    check_episodes(arguments.episodes)
    if not (math.isfinite(arguments.timeout) and arguments.timeout > 0.0):
        raise BadInput(f"--timeout {arguments.timeout} is not a time; give seconds above 0.")
    modes: list[Any] = chosen("mode", arguments.mode, MODES)
    splits: list[Any] = chosen("split", arguments.split, SPLITS)
    wanted = chosen_categories(arguments.categories)
    from tamp import ledger
    from tamp.bench.jobs import required
    from tamp.plan import package_versions
    from tamp.proposers import PROPOSERS, check_proposer, usable_proposers

    methods = chosen("method", arguments.methods, usable_proposers() if arguments.methods == "all" else PROPOSERS)
    for method in methods:
        check_proposer(method)
    found, absent = required(arguments.asset, wanted, splits, arguments.categories, every=arguments.every_instance)
    return Settings(
        methods=methods,
        mode=modes,
        categories=found,
        split=splits,
        asset=arguments.asset,
        episodes=arguments.episodes,
        every_instance=arguments.every_instance,
        timeout=arguments.timeout,
        versions=package_versions(),
        program=ledger.program_digest(),
    ), absent


def show(results: Results, output: Output) -> None:
    """The results for people."""
    from rich.markup import escape
    from rich.table import Table

    from tamp.cli.counting import print_table

    console = output.console
    table = Table("method", "mode", "category", "split", box=None, header_style="dim")
    for name in ("success", "rate", "95 % interval", "plan, median"):
        table.add_column(name, justify="right")
    table.add_column("commonest failure")
    for rate in results.rows:
        worst = next(iter(rate.failures.items()), None)
        table.add_row(
            rate.method,
            rate.mode,
            rate.category,
            rate.split,
            f"{rate.successes}/{rate.episodes}",
            f"{100 * rate.rate:.0f} %",
            f"{100 * rate.ci_low:.0f} to {100 * rate.ci_high:.0f} %",
            "-" if rate.plan_seconds_median is None else f"{rate.plan_seconds_median:.2f} s",
            "" if worst is None else f"{worst[0]} ({worst[1]})",
        )
    print_table(table, output)
    for mean in results.means:
        console.print(
            f"{mean.method} {mean.mode}, {mean.task_type}, {mean.split}: mean of {mean.categories} "
            f"categories {100 * mean.rate:.1f} %, {mean.successes} of {mean.episodes} episodes"
        )
    for fault in results.faults[:FAULTS_NAMED]:
        console.print(f"[red]{fault.reason}[/red] {fault.episode}: {escape(fault.detail)}")
    if len(results.faults) > FAULTS_NAMED:
        console.print(f"... and {len(results.faults) - FAULTS_NAMED} more; all are in {results.out}/results.json")
    console.print(f"saved {results.out}/   open report.html in any browser")
