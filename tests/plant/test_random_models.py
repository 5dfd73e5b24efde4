"""Forty random models agree with a second simulator, and 210 more where there is time."""

import functools

import pytest
import random_models
from forceaxis import _core

pytestmark = pytest.mark.beside
BLOCKS, EACH = 4, 10
COUNT = BLOCKS * EACH


@functools.cache
def outcomes(block):
    seeds = range(block * EACH, (block + 1) * EACH)
    return [random_models.compare_safely(seed) for seed in seeds]


MORE = [pytest.param(n, marks=pytest.mark.long) for n in range(BLOCKS, BLOCKS + 11)]


@pytest.mark.parametrize("block", [*range(BLOCKS), *MORE])
def test_every_model_agrees_with_dop853(block):
    assert [str(o) for o in outcomes(block) if not o.agrees()] == []


def test_they_have_what_they_should():
    every = [o for block in range(BLOCKS) for o in outcomes(block)]
    assert {o.bodies for o in every} == set(range(3, 13))
    assert sum(o.ticks for o in every) > 0.9 * COUNT * random_models.TICKS
    assert sum(o.events for o in every) > 2000
    changes = sum((o.changes for o in every), start=random_models.collections.Counter())
    for element in ("contact", "friction", "spring", "damper", "gravity", "drive.amplifier",
                    "drive.preamp", "drive.current_feedback", "drive.effort"):  # fmt: skip
        assert changes[element] > 0, element
    for flank in ("backlash0.low", "backlash0.high", "stop0.low", "stop0.high", "adc0.sensor"):
        assert changes[flank] > 0, flank


MORE_SEEDS = range(5000, 5020)


def test_current_loops_tables_and_solids_agree_with_dop853():
    """These plants have every element of add_motor() and add_tables() besides the others."""
    found = [random_models.compare_safely(seed, more=True) for seed in MORE_SEEDS]
    assert [str(o) for o in found if not o.agrees()] == []
    changes = sum((o.changes for o in found), start=random_models.collections.Counter())
    for element in ("drive.peak", "drive.rated", "load", "foldback", "cogging", "external",
                    "solid", "hard", "hard0.stiffness", "drive.load_angle"):  # fmt: skip
        assert changes[element] > 0, element
    assert sum(o.ticks for o in found) > 0.9 * len(MORE_SEEDS) * random_models.TICKS


MODAL_SEEDS = [range(8000, 8005), pytest.param(range(8005, 8015), marks=pytest.mark.long)]


@pytest.mark.parametrize("seeds", MODAL_SEEDS)
def test_structures_and_hysteresis_agree_with_dop853(seeds):
    """These plants have every element of add_structures() and add_hysteresis()."""
    found = [random_models.compare_safely(seed, modal=True) for seed in seeds]
    assert [str(o) for o in found if not o.agrees()] == []
    changes = sum((o.changes for o in found), start=random_models.collections.Counter())
    for element in ("jenkins", "contact", "friction"):
        assert changes[element] > 20, element
    assert sum(o.ticks for o in found) > 0.9 * len(seeds) * random_models.TICKS


def test_a_comparison_can_fail(monkeypatch):
    """The reference with one spring softer by 1e-6 of itself is found out."""
    load = random_models.Reference._flank

    def softer(self, name, link, *more):
        load(self, name, link | {"stiffness": link["stiffness"] * (1 - 1e-6)}, *more)

    monkeypatch.setattr(random_models.Reference, "_flank", softer)
    assert not random_models.compare(0).agrees()


def test_the_plant_refuses_bad_input(tmp_path):
    model = tmp_path / "m.toml"
    model.write_text('[[body]]\nname = "a"\nmass = -1\n')
    with pytest.raises(_core.InputError, match=r"body\[0\]\.mass"):
        _core.Plant(model)
    model.write_text(random_models.random_model(0)[0])
    with pytest.raises(_core.InputError, match=r"parameters\.nosuch"):
        _core.Plant(model, {"nosuch": 1.0})
    plant = _core.Plant(model)
    with pytest.raises(ValueError, match="outside"):
        plant.step(1 << 20)
    with pytest.raises(ValueError, match="no body named nobody"):
        plant.apply_impulse("nobody", 1.0)
