"""Which instances does a generated family have, and which of them are kept for testing?"""

from __future__ import annotations

import colorsys
from dataclasses import dataclass

import numpy as np

from robots.errors import UnknownName
from worlds.assets.asset import Split

MOST = 1000
"""Instances that can be asked for: their numbers have three digits."""

HELD_OUT = 4
"""Every fourth instance is unseen; coprime to the numbers of closures, so the unseen ones have all kinds."""


@dataclass(frozen=True, slots=True)
class Series:
    """A numbered family.

    Attributes:
        category: For example ``Bottle``.
        count: How many instances; further ones, all of them seen, can be asked for to learn from.
        seed: First word of every instance's seed.
    """

    category: str
    count: int
    seed: int

    def names(self, split: Split | None = None, count: int | None = None) -> list[str]:
        """Every instance name, or those of one split, in order; of ``count`` instances if that is more."""
        among = range(max(self.count, count or 0))
        return [self._name(index) for index in among if split in (None, self.split(index))]

    def split(self, index: int) -> Split:
        """The split of instance ``index``."""
        return "unseen" if index < self.count and index % HELD_OUT == HELD_OUT - 1 else "seen"

    def index(self, instance: str, count: int = MOST) -> int:
        """The number of ``instance``; ``UnknownName`` with a suggestion when ``names`` of that ``count`` lack it."""
        names = self.names(count=count)
        if instance not in names:
            raise UnknownName(f"{self.category} instance", instance, names)
        return names.index(instance)

    def rng(self, index: int) -> np.random.Generator:
        """A generator of its own for instance ``index``."""
        return np.random.default_rng([self.seed, index])

    def _name(self, index: int) -> str:
        return f"{self.category.lower()}-{index:03d}"


def mixed(index: int, kinds: int) -> int:
    """Which of some kinds instance ``index`` is, for a number of kinds that shares a factor with ``HELD_OUT``."""
    return (index + index // HELD_OUT) % kinds


def pastel(rng: np.random.Generator, *, dark: bool = False) -> tuple[float, float, float]:
    """Some colour, red green blue in 0..1: light and soft, or ``dark`` and strong."""
    saturation, value = (0.75, 0.55) if dark else (0.35, 0.9)
    return colorsys.hsv_to_rgb(rng.random(), saturation, value)
