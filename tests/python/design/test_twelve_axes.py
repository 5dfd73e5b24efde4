"""Twelve axes from data sheets: a bank designed for each, beside P at the same margins."""

from dataclasses import replace

import pytest
import twelve_axes
from forceaxis.design import data_sheet, new, reduced, sets
from forceaxis.design.grid import LOWEST_HZ, Goal
from forceaxis.linear import over
from forceaxis.linear.bank import Bank
from forceaxis.linear.loops import LoopSpec

BETTER = 1.5
ALL = list(twelve_axes.AXES)
QUICK = [ALL[11]]
LATER = (pytest.mark.beside, pytest.mark.long)
SHEETS = [pytest.param(n, marks=() if n in QUICK else LATER, id=n) for n in ALL]


def made(folder, sheet):
    """(PlantSet, Goal) of an axis."""
    words = sheet.split()
    given = {o[2:].replace("-", "_"): v for o, v in zip(words[::2], words[1::2], strict=True)}
    names = {field.name.lower(): field.name for field in data_sheet.FIELDS}
    values, sources = data_sheet.collect({names[n]: v for n, v in given.items()})
    new.write(folder / "axis", values, sources)
    plants = sets.plant_set(folder / "axis/model.toml")
    return plants, Goal(adc_bits=int(values.sensor_bits))


@pytest.mark.parametrize("name", SHEETS)
def test_the_bank_is_half_as_fast_again_as_p_or_the_sentence_says_why_not(tmp_path, name):
    plants, goal = made(tmp_path, twelve_axes.AXES[name])
    problem = reduced.ShortSearch(plants, goal)
    p, found = problem.worst(Bank(1.0)).worst, problem.designed()
    bank, worst = problem.exact(found.bank)
    # Exact figures, not those of the grid, at the worst of the set.
    for timing, most in (("zoh", goal.ms), ("zoh+1", goal.ms_late)):
        exact = over.worst(plants, (timing,), LoopSpec("bank", bank=bank))
        assert exact.stable and exact.Ms < 1.0001 * most
        assert exact.gain_margin is None or exact.gain_margin > 0.9999 * goal.gain_margin
        assert exact.fS_Hz > 0.9999 * worst.fS_Hz and not exact.sag
    if p.fS_Hz < 1.01 * LOWEST_HZ:  # |S| of P is above -3 dB everywhere
        assert p.static_error > 0.7
        return
    if worst.fS_Hz >= BETTER * p.fS_Hz:
        return
    # What the sentence names is what limits: given more of it alone, the bank gets faster.
    sentence = problem.limited_by(found)
    if "high frequency" in sentence:
        more = replace(goal, adc_bits=16, hf_gain=2 * goal.bounds().hf_gain)
    elif "peak of |S|" in sentence:
        more = replace(goal, ms=1.3 * goal.ms, ms_late=1.3 * goal.ms_late)
    else:
        assert "gain margin" in sentence
        more = replace(goal, gain_margin=goal.gain_margin / 1.3)
    faster = reduced.ShortSearch(plants, more).designed().worst.fS_Hz
    assert faster > 1.02 * worst.fS_Hz, sentence
