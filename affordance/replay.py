"""How does a GPU get its thousands of small kernels in time? They are recorded once, and later steps replay them.

A step of training is bound by how fast its kernels are launched, not by how fast they run. CUDA graphs launch all of
them at once; what changes between two steps - the rows, the number of the step, the random numbers - is written to
where the recorded kernels read it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from affordance.dataset import Batch
from affordance.losses import Parts
from affordance.networks import Model

WARM = 3
"""Steps of each kind that run before one is recorded, so that libraries have set themselves up."""

Compute = Callable[[Batch, Tensor, torch.Generator, bool], tuple[Parts, Tensor]]
"""Losses and their sum of rows, a step's number and a generator; the flag says whether affordances are labelled. The
weights have its gradients afterwards."""


@dataclass(frozen=True, slots=True, eq=False)
class _Recording:
    """One kind of step: its kernels, and where they leave what they compute."""

    graph: torch.cuda.CUDAGraph
    parts: Parts
    loss: Tensor
    gradients: tuple[Tensor | None, ...]


class Recorder:
    """Steps of one training on a GPU; batches have one size."""

    def __init__(self, model: Model) -> None:
        """Prepare for the weights of a model that is on the GPU."""
        self._weights = list(model.parameters())
        self._stream = torch.cuda.Stream()  # type: ignore[no-untyped-call]
        self._generator = torch.Generator(device="cuda")
        self._step = torch.zeros((), device="cuda")
        self._batch: Batch | None = None
        self._run: Counter[bool] = Counter()
        self._recordings: dict[bool, _Recording] = {}

    def __call__(self, batch: Batch, step: int, seed: int, labelled: bool, compute: Compute) -> tuple[Parts, Tensor]:
        """Compute losses and gradients of a batch on the CPU; the answer is overwritten by the next call."""
        self._generator.manual_seed(seed)
        self._step.fill_(step)
        if self._batch is None:
            self._batch = batch.to("cuda")
        else:
            self._batch.take(batch)
        if self._run[labelled] < WARM:
            self._run[labelled] += 1
            self._stream.wait_stream(torch.cuda.current_stream())
            with torch.cuda.stream(self._stream):
                answer = compute(self._batch, self._step, self._generator, labelled)
            torch.cuda.current_stream().wait_stream(self._stream)
            return answer
        if labelled not in self._recordings:
            self._recordings[labelled] = self._recorded(self._batch, labelled, compute)
        recording = self._recordings[labelled]
        recording.graph.replay()
        for weight, gradient in zip(self._weights, recording.gradients, strict=True):
            weight.grad = gradient
        return recording.parts, recording.loss

    def _recorded(self, batch: Batch, labelled: bool, compute: Compute) -> _Recording:
        graph = torch.cuda.CUDAGraph()
        graph.register_generator_state(self._generator)
        torch.cuda.synchronize()
        with torch.cuda.graph(graph, stream=self._stream):
            parts, loss = compute(batch, self._step, self._generator, labelled)
        return _Recording(graph, parts, loss, tuple(weight.grad for weight in self._weights))
