"""The same trace, to the last bit of every double, from every build of one compiler."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
FORCEAXIS = Path(sys.executable).parent / "forceaxis"


@pytest.mark.long
@pytest.mark.parametrize("other", ["debug-plain", "debug"])
@pytest.mark.parametrize(
    ("experiment", "overrides"),
    [
        ("contact", ["firmware.force_gain=7", "firmware.force_setpoint=20"]),
        ("contact_unstable", ["experiment.duration_s=1"]),
        ("axis_contact_b", []),
        ("position_step", []),
        ("grip_soft", ["experiment.duration_s=1"]),
    ],
)
def test_presets_agree(experiment, overrides, other):
    file = f"sim/experiments/{experiment}.toml"
    hashes = {
        preset: output([ROOT / "build" / preset / "tests/loop/trace_hash", file, *overrides])
        for preset in ("release", other)
    }
    assert len(set(hashes.values())) == 1, hashes
    trace, doubles = hashes["release"].split()
    assert len(trace) == len(doubles) == 64
    sets = [word for o in overrides for word in ("--set", o)]
    assert json.loads(output([FORCEAXIS, "run", file, *sets, "--json"]))["trace_hash"] == trace


def output(command):
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    return done.stdout.strip()
