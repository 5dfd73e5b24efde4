"""The general force law on the exact plant: what a bank bears that P does not, over a set of
workpieces and of gains."""

import random
import re
from pathlib import Path

import forceaxis
import pytest

ROOT = Path(__file__).resolve().parents[3]
SETPOINTS_COUNT = (12, 30, 60)  # 2.5 N each, of 100 N rated force
STRIKE_N_S = 0.5
NOMINAL = [(412700, 6.6)]
# The banks of hold_biquad.toml and hold_biquad_12bit.toml.
BIQUAD = (
    "laboratory",
    8,
    4.37,
    [[1.394373, -2.718615, 1.362417, -1.741615, 0.779790]],
)
BIQUAD_12BIT = (
    "laboratory_12bit",
    12,
    6.08,
    [[5.790171, -11.321576, 5.681603, -1.556226, 0.706424]],
)


ENABLE = "".join(
    f"[[at]]\ntime_s = {time_s}\nfirmware = {{ controlword = {word} }}\n"
    for time_s, word in ((0.01, 6), (0.02, 7), (0.03, 15))
)


def experiments(folder, bank, gain=1.0, strike_N_s=STRIKE_N_S):
    """Contact at three set-points in mode 4, and a strike on the workpiece at two of them."""
    model, bits, k_f, sections = bank
    files = []
    for setpoint, strike in [*((s, False) for s in SETPOINTS_COUNT), (12, True), (30, True)]:
        file = folder / f"{model}_{gain}_{setpoint}{'_strike' * strike}.toml"
        hit = f"""
[[at]]
time_s = 2.0
impulse = {{ body = "workpiece", N_s = {strike_N_s} }}
"""
        file.write_text(f"""title = "Contact with a bank"
model = "{ROOT}/sim/models/{model}.toml"
duration_s = 5.0
[set]
approach = "4 mm"
[firmware]
adc_bits = {bits}
position_gain = 4.0
velocity_gain = 20.0
modes_of_operation = 4
approach_velocity_max = "20 mm/s"
force_slope = 7500
target_force = {25 * setpoint}
latency_ticks = 0
bump_decay_shift = 0
force_bank = 2
[firmware.bank_2]
gain = {gain * k_f}
integral_rad_per_s = 8.0
sections = {sections}
{ENABLE}{hit * strike}
[verdict]
window_s = 0.5
contact_held = true
force_ripple_max_count = 3.0
""")
        files.append(str(file))
    return files


def verdicts(files, members):
    jobs = [(f, [f"k_w={k_w}", f"m_w={m_w}"]) for f in files for k_w, m_w in members]
    return [r["verdict"] for r in forceaxis.run_many(jobs, threads=2)]


def workpieces(count):
    """Stiffness and mass within 30 % of the laboratory's."""
    rng = random.Random(1988)
    return [(412700 * rng.uniform(0.7, 1.3), 6.6 * rng.uniform(0.7, 1.3)) for _ in range(count)]


@pytest.mark.parametrize("bank", [BIQUAD, BIQUAD_12BIT], ids=["8 bits", "12 bits"])
@pytest.mark.parametrize("count", [20, pytest.param(200, marks=pytest.mark.long)])
def test_a_bank_bears_workpieces_that_are_30_percent_off(tmp_path, bank, count):
    found = verdicts(experiments(tmp_path, bank), workpieces(count))
    assert found == ["stable"] * (5 * count)


def test_the_same_workpieces_are_too_much_for_p(tmp_path):
    files = experiments(tmp_path, ("laboratory", 8, 4.5, []))
    for file in map(Path, files):
        file.write_text(file.read_text().replace("integral_rad_per_s = 8.0\n", ""))
    assert verdicts(files, workpieces(20)).count("unstable") >= 5


@pytest.mark.parametrize(
    ("bank", "gain"), [(BIQUAD, 2.0), (BIQUAD_12BIT, 3.0)], ids=["8 bits", "12 bits"]
)
def test_the_nominal_workpiece_bears_a_multiple_of_the_gain(tmp_path, bank, gain):
    assert verdicts(experiments(tmp_path, bank, gain), NOMINAL) == ["stable"] * 5


@pytest.mark.parametrize("bank", [BIQUAD, BIQUAD_12BIT], ids=["8 bits", "12 bits"])
def test_a_hard_strike_is_survived_with_the_dwell_after_a_loss(tmp_path, bank):
    """2.8 N s on the workpiece at 30 counts; without the dwell the 12-bit bank bears 1.2."""
    assert verdicts(experiments(tmp_path, bank, strike_N_s=2.8)[-1:], NOMINAL) == ["stable"]


def test_without_the_dwell_the_same_strike_is_too_much(tmp_path):
    file = Path(experiments(tmp_path, BIQUAD_12BIT, strike_N_s=2.8)[-1])
    file.write_text(
        file.read_text().replace("[firmware]\n", "[firmware]\ncontact_loss_dwell = 0\n")
    )
    assert verdicts([str(file)], NOMINAL) == ["unstable"]


STRIKES_N_S = (0.4, 0.8, 1.0, 1.2, 1.6, 2.0, 2.4, 2.8, 4.0, 5.0)
LARGEST_N_S = {"strike_p": 1.6, "strike_biquad": 2.8, "strike_biquad_12bit": 5.0}


def struck(folder, name, strikes_N_s):
    """Verdicts of an experiment under other strikes, 6 s after them: P needs up to 4 to settle."""
    text = (ROOT / f"sim/experiments/{name}.toml").read_text()
    text = text.replace('"../models', f'"{ROOT}/sim/models')
    files = []
    for N_s in strikes_N_s:
        file = folder / f"{name}_{N_s}.toml"
        file.write_text(re.sub(r"N_s = [0-9.]+", f"N_s = {N_s}", text))
        files.append(str(file))
    jobs = [(file, ["experiment.duration_s=8"]) for file in files]
    return [r["verdict"] for r in forceaxis.run_many(jobs, threads=2)]


@pytest.mark.parametrize("name", LARGEST_N_S)
def test_every_strike_up_to_the_promised_one_is_survived_at_75_N(tmp_path, name):
    strikes = [s for s in STRIKES_N_S if s <= LARGEST_N_S[name]]
    assert struck(tmp_path, name, strikes) == ["stable"] * len(strikes)
