"""The image on an emulated Cortex-M4 around the plant: the very trace of the run in process.

Start-up, interrupt and firmware are those that are flashed; what QEMU has no model of is replaced
(firmware/port/stm32f4/emulated). The interrupt runs at 1500 Hz of the chip's own clock.
"""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from chip import BOARD
from cycle_examples import IDS, PARTS, expect_the_same, expect_the_same_objects, file_of
from forceaxis import _core
from forceaxis.chip import emulator as chip
from forceaxis.experiments import link
from forceaxis.paths import EXPERIMENTS
from forceaxis.thesis import tables

SIM = EXPERIMENTS.parent
CHIP = link.LinkOptions("pil-stm32")
FORCEAXIS = Path(sys.executable).parent / "forceaxis"


@pytest.mark.parametrize(
    ("name", "overrides"),
    [
        ("contact.toml", []),
        ("contact.toml", ["firmware.force_gain=10", "firmware.force_setpoint=15"]),
        ("position_step.toml", []),
        ("strike.toml", []),
        ("hold_biquad.toml", []),
        ("hold_biquad_12bit.toml", []),
        ("excite_in_contact.toml", []),
    ],
)
def test_the_trace_is_that_of_the_run_in_process(name, overrides):
    path = EXPERIMENTS / name
    here = _core.run(str(path), overrides)
    result, report, *_ = link.run(CHIP, path, overrides)
    assert report.same
    assert report.hashes.axis == here.trace_hash
    # Each interrupt did a tick, and no tick was done without one.
    assert report.interrupts == report.ticks == len(here.tick)
    assert result.refused == here.refused
    assert len(set(result.columns()["dac"])) > 5  # it was driven


def expect_the_part_of_the_run_in_process(path, overrides):
    here = _core.run(str(path), list(overrides))
    result, report, _, cycle = link.run(CHIP, path, overrides)
    assert report.same
    expect_the_same(result, cycle, here)
    expect_the_same_objects(result, here)
    assert report.interrupts == report.ticks == len(here.tick)
    return report


@pytest.mark.parametrize(
    ("name", "overrides"),
    [
        pytest.param(*part, id=name, marks=() if name == "press_fit-good" else pytest.mark.long)
        for part, name in zip(PARTS, IDS, strict=True)
    ],
)
def test_a_part_is_pressed_and_evaluated_as_in_process(name, overrides):
    """Trace, verdict and values are the same, and each tick has the same state of the cycle. The
    main loop of the chip has completed each tick before the next one began, but for a few in which
    much happens: a tick of the emulator has 5,208 instructions, that of the chip 112,000 cycles."""
    assert expect_the_part_of_the_run_in_process(file_of(name), overrides).late_ticks <= 5


PROGRAM = SIM / "cycles/press_fit.toml"


def with_program(folder, text):
    """The press-fit with another program."""
    (folder / "cycle.toml").write_text(text)
    press_fit = file_of("press_fit").read_text().replace('"../models', f'"{SIM}/models')
    experiment = folder / "press.toml"
    experiment.write_text(press_fit.replace("../cycles/press_fit.toml", "cycle.toml"))
    return experiment


def test_a_program_without_a_number_is_loaded_too(tmp_path):
    experiment = with_program(tmp_path, PROGRAM.read_text().replace("number = 1\n", ""))
    expect_the_part_of_the_run_in_process(experiment, ["experiment.duration_s=2.5"])


WINDOW = """
[[element]]
name = "window_{i}"
kind = "window"
phases = ["approach", "join", "seat", "retract"]
from = "-{i}.5 mm"
to = "{i}.9 mm"
least = "-1 N"
most = "390 N"
enters = ["left", "bottom", "right", "top"]
"""


def test_an_evaluation_longer_than_a_tick_ends_in_the_same_tick_too(tmp_path):
    """Sixteen windows up to the end of the cycle: the main loop of the chip comes late in most
    ticks, and the state of the cycle is still that in process after each tick."""
    phases = PROGRAM.read_text().split("[[element]]")[0]
    windows = "".join(WINDOW.format(i=i) for i in range(4, 20))
    experiment = with_program(tmp_path, phases + windows)
    assert expect_the_part_of_the_run_in_process(experiment, []).late_ticks > 1000


@pytest.mark.long
@pytest.mark.parametrize("every", [5, 1])
def test_the_stability_tables_are_those_of_the_runs_in_process(every):
    known = tables.load()
    assert len(known.cells) == 55
    jobs = [known.job(cell) for cell in known.cells[::every]]
    assert tables.run_jobs(jobs, 1, "tables", CHIP) == tables.run_jobs(jobs, 1, "tables")


def test_a_chip_that_ends_is_reported(tmp_path):
    """A power-up that another program cuts short."""
    with chip.Emulator(BOARD) as emulator:
        os.kill(emulator.process.pid, signal.SIGKILL)
        emulator.process.wait()
        with pytest.raises(_core.TransportError, match=r"emulated chip: (ended|no response)"):
            _core.run_on_chip(str(EXPERIMENTS / "contact.toml"), [], *emulator.pipes, timeout_s=0.5)


def test_the_verb_says_where_the_firmware_was():
    done = subprocess.run(
        [FORCEAXIS, "run", EXPERIMENTS / "contact.toml", "--link", "pil-stm32"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "netduinoplus2" in done.stdout
    assert "interrupts" in done.stdout
