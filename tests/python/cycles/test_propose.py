"""Proposed bounds on drawn populations without a simulation: the share that they refuse later."""

import re
from pathlib import Path

import numpy as np
import pytest
from forceaxis import InputError, paths
from forceaxis.cycles import propose
from forceaxis.cycles.outcome import PartOutcome
from forceaxis.cycles.program import Element, Program, read_program
from forceaxis.cycles.statistics import parts_needed
from scipy import stats

BOTH = [(0, 1), (0, -1), (1, 1), (1, -1), (2, 1), (2, -1)]  # both sides of three elements


def within(x, bounds, columns):
    """The part of [0, 1] in each column that is between its bounds."""
    width = []
    for column in range(columns):
        low, high = bounds[2 * column], bounds[2 * column + 1]
        width.append(high - low)
    return np.prod(width)


def test_the_share_that_independent_elements_refuse_has_the_stated_distribution():
    """The refused share of uniform values is known exactly: no fresh parts are drawn."""
    random, parts, take = np.random.default_rng(1), 600, 6
    refused = []
    for _ in range(2000):
        values = random.random((parts, 3))
        refused.append(1 - within(values, propose.bounds_by_blocks(values, BOTH, take), 3))
    assert np.mean(refused) == pytest.approx(take / (parts + 1), rel=0.04)
    exact = stats.beta(take, parts + 1 - take)
    assert stats.kstest(refused, exact.cdf).pvalue > 0.01


@pytest.mark.parametrize("power", [1.0, 3.0, -1.0])
def test_the_share_that_dependent_elements_refuse_has_it_too(power):
    """Elements that say the same, and one that says it in reverse."""
    random, parts, take = np.random.default_rng(2), 400, 12
    refused = []
    for _ in range(1000):
        x = random.random(parts)
        values = np.stack([x, x ** abs(power) * np.sign(power), x * 5 + 2], axis=1)
        bounds = propose.bounds_by_blocks(values, BOTH, take)
        ends = [b if power > 0 else -b for b in bounds[2:4]]
        second = sorted(end ** (1 / abs(power)) for end in ends)
        low = max(bounds[0], second[0], (bounds[4] - 2) / 5)
        high = min(bounds[1], second[1], (bounds[5] - 2) / 5)
        refused.append(1 - (high - low))
    assert stats.kstest(refused, stats.beta(take, parts + 1 - take).cdf).pvalue > 0.01


def test_correlated_normal_elements_on_fresh_parts():
    """9000 parts and one percent, judged on 30,000 others, as the press-fit is judged."""
    random = np.random.default_rng(3)
    mixed = np.linalg.cholesky(np.array([[1, 0.8, -0.3], [0.8, 1, 0.1], [-0.3, 0.1, 1]]))
    judged = []
    for _ in range(40):
        values, fresh = (random.normal(size=(n, 3)) @ mixed.T for n in (9000, 30000))
        bounds = propose.bounds_by_blocks(values, BOTH, 90)
        refused = (fresh < bounds[::2]).any(axis=1) | (fresh > bounds[1::2]).any(axis=1)
        judged.append(refused.mean())
    assert np.mean(judged) == pytest.approx(0.01, abs=0.0006)
    # Deviation of Beta(90, 8911) and of 30,000 parts.
    deviation = np.hypot(stats.beta(90, 8911).std(), np.sqrt(0.01 * 0.99 / 30000))
    assert np.std(judged) == pytest.approx(deviation, rel=0.4)
    assert sum(0.007 <= share <= 0.013 for share in judged) >= 38


def test_equal_values_refuse_less_and_not_much_less():
    """Values in steps, as an encoder and a converter give them."""
    random, parts, take = np.random.default_rng(4), 2000, 40
    refused = []
    for _ in range(300):
        values = np.round(random.normal(size=(parts, 2)) * 50)
        fresh = np.round(random.normal(size=(20000, 2)) * 50)
        bounds = propose.bounds_by_blocks(values, BOTH[:4], take)
        outside = (fresh < bounds[::2]).any(axis=1) | (fresh > bounds[1::2]).any(axis=1)
        refused.append(outside.mean())
    assert 0.85 * take / (parts + 1) <= np.mean(refused) <= 1.03 * take / (parts + 1)


def test_a_single_bound_takes_the_parts_of_its_side():
    values = np.arange(1000.0)[:, None]
    assert propose.bounds_by_blocks(values, [(0, 1)], 10) == [9.0]
    assert propose.bounds_by_blocks(values, [(0, -1)], 10) == [990.0]
    assert propose.bounds_by_blocks(values, [(0, 1), (0, -1)], 10) == [4.0, 995.0]


# Outcomes and programs.


def element(name, kind="peak", least=0.0, most=1.0, unit="N"):
    shape = kind in ("window", "envelope")
    bounds = (None, None, least, most, None, [], [])
    return Element(name, kind, shape, ["seat"], "travel", "x", unit, 1.0, *bounds)


def program(*elements):
    return Program(
        Path("cycle.toml"), "A program", 1, b"", 0, "touch", None, [], list(elements), []
    )


def outcomes(values, verdicts=None, how="by_program"):
    found = verdicts or ["good"] * values.shape[1]
    return [PartOutcome("good", how, "", found, [float(v) for v in row]) for row in values]


