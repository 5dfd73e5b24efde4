"""A measurement in contact, inside the closed force law: the exact plant's response as the linear
closed loop has it."""

import json
from pathlib import Path

import numpy as np
import pytest
from forceaxis import linear
from forceaxis.experiments import run as runs

ROOT = Path(__file__).resolve().parents[3]
VOLTS_PER_CODE = 20 / 4096
GAIN = 2.25  # codes a count
PERIOD, PERIODS = 1500, 4
START_S = 1.5
SETTLED = PERIOD  # ticks from the start on that are left out
LINES = slice(2, 60)  # Hz
PLANT = {"amp_break": 10.0}  # one slope of the amplifier: what is measured is linear

AT_OUTPUT = "excitation_code = 100"
AT_SETPOINT = 'excitation_point = "setpoint"\nexcitation_force = 40.0'


def experiment(folder, mode, excitation, more="", duration_s=7.0):
    file = folder / "excited.toml"
    words = "".join(
        f"[[at]]\ntime_s = {time_s}\nfirmware = {{ controlword = {word} }}\n"
        for time_s, word in ((0.01, 6), (0.02, 7), (0.03, 15))
    )
    file.write_text(f"""title = "Excited in contact"
model = "{ROOT}/sim/models/laboratory_12bit.toml"
duration_s = {duration_s}
[set]
amp_break = {PLANT["amp_break"]}
approach = "1 mm"
[firmware]
adc_bits = 12
position_gain = 4.0
velocity_gain = 20.0
latency_ticks = 0
bump_decay_shift = 0
modes_of_operation = {mode}
approach_velocity_max = "20 mm/s"
force_slope = 7500
target_force = 750
force_setpoint = 30.0
force_gain = {GAIN}
excitation_seed = 5
excitation_period = {PERIOD}
{excitation}
{words}
[[at]]
time_s = {START_S}
firmware = {{ excitation_run = "start" }}
{more}
[trace]
objects = ["excitation_value", "excitation_state", "force", "force_demand", "contact"]
""")
    return file


def spectra(values, first):
    """Spectra of whole periods, one a row."""
    return np.fft.rfft(values[first : first + PERIODS * PERIOD].reshape(PERIODS, PERIOD), axis=1)


@pytest.mark.parametrize("mode", [-1, 4])
@pytest.mark.parametrize("excitation", [AT_OUTPUT, AT_SETPOINT], ids=["output", "setpoint"])
def test_a_measurement_in_contact_is_the_closed_loop(tmp_path, mode, excitation):
    done = runs.run(experiment(tmp_path, mode, excitation, duration_s=6.6))
    columns = done.columns
    assert done.summary["refused"] == []
    first = int(np.flatnonzero(columns["excitation_state"] > 9)[0])
    assert first == START_S * 1500
    # Contact is held throughout, at the set-point's own force.
    assert columns["contact"][first:].all()
    assert np.ptp(columns["force_demand"][first:]) <= 1
    added = spectra(columns["excitation_value"], first + SETTLED - PERIOD // 2)
    reading = spectra(columns["force"], first + SETTLED - PERIOD // 2)
    measured = reading.sum(0)[LINES] / added.sum(0)[LINES]
    coherence = np.abs(reading.sum(0)) ** 2 / (PERIODS * (np.abs(reading) ** 2).sum(0))
    assert np.median(coherence[LINES]) > 0.99
    assert np.mean(coherence[LINES] > 0.9) > 0.9

    plant = linear.linearise("laboratory_12bit", outputs=("adc0",), overrides=PLANT).sampled()
    open_loop = VOLTS_PER_CODE * plant.response(np.arange(PERIOD)[LINES] * 1500 / PERIOD)
    closed = open_loop / (1 + GAIN * open_loop)
    wanted = closed if excitation == AT_OUTPUT else GAIN * closed
    error = np.abs(measured - wanted) / np.abs(wanted)
    assert np.median(error) < 0.03
    # Where the response is small the steps of the converter weigh more.
    assert np.max(np.abs(measured - wanted)) < 0.06 * np.max(np.abs(wanted))


def test_a_strike_ends_it_and_the_law_holds_on(tmp_path):
    """The largest reading allowed is exceeded by a strike on the workpiece."""
    strike = '[[at]]\ntime_s = 2.0\nimpulse = { body = "workpiece", N_s = -0.3 }\n'
    bounds = "excitation_code = 40\nexcitation_force_max = 30.0\nexcitation_force_min = 15.0"
    columns = runs.run(experiment(tmp_path, 4, bounds, strike, 4.0)).columns
    state, reading = columns["excitation_state"], columns["force"]
    ended = int(np.flatnonzero(state == 2)[0])
    outside = (reading > 30.0) | (reading < 15.0)
    assert ended == np.flatnonzero(outside & (np.arange(len(state)) > START_S * 1500))[0]
    assert not columns["excitation_value"][ended:].any()
    assert columns["excitation_value"][ended - 1] != 0
    assert columns["contact"][-750:].all()
    # Beside it: without the strike the same bounds do not act.
    state = runs.run(experiment(tmp_path, 4, bounds, "", 3.0)).columns["excitation_state"]
    assert state[-1] == 11


def test_a_start_before_contact_is_refused_by_name(tmp_path):
    file = experiment(tmp_path, 4, AT_OUTPUT, duration_s=2.0)
    file.write_text(file.read_text().replace(f"time_s = {START_S}", "time_s = 0.04"))
    done = runs.run(file)
    assert [r["object"] for r in done.summary["refused"]] == ["excitation_run"]
    assert done.columns["excitation_state"][-1] == 8
    assert not done.columns["excitation_value"].any()
    json.dumps(done.summary, allow_nan=False)
