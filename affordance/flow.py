"""How does a network draw one of many right answers without a latent space? It carries noise along a learned velocity.

Rectified flow (Liu et al., "Flow Straight and Fast", ICLR 2023) with the time distribution of 3D FlowMatch Actor: a
point on the way is ``(1 - t) answer + t noise``, the velocity there ``noise - answer``.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from affordance.heads import HIDDEN, joined

WAVES = 4
"""Octaves in which time is written, a sine and a cosine each."""

TIME_SPREAD = 1.5
"""Standard deviation of the normal distribution whose logistic is the time of a training sample."""


class Flow(nn.Module):
    """A conditional flow from standard normal noise to answers.

    Attributes:
        latent: Numbers of noise: as many as an answer has.
        steps: Euler steps from noise to answer.
    """

    offset: Tensor

    def __init__(self, condition: int, offset: tuple[float, ...], steps: int) -> None:
        """Build it.

        Args:
            condition: Features of the condition.
            offset: Where answers are centred; its length is the number of outputs.
            steps: Euler steps.
        """
        super().__init__()
        self.latent, self.steps = len(offset), steps
        self.register_buffer("offset", torch.tensor(offset), persistent=False)
        self.velocity = nn.Sequential(
            nn.Linear(condition + self.latent + 2 * WAVES, HIDDEN),
            nn.LeakyReLU(),
            nn.Linear(HIDDEN, HIDDEN),
            nn.LeakyReLU(),
            nn.Linear(HIDDEN, self.latent),
        )

    def decode(self, condition: Tensor, z: Tensor) -> Tensor:
        """The answer ``(..., outputs)`` to which noise ``(..., outputs)`` is carried."""
        state = z
        for k in range(self.steps, 0, -1):
            time = torch.full_like(state[..., :1], k / self.steps)
            state = state - self._velocity(condition, state, time) / self.steps
        return state + self.offset

    def errors(self, condition: Tensor, target: Tensor, generator: torch.Generator) -> Tensor:
        """``(...)`` mean squared error of the velocity at a random time on the way to answers ``(..., outputs)``."""
        answer = target - self.offset
        noise, when = (
            torch.randn(shape, generator=generator, device=generator.device, dtype=target.dtype)
            for shape in (answer.shape, answer[..., :1].shape)
        )
        time = torch.sigmoid(TIME_SPREAD * when)
        velocity = self._velocity(condition, (1.0 - time) * answer + time * noise, time)
        return (velocity - (noise - answer)).square().mean(-1)

    def _velocity(self, condition: Tensor, state: Tensor, time: Tensor) -> Tensor:
        octaves = math.pi * 2.0 ** torch.arange(WAVES, device=time.device, dtype=time.dtype)
        waves = torch.cat([torch.sin(time * octaves), torch.cos(time * octaves)], dim=-1)
        out: Tensor = self.velocity(joined(condition, state, waves))
        return out
