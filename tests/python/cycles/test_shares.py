"""Intervals of shares, and numbers of parts, against closed forms and the binomial distribution."""

import numpy as np
import pytest
from forceaxis.cycles.statistics import parts_needed, refused_range, share
from scipy import stats

pytestmark = pytest.mark.quick


@pytest.mark.parametrize("n", [1, 20, 1000, 30000])
def test_no_and_all_parts_have_closed_forms(n):
    none, all_ = share(0, n), share(n, n)
    assert (none.low, all_.high) == (0.0, 1.0)
    assert none.high == pytest.approx(1 - 0.025 ** (1 / n), rel=1e-9)
    assert all_.low == pytest.approx(0.025 ** (1 / n), rel=1e-9)


@pytest.mark.parametrize(("count", "of"), [(1, 20), (7, 20), (300, 30000), (999, 1000)])
def test_the_ends_have_binomial_tails_of_2_5_percent(count, of):
    found = share(count, of)
    assert stats.binom.sf(count - 1, of, found.low) == pytest.approx(0.025, rel=1e-6)
    assert stats.binom.cdf(count, of, found.high) == pytest.approx(0.025, rel=1e-6)
    assert found.share == count / of


def test_the_interval_covers_every_probability():
    n = 40
    intervals = [share(k, n) for k in range(n + 1)]
    for p in np.linspace(0.001, 0.999, 97):
        covered = sum(
            stats.binom.pmf(k, n, p) for k, i in enumerate(intervals) if i.low <= p <= i.high
        )
        assert covered >= 0.95


def test_without_parts_nothing_is_known():
    none = share(0, 0)
    assert (none.share, none.low, none.high) == (None, 0.0, 1.0)


def test_one_block_is_the_smallest_of_n_uniform_values():
    n = 500
    low, high = refused_range(1, n)
    assert low == pytest.approx(1 - 0.975 ** (1 / n), rel=1e-9)
    assert high == pytest.approx(1 - 0.025 ** (1 / n), rel=1e-9)


def test_299_parts_are_the_fewest_for_one_percent():
    assert 0.99**299 < 0.05 < 0.99**298
    assert parts_needed(0.01, 1) == 299
    assert parts_needed(0.1, 1) == 299  # 29 would do, but nothing is proposed from so few
    assert parts_needed(0.001, 1) == 2995
    assert parts_needed(0.01, 6) == 599  # each of six bounds takes a part of 600