def test_elements_without_a_number_or_a_bound_stay():
    own = program(
        element("window", "window"),
        element("top", "peak", least=None),
        element("free", "valley", None, None),
    )
    values = np.random.default_rng(5).random((1000, 3))
    found, anyway = propose.proposed(own, outcomes(values), 0.01)
    assert found.elements[0] == own.elements[0] and found.elements[2] == own.elements[2]
    assert found.elements[1].least is None
    assert found.elements[1].most == np.sort(values[:, 1])[-10].round(12)
    assert anyway == 0
    assert [(one.name, one.why) for one in propose.left_of(found)] == [
        ("window", propose.LEFT_SHAPE),
        ("free", propose.LEFT_OPEN),
    ]


def test_parts_that_are_refused_anyway_count():
    """Eight of a thousand parts fail at the window or at a limit: two are left for the bound."""
    own = program(element("window", "window"), element("top", least=None))
    values = np.arange(2000.0).reshape(1000, 2)
    parts = outcomes(values)
    for i in range(500, 505):
        parts[i] = outcomes(values[i : i + 1], ["wrong side", "good"])[0]
    for i in range(505, 508):
        parts[i] = outcomes(values[i : i + 1], how="over_force")[0]
    found, anyway = propose.proposed(own, parts, 0.01)
    assert anyway == 8
    assert found.elements[1].most == 1997.0  # the second largest
    # Aborted parts are no parts.
    aborted = [PartOutcome("aborted", "stopped", "seat", ["aborted", "aborted"], [0, 0])] * 50
    assert propose.proposed(own, [*aborted, *parts], 0.01) == (found, anyway)


@pytest.mark.parametrize(
    ("count", "rate", "elements", "words"),
    [
        (298, 0.1, [element("top", least=None)], ["parts", "at least 299", "298"]),
        (598, 0.01, [element(n) for n in "abc"], ["parts", "at least 599 good parts for 6 bounds"]),
        (1000, 0.0, [element("top")], ["propose", "a share from"]),
        (1000, 0.6, [element("top")], ["propose", "a share from"]),
        (1000, 0.01, [element("w", "window")], ["`least` or `most`", "is not a `window`"]),
    ],
)
def test_what_cannot_be_proposed_is_refused(count, rate, elements, words):
    values = np.random.default_rng(6).random((count, len(elements)))
    with pytest.raises(InputError) as error:
        propose.proposed(program(*elements), outcomes(values), rate)
    for word in words:
        assert word in str(error.value)


def test_a_window_that_refuses_more_than_the_rate_is_named():
    values = np.random.default_rng(7).random((1000, 2))
    parts = outcomes(values)
    for i in range(20):
        parts[i] = outcomes(values[i : i + 1], ["again", "good"])[0]
    with pytest.raises(InputError, match="20 of 1000 good parts whatever the bounds"):
        propose.proposed(program(element("w", "window"), element("top")), parts, 0.01)


def test_the_number_of_parts_that_a_refusal_names_is_enough():
    """A window that refuses 0.5 % of the parts leaves too few of 600 for the bounds at 1 %."""
    own = program(element("w", "window"), *(element(name) for name in "abc"))

    def parts(count):
        values = np.random.default_rng(8).random((count, 4))
        found = outcomes(values)
        for i in range(0, count, 200):
            found[i] = outcomes(values[i : i + 1], ["again", *["good"] * 3])[0]
        return found

    with pytest.raises(InputError, match="give a larger share or take some") as error:
        propose.proposed(own, parts(600), 0.01)
    named = int(re.search(r"take some (\d+) parts", str(error.value))[1])
    assert propose.proposed(own, parts(named + 200), 0.01)[1] == -(-(named + 200) // 200)


def test_the_page_names_the_parts_that_its_example_needs():
    page = (paths.ROOT / "docs/guide/cycles.md").read_text(encoding="utf-8")
    stated = re.search(r"The six bounds of the\s+press-fit need (\d+) parts at 1 %", page)
    own = read_program(paths.EXPERIMENTS / "press_fit.toml")
    bounds = len(propose.sides_of(own))
    assert bounds == 6 and int(stated[1]) == parts_needed(0.01, bounds)


TEXT = """\
# The head stays.
title = "A program"   # so does this

[[element]]
name = "top"          # peak
kind = "peak"
phases = ["seat"]
least = "390 N"       # lower
most = "0.425 kN"

[[element]]
name = "shoulder"
kind = "at"
phases = ["join"]
of = "force"
level = "200 N"
least = 0.0038
most = "4.3 mm"
"""


def test_only_the_bounds_of_the_text_change():
    own = program(
        element("top", least=400.655, most=401.25),
        element("shoulder", "at", least=0.003897, most=0.0041239999999999996, unit="m"),
    )
    expected = (
        TEXT.replace('"390 N"', '"400.655 N"')
        .replace('"0.425 kN"', '"0.40125 kN"')
        .replace("0.0038", "0.003897")
        .replace('"4.3 mm"', '"4.124 mm"')
    )
    assert propose.edited(TEXT, own) == expected
    assert propose.edited(TEXT.replace("\n", "\r\n"), own) == expected.replace("\n", "\r\n")
