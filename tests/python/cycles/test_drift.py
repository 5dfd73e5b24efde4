"""The test for wear and drift has the stated share of false alarms, and finds changes."""

import itertools
import random

import numpy as np
import pytest
from forceaxis.cycles import drift, judge
from forceaxis.errors import ParameterError
from forceaxis.recordings.importing import Imported
from judged_curves import recording
from scipy import stats
from test_judge import PRESS, press_of, pressed


def series(values, name="a", is_count=False):
    return drift.Series(name, "N", is_count, [None if v is None else float(v) for v in values])


def largest_sum(values, reference):
    """The largest sum of a rise, in steps, by the definition of the test."""
    total, largest = 0.0, 0.0
    for i in range(reference, len(values)):
        rank = 1 + sum(v < values[i] for v in values[:i])
        score = stats.norm.ppf(rank / (i + 2)) / drift.STEP
        total = max(0.0, total + round(score) - drift.ALLOWANCE)
        largest = max(largest, total)
    return largest


@pytest.mark.parametrize(("reference", "n"), [(2, 6), (4, 6), (1, 6)])
@pytest.mark.parametrize("limit", [0, 3, 7, 12, 20])
def test_the_share_of_alarms_is_that_over_all_orders_of_the_values(reference, n, limit):
    alarms = [largest_sum(o, reference) > limit for o in itertools.permutations(range(n))]
    assert drift.exceeded(limit, reference, n) == pytest.approx(np.mean(alarms), abs=1e-12)


@pytest.mark.parametrize("i", [1, 2, 7, 31, 200, 5001])
def test_the_scores_of_equally_probable_ranks_have_the_distribution(i):
    ranks = np.arange(1, i + 1) / (i + 1)
    scores = np.round(stats.norm.ppf(ranks) / drift.STEP).astype(int) + drift.SCORE_MOST
    assert np.array_equal(np.bincount(scores, minlength=161) / i, drift.distribution(i))


def test_the_limit_is_the_smallest_that_keeps_the_share():
    limit, share = drift.limit_of(30, 200, 0.001)
    assert share == drift.exceeded(limit, 30, 200) <= 0.001 < drift.exceeded(limit - 1, 30, 200)


def test_an_element_is_flagged_where_a_sum_exceeds_its_limit():
    rng, seen = np.random.default_rng(7), set()
    for _ in range(150):
        values = rng.normal(size=24)
        (found,) = drift.drift([series(values)], 0.5, 10).elements
        limit = round(found.limit / drift.STEP)
        sums = [largest_sum(values, 10), largest_sum(-values, 10)]
        assert (found.found_at is not None) == (max(sums) > limit)
        seen.add((max(sums) > limit, max(sums) == limit))
        if found.found_at is not None:
            before = values[: found.found_at - 1]
            assert max(largest_sum(before, 10), largest_sum(-before, 10)) <= limit
    assert seen == {(True, False), (False, False), (False, True)}


# Values of parts without a change, of five elements of the same curve.
UNCHANGED = {
    "normal": lambda rng, shape: rng.normal(size=shape),
    "Cauchy": lambda rng, shape: rng.standard_cauchy(size=shape),
    "exponential": lambda rng, shape: rng.exponential(size=shape),
    "two kinds of parts": lambda rng, shape: rng.normal(size=shape) + 9 * (rng.random(shape) < 0.3),
}


def found_share(draw, runs, parts=120, elements=5, share=0.1, seed=1):
    """(share of series in which the test finds a change, stated share)."""
    rng = np.random.default_rng(seed)
    flagged = 0
    for _ in range(runs):
        columns = draw(rng, (elements, parts))
        done = drift.drift([series(c, str(k)) for k, c in enumerate(columns)], share, 30)
        flagged += done.is_found
    return flagged / runs, done.false_alarms


@pytest.mark.parametrize("name", UNCHANGED)
def test_false_alarms_are_within_the_stated_share(name):
    runs = 300
    found, stated = found_share(UNCHANGED[name], runs)
    assert 0.09 < stated <= 0.1
    assert found * runs <= stats.binom.ppf(0.999, runs, stated)
    # The bound is near what happens: five independent elements are flagged in 1 - 0.98^5 = 9.6 %.
    assert found * runs >= stats.binom.ppf(0.001, runs, 0.096)


