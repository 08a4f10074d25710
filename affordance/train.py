"""How are the weights fitted? One step after another, each decided by its number, so that stopping changes nothing.

A checkpoint holds the networks, their running mean and the optimiser; training goes on from it as if it had never
stopped. The running mean labels affordances, and is what is given out in the end.
"""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from affordance import checkpoint
from affordance.checkpoint import Checkpoint
from affordance.dataset import Batch, Dataset
from affordance.losses import Parts, total
from affordance.networks import Model
from affordance.objective import parts_of
from affordance.pointnet2 import Encoder
from affordance.replay import Recorder
from affordance.settings import Settings
from affordance.text import Backend
from affordance.trainlog import Log, Watch, interruptible
from affordance.validation import validate
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
    for module in model.modules():
        if isinstance(module, Encoder):
            module.bf16 = settings.training.bf16
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
    log = Log(folder / LOG, fitting.settings, fitting.step, watch)
    told: dict[str, float] = {}
    saved = time.monotonic()
    with interruptible() as interrupted:
        while fitting.step < last and not interrupted:
            log.add(fitting.advance(dataset, device, loss_of))
            if fitting.step % LOG_EVERY == 0 or fitting.step == last:
                log.write(fitting.step, fitting.rate())
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


def _numbers(model: Model) -> list[Tensor]:
    """Weights and running statistics of a model; not its counters of batches."""
    return [*model.parameters(), *(buffer for buffer in model.buffers() if buffer.is_floating_point())]
