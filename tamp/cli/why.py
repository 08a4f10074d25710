"""Tell what was tried, why it was rejected and where the search went back to."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from msgspec import Struct

from tamp.cli.output import Output

if TYPE_CHECKING:
    from tamp.trace import Trace


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


class Searched(Struct, frozen=True):
    """One search: the only one, or one of a closed loop's rounds."""

    status: str
    skeletons: list[list[str]]
    chosen: int | None
    """Number of the skeleton of the plan; ``None`` without a plan."""
    rejected: int
    rejections: list[Tally]


def run(arguments: Arguments, output: Output) -> int:
    """Explain; 0 whenever the trace can be read."""
    from tamp import folder
    from tamp.trace import load

    trace = load(arguments.run_dir)
    earlier = [_searched(load(place)) for place in folder.earlier_rounds(arguments.run_dir)]
    last = _searched(trace)
    for number, searched in enumerate([*earlier, last]):
        if earlier:
            output.console.print(f"round {number + 1} of {len(earlier) + 1}")
        _show(searched, output)
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
            "skeletons": last.skeletons,
            "chosen": last.chosen,
            "rejected": last.rejected,
            "rejections": last.rejections,
            "rounds": len(earlier) + 1,
            "earlier": earlier,
            "failure": trace.failure,
        }
    )
    return 0


def _searched(trace: Trace) -> Searched:
    """A trace summed up, the commonest rejections first."""
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
    return Searched(trace.status, trace.skeletons, trace.chosen, len(trace.rejections), tallies)


def _show(searched: Searched, output: Output) -> None:
    from rich.table import Table

    console = output.console
    console.print(
        f"{searched.status}: {len(searched.skeletons)} skeleton(s) tried, {searched.rejected} candidate(s) rejected"
    )
    for number, skeleton in enumerate(searched.skeletons):
        console.print(f"  {number + 1}  {' '.join(skeleton)}{'   <- the plan' if number == searched.chosen else ''}")
    if searched.rejections:
        table = Table("times", "stage", "arm", "worst case", "back to", box=None, header_style="dim")
        for tally in searched.rejections[:20]:
            table.add_row(str(tally.count), tally.stage, tally.arm, tally.example, tally.back_to)
        console.print(table)
    elif searched.status != "no_plan":
        console.print("  every first candidate worked")
