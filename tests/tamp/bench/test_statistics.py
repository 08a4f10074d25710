"""Intervals, tests and quantiles against values from the literature and from independent libraries."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from tamp.bench.statistics import mcnemar, quantile, wilson


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    [
        (81, 263, 0.2553, 0.3662),  # Newcombe, Statistics in Medicine 17 (1998), table I, method 3
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0000, 0.1611),
        (1, 29, 0.0061, 0.1718),
        (50, 100, 0.4038, 0.5962),
    ],
)
def test_wilson_gives_published_intervals(successes: int, trials: int, low: float, high: float) -> None:
    assert wilson(successes, trials) == pytest.approx((low, high), abs=5e-5)


@settings(deadline=None)
@given(st.integers(1, 300), st.data())
def test_wilson_is_what_scipy_says(trials: int, data: st.DataObject) -> None:
    successes = data.draw(st.integers(0, trials))
    theirs = stats.binomtest(successes, trials).proportion_ci(0.95, method="wilson")
    assert wilson(successes, trials) == pytest.approx((theirs.low, theirs.high), abs=1e-12)


def test_wilson_without_trials_is_everything() -> None:
    assert wilson(0, 0) == (0.0, 1.0)


@pytest.mark.parametrize(
    ("first", "second", "p"), [(0, 0, 1.0), (5, 5, 1.0), (1, 0, 1.0), (0, 6, 0.03125), (1, 9, 0.021484375)]
)
def test_mcnemar_gives_known_values(first: int, second: int, p: float) -> None:
    assert mcnemar(first, second) == p


@settings(deadline=None)
@given(st.integers(0, 1800), st.integers(0, 1800))
def test_mcnemar_is_a_binomial_test_and_symmetric(first: int, second: int) -> None:
    assert mcnemar(first, second) == mcnemar(second, first)
    if first + second:
        theirs = stats.binomtest(first, first + second, 0.5).pvalue
        assert mcnemar(first, second) == pytest.approx(theirs, rel=1e-6, abs=1e-200)


@settings(deadline=None)
@given(st.lists(st.floats(0, 100), min_size=1), st.floats(0, 1))
def test_quantiles_lie_between_the_extremes(values: list[float], share: float) -> None:
    found = quantile(values, share)
    assert found is not None
    assert found == pytest.approx(np.quantile(values, share), abs=1e-6)


def test_no_values_have_no_quantile() -> None:
    assert quantile([], 0.5) is None
