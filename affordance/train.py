"""How are the weights fitted? One step after another, each decided by its number, so that stopping changes nothing.

A checkpoint holds the networks, their running mean and the optimiser; training goes on from it as if it had never
stopped. The running mean labels affordances, and is what is given out in the end.
"""

from __future__ import annotations

import copy
import functools
import json
import math
import resource
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import torch
from msgspec import structs
from torch import Tensor

from affordance import checkpoint
from affordance.checkpoint import Checkpoint
from affordance.dataset import Batch, Dataset
from affordance.examples import Example
from affordance.losses import Parts, total
from affordance.networks import Model
from affordance.objective import parts_of
from affordance.replay import Recorder
from affordance.settings import Settings
from affordance.text import Backend, text_encoder
from affordance.validation import validate
from robots.cache import write_atomic
from robots.errors import BadInput, TrainingDiverged

CHECKPOINT, WEIGHTS, LOG = "checkpoint.safetensors", "weights.safetensors", "log.jsonl"

SAVE_EVERY = 60.0
"""Seconds between two checkpoints."""

LOG_EVERY, VALIDATE_EVERY = 20, 500
"""Steps between two lines of the log, and between two validations."""

VALIDATED = 16
"""Rows of a batch in validation."""

ADAPTING_RATE = 1e-4
"""Learning rate while adapting: what is learned already is to be corrected, not forgotten."""

AVERAGE, FIRST, SECOND, COUNT = "average.", "first.", "second.", "count."
"""Beginnings of the names of a checkpoint's extra tensors: means of the weights, the gradient and its square, and how
often Adam has moved a weight: maps are not learned in every step."""

ADAM = {COUNT: "step", FIRST: "exp_avg", SECOND: "exp_avg_sq"}
"""What Adam calls these."""

Watch = Callable[[int, Mapping[str, float]], None]
"""Is told the step and the numbers of every line of the log."""

LossOf = Callable[..., Parts]
"""As ``affordance.objective.parts_of``."""


