"""Execute a saved plan again in a freshly built scene."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from tamp.cli.output import Output, Progress
from tamp.cli.plan import show


@dataclass(frozen=True)
class Arguments:
    """Arguments of ``bipre run``."""

    run_dir: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RUN_DIR")]
    """Run folder with a plan.json."""
    video: bool = False
    """Record the execution from two sides (needs the extra `video`)."""
    json: bool = False
    """One JSON object on stdout, nothing else."""
    debug: bool = False
    """Show tracebacks of input errors."""


def run(arguments: Arguments, output: Output) -> int:
    """Execute and report; 0 on success, else 1."""
    from tamp.plan import load

    load(arguments.run_dir)
    from tamp.episode import run_again

    with Progress(output) as progress:
        report = run_again(arguments.run_dir, video=arguments.video, watch=progress)
    show(report, output)
    output.emit(report)
    return 0 if report.success else 1
