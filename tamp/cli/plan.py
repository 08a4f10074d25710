"""Plan a whole bimanual sequence for one object, check it, and execute it in the simulated cell.

Writes a run folder with plan.json, trace.json, observation.npz, plan.html and, with --video, execution.mp4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from robots.errors import BadInput, UnknownName
from tamp.cli.output import Output, Progress

if TYPE_CHECKING:
    from tamp.episode import Report

PROPOSERS = ("heuristic",)


@dataclass(frozen=True)
class Arguments:
    """Arguments of ``bipre plan``."""

    category: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="CATEGORY")]
    """Bottle, Dispenser, Lighter, Pen-Button, Pen-Cap, Stapler or USB."""
    asset: str = "synthetic"
    """Where the object comes from: synthetic, or partnet:DIR with a PartNet-Mobility folder."""
    instance: str | None = None
    """Which instance; without it the seed chooses one. `bipre assets` lists them."""
    split: Literal["seen", "unseen"] | None = None
    """Choose among the seen or the held-out instances only."""
    seed: int = 0
    """Decides the instance, its pose and every draw of the search."""
    proposer: str = "heuristic"
    """Where candidates come from."""
    workcell: str = "panda_pair"
    """Name of a shipped workcell, or a TOML file."""
    closed_loop: bool = False
    """Observe and plan again between stages."""
    no_execute: bool = False
    """Stop once the plan is written."""
    timeout: float = 60.0
    """Wall time for the search [s]."""
    out: Path | None = None
    """Run folder; without it runs/CATEGORY-SOURCE-INSTANCE-seedN."""
    video: bool = False
    """Record the execution from two sides (needs the extra `video`)."""
    json: Annotated[bool, tyro.conf.arg(help="One JSON object on stdout, nothing else.")] = False
    debug: Annotated[bool, tyro.conf.arg(help="Show tracebacks of input errors.")] = False


def run(arguments: Arguments, output: Output) -> int:
    """Plan, execute and report; 0 on success (or a plan with --no-execute), else 1."""
    _check(arguments)
    from tamp.episode import Request, plan_episode

    request = Request(
        category=arguments.category,
        asset=arguments.asset,
        instance=arguments.instance,
        split=arguments.split,
        seed=arguments.seed,
        proposer=arguments.proposer,
        workcell=arguments.workcell,
        execute=not arguments.no_execute,
        timeout=arguments.timeout,
        out=arguments.out,
        video=arguments.video,
    )
    with Progress(output) as progress:
        report = plan_episode(request, progress)
    show(report, output)
    output.emit(report)
    return 0 if report.status in ("success", "planned") else 1


def _check(arguments: Arguments) -> None:
    """Refuse what cannot work before anything heavy is loaded."""
    from worlds.tasks import task_of

    task_of(arguments.category)
    if arguments.proposer not in PROPOSERS:
        raise UnknownName("proposer", arguments.proposer, PROPOSERS)
    if arguments.closed_loop:
        raise BadInput("--closed-loop is not available in this version; leave it out to plan offline.")
    if arguments.seed < 0:
        raise BadInput(f"--seed {arguments.seed} is negative; give 0 or more.")
    if not (math.isfinite(arguments.timeout) and arguments.timeout > 0.0):
        raise BadInput(f"--timeout {arguments.timeout} is not a time; give seconds above 0.")
    if arguments.out is not None and arguments.out.is_file():
        raise BadInput(f"--out {arguments.out} is a file; give a folder.")


def show(report: Report, output: Output) -> None:
    """A report for people."""
    from rich.table import Table

    console = output.console
    solved = {"success": "[green]success[/green]", "planned": "[green]planned[/green], not executed"}
    status = solved.get(report.status, f"[red]{report.status.replace('_', ' ')}[/red]")
    took = "plan found in" if report.stages else "searched"
    console.print(
        f"{status}  {report.category} {report.instance}, seed {report.seed}, {report.proposer}: "
        f"{took} {report.plan_seconds:.1f} s"
    )
    if report.stages:
        table = Table("stage", "arm", "role", "seconds", "candidates", "monitor", box=None, header_style="dim")
        said = {check.stage: check for check in report.checked}
        for stage in report.stages:
            check = said.get(stage.name)
            monitor = "" if check is None else f"{'yes' if check.true else 'NO'}: {check.fact}, {check.detail}"
            table.add_row(
                stage.name, stage.arm, stage.role, f"{stage.duration:.1f}", str(stage.candidates_tried), monitor
            )
        console.print(table)
    if report.failure is not None:
        console.print(
            f"failed at [bold]{report.failure.stage}[/bold] ({report.failure.reason}): {report.failure.detail}"
        )
        console.print(f"what was tried: bipre why {report.run_dir}")
    console.print(f"saved {report.run_dir}/   open plan.html in any browser")
