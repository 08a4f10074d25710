"""What may be concluded from counts of successes: intervals, paired tests, quantiles."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

NORMAL_95 = 1.959963984540054
"""97.5 % quantile of the normal distribution, for two-sided 95 % intervals."""


def wilson(successes: int, trials: int, z: float = NORMAL_95) -> tuple[float, float]:
    """Wilson's score interval of a success rate; the whole of ``[0, 1]`` without trials.

    E. B. Wilson, "Probable Inference, the Law of Succession, and Statistical Inference", JASA 22 (1927).
    """
    if trials == 0:
        return 0.0, 1.0
    rate, spread = successes / trials, z * z / trials
    middle = (rate + spread / 2) / (1 + spread)
    half = z / (1 + spread) * math.sqrt(rate * (1 - rate) / trials + spread / (4 * trials))
    return max(0.0, middle - half), min(1.0, middle + half)


def mcnemar(only_first: int, only_second: int) -> float:
    """Two-sided p-value of McNemar's exact test.

    Under the hypothesis that two methods are equally good, a pair that only one of them solves falls to either with
    probability one half, so the smaller count is binomial.

    Args:
        only_first: Pairs that only the first method solved.
        only_second: Pairs that only the second one solved.
    """
    trials, fewer = only_first + only_second, min(only_first, only_second)
    ways = tail = 1
    for k in range(fewer):
        ways = ways * (trials - k) // (k + 1)  # of choosing k + 1 of the trials
        tail += ways
    return min(1.0, float(2 * tail / 2**trials))


def quantile(values: Sequence[float], share: float) -> float | None:
    """The value below which a share of the values lies, linear between them, to 1e-6; ``None`` without values."""
    return round(float(np.quantile(np.asarray(values), share)), 6) if values else None
