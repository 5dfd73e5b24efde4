"""Supervision of the force sensor with sensible settings, in every experiment: it must not act
where the sensor is sound, and every recorded trace stays as it is."""

import re
import tomllib
from pathlib import Path

import pytest
from forceaxis import _core

EXPERIMENTS = Path(__file__).resolve().parents[3] / "sim" / "experiments"
FAULTS = ("force_railed", "force_jump", "force_stuck", "force_disconnected")
SETTINGS = {
    "force_railed_time": 50,
    "force_jump_max": 40,
    "force_stuck_travel": 100,
    "force_disconnected_code": 100,
    "force_disconnected_time": 100,
}
# Finer encoders: a code of the reading is the deflection of some hundred counts.
TRAVEL = {"axis_contact_a": 2000, "axis_contact_b": 2000, "full_axis": 2000}
# Sensors or electronics that saturate: the axis moves on at a constant reading, as it is found.
SATURATED = {
    "nl_saturation_conditioning",
    "nl_saturation_controller_unstable",
    "nl_saturation_sensor",
}


def experiments():
    for file in sorted(EXPERIMENTS.glob("*.toml")):
        text = file.read_text()
        content = tomllib.loads(text)
        if "duration_s" in content and re.search(r'^mode = "force"|^modes_of_op', text, re.M):
            yield pytest.param(file, content, id=file.stem)


def supervised(file):
    settings = SETTINGS | {"force_stuck_travel": TRAVEL.get(file.stem, 100)}
    return _core.run(str(file), [f"firmware.{name}={value}" for name, value in settings.items()])


@pytest.mark.parametrize("file, content", list(experiments()))
def test_a_sound_sensor_is_no_finding(file, content):
    result = supervised(file)
    if file.stem in SATURATED:
        assert result.fault == "force_stuck"
        return
    assert result.fault not in FAULTS
    recorded = content.get("expect", {}).get("trace_hash")
    assert recorded is None or result.trace_hash == recorded
