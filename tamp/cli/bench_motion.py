"""Plan the problems of a MotionBenchMaker file and compare with other planners."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tamp.cli.output import Output, Progress


@dataclass(frozen=True)
class Arguments:
    """Arguments of ``bipre bench motion``."""

    problems: Path
    """A .json.gz file of problems."""
    limit: int | None = None
    """Only so many problems, taken in turn from every scene."""
    paths: Path | None = None
    """Write the final paths there."""
    methods: str = "ours"
    """Comma-separated: ours, ours-ompl, ompl-plain, roboplan, mplib (see make peers)."""
    seed: int = 1
    """Makes the run repeatable."""
    json: bool = False
    """One JSON object on stdout, nothing else."""
    debug: bool = False
    """Show tracebacks of input errors."""


def run(arguments: Arguments, output: Output) -> int:
    """Plan and report; 0 when the first method solved every problem, else 1."""
    from robots.errors import BadInput
    from tamp.motion_bench.bench import solve_all, write_paths
    from tamp.motion_bench.problems import load_problems, spread
    from tamp.motion_bench.rows import summary

    if arguments.limit is not None and arguments.limit < 1:
        raise BadInput(f"--limit must be at least 1, not {arguments.limit}.")
    problems = load_problems(arguments.problems)
    if arguments.limit is not None:
        problems = spread(problems, arguments.limit)
    methods = [name.strip() for name in arguments.methods.split(",") if name.strip()]
    if not methods:
        raise BadInput("--methods names no method.")
    with Progress(output) as progress:
        rows = solve_all(problems, methods, seed=arguments.seed, told=progress.note)
    if arguments.paths is not None:
        write_paths(arguments.paths, rows)
    found = summary(rows)
    _show(found, output)
    output.emit({"rows": [row.table() for row in rows], "summary": found})
    return 0 if all(row.solved for row in rows if row.method == methods[0]) else 1


def _show(found: dict[str, object], output: Output) -> None:
    from rich.table import Table

    head = (
        "method",
        "solved",
        "plan ms",
        "p95",
        "simplify ms",
        "certify ms",
        "all ms",
        "p95",
        "length rad",
        "scene ms",
    )
    table = Table(*head, box=None, header_style="dim")
    methods = found["methods"]
    assert isinstance(methods, dict)
    for name, row in methods.items():
        numbers = ("plan_ms_median", "plan_ms_p95", "simplify_ms_median", "certify_ms_median", "total_ms_median")
        rest = ("total_ms_p95", "length_median", "setup_ms_median")
        cells = [f"{row[key]:.2f}" for key in (*numbers, *rest)]
        table.add_row(name, f"{row['solved']}/{row['problems']}", *cells)
    output.console.print(table)
