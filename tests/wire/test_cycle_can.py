"""A program is loaded into an axis over SocketCAN, and parts are pressed in real time.

They have the verdicts of the simulated parts, and nearly their values.
"""

import csv
import json
import sys
from pathlib import Path

import pytest
from forceaxis.cycles import live, part

SESSION = Path(__file__).with_name("cycle_session.py")
EXPERIMENT = Path(__file__).resolve().parents[2] / "sim/experiments/press_fit.toml"
KINDS = {"good": (), "tight": ("k_bore=80 kN/m",)}
pytestmark = pytest.mark.long  # a minute of real time


@pytest.fixture(scope="module")
def found(tmp_path_factory, vcan):
    folder = tmp_path_factory.mktemp("cycles")
    done = vcan([sys.executable, SESSION, folder], 300)
    assert done.returncode == 0, done.stderr + done.stdout
    return json.loads((folder / "found.json").read_text()) | {"folder": folder}


@pytest.mark.parametrize("kind", KINDS)
def test_a_program_is_loaded_and_selected(found, kind):
    loaded = found[kind]["loaded"]
    assert loaded["status"] == 0, loaded["said"]
    assert int(loaded["result"]["crc"], 16) == live.live_program(EXPERIMENT).crc


@pytest.mark.parametrize("kind", KINDS)
def test_without_its_program_no_part_is_pressed(found, kind):
    early = found[kind]["early"]
    assert early["status"] == 1
    assert "forceaxis cycle load" in early["said"] and early["said"].count("\n") == 1


@pytest.mark.parametrize("kind", KINDS)
def test_parts_have_the_verdicts_of_the_simulation(found, kind):
    simulated = part.run(EXPERIMENT, KINDS[kind]).result
    for number, pressed in enumerate(found[kind]["parts"], 1):
        assert pressed["status"] == 0, pressed["said"]
        result = pressed["result"]
        assert (result["state"], result["cycles"]) == (simulated.state, number)
        for own, other in zip(result["elements"], simulated.elements, strict=True):
            assert own["verdict"] == other.verdict, (own, other)
            if other.value is not None:
                assert own["value"] == pytest.approx(other.value, rel=0.05)


@pytest.mark.parametrize(
    ("kind", "way"),
    [*(("good", way) for way in ("can0", "can1", "gateway", "modbus")), ("tight", "can1")],
)
def test_each_connection_reads_the_curve_of_its_part(found, kind, way):
    """By blocks over CAN, five points at a time over the others; all of them see the same press."""
    with (found["folder"] / kind / f"{way}.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    curve = part.run(EXPERIMENT, KINDS[kind]).curve
    assert 300 < len(rows) <= 1000
    names = [phase.name for phase in live.live_program(EXPERIMENT).program.phases]
    assert list(dict.fromkeys(row["phase"] for row in rows)) == [
        names[number] for number in dict.fromkeys(curve.phase.tolist())
    ]
    times = [float(row["time_s"]) for row in rows]
    assert times == sorted(set(times)) and times[0] < 0.002
    forces, travels = ([float(row[key]) for row in rows] for key in ("force_N", "travel_m"))
    # The first part begins 5 mm above the bearing, the others where the one before has ended.
    begin = curve.travel_m[0] if way == "can0" else curve.travel_m[-1]
    assert travels[0] == pytest.approx(begin, abs=1e-4)
    assert times[-1] == pytest.approx(len(curve.time_s) / 1500, abs=0.4)
    assert max(forces) == pytest.approx(curve.force_N.max(), rel=0.05)
    assert max(travels) == pytest.approx(curve.travel_m.max(), abs=2e-4)
