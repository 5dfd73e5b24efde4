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
from forceaxis import _core
from forceaxis.chip import emulator as chip
from forceaxis.experiments import link
from forceaxis.paths import EXPERIMENTS
from forceaxis.thesis import tables

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
    result, report, _ = link.run(CHIP, path, overrides)
    assert report.same
    assert report.hashes.axis == here.trace_hash
    # Each interrupt did a tick, and no tick was done without one.
    assert report.interrupts == report.ticks == len(here.tick)
    assert result.refused == here.refused
    assert len(set(result.columns()["dac"])) > 5  # it was driven


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
