"""One call that trains in a folder, or tells what that would take."""

from __future__ import annotations

import functools
import resource
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from msgspec import structs

from affordance import checkpoint
from affordance.checkpoint import Checkpoint
from affordance.dataset import Dataset
from affordance.examples import Example
from affordance.networks import Model
from affordance.settings import Settings
from affordance.text import text_encoder
from affordance.train import CHECKPOINT, WEIGHTS, Fitting, begun, train
from affordance.trainlog import Watch
from robots.errors import BadInput


@dataclass(frozen=True, slots=True)
class Fitted:
    """How a training ended.

    Attributes:
        steps: Done in all.
        rows: Examples learned from.
        held_out: Examples of validation.
        parameters: Of the networks.
        loss: Of the last line of the log.
        validation: Its last numbers.
        weights: The file of weights.
        seconds: Wall time of this call [s].
    """

    steps: int
    rows: int
    held_out: int
    parameters: int
    loss: float
    validation: dict[str, float]
    weights: str
    seconds: float


@dataclass(frozen=True, slots=True)
class Forecast:
    """What a training would take.

    Attributes:
        rows, held_out, parameters: As in ``Fitted``.
        steps: Wanted.
        megabytes: Largest memory of this process, or on the GPU, after the steps that were tried [MB].
        seconds_per_step: Median of the steps that were tried [s].
        hours: Of all steps.
    """

    rows: int
    held_out: int
    parameters: int
    steps: int
    megabytes: float
    seconds_per_step: float
    hours: float


OPTIONS = {
    "profile": "--profile",
    "losses": "--preset",
    "head": "--head",
    "anticipation": "--no-anticipation",
    "object_pose": "--no-object-pose",
}
"""Settings that weights to begin with bring along, and the options that ask for them."""

TRIED = 5
"""Steps tried for a forecast, after one that warms up."""


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """What is to be fitted.

    Attributes:
        learned, held_out: Examples to learn from, and of objects kept aside.
        settings: What is built and how.
        seed: Decides everything drawn.
        device: ``cpu`` or ``cuda``.
        threads: Of the CPU.
        start: Weights to begin with; ``None`` trains from nothing.
        adapting: Whether only judges and maps learn.
        asked: Names of settings that were asked for, and not only taken as nothing else was said; the weights to begin
            with must have been trained with the same.
    """

    learned: Sequence[Example]
    held_out: Sequence[Example]
    settings: Settings
    seed: int
    device: str
    threads: int
    start: Path | None
    adapting: bool
    asked: tuple[str, ...] = ()

    def started(self) -> Checkpoint | None:
        """The weights to begin with, if there are any.

        Raises:
            BadInput: There is no CUDA, or the weights to begin with cannot be used or are not as asked for.
        """
        if self.device == "cuda" and not torch.cuda.is_available():
            raise BadInput("--device cuda: torch sees no CUDA device here; leave it out to train on the CPU.")
        if self.start is None:
            return None
        found = checkpoint.load(self.start)
        for name in self.asked:
            if getattr(self.settings, name) != getattr(found.model.settings, name):
                raise BadInput(
                    f"{self.start} was trained with another {OPTIONS[name]} than asked for; leave that option out to "
                    "go on with what the file has, or train from nothing."
                )
        found.model.settings = structs.replace(found.model.settings, training=self.settings.training)
        return found

    def begun(self) -> Fitting:
        """Before the first step.

        Raises:
            BadInput: As ``started``.
        """
        torch.set_num_threads(self.threads)
        start = self.started()
        return begun(
            self.settings if start is None else start.model.settings,
            seed=self.seed,
            text_backend="hash" if start is None else start.text_backend,
            device=self.device,
            start=start,
            adapting=self.adapting,
        )


def fit(task: Task, folder: Path, watch: Watch) -> Fitted:
    """Train in a folder, going on from the checkpoint in it, if there is one.

    Raises:
        BadInput: The checkpoint there cannot be used, or the loss stops being finite.
    """
    started, fitting = time.monotonic(), task.begun()
    if (folder / CHECKPOINT).is_file():
        found = checkpoint.load(folder / CHECKPOINT)
        fitting.go_on_from(found)
    encoder = text_encoder(fitting.text_backend)
    made = functools.partial(Dataset, settings=fitting.settings, encoder=encoder, seed=task.seed, device=task.device)
    dataset, held_out = made(task.learned), made(task.held_out) if task.held_out else None
    told, loss = train(
        fitting, dataset, held_out, folder, watch, device=task.device, steps=task.settings.training.steps
    )
    return Fitted(
        steps=fitting.step,
        rows=len(dataset),
        held_out=0 if held_out is None else len(held_out),
        parameters=_count(fitting.model),
        loss=loss,
        validation=told,
        weights=str(folder / WEIGHTS),
        seconds=round(time.monotonic() - started, 1),
    )


def forecast(task: Task) -> Forecast:
    """Sizes, memory and time, from a few steps whose result is dropped."""
    fitting = task.begun()
    encoder = text_encoder(fitting.text_backend)
    dataset = Dataset(task.learned, fitting.settings, encoder, seed=task.seed, device=task.device)
    spent = []
    for _ in range(1 + TRIED):
        began = time.perf_counter()
        fitting.advance(dataset, task.device)
        spent.append(time.perf_counter() - began)
    each, steps = float(np.median(spent[1:])), task.settings.training.steps
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    if task.device == "cuda":
        peak = torch.cuda.max_memory_allocated() / 2**20
    return Forecast(
        len(dataset), len(task.held_out), _count(fitting.model), steps, round(peak, 1), round(each, 3),
        round(each * steps / 3600, 2),
    )  # fmt: skip


def _count(model: Model) -> int:
    return sum(weight.numel() for weight in model.parameters())
