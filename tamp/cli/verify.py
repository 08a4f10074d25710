"""Check a saved plan independently of the planner: limits, continuity, every contact, against the true object."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from tamp.cli.output import Output, Progress


@dataclass(frozen=True)
class Arguments:
    """Arguments of ``bipre verify``."""

    run_dir: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RUN_DIR")]
    """Run folder with a plan.json."""
    json: bool = False
    """One JSON object on stdout, nothing else."""
    debug: bool = False
    """Show tracebacks of input errors."""


def run(arguments: Arguments, output: Output) -> int:
    """Check and report; 0 when nothing is wrong, else 1."""
    from tamp.plan import load

    plan = load(arguments.run_dir)
    from tamp.verify import verify

    with Progress(output) as progress:
        progress.begin("verify")
        found = verify(plan)
    console = output.console
    verdict = "[green]ok[/green]" if found.ok else "[red]violations[/red]"
    console.print(
        f"{verdict}  {found.checked_states} states checked in {found.seconds:.1f} s, "
        f"clearance {1e3 * found.min_clearance:z.1f} mm, velocity {100 * found.max_velocity_ratio:.0f} % and "
        f"acceleration {100 * found.max_acceleration_ratio:.0f} % of the limits"
    )
    for violation in found.violations:
        where = f"{violation.stage}, step {violation.step}, at {violation.time:.2f} s"
        console.print(f"  {violation.kind} in {where}: {violation.detail}")
    output.emit(found)
    return 0 if found.ok else 1
