"""Serve a saved plan's scene to the browser, with a time line."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from robots.errors import BadInput
from tamp.cli.output import Output


@dataclass(frozen=True)
class Arguments:
    """Arguments of ``bipre view``."""

    run_dir: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RUN_DIR")]
    """Run folder with a plan.json."""
    port: int = 8080
    """First port tried."""
    json: bool = False
    """One JSON object on stdout, nothing else, once the server ends."""
    debug: bool = False
    """Show tracebacks of input errors."""


def run(arguments: Arguments, output: Output) -> int:
    """Serve until Ctrl-C, which ends it with 0: nothing is lost."""
    if not 1 <= arguments.port <= 65535:
        raise BadInput(f"--port {arguments.port} is not a port; give 1 to 65535.")
    from tamp import plan as plan_file
    from tamp import trace as trace_file

    plan, trace = plan_file.load(arguments.run_dir), trace_file.load(arguments.run_dir)
    from tamp.view.html import serve
    from worlds.observe import load

    observation = load(arguments.run_dir)
    serve(plan, observation.cloud, observation.colours, trace, arguments.port, say=output.text)
    output.emit({"run_dir": str(arguments.run_dir), "served": True})
    return 0
