"""The hidden machines of the study of `forceaxis tune` (machine_study.py): that they are what the
table of ranges says, and can be built."""

import math

import drawn_axes
import drawn_machines
import pytest
from drawn_machines import KINDS, RANGES
from forceaxis import _core, linear
from forceaxis.design import data_sheet, new

pytestmark = pytest.mark.quick

SEEDS = range(125)  # of each of the eight kinds
DEVIATIONS = 4.5  # of a binomial count: one of 150,000 honest counts is further away


@pytest.fixture(scope="module")
def machines():
    return [drawn_machines.draw(kind, seed) for kind in KINDS for seed in SEEDS]


def expect_binomial(count, trials, probability):
    deviation = math.sqrt(trials * probability * (1 - probability))
    assert abs(count - trials * probability) <= DEVIATIONS * deviation, (count, trials)


def test_each_disturbance_occurs_as_often_as_the_table_says(machines):
    names = {name for machine in machines for name in machine.possible}
    assert names == set(RANGES["disturbance"]) == set(drawn_machines.DRAWS)
    for name in names:
        able = [machine for machine in machines if name in machine.possible]
        assert len(able) >= 50
        expect_binomial(sum(name in m.elements for m in able), len(able), RANGES["probability"])


def test_disturbances_are_independent(machines):
    third = RANGES["probability"]
    names = sorted(RANGES["disturbance"])
    for one in names:
        for other in names:
            able = [m for m in machines if {one, other} <= {*m.possible}]
            if one < other and {one, other} != {"soft", "stiff"} and len(able) > 100:
                both = sum({one, other} <= m.elements.keys() for m in able)
                expect_binomial(both, len(able), third**2)
    assert not any({"soft", "stiff"} <= machine.elements.keys() for machine in machines)


def test_a_vertical_axis_can_be_each_other_kind_and_looks_both_ways(machines):
    upright = [machine for machine in machines if machine.kind == "vertical"]
    assert {machine.drive for machine in upright} == {*drawn_machines.SIMPLE}
    expect_binomial(sum(m.sheet["inclination_deg"] > 0 for m in upright), len(upright), 0.5)
    assert all("inclination_deg" not in m.sheet for m in machines if m.kind != "vertical")


def test_forces_and_sensors_span_the_table(machines):
    full, spans = [machine.full_N for machine in machines], RANGES["full_scale_n"].values()
    assert min(full) < 1.5 * min(low for low, _ in spans)
    assert max(full) > max(high for _, high in spans) / 1.5
    sensor, sheets = RANGES["sensor"], [machine.sheet for machine in machines]
    for kind in KINDS:
        own = [machine.sheet for machine in machines if machine.kind == kind]
        assert {sheet["sensor_bits"] for sheet in own} == set(sensor["bits"])
        ticks = sum("sensor_rate_hz" not in sheet for sheet in own)
        expect_binomial(ticks, len(own), sensor["at_the_tick"])
    rates = {sheet["sensor_rate_hz"] for sheet in sheets if "sensor_rate_hz" in sheet}
    assert rates == set(sensor["rate_hz"])
    assert {sheet.get("sensor_filter") for sheet in sheets} == {None, *sensor["filter"]}


def test_without_a_disturbance_nothing_else_of_a_machine_changes():
    for kind in KINDS:
        machine = drawn_machines.draw(kind, 3)
        for name, found in machine.elements.items():
            less = drawn_machines.draw(kind, 3, without=(name,))
            assert less.elements == {k: v for k, v in machine.elements.items() if k != name}, found
            assert less.full_N == machine.full_N and less.possible == machine.possible


def test_an_exact_machine_is_its_data_sheet():
    for kind in KINDS:
        machine = drawn_machines.draw(kind, 3, exact=True)
        assert machine.truth == machine.elements == {}


# An experiment in which a machine is off; `forceaxis new` would compute gains for its own.
OFF = """title = "at rest"
model = "model.toml"
duration_s = 1.0
[firmware]
mode = "disabled"
adc_bits = {bits}
force_zero_code = {zero}
"""


@pytest.mark.parametrize("kind", KINDS)
def test_true_machines_load_and_rest(kind, tmp_path):
    """One that is off stays where it is: a brake or dry friction holds it, or nothing pulls."""
    lowest = data_sheet.BY_NAME["sensor_rate_hz"].low
    for seed in range(16):
        machine = drawn_machines.draw(kind, seed)
        # slower sensors are refused by their field
        machine.sheet["sensor_rate_hz"] = max(lowest, machine.sheet.get("sensor_rate_hz", 1500))
        values, sources = drawn_axes.collected(machine.sheet)
        known = tmp_path / f"known{seed}"
        known.mkdir()
        text = new.render(new.MODEL, "drawn", new.derive(values), sources)
        (known / "model.toml").write_text(text)
        bits = values.code_bits
        (known / "contact.toml").write_text(OFF.format(bits=bits, zero=2 ** (bits - 1)))
        model = drawn_machines.true_model(known / "model.toml", machine, tmp_path / f"true{seed}")
        linear.facts(model.with_name("linear.toml"))
        axis = _core.LiveAxis(str(model.with_name("contact.toml")), [], "")
        axis.step(100)
        scale = abs(linear.facts(model).required_encoder.scale)
        moved = [axis.extremes[f"position_{end}_cnt"] / scale for end in ("min", "max")]
        assert max(moved) - min(moved) < 2e-5 and abs(axis.extremes["force_N"]) < 1e-9, (
            seed,
            moved,
        )