@dataclass
class Fitting:
    """A training in progress.

    Attributes:
        model: The networks that learn.
        average: Their running mean.
        optimiser: Adam.
        settings: What decides them.
        seed: Decides everything that is drawn, with the number of the step.
        text_backend: Encoder of the instructions.
        adapting: Whether only judges and maps learn.
        recorder: Records and replays steps on a GPU; ``None`` on the CPU.
        step: Steps done.
    """

    model: Model
    average: Model
    optimiser: torch.optim.Adam
    settings: Settings
    seed: int
    text_backend: Backend
    adapting: bool
    recorder: Recorder | None
    step: int = 0
    _ahead: tuple[int, Batch] | None = None

    def rate(self) -> float:
        """Learning rate of the next step: a cosine from the first to the last (Loshchilov and Hutter, "SGDR", ICLR
        2017, eq. 5, without restarts).
        """
        if self.adapting:
            return ADAPTING_RATE
        training = self.settings.training
        share = min(1.0, self.step / training.steps)
        return training.last_rate + 0.5 * (training.rate - training.last_rate) * (1.0 + math.cos(math.pi * share))

    def advance(self, dataset: Dataset, device: str, loss_of: LossOf = parts_of) -> Parts:
        """One step.

        Raises:
            TrainingDiverged: The loss or its gradient is not finite; no weight has been changed then.
        """
        training, labelled = self.settings.training, self.step % self.settings.losses.label_every == 0

        def compute(
            rows: Batch, step: int | Tensor, generator: torch.Generator, labelled: bool
        ) -> tuple[Parts, Tensor]:
            self.optimiser.zero_grad(set_to_none=True)
            parts = loss_of(self.model, self.average, rows, step, generator, labelled=labelled, adapting=self.adapting)
            loss = total(parts, self.settings.losses)
            loss.backward()  # type: ignore[no-untyped-call]
            return Parts(**{f.name: getattr(parts, f.name).detach() for f in fields(Parts)}), loss.detach()

        batch, number = self._drawn(dataset), int(np.random.default_rng([self.seed, self.step, 1]).integers(2**62))
        if self.recorder is not None:
            parts, loss = self.recorder(batch, self.step, number, labelled, compute)
            self._ahead = (self.step + 1, dataset.batch(self._rng(self.step + 1), training.batch))
        else:
            generator = torch.Generator(device=device).manual_seed(number)
            parts, loss = compute(batch.to(device), self.step, generator, labelled)
        if not bool(torch.isfinite(loss)):
            bad = [f.name for f in fields(Parts) if not bool(torch.isfinite(getattr(parts, f.name)).all())]
            raise TrainingDiverged(
                f"Training stopped at step {self.step}: the loss of {', '.join(bad)} is not a finite number."
            )
        for group in self.optimiser.param_groups:
            group["lr"] = self.rate()
        norm = torch.nn.utils.clip_grad_norm_([w for w in self.model.parameters() if w.requires_grad], training.clip)
        if not bool(torch.isfinite(norm)):
            raise TrainingDiverged(f"Training stopped at step {self.step}: the gradient is not a finite number.")
        self.optimiser.step()
        self._average_in()
        self.step += 1
        return parts

    def _drawn(self, dataset: Dataset) -> Batch:
        """The rows of this step; on a GPU they were drawn while it computed the step before."""
        if self._ahead is not None and self._ahead[0] == self.step:
            return self._ahead[1]
        return dataset.batch(self._rng(self.step), self.settings.training.batch)

    def _average_in(self) -> None:
        """Take the weights into the running mean, which follows faster at the beginning."""
        decay = min(self.settings.training.average, (1.0 + self.step) / (10.0 + self.step))
        with torch.no_grad():
            means, weights = (_numbers(model) for model in (self.average, self.model))
            torch._foreach_lerp_(means, weights, 1.0 - decay)

    def _rng(self, step: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, step])

    # -- keeping it ------------------------------------------------------------------------------------------------

    def save(self, folder: Path) -> None:
        """Write the checkpoint."""
        extra = {f"{AVERAGE}{name}": tensor for name, tensor in self.average.state_dict().items()}
        for name, weight in self.model.named_parameters():
            state = self.optimiser.state.get(weight)
            if state:
                extra |= {f"{kind}{name}": state[key] for kind, key in ADAM.items()}
        checkpoint.save(folder / CHECKPOINT, self.model, self.text_backend, self.step, extra)

    def give_out(self, folder: Path) -> Path:
        """Write the running mean alone, which is what proposers read."""
        return checkpoint.save(folder / WEIGHTS, self.average, self.text_backend, self.step, half=True)

    def go_on_from(self, found: Checkpoint) -> None:
        """Take over everything from a checkpoint of the same settings.

        Raises:
            BadInput: It holds networks alone, from which training cannot go on.
        """
        if not any(name.startswith(AVERAGE) for name in found.extra):
            raise BadInput(
                "The checkpoint there holds networks without their training; --adapt begins with such weights."
            )
        self.model.load_state_dict(found.model.state_dict())
        learning(self.model, adapting=self.adapting)
        mean = {name.removeprefix(AVERAGE): t for name, t in found.extra.items() if name.startswith(AVERAGE)}
        self.average.load_state_dict(mean)
        for name, weight in self.model.named_parameters():
            if f"{FIRST}{name}" in found.extra:
                kept = {key: found.extra[f"{kind}{name}"].clone() for kind, key in ADAM.items()}
                self.optimiser.state[weight] = {key: tensor.to(weight.device) for key, tensor in kept.items()}
        self.step = found.step


