"""Designs over a bus and with sampled sensors: the loop of the search is the lifted loop, and every
printed law keeps its margins by closed-loop eigenvalues."""

import itertools
import os
from dataclasses import replace

import design_study
import pytest
from forceaxis import paths
from forceaxis.design import search, structures
from forceaxis.design.grid import Goal
from forceaxis.linear import over
from forceaxis.linear.bank import Bank
from forceaxis.linear.loops import LoopSpec
from forceaxis.linear.plant_set import PlantSet, ranges_of
from forceaxis.linear.precise import FIGURES, PreciseLoops, Responses

pytestmark = pytest.mark.beside
BOTH = ("zoh", "zoh+1")
SLOPES = ({}, {"drive.amplifier": "high outer"})
# Keys of the sensor, cycle of the bus and delay of the command in ticks.
ONCE_A_CYCLE = ("sample_rate = 500\nsample_phase = 0\n", 3, 3)
SENSORS = {
    "once a cycle": ONCE_A_CYCLE,
    "twice a cycle, late, filter, no bus delay": (
        'sample_rate = 1000\nsample_phase = 0.0004\nlatency = 0.0005\nconverter_filter = "sinc3"\n',
        3, 0,
    ),
    "filter over four cycles, command a tick late": (
        'sample_rate = 500\nsample_phase = 0.0011\nconverter_filter = "sinc5"\n', 3, 1,
    ),
    "each tick, late, no bus": (
        "sample_rate = 1500\nsample_phase = 0\nlatency = 0.0005\n", 1, 0,
    ),
    "any phase": ("sample_rate = 1000\nlatency = 0.0003\n", 3, 3),
}  # fmt: skip
LEAD = Bank(1.2, 2.0, 0.0, ((1.2, -1.1, 0.2, -0.8, 0.1),))


def model(folder, adc, cycle, late):
    """The laboratory axis with 12 bits, on a bus, with keys of its sensor."""
    text = (paths.MODELS / "laboratory_12bit.toml").read_text()
    text = text.replace("[[adc]]\nchannel = 0\n", f"[[adc]]\nchannel = 0\n{adc}")
    keys = f"cycle_ticks = {cycle}\ndelay_ticks_out = {late}\n" if cycle > 1 else ""
    file = folder / "sampled.toml"
    file.write_text(text.replace("[drive]\n", "[drive]\n" + keys))
    (folder / "thesis.toml").write_text((paths.MODELS / "thesis.toml").read_text())
    return str(file)


@pytest.mark.quick
@pytest.mark.parametrize("name", SENSORS)
def test_where_one_code_leaves_a_period_figures_are_those_of_the_lifted_loop(tmp_path, name):
    file = model(tmp_path, *SENSORS[name])
    plants = PlantSet(file, {}, {}, SLOPES)
    responses = Responses(plants, BOTH, all_phases=True)
    assert responses.is_exact and responses.is_free == (name == "any phase")
    spec = LoopSpec("bank", bank=LEAD)
    loops = PreciseLoops.of(responses, BOTH, spec, None, None)
    for member, rows in zip(plants.nominal(), loops.figures(plants.nominal()), strict=True):
        for timing, found in zip(BOTH, rows, strict=True):
            loop = plants.loop(member, timing, spec)
            true = over.figures(loop, loop.gain_of(LEAD.force_gain))
            assert true.stable and found.stable
            for figure in FIGURES:
                value = abs(getattr(true, figure))
                # |T| of C++ is that of the reading, and its set-point acts once in a cycle.
                error = 0.1 if figure == "fT_Hz" else 1e-7
                assert abs(getattr(found, figure)) == pytest.approx(value, rel=error), figure


GOAL = Goal(adc_bits=12, hf_gain=15.0)


@pytest.fixture
def bus(tmp_path):
    """The set of plants of an axis whose force and command pass once in a cycle."""
    file = model(tmp_path, *ONCE_A_CYCLE)
    return PlantSet(file, {}, ranges_of(file, ["k_w=30%,m_w=30%"]), SLOPES)


def test_a_law_over_a_bus_is_certified_and_what_costs_bandwidth_is_said(bus, monkeypatch):
    """A table had a bank of 4.5 Hz that is unstable, and the chosen one was slower than P."""
    monkeypatch.setattr(search, "RANDOM", 30)
    monkeypatch.setattr(search, "PROBE_RANDOM", 10)
    monkeypatch.setattr(search, "RESTARTS", (1, 1, 1))
    monkeypatch.setattr(structures, "STRUCTURES", {"P": None, "PI": 0, "PI and one biquad": 1})
    found = search.search(bus, GOAL)
    assert design_study.faults(bus, GOAL, found) == []
    assert found.worst.fS_Hz > 3.5 and "a ramp of 0.1 s: without this" in found.limited_by


@pytest.mark.long
def test_a_longer_ramp_permits_more_bandwidth_over_a_bus(bus):
    found = search.search(bus, replace(GOAL, ramp_s=1.0))
    assert design_study.faults(bus, GOAL, found) == []
    assert found.worst.fS_Hz > 4.44  # of a search of another program, with one section


@pytest.mark.quick
def test_a_larger_structure_without_more_bandwidth_is_not_printed(tmp_path, monkeypatch):
    """Its search may end at a worse law than that of a smaller structure."""
    monkeypatch.setattr(search, "RANDOM", 10)
    monkeypatch.setattr(search, "PROBE_RANDOM", 5)
    monkeypatch.setattr(structures, "STRUCTURES", {"P": None, "PI": 0, "PI and one biquad": 1})

    def poor(problem, thin, name, fS, zeros, best):
        limits = structures.bounds(name, fS)
        return best if len(best) == len(limits) else limits @ [0.8, 0.2]

    monkeypatch.setattr(search, "_search", poor)
    monkeypatch.setattr(search, "_polished", lambda problem, numbers, limits: numbers)
    plants = PlantSet("fig4_19", {}, ranges_of("fig4_19", ["k_w=30%"]), ({},))
    found = search.search(plants, Goal(adc_bits=12))
    rows = [row.bandwidth_Hz for row in found.structures if row.name != "P"]
    assert all(before < after for before, after in itertools.pairwise(rows))
    assert rows and found.worst.fS_Hz >= max(rows) * 0.99


COUNT = int(os.environ.get("FORCEAXIS_DESIGNS", "4"))  # all: 200


@pytest.mark.parametrize(
    "number", [pytest.param(n, marks=() if n == 1 else pytest.mark.long) for n in range(COUNT)]
)
def test_no_design_is_below_a_smaller_structure_and_each_row_is_confirmed(number):
    kinds = design_study.KINDS
    # Every third kind, so that few designs have different ones.
    line, wrong = design_study.study(kinds[3 * number % len(kinds)], number // len(kinds))
    print(line)
    assert wrong == [], line
