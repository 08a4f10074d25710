"""Tell what was tried, why it was rejected and where the search went back to."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from msgspec import Struct

from tamp.cli.output import Output


@dataclass(frozen=True)
class Arguments:
    """Arguments of ``bipre why``."""

    run_dir: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RUN_DIR")]
    """Run folder with a trace.json."""
    json: bool = False
    """One JSON object on stdout, nothing else."""
    debug: bool = False
    """Show tracebacks of input errors."""


class Tally(Struct, frozen=True):
    """Rejections of one stage for one cause."""

    stage: str
    arm: str
    cause: str
    count: int
    worst: float | None
    """Deepest penetration or largest miss [m]."""
    example: str
    back_to: str
    """Where the search went back to most often."""


def run(arguments: Arguments, output: Output) -> int:
    """Explain; 0 whenever the trace can be read."""
    from tamp.trace import load

    trace = load(arguments.run_dir)
    groups: dict[tuple[str, str, str], list[int]] = {}
    for number, rejection in enumerate(trace.rejections):
        key = (rejection.stage, rejection.arm, rejection.detail.split(",")[0] if rejection.bodies else rejection.cause)
        groups.setdefault(key, []).append(number)
    tallies = []
    for (stage, arm, _), numbers in groups.items():
        mine = [trace.rejections[k] for k in numbers]
        worst = max(mine, key=lambda r: r.amount or 0.0)
        back_to = Counter(r.blame for r in mine).most_common(1)[0][0]
        tallies.append(Tally(stage, arm, worst.cause, len(mine), worst.amount, worst.detail, back_to))
    tallies.sort(key=lambda tally: -tally.count)
    _show(trace.status, trace.skeletons, trace.chosen, tallies, output)
    if trace.failure is not None:
        output.console.print(f"failed at {trace.failure.stage} ({trace.failure.reason}): {trace.failure.detail}")
    output.emit(
        {
            "status": trace.status,
            "category": trace.category,
            "instance": trace.instance,
            "seed": trace.seed,
            "proposer": trace.proposer,
            "plan_seconds": trace.plan_seconds,
            "skeletons": trace.skeletons,
            "chosen": trace.chosen,
            "rejected": len(trace.rejections),
            "rejections": tallies,
            "failure": trace.failure,
        }
    )
    return 0


def _show(status: str, skeletons: list[list[str]], chosen: int | None, tallies: list[Tally], output: Output) -> None:
    from rich.table import Table

    console = output.console
    console.print(
        f"{status}: {len(skeletons)} skeleton(s) tried, {sum(t.count for t in tallies)} candidate(s) rejected"
    )
    for number, skeleton in enumerate(skeletons):
        console.print(f"  {number + 1}  {' '.join(skeleton)}{'   <- the plan' if number == chosen else ''}")
    if tallies:
        table = Table("times", "stage", "arm", "worst case", "back to", box=None, header_style="dim")
        for tally in tallies[:20]:
            table.add_row(str(tally.count), tally.stage, tally.arm, tally.example, tally.back_to)
        console.print(table)
    elif status != "no_plan":
        console.print("  every first candidate worked")
