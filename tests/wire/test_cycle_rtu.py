"""A part by the commands of `forceaxis cycle` over the serial line of an axis, in real time."""

import functools
import json
import os
import subprocess
import time

import pytest
import verbs
from cycle_examples import file_of
from cycle_session import PATIENT, PATIENT_S, machine
from forceaxis.axis import modbus
from forceaxis.cycles import live, part
from forceaxis.experiments import link

EXPERIMENT = file_of("press_fit")
# Sets the silent interval to 7 ticks, which a pty under load does not exceed within a frame.
BAUD = 9600


@pytest.fixture
def way(tmp_path):
    """The options of a connection to a press in real time, by a pair of ptys."""
    ends = tmp_path / "axis", tmp_path / "client"
    first = ["nice", "-n", "-15"] if os.geteuid() == 0 else []  # a machine may be busy
    ptys = [f"pty,raw,echo=0,link={end}" for end in ends]
    running = [subprocess.Popen([*first, "socat", *ptys])]
    try:
        until = time.monotonic() + 5
        while not all(end.exists() for end in ends):
            assert time.monotonic() < until, "socat makes no ptys"
            time.sleep(0.01)
        common = [str(machine(tmp_path, "press_fit")), "--run-id", str(link.new_run_id())]
        common += ["--endless", "--pace", "real", "--set", PATIENT]
        line = ["--modbus", str(ends[0]), "--modbus-baud", str(BAUD)]
        for name, more in (("axis_node", line), ("plant_node", [])):
            node = [*first, link.program(name), *common, *more]
            running.append(subprocess.Popen(node, stdout=subprocess.PIPE, text=True))
            assert "ready" in running[-1].stdout.readline()
        yield "--on", f"serial:{ends[1]}@{BAUD}"
    finally:
        for process in reversed(running):
            process.terminate()
            process.communicate()


def test_a_program_is_loaded_in_parts_and_a_part_is_pressed(way, monkeypatch):
    patient = functools.partial(modbus.ModbusLink, timeout_s=PATIENT_S)
    monkeypatch.setattr(modbus, "ModbusLink", patient)
    loaded = verbs.forceaxis("cycle", "load", EXPERIMENT, *way, "--json")
    assert loaded.returncode == 0, loaded.stderr
    assert int(json.loads(loaded.stdout)["crc"], 16) == live.live_program(EXPERIMENT).program.crc
    done = verbs.forceaxis("cycle", "start", EXPERIMENT, *way, "--json")
    assert done.returncode == 0, done.stderr
    pressed, simulated = json.loads(done.stdout), part.run(EXPERIMENT).result
    assert (pressed["state"], pressed["number"]) == ("good", 1)
    for own, other in zip(pressed["elements"], simulated.elements, strict=True):
        assert (own["name"], own["verdict"]) == (other.name, other.verdict)