@pytest.mark.long
@pytest.mark.parametrize("name", UNCHANGED)
def test_false_alarms_are_within_the_stated_share_of_many_series(name):
    found, stated = found_share(UNCHANGED[name], 4000, parts=200, share=0.05, seed=2)
    assert found <= stats.binom.ppf(0.9999, 4000, stated) / 4000


def test_dependent_elements_and_counted_values_raise_fewer_alarms():
    def same(rng, shape):
        return np.tile(rng.normal(size=shape[1]), (shape[0], 1))

    def whole(rng, shape):
        return np.round(rng.normal(size=shape))

    for draw in (same, whole):
        found, stated = found_share(draw, 300)
        assert found * 300 <= stats.binom.ppf(0.999, 300, stated)
    assert found_share(same, 300)[0] < 0.06


def test_equal_values_are_no_change():
    done = drift.drift([series([4.0] * 500)], 0.5, 10)
    assert not done.is_found


@pytest.mark.parametrize(("sign", "direction"), [(1, "rises"), (-1, "falls")])
def test_a_step_is_found_where_it_is(sign, direction):
    rng = np.random.default_rng(5)
    values = rng.normal(50, 1, 200)
    values[100:] += 2.5 * sign
    (found,) = drift.drift([series(values)]).elements
    assert found.direction == direction
    assert 100 < found.found_at <= 115
    assert 99 <= found.since <= 103  # the part 101 is the first one
    assert found.change == pytest.approx(2.5 * sign, abs=0.5)


def test_parts_without_a_value_keep_their_numbers():
    rng = np.random.default_rng(6)
    values = [*rng.normal(0, 1, 60), *[None] * 40, *rng.normal(6, 1, 20)]
    (found,) = drift.drift([series(values)]).elements
    assert found.n == 80
    assert 100 < found.found_at <= 110
    assert found.since == 101


def test_what_cannot_be_tested_says_why():
    short, window = drift.drift([series(range(30)), series(range(90), is_count=True)]).elements
    assert short.without == drift.TOO_FEW
    assert window.without == drift.WINDOW
    with pytest.raises(ParameterError, match="expected at least 10 parts, got 9"):
        drift.drift([], 0.01, 9)
    with pytest.raises(ParameterError, match=r"expected a share from 1e-06 to 0\.5, got 0\.6"):
        drift.drift([], 0.6)


def worn(press, seed, wear_mm_per_part):
    """200 judged parts, whose shoulder moves after the hundredth."""
    rng = random.Random(seed)
    curves = []
    for number in range(1, 201):
        wear_m = wear_mm_per_part * 1e-3 * max(0, number - 100)
        shoulder, friction = rng.gauss(0.003, 20e-6) - wear_m, rng.gauss(25e3, 1e3)
        made = recording(*pressed(rng, 1000.0, shoulder, friction))
        curves.append((f"{number}.npz", [Imported(made, ())]))
    return judge.judge_all(press, curves)


def test_wear_after_the_hundredth_part_is_found(tmp_path):
    """The shoulder moves by 2 um from part to part, a tenth of the deviation of the parts."""
    judged = worn(press_of(tmp_path, PRESS), 45, 0.002)
    found = drift.drift(drift.series_of(judged.records), 0.01, 50)
    assert found.false_alarms <= 0.01
    by_name = {element.name: element for element in found.elements}
    shoulder = by_name["shoulder"]
    assert shoulder.direction == "falls"
    assert 100 < shoulder.found_at <= 130
    assert 90 <= shoulder.since <= 115
    assert by_name["slope"].found_at is None  # the friction does not change
    assert by_name["joining"].without == drift.WINDOW


def test_a_series_without_wear_is_not_flagged(tmp_path):
    judged = worn(press_of(tmp_path, PRESS), 46, 0.0)
    assert not drift.drift(drift.series_of(judged.records), 0.01, 50).is_found