def begun(
    settings: Settings,
    *,
    seed: int,
    text_backend: Backend,
    device: str = "cpu",
    start: Checkpoint | None = None,
    adapting: bool = False,
) -> Fitting:
    """A training before its first step.

    Args:
        settings: What is built and how it is fitted.
        seed: Decides the first weights and every draw.
        text_backend: Encoder of the instructions.
        device: ``cpu`` or ``cuda``.
        start: Weights to begin with; without it, random ones.
        adapting: Whether only judges and maps learn from then on.
    """
    torch.manual_seed(seed)
    model = Model(settings) if start is None else copy.deepcopy(start.model)
    model.to(device)
    learning(model, adapting=adapting)
    for name, weight in model.named_parameters():
        weight.requires_grad_(not adapting or learns_while_adapting(name))
    average = copy.deepcopy(model).eval()
    average.requires_grad_(False)
    training = settings.training
    learned = [weight for weight in model.parameters() if weight.requires_grad]
    on_gpu = device == "cuda"
    optimiser = torch.optim.Adam(learned, training.rate, weight_decay=training.weight_decay, fused=on_gpu)
    recorder = Recorder(model) if on_gpu else None
    return Fitting(model, average, optimiser, settings, seed, text_backend, adapting, recorder)


def learning(model: Model, *, adapting: bool) -> None:
    """Let a model learn; while adapting, what stays keeps the statistics of its batch normalisation too."""
    model.train(not adapting)
    if adapting:
        model.critics.train()


def learns_while_adapting(name: str) -> bool:
    """Whether the weight of that name is a judge's or a map's."""
    return name.startswith(("critics.", "goal.scorer.", "pre.scorer."))


def train(
    fitting: Fitting,
    dataset: Dataset,
    held_out: Dataset | None,
    folder: Path,
    watch: Watch,
    *,
    device: str = "cpu",
    steps: int | None = None,
    loss_of: LossOf = parts_of,
) -> tuple[dict[str, float], float]:
    """Train to the last step; an interruption waits for the end of a step and leaves a checkpoint.

    Args:
        fitting: Fresh, or gone on with.
        dataset: What is learned from.
        held_out: What validation looks at.
        folder: Where checkpoint, weights and log are.
        watch: Is told of progress.
        device: ``cpu`` or ``cuda``.
        steps: Last step; without it the settings'.
        loss_of: The loss of a batch.

    Returns:
        The last validation, and the loss of the last line of the log.

    Raises:
        TrainingDiverged: A loss is no longer finite; the last checkpoint stays.
    """
    last = fitting.settings.training.steps if steps is None else steps
    batches = [] if held_out is None else [batch.to(device) for batch in held_out.fixed(VALIDATED)]
    log = _Log(folder / LOG, fitting, watch)
    told: dict[str, float] = {}
    saved = time.monotonic()
    with _interruptible() as interrupted:
        while fitting.step < last and not interrupted:
            log.add(fitting.advance(dataset, device, loss_of))
            if fitting.step % LOG_EVERY == 0 or fitting.step == last:
                log.write()
            if batches and (fitting.step % VALIDATE_EVERY == 0 or fitting.step == last):
                generator = torch.Generator(device=device).manual_seed(fitting.seed)
                told = validate(fitting.average, batches, generator)
                log.append({"step": fitting.step, "validation": told})
            if time.monotonic() - saved > SAVE_EVERY:
                fitting.save(folder)
                saved = time.monotonic()
        fitting.save(folder)
        if interrupted:
            raise KeyboardInterrupt
    fitting.give_out(folder)
    return told, log.loss


class _Log:
    """Means of the losses since the last line, written as lines."""

    def __init__(self, path: Path, fitting: Fitting, watch: Watch) -> None:
        self.path, self.fitting, self.watch = path, fitting, watch
        self.loss = float("nan")
        self._before = _cut_back(path, fitting.step)
        self._began = time.monotonic()
        self._sums: dict[str, float] = {}
        self._count = 0

    def add(self, parts: Parts) -> None:
        """Take in the losses of a step."""
        self._count += 1
        for f in fields(Parts):
            self._sums[f.name] = self._sums.get(f.name, 0.0) + float(getattr(parts, f.name).detach())

    def write(self) -> None:
        """Write a line of what was taken in."""
        line = {name: value / self._count for name, value in self._sums.items()}
        self.loss = _weighed(line, self.fitting.settings)
        seconds = self._before + time.monotonic() - self._began
        line |= {"loss": self.loss, "rate": self.fitting.rate(), "seconds": seconds}
        self.append({"step": self.fitting.step, **line})
        self.watch(self.fitting.step, line)
        self._sums, self._count = {}, 0

    def append(self, values: Mapping[str, Any]) -> None:
        """Write any line."""
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(values) + "\n")


