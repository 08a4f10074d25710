"""Train the networks on collected episodes; the same command goes on where an interrupted one ended.

Writes OUT/checkpoint.safetensors every minute, log.jsonl and curves.png, and at the end weights.safetensors, which
`bipre plan --proposer learned --weights` reads (needs the extra `learn`).
"""

from __future__ import annotations

import importlib.util
import math
import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import msgspec
from msgspec import Struct

from robots.errors import BadInput, MissingDependency
from tamp.cli.output import Output

if TYPE_CHECKING:
    from affordance.settings import Settings


class Begun(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All that a training keeps when it goes on; data and steps may grow."""

    profile: str | None
    preset: str | None
    head: str | None
    no_anticipation: bool
    no_object_pose: bool
    batch: int
    start: str
    adapt: str
    rate: float
    bf16: bool
    seed: int
    device: str


@dataclass(frozen=True)
class Arguments:
    """Arguments of ``bipre train``."""

    data: str
    """Data sets of `bipre collect`, with commas between."""
    out: Path
    """Folder of the training."""
    steps: int | None = None
    """Steps in all; without it the profile's."""
    epochs: float | None = None
    """How often each example is seen, instead of --steps."""
    batch: int | None = None
    """Examples of a step."""
    profile: str | None = None
    """How many points are looked at: paper, default, cpu, shipped or test; without it shipped, or what --start has."""
    preset: str | None = None
    """Weights of the losses: default, sxy, biassembly or printed; without it default, or what --start has."""
    head: Literal["cvae", "flow"] | None = None
    """What draws orientations and poses; without it cvae, or what --start has."""
    no_anticipation: bool = False
    """The ablation that never shows the goal to the preparing arm."""
    no_object_pose: bool = False
    """The ablation without an object pose for the reorientation."""
    start: Path | None = None
    """Weights that the training begins with, instead of random ones."""
    rate: float | None = None
    """Learning rate of the first step."""
    bf16: bool = False
    """Half precision in the encoders: twice as fast on a CPU with AVX-512 BF16 or AMX; a GPU always does."""
    adapt: Path | None = None
    """Weights whose critics and maps are corrected on the data, while the actors stay."""
    seed: int = 0
    """Decides the first weights and every draw."""
    device: Literal["cpu", "cuda"] = "cpu"
    """Where it is computed."""
    threads: int | None = None
    """CPU threads; without it one a core."""
    dry_run: bool = False
    """Tell sizes, memory and time, and write nothing."""
    json: bool = False
    """One JSON object on stdout, nothing else."""
    debug: bool = False
    """Show tracebacks of input errors."""


def run(arguments: Arguments, output: Output) -> int:
    """Train to the last step; 0 when it was reached."""
    settings = _checked(arguments)
    from dataclasses import asdict

    from affordance.curves import write_curves
    from affordance.fit import Task, fit, forecast
    from affordance.train import LOG
    from tamp import ledger
    from tamp.learning import examples_in

    learned, held_out = examples_in([Path(name) for name in arguments.data.split(",")])
    settings = _timed(arguments, settings, len(learned))
    output.text(f"{len(learned)} examples to learn from, {len(held_out)} of objects kept aside")
    threads = arguments.threads or len(os.sched_getaffinity(0))
    start, adapting = arguments.adapt or arguments.start, arguments.adapt is not None
    task = Task(
        learned, held_out, settings, arguments.seed, arguments.device, threads, start, adapting, _asked(arguments)
    )
    if arguments.dry_run:
        expected = forecast(task)
        output.text(
            f"{expected.parameters / 1e6:.2f} M parameters, {expected.megabytes:.0f} MB, "
            f"{expected.seconds_per_step:.2f} s a step, {expected.hours:.2f} h for {expected.steps} steps"
        )
        output.emit(asdict(expected))
        return 0

    began: list[float] = []
    """Step and time of the first line."""

    def watch(step: int, line: Mapping[str, float]) -> None:
        each = (time.monotonic() - began[1]) / max(1, step - began[0]) if began else 0.0
        began.extend((step, time.monotonic()) if not began else ())
        left = (settings.training.steps - step) * each
        output.text(
            f"step {step} of {settings.training.steps}, loss {line['loss']:.3f}, about {left / 60:.0f} min left"
        )

    task.started()  # what cannot be begun with is refused before there is a folder
    with ledger.claimed(arguments.out, _begun(arguments, settings)):
        try:
            done = fit(task, arguments.out, watch)
        finally:
            if (arguments.out / LOG).is_file():
                write_curves(arguments.out / LOG, arguments.out / "curves.png")
    for name, value in done.validation.items():
        output.text(f"validation {name}: {value:.3f}")
    output.text(f"saved {done.weights}")
    output.emit(asdict(done))
    return 0


def _checked(arguments: Arguments) -> Settings:
    """What is built and how, after refusing what cannot work before anything heavy is loaded."""
    from affordance.settings import settings_of

    settings = settings_of(arguments.profile or "shipped", arguments.preset or "default")
    _check_numbers(arguments)
    _check_files(arguments)
    for package, what in (("torch", "Training"), ("h5py", "A data set"), ("PIL", "The picture of the curves")):
        if importlib.util.find_spec(package) is None:
            raise MissingDependency(package.replace("PIL", "pillow"), "learn", what)
    training = settings.training
    batch = training.batch if arguments.batch is None else arguments.batch
    rate = training.rate if arguments.rate is None else arguments.rate
    return msgspec.structs.replace(
        settings,
        training=msgspec.structs.replace(training, batch=batch, rate=rate, bf16=arguments.bf16),
        head=arguments.head or "cvae",
        anticipation=not arguments.no_anticipation,
        object_pose=not arguments.no_object_pose,
    )


def _asked(arguments: Arguments) -> tuple[str, ...]:
    """Settings that an option names."""
    given = {
        "profile": arguments.profile,
        "losses": arguments.preset,
        "head": arguments.head,
        "anticipation": arguments.no_anticipation,
        "object_pose": arguments.no_object_pose,
    }
    return tuple(name for name, value in given.items() if value)


def _check_numbers(arguments: Arguments) -> None:
    for name in ("steps", "batch", "threads"):
        value = getattr(arguments, name)
        if value is not None and value < 1:
            raise BadInput(f"--{name} {value}: give 1 or more.")
    if arguments.steps is not None and arguments.epochs is not None:
        raise BadInput("--steps and --epochs both say how long; leave one of them out.")
    if arguments.seed < 0:
        raise BadInput(f"--seed {arguments.seed} is negative; give 0 or more.")
    for name in ("epochs", "rate"):
        value = getattr(arguments, name)
        if value is not None and not (math.isfinite(value) and value > 0.0):
            raise BadInput(f"--{name} {value}: give a number above 0.")


def _check_files(arguments: Arguments) -> None:
    for name in ("start", "adapt"):
        path = getattr(arguments, name)
        if path is not None and not path.is_file():
            raise BadInput(f"--{name} {path}: there is no such file.")
    if arguments.start is not None and arguments.adapt is not None:
        raise BadInput("--start and --adapt both name weights to begin with; leave one of them out.")


def _timed(arguments: Arguments, settings: Settings, examples: int) -> Settings:
    """The settings with as many steps as were asked for."""
    training = settings.training
    steps = training.steps if arguments.steps is None else arguments.steps
    if arguments.epochs is not None:
        steps = max(1, round(arguments.epochs * examples / training.batch))
    return msgspec.structs.replace(settings, training=msgspec.structs.replace(training, steps=steps))


def _begun(arguments: Arguments, settings: Settings) -> Begun:
    return Begun(
        profile=arguments.profile,
        preset=arguments.preset,
        head=arguments.head,
        no_anticipation=arguments.no_anticipation,
        no_object_pose=arguments.no_object_pose,
        batch=settings.training.batch,
        start=str(arguments.start or ""),
        adapt=str(arguments.adapt or ""),
        rate=settings.training.rate,
        bf16=settings.training.bf16,
        seed=arguments.seed,
        device=arguments.device,
    )
