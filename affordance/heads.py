"""How does a network answer with one of many right rotations or motions? It draws one, given a condition.

Conditions are rows of features; everything here takes any number of dimensions before the last.
"""

from __future__ import annotations

from typing import Protocol

import torch
from torch import Tensor, nn

HIDDEN = 128
"""Width of every hidden layer but one."""

SUMMARY = 64
"""Width of a cVAE encoder's last layer."""


class Head(Protocol):
    """A conditional distribution that can be drawn from."""

    @property
    def latent(self) -> int:
        """Numbers of standard normal noise that decide a draw."""

    def decode(self, condition: Tensor, z: Tensor) -> Tensor:
        """The draw ``(..., outputs)`` that the noise ``(..., latent)`` decides under ``condition``."""


class CVAE(nn.Module):
    """A conditional variational autoencoder (Sohn et al., "Learning Structured Output Representation using Deep
    Conditional Generative Models", NeurIPS 2015).
    """

    offset: Tensor

    def __init__(self, condition: int, offset: tuple[float, ...], latent: int) -> None:
        """Build it.

        Args:
            condition: Features of the condition.
            offset: What the decoder's output is added to; its length is the number of outputs.
            latent: Dimensions of the latent.
        """
        super().__init__()
        self.latent = latent
        self.register_buffer("offset", torch.tensor(offset), persistent=False)
        self.encoder = nn.Sequential(
            nn.Linear(condition + len(offset), HIDDEN), nn.LeakyReLU(), nn.Linear(HIDDEN, SUMMARY), nn.LeakyReLU()
        )
        self.mean, self.log_variance = nn.Linear(SUMMARY, latent), nn.Linear(SUMMARY, latent)
        self.decoder = nn.Sequential(
            nn.Linear(condition + latent, HIDDEN),
            nn.LeakyReLU(),
            nn.Linear(HIDDEN, HIDDEN),
            nn.LeakyReLU(),
            nn.Linear(HIDDEN, len(offset)),
        )

    def encode(self, condition: Tensor, target: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and logarithm of the variance of the latent, ``(..., latent)`` each, given the right answer."""
        summary = self.encoder(joined(condition, target))
        return self.mean(summary), self.log_variance(summary)

    def decode(self, condition: Tensor, z: Tensor) -> Tensor:
        """The answer ``(..., outputs)`` for a latent ``(..., latent)``."""
        out: Tensor = self.decoder(joined(condition, z))
        return out + self.offset


def mlp(inputs: int, outputs: int) -> nn.Sequential:
    """The small network that every score and every plain number comes from."""
    return nn.Sequential(nn.Linear(inputs, HIDDEN), nn.LeakyReLU(), nn.Linear(HIDDEN, outputs))


def joined(*parts: Tensor) -> Tensor:
    """Features side by side ``(B, ..., sum of C)``; a part with fewer dimensions is repeated along those it lacks.

    Dimensions are matched from the first on, the batch: features of a cloud ``(B, C)`` meet those of its points
    ``(B, P, C)``.
    """
    depth = max(part.dim() for part in parts)
    full = [part.reshape(*part.shape[:-1], *[1] * (depth - part.dim()), part.shape[-1]) for part in parts]
    leading = [max(sizes) for sizes in zip(*(part.shape[:-1] for part in full), strict=True)]
    return torch.cat([part.expand(*leading, part.shape[-1]) for part in full], dim=-1)


def drawn(
    head: Head, condition: Tensor, count: int, generator: torch.Generator, *, middle_first: bool = False
) -> Tensor:
    """``(..., count, outputs)`` draws under conditions ``(..., C)``.

    Args:
        head: What is drawn from.
        condition: The conditions.
        count: Draws for each.
        generator: Decides them; of the device of the weights.
        middle_first: Whether the first draw has a latent of zero, which is repeatable but may lie between two modes.
    """
    shape = (*condition.shape[:-1], count, head.latent)
    z = torch.randn(shape, generator=generator, device=generator.device, dtype=condition.dtype)
    if middle_first:
        z[..., 0, :] = 0.0
    return head.decode(condition, z)
