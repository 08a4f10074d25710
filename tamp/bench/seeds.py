"""Which seeds does the benchmark use?

One hundred for each column and split, in ``seeds.json``. The rule: seed ``k`` of a list is the first eight bytes of
SHA-256 of ``"bipremanip benchmark 1/COLUMN/SPLIT/k"`` modulo 2^31 - 1000, plus 1000. So nobody chose them, lists share
no seed, and 0 to 999, which development and tests use, are in none. Data collection leaves them out too. The lists
are committed and never edited: a seed that turns out hard, or impossible, stays and counts.
"""

from __future__ import annotations

import hashlib
from functools import cache
from importlib import resources

import msgspec

from worlds.assets.asset import Split

PER_LIST = 100
"""Seeds of a column and split; the paper tests each category 100 times."""

RESERVED = 1000
"""Seeds below this belong to development and tests."""

SEED_END = 2**31
"""Seeds lie below this."""


def seed_at(topic: str, number: int) -> int:
    """Seed ``number`` of the list that ``topic`` names, by the rule above."""
    digest = hashlib.sha256(f"{topic}/{number}".encode()).digest()
    return RESERVED + int.from_bytes(digest[:8], "big") % (SEED_END - RESERVED)


@cache
def _lists() -> dict[str, dict[str, list[int]]]:
    data = (resources.files("tamp") / "bench" / "seeds.json").read_bytes()
    return msgspec.json.decode(data, type=dict[str, dict[str, list[int]]])


def benchmark_seeds(category: str, split: Split) -> list[int]:
    """The committed list of a column and split."""
    return list(_lists()[category][split])


@cache
def every_benchmark_seed() -> frozenset[int]:
    """All of them, so that training data can keep away from them."""
    return frozenset(seed for splits in _lists().values() for seeds in splits.values() for seed in seeds)
