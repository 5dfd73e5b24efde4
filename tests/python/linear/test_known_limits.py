"""A limit that is known only up to a gain, above which rounding decides, is said so everywhere: no
verb says that the loop is stable at every gain, nor that gain to be its limit."""

import re

import pytest
from click.testing import CliRunner
from forceaxis import paths
from forceaxis.cli import main as cli
from forceaxis.cli.advise_text import describe
from forceaxis.design import advise, new
from forceaxis.linear import locus, loops, over, plant_set, plots, request, stability
from forceaxis.pages import axes

MODEL = "fig4_19"
KNOWN_TO = 7.5  # V/N; the limits of this model are above it
# What would be false of such a loop.
FALSE = r"every gain|infinite|no limit(?! up to)|no crossing above(?! up to)|none$|limit +[0-9]"


@pytest.fixture(autouse=True)
def drowned(monkeypatch):
    """No crossing below KNOWN_TO, above which rounding decides, and poles that settle nothing."""
    monkeypatch.setattr(stability.Loop, "_crossed", property(lambda loop: ([], KNOWN_TO)))
    monkeypatch.setattr(stability.Loop, "_settled", lambda loop, gain: None)


def says(*arguments):
    done = CliRunner().invoke(cli.cli, [str(a) for a in arguments])
    assert done.exit_code == 0, done.output
    return done.output


@pytest.mark.parametrize("arguments", [
    ("loop", "limit", MODEL),
    ("loop", "limit", MODEL, "--timing", "continuous"),
    ("loop", "limit", MODEL, "--law", "gain=0.01"),
    ("loop", "limit", MODEL, "--over", "b_w=30%"),
    ("loop", "limit", MODEL, "--over", "b_w=30%", "--law", "gain=0.01"),
    ("loop", "rlocus", MODEL),
])  # fmt: skip
def test_every_verb_says_up_to_where_it_is_known(arguments, tmp_path):
    if arguments[0] == "rlocus":
        arguments = (*arguments, "--out", tmp_path / "locus.png")
    text = says(*arguments)
    assert not re.search(FALSE, text, re.MULTILINE), text
    assert "up to 7.5 V/N, above which rounding decides" in " ".join(text.split()), text


def test_the_largest_gain_of_a_set_is_none_that_is_known():
    plants = plant_set.PlantSet(MODEL, {}, {"b_w": (8.25, 6.0, 10.0)}, ({},))
    largest = over.largest_gain(plants)
    assert (largest.gain, largest.known_to, largest.frequency_hz) == (None, KNOWN_TO, None)
    worst = over.worst(plants, gain=0.01)
    assert (worst.gain_margin, worst.known_to) == (None, pytest.approx(750))


def test_a_table_of_advice_gives_a_bound():
    found = advise.performance(loops.force_loop(MODEL))
    assert (found.critical_gain, found.known_to) == (None, KNOWN_TO)
    assert found.crossover_hz > 0  # of half of that gain
    none = advise.Performance(critical_gain=None, known_to=None, frequency_hz=None)
    # One that is stable at every gain is better than one of which this is not known.
    assert advise.rank(none, True) < advise.rank(found, True)
    text = describe(advise.advise(advise.AdviceOrder(MODEL, runs="none")))
    assert re.search(r"present design +> 7\.5 ", text), text
    assert "limit        none: stable up to 7.5 V/N, above which rounding decides" in text
    assert not re.search("every gain|no limit(?! up to)", text), text


def test_pictures_and_pages_say_so():
    (one,) = locus.loci([loops.force_loop(MODEL)], [""], None, [None])
    figure = plots.rlocus([one], "")
    assert any("rounding" in text.get_text() for ax in figure.axes for text in ax.texts)
    for text in axes.limits(paths.MODELS / f"{MODEL}.toml")[:2]:
        assert re.fullmatch(r"none up to [0-9.,]+, above which rounding decides", text), text


def test_first_gains_stay_below_what_is_known():
    """A sixth of it, in DAC codes per unit of the signal."""
    assert new.highest_gain(loops.force_loop(MODEL), 0.05) == pytest.approx(KNOWN_TO / 0.05)
    assert request.drawn_gain(loops.force_loop(MODEL), None, None) == 1.0