@contextmanager
def _interruptible() -> Iterator[list[int]]:
    """A list that an interruption fills, so that it is heard between two steps; a second one is not waited for.

    Outside of the main thread, where signals cannot be handled, the list stays empty.
    """
    heard: list[int] = []

    def hear(number: int, frame: object) -> None:
        if heard:
            raise KeyboardInterrupt
        heard.append(number)

    if threading.current_thread() is not threading.main_thread():
        yield heard
        return
    before = signal.signal(signal.SIGINT, hear)
    try:
        yield heard
    finally:
        signal.signal(signal.SIGINT, before)


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
        megabytes: Largest memory of this process after the steps that were tried [MB].
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
        adapt: Weights whose judges and maps are corrected; ``None`` trains everything from nothing.
    """

    learned: Sequence[Example]
    held_out: Sequence[Example]
    settings: Settings
    seed: int
    device: str
    threads: int
    adapt: Path | None

    def begun(self) -> Fitting:
        """Before the first step.

        Raises:
            BadInput: There is no CUDA, or the weights to adapt cannot be used.
        """
        if self.device == "cuda" and not torch.cuda.is_available():
            raise BadInput("--device cuda: torch sees no CUDA device here; leave it out to train on the CPU.")
        torch.set_num_threads(self.threads)
        start = None if self.adapt is None else checkpoint.load(self.adapt)
        if start is not None:
            fixed = structs.replace(start.model.settings, training=self.settings.training)
            start.model.settings = fixed
            return begun(
                fixed, seed=self.seed, text_backend=start.text_backend, device=self.device, start=start, adapting=True
            )
        return begun(self.settings, seed=self.seed, text_backend="hash", device=self.device)


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
    dataset = Dataset(task.learned, fitting.settings, text_encoder(fitting.text_backend), seed=task.seed)
    spent = []
    for _ in range(1 + TRIED):
        began = time.perf_counter()
        fitting.advance(dataset, task.device)
        spent.append(time.perf_counter() - began)
    each, steps = float(np.median(spent[1:])), task.settings.training.steps
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return Forecast(
        len(dataset), len(task.held_out), _count(fitting.model), steps, round(peak, 1), round(each, 3),
        round(each * steps / 3600, 2),
    )  # fmt: skip


def _count(model: Model) -> int:
    return sum(weight.numel() for weight in model.parameters())


def _weighed(parts: Mapping[str, float], settings: Settings) -> float:
    tensors = {f.name: torch.tensor(parts[f.name]) for f in fields(Parts)}
    return float(total(Parts(**tensors), settings.losses))


def _cut_back(path: Path, step: int) -> float:
    """Forget what the log says of steps after a checkpoint, and a cut off line; returns the seconds spent till then."""
    if not path.is_file():
        return 0.0
    kept, seconds = [], 0.0
    for line in path.read_text("utf-8").splitlines():
        try:
            row = json.loads(line)
            if row["step"] <= step:
                kept.append(line)
                seconds = float(row.get("seconds", seconds))
        except (json.JSONDecodeError, KeyError, TypeError):
            break
    write_atomic(path, "".join(f"{line}\n" for line in kept).encode())
    return seconds


def _numbers(model: Model) -> list[Tensor]:
    """Weights and running statistics of a model; not its counters of batches."""
    return [*model.parameters(), *(buffer for buffer in model.buffers() if buffer.is_floating_point())]


def tensors_of(fitting: Fitting) -> dict[str, Tensor]:
    """Every number that a training consists of, for comparing two."""
    found = dict(fitting.model.state_dict()) | {f"{AVERAGE}{k}": v for k, v in fitting.average.state_dict().items()}
    for name, weight in fitting.model.named_parameters():
        for key, value in fitting.optimiser.state.get(weight, {}).items():
            found[f"{key}.{name}"] = torch.as_tensor(value)
    return found
