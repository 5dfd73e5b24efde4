"""Statistics of parts against NumPy, SciPy and sampling: capability, intervals, counts."""

import math

import numpy as np
import pytest
from forceaxis.cycles import capability
from forceaxis.cycles.part import ElementFigure
from forceaxis.cycles.record import PartRecord
from forceaxis.cycles.records import RecordedParts
from scipy import stats

pytestmark = pytest.mark.quick


def figure(value, least=9.0, most=11.0, verdict=None, name="force"):
    if verdict is None:
        low = least is not None and value < least
        verdict = "below" if low else "above" if most is not None and value > most else "good"
    return ElementFigure(name, "peak", verdict, value, "N", least, most)


def parts(values, least=9.0, most=11.0, **given):
    """Records of parts with one element each."""
    made = []
    for number, value in enumerate(values, 1):
        element = figure(value, least, most)
        state = "good" if element.verdict == "good" else "bad"
        made.append(PartRecord(number, state=state, program_crc="A", elements=[element], **given))
    return RecordedParts("here", made)


def of(records):
    return capability.statistics(RecordedParts("here", records))


@pytest.mark.parametrize("seed", range(5))
def test_the_figures_are_those_of_numpy_and_scipy(seed):
    random = np.random.default_rng(seed)
    n = int(random.integers(30, 3000))
    values = random.normal(10.2, 0.3, n)
    found = capability.statistics(parts(values))
    (one,) = found.elements
    s = np.sqrt(((values - values.mean()) ** 2).sum() / (n - 1))
    assert one.n == n and one.mean == pytest.approx(values.mean(), rel=1e-12)
    assert one.deviation == pytest.approx(s, rel=1e-12)
    assert (one.smallest, one.largest) == (values.min(), values.max())
    assert one.cp.value == pytest.approx(2 / (6 * s), rel=1e-12)
    assert one.cpk.value == pytest.approx((11 - values.mean()) / (3 * s), rel=1e-12)
    chi = stats.chi2(n - 1)
    assert one.cp.low == pytest.approx(one.cp.value * math.sqrt(chi.ppf(0.025) / (n - 1)))
    assert one.cp.high == pytest.approx(one.cp.value * math.sqrt(chi.ppf(0.975) / (n - 1)))
    within = int(((values >= 9) & (values <= 11)).sum())
    exact = stats.binomtest(within, n).proportion_ci(0.95, "exact")
    assert (one.good.count, one.good.of) == (within, n)
    assert (one.good.low, one.good.high) == pytest.approx((exact.low, exact.high))
    assert (found.good, found.bad, found.aborted) == (within, n - within, 0)


def noncentral(value, n):
    """The exact interval of a one-sided Cpk: 3 sqrt(n) Cpk has a noncentral t distribution."""
    t, root = 3 * math.sqrt(n) * value, 3 * math.sqrt(n)

    def solved(tail):
        low, high = -5.0, 3 * value + 5.0
        for _ in range(80):
            middle = (low + high) / 2
            low, high = (middle, high) if stats.nct.cdf(t, n - 1, middle * root) > tail else (
                low, middle,
            )  # fmt: skip
        return low

    return solved(0.975), solved(0.025)


@pytest.mark.parametrize("n", [30, 100, 1000])
@pytest.mark.parametrize("wanted", [0.7, 1.33, 2.0])
def test_the_interval_of_a_one_sided_cpk_is_near_the_exact_one(n, wanted):
    deviation = 1.0
    found = capability.cpk(None, 3 * wanted, 0.0, deviation, n)
    low, high = noncentral(wanted, n)
    assert found.value == pytest.approx(wanted)
    tolerance = 0.12 * (high - low)  # Bissell is an approximation by a normal distribution
    assert (found.low, found.high) == pytest.approx((low, high), abs=tolerance)


@pytest.mark.parametrize(("least", "most"), [(-4.0, 4.0), (-4.0, 5.0), (None, 3.0), (-6.0, None)])
@pytest.mark.parametrize("n", [30, 200])
def test_the_intervals_contain_the_true_value_with_95_percent(least, most, n):
    trials = 4000
    random = np.random.default_rng(1)
    sides = [3.0 if b is None else abs(b) / 3 for b in (least, most) if b is not None]
    true_cpk, hits_cpk, hits_cp = min(sides), 0, 0
    for values in random.normal(0, 1, (trials, n)):
        s = values.std(ddof=1)
        found = capability.cpk(least, most, values.mean(), s, n)
        hits_cpk += found.low <= true_cpk <= found.high
        if least is not None and most is not None:
            both = capability.cp(least, most, s, n)
            hits_cp += both.low <= (most - least) / 6 <= both.high
    # Where both sides are equally near, the smaller of the two estimates is below the true value.
    lowest = 0.90 if (least, most) == (-4.0, 4.0) else 0.935
    assert lowest <= hits_cpk / trials <= 0.965
    if least is not None and most is not None:
        assert 0.94 <= hits_cp / trials <= 0.96


