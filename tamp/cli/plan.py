"""Plan a whole bimanual sequence for one object, check it, and execute it in the simulated cell.

Writes a run folder with plan.json, trace.json, observation.npz, plan.html and, with --video, execution.mp4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from affordance.variants import VARIANTS
from robots.errors import BadInput, UnknownName
from tamp.cli.output import Output, Progress
from worlds.tasks import TASKS

if TYPE_CHECKING:
    from tamp.episode import Mode, Report

PROPOSERS = ("heuristic", "uniform", *VARIANTS)
"""As in ``tamp.proposers``, which is not imported before the arguments are found usable."""


@dataclass(frozen=True)
class Arguments:
    """Arguments of ``bipre plan``."""

    category: Annotated[
        tyro.conf.Positional[str], tyro.conf.arg(metavar="CATEGORY", help=f"What to do: {', '.join(TASKS)}.")
    ]
    asset: str = "synthetic"
    """Where the object comes from: synthetic, partnet:DIR with a PartNet-Mobility folder, or mesh:DIR with a folder of
    meshes."""
    instance: str | None = None
    """Which instance; without it the seed chooses one. `bipre assets` lists them."""
    split: Literal["seen", "unseen"] | None = None
    """Choose among the seen or the held-out instances only."""
    seed: int = 0
    """Decides the instance, its pose and every draw of the search."""
    proposer: Annotated[
        str,
        tyro.conf.arg(
            help="Where candidates come from: networks, whole or without one of their parts: "
            f"{', '.join(VARIANTS)}; uniform, which knows the seen points; or heuristic, which knows the true object."
        ),
    ] = "learned"
    weights: Path | None = None
    """Weights of a learned proposer; without it those that are shipped."""
    workcell: str = "panda_pair"
    """Name of a shipped workcell, or a TOML file."""
    closed_loop: bool = False
    """Look again after each push and after a failed stage, and plan on from what is seen."""
    no_resample: bool = False
    """Try the best candidate of each stage and no other, and push once at the most."""
    no_overlap: bool = False
    """Let one arm wait at home until the other has finished its stage."""
    max_pushes: int = 3
    """How often the object may be pushed."""
    no_execute: bool = False
    """Stop once the plan is written."""
    timeout: float = 60.0
    """Wall time for the search [s]."""
    out: Path | None = None
    """Run folder; without it runs/CATEGORY-SOURCE-INSTANCE-seedN."""
    affordance_png: Path | None = None
    """Picture of the affordance maps of a learned proposer, as a PNG file."""
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
        weights=arguments.weights,
        workcell=arguments.workcell,
        execute=not arguments.no_execute,
        mode=_mode(arguments),
        overlap=not arguments.no_overlap,
        max_pushes=arguments.max_pushes,
        timeout=arguments.timeout,
        out=arguments.out,
        video=arguments.video,
    )
    with Progress(output) as progress:
        report = plan_episode(request, progress)
    if arguments.affordance_png is not None:
        from affordance.maps import load_maps
        from tamp.view.affordance import write_affordance_png

        write_affordance_png(load_maps(Path(report.run_dir)), arguments.affordance_png)
    show(report, output)
    output.emit(report)
    return 0 if report.status in ("success", "planned") else 1


def _check(arguments: Arguments) -> None:
    """Refuse what cannot work before anything heavy is loaded."""
    from worlds.tasks import task_of

    task_of(arguments.category)
    if arguments.proposer not in PROPOSERS:
        raise UnknownName("proposer", arguments.proposer, PROPOSERS)
    if arguments.affordance_png is not None:
        if arguments.proposer not in VARIANTS:
            raise BadInput(f"--affordance-png: the proposer {arguments.proposer} has no affordance maps.")
        from tamp.view.affordance import require_affordance_png

        require_affordance_png(arguments.affordance_png)
    if arguments.closed_loop and arguments.no_resample:
        raise BadInput("--closed-loop tries again and --no-resample does not; leave one of them out.")
    if arguments.closed_loop and arguments.no_execute:
        raise BadInput("--closed-loop needs the execution that --no-execute leaves out; leave one of them out.")
    if arguments.max_pushes < 1:
        raise BadInput(f"--max-pushes {arguments.max_pushes} is too few; give 1 or more.")
    if arguments.seed < 0:
        raise BadInput(f"--seed {arguments.seed} is negative; give 0 or more.")
    if not (math.isfinite(arguments.timeout) and arguments.timeout > 0.0):
        raise BadInput(f"--timeout {arguments.timeout} is not a time; give seconds above 0.")
    if arguments.out is not None and arguments.out.is_file():
        raise BadInput(f"--out {arguments.out} is a file; give a folder.")


def _mode(arguments: Arguments) -> Mode:
    """How the episode is run."""
    return "E3" if arguments.closed_loop else "E1" if arguments.no_resample else "E2"


def show(report: Report, output: Output) -> None:
    """A report for people."""
    from rich.table import Table

    console = output.console
    solved = {"success": "[green]success[/green]", "planned": "[green]planned[/green], not executed"}
    status = solved.get(report.status, f"[red]{report.status.replace('_', ' ')}[/red]")
    took = "plan found in" if report.stages else "searched"
    rounds = f" over {report.rounds} rounds; the last:" if report.rounds > 1 else ""
    console.print(
        f"{status}  {report.category} {report.instance}, seed {report.seed}, {report.proposer}: "
        f"{took} {report.plan_seconds:.1f} s{rounds}"
    )
    if report.stages:
        table = Table("stage", "arm", "role", "seconds", "candidates", "monitor", box=None, header_style="dim")
        for number, stage in enumerate(report.stages):
            check = report.checked[number] if number < len(report.checked) else None
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
