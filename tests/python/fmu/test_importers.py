"""Units in other simulators: the same codes as in a run of forceaxis, tick by tick over 10 s."""

import math

import fmpy
import fmus
import pytest
from forceaxis import _core, paths
from libcosimpy import CosimLogging
from libcosimpy.CosimEnums import CosimVariableType
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave

TICKS = 15_001  # a run has a tick at its start and at its end
VERSIONS = pytest.mark.parametrize("version", ["2.0", "3.0"])
CONTACT = paths.EXPERIMENTS / "contact.toml"
SIGNALS = ("robot.position", "tip.velocity", "sensor.force", "drive.current")  # m, m/s, N, A
SETS = ("experiment.duration_s=10", "firmware.force_gain=4.37")


@pytest.fixture(scope="module")
def contact():
    return _core.run(CONTACT, SETS)


def p_law(adc0):
    """The DAC code of the P law: the gain 4.37 as a multiple of 1/256, rounded half up, times the
    force error of the set-point 30 counts."""
    gain_q8 = math.floor(4.37 * 256 + 0.5)
    return max(-2048, min(2047, (gain_q8 * (30 - adc0) + 128) // 256))


@VERSIONS
def test_the_plant_with_a_law_in_python(version, contact, tmp_path):
    with fmus.Fmpy(fmus.write("plant", CONTACT, tmp_path / "plant.fmu", version)) as plant:
        plant.start()
        plant.put_bools(["amp_enable"], [True])
        rows, signals = [], []
        for tick in range(TICKS):
            encoder, adc0, adc1 = plant.ints(["encoder_cnt", "adc0_code", "adc1_code"])
            signals.append(tuple(plant.reals(SIGNALS)))
            rows.append((encoder, adc0, adc1, p_law(adc0), 1))
            plant.put_ints(["dac_code"], [p_law(adc0)])
            plant.step(tick)
    assert rows == fmus.rows_of(contact)
    assert len({row[3] for row in rows}) > 20  # the axis has moved and pressed
    columns = contact.columns()
    assert signals == list(zip(*(columns[name] for name in SIGNALS), strict=True))


@VERSIONS
def test_the_firmware_with_a_plant_in_python(version, contact, tmp_path):
    inputs = _core.inputs(CONTACT)
    plant = _core.Plant(inputs["model"])
    file = fmus.write(
        "firmware", CONTACT, tmp_path / "firmware.fmu", version, "--set", "firmware.force_gain=4.37"
    )
    with fmus.Fmpy(file) as firmware:
        firmware.start()
        rows = []
        for tick in range(TICKS):
            codes = plant.codes()
            firmware.put_ints(["encoder_cnt", "adc0_code", "adc1_code"], codes)
            firmware.step(tick)
            (dac,), (enabled,) = firmware.ints(["dac_code"]), firmware.bools(["amp_enable"])
            rows.append((*codes, dac, int(enabled)))
            plant.step(dac, enabled)
        force, gain = firmware.reals(["axis.force", "axis.force_gain"])
    assert rows == fmus.rows_of(contact)
    assert force == rows[-1][1]  # counts of an 8-bit ADC with the zero code 0
    assert gain == math.floor(4.37 * 256 + 0.5) / 256


@pytest.mark.parametrize(
    ("experiment", "version"), [("press_fit", "2.0"), ("force_step", "3.0"), ("homing", "3.0")]
)
@pytest.mark.parametrize("importer", [fmus.Fmpy, fmus.Fmuloader])
def test_both_units_in_two_importers(experiment, version, importer, tmp_path):
    source = paths.EXPERIMENTS / f"{experiment}.toml"
    files = [
        fmus.write(kind, source, tmp_path / f"{kind}.fmu", version)
        for kind in ("plant", "firmware")
    ]
    expected = fmus.rows_of(_core.run(source))
    with importer(files[0]) as plant, importer(files[1]) as firmware:
        plant.start()
        firmware.start()
        assert fmus.loop(plant, firmware, len(expected)) == expected


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_a_loop_with_a_step_of_a_seventh_of_a_tick_has_the_codes_of_a_run(version, tmp_path):
    """The firmware's outputs change at ticks alone, so the plant computes the same doubles."""
    source = paths.EXPERIMENTS / "force_step.toml"
    files = [
        fmus.write(kind, source, tmp_path / f"{kind}.fmu", version)
        for kind in ("plant", "firmware")
    ]
    expected = fmus.rows_of(_core.run(source))[:1000]
    with fmus.Fmpy(files[0]) as plant, fmus.Fmpy(files[1]) as firmware:
        plant.start()
        firmware.start()
        rows = fmus.loop(plant, firmware, 7 * len(expected), step_s=fmus.STEP_S / 7)
    assert rows[::7] == expected
    # Between ticks, codes and outputs are held: the next row has the codes before the step's end.
    assert rows[3::7] == rows[::7]


def test_fmpy_simulates_the_plant_with_steps_of_a_master_of_its_own(tmp_path):
    """Steps of 1 ms, 0.1 ms, 0.7 ms and 0.5 s: the signals at common instants are the same."""
    file = str(fmus.write("plant", CONTACT, tmp_path / "plant.fmu", "3.0"))
    signals, starts = ["robot.position", "sensor.force"], {"dac_code": 150, "amp_enable": True}
    found = {}
    for step_s in (1e-3, 1e-4, 7e-4, 0.5, 1 / 1500):
        done = fmpy.simulate_fmu(
            file, stop_time=2.0, step_size=step_s, output_interval=step_s, start_values=starts,
            output=signals,
        )  # fmt: skip
        for row in done:
            found.setdefault(round(row["time"], 9), []).append([row[name] for name in signals])
    # 0 s, 0.5 s, ..., and others; the largest force is beyond 10 N, so the contact is made.
    common = {time: rows for time, rows in found.items() if len(rows) >= 3}
    assert len(common) > 100 and max(abs(rows[0][1]) for rows in common.values()) > 10
    for rows in common.values():
        assert all(row == pytest.approx(rows[0], rel=1e-9, abs=1e-12) for row in rows)


def test_a_simulator_that_steps_all_units_at_once(tmp_path):
    """libcosim takes the outputs of the last tick, and cuts the step to whole nanoseconds."""
    files = {k: fmus.write(k, CONTACT, tmp_path / f"{k}.fmu") for k in ("plant", "firmware")}
    with fmus.Fmpy(files["plant"]) as plant, fmus.Fmpy(files["firmware"]) as firmware:
        plant.start()
        firmware.start()
        expected = fmus.parallel(plant, firmware, TICKS - 1)
        places = {"plant": plant.references, "firmware": firmware.references}
    CosimLogging.log_output_level(CosimLogging.CosimLogLevel.WARNING)
    execution = CosimExecution.from_step_size(1e9 / 1500)
    # libcosimpy 0.0.6 calls this function by a name that it does not have.
    integers = execution._CosimExecution__connect_int_variables
    execution._CosimExecution__connect_integer_variables = integers
    index = {k: execution.add_local_slave(CosimLocalSlave(str(f), k)) for k, f in files.items()}

    def connect(names, source, to, how):
        for name in names:
            assert how(index[source], places[source][name], index[to], places[to][name]) == 0

    connect(fmus.CODES, "plant", "firmware", execution.connect_integer_variables)
    connect(fmus.SWITCHES, "plant", "firmware", execution.connect_boolean_variables)
    connect(["dac_code"], "firmware", "plant", execution.connect_integer_variables)
    connect(fmus.OUTPUTS, "firmware", "plant", execution.connect_boolean_variables)
    observer = CosimObserver.create_time_series(buffer_size=TICKS)
    execution.add_observer(observer)
    watched = [("plant", "encoder_cnt"), ("firmware", "dac_code")]
    for kind, name in watched:
        observer.start_time_series(index[kind], places[kind][name], CosimVariableType.INTEGER)
    assert execution.step(TICKS - 1)
    columns = [
        list(observer.time_series_integer_samples(index[k], places[k][n], 1, TICKS - 1)[2])
        for k, n in watched
    ]
    assert list(zip(*columns, strict=True)) == expected