def test_one_bound_has_no_cp():
    values = np.random.default_rng(0).normal(10, 0.1, 100)
    (low,) = capability.statistics(parts(values, most=None)).elements
    (high,) = capability.statistics(parts(values, least=None)).elements
    s = values.std(ddof=1)
    assert low.cp is None and low.cpk.value == pytest.approx((values.mean() - 9) / (3 * s))
    assert high.cp is None and high.cpk.value == pytest.approx((11 - values.mean()) / (3 * s))
    (none,) = capability.statistics(parts(values, None, None)).elements
    assert none.cpk is None and none.without == capability.NO_BOUND


def test_a_mean_beyond_a_bound_has_a_negative_cpk():
    values = np.random.default_rng(0).normal(12, 0.1, 50)
    (one,) = capability.statistics(parts(values)).elements
    assert one.cpk.value == pytest.approx(-(values.mean() - 11) / (3 * values.std(ddof=1)))
    assert one.cpk.high < 0 and one.good.count == 0


@pytest.mark.parametrize("n", [1, 2, 29])
def test_few_values_have_no_capability(n):
    values = np.linspace(9.9, 10.1, n)
    (one,) = capability.statistics(parts(values)).elements
    assert (one.cp, one.cpk, one.without) == (None, None, "fewer than 30 values")
    assert one.mean == pytest.approx(values.mean())
    assert (one.deviation is None) == (n == 1)


def test_equal_values_have_no_capability():
    (one,) = capability.statistics(parts([10.1] * 40)).elements
    assert (one.cpk, one.without) == (None, "all values are equal")
    assert capability.histogram(one.values)[0] and sum(capability.histogram(one.values)[0]) == 40


def test_aborted_parts_and_parts_without_a_value_are_apart():
    records = parts([10.0] * 3 + [12.0]).records
    missing = figure(None, verdict="not reached")
    records.append(PartRecord(5, state="bad", program_crc="A", elements=[missing]))
    aborted = figure(10.0, verdict="aborted")
    records += [PartRecord(n, state="aborted", program_crc="A", elements=[aborted]) for n in (6, 7)]
    found = of(records)
    assert (found.good, found.bad, found.aborted, found.parts) == (3, 2, 2, 7)
    assert (found.good_share.count, found.good_share.of) == (3, 5)
    assert found.bad_in_row == 4
    (one,) = found.elements
    assert (one.n, one.not_found, one.good.of) == (4, 1, 5)
    assert one.values == [10.0, 10.0, 10.0, 12.0, None]


def test_only_parts_with_the_program_of_the_last_part_are_in_the_figures():
    old = parts([20.0] * 5).records
    new = [
        PartRecord(r.number + 5, state="good", program_crc="B", elements=[figure(1.0, 0.0, 2.0)])
        for r in old
    ]
    found = of([*old, *new])
    assert (found.parts, found.other_programs, found.bad) == (10, 5, 5)
    (one,) = found.elements
    assert (one.n, one.mean, one.least) == (5, 1.0, 0.0)


def test_a_window_counts_entries_and_has_no_capability():
    window = ElementFigure("window", "window", "good", 1.0, "", None, None)
    wrong = ElementFigure("window", "window", "wrong side", 1.0, "", None, None)
    records = [
        PartRecord(i, state="good", elements=[window if i % 4 else wrong]) for i in range(40)
    ]
    (one,) = of(records).elements
    assert (one.n, one.not_found, one.cpk, one.good.count) == (30, 10, None, 30)


def test_a_histogram_has_every_value_once():
    values = [*np.random.default_rng(3).normal(0, 1, 2000).tolist(), None]
    counts, edges = capability.histogram(values)
    assert (sum(counts), len(counts), len(edges)) == (2000, 30, 31)
    assert edges[0] == min(v for v in values if v is not None)
    assert capability.histogram([None]) == ([], [])


def test_only_the_last_curves_are_drawn():
    curve = [(0.0, 0.0, 1.0), (0.1, 0.001, 2.0)]
    records = [PartRecord(i, state="good", curve=curve if i % 2 else None) for i in range(10)]
    found = capability.last_curves(RecordedParts("here", records), 3)
    assert len(found) == 3 and found[0] == ("good", curve)
    assert capability.last_curves(RecordedParts("here", records), 0) == []
