"""Programs are loaded into axes over SocketCAN, and parts are pressed in real time.

They have the verdicts of the simulated parts, and their values. A gateway and Modbus TCP do the
same. Commands and axes are killed. cycle_session.py has the sessions. Of the ten parts of the
examples five are pressed, drawn by the commit; with FORCEAXIS_WHOLE=1 all of them.
"""

import csv
import json
import re
import signal
from dataclasses import asdict
from pathlib import Path

import draws
import numpy as np
import pytest
from cycle_examples import BY_ID, IDS
from cycle_session import EXPERIMENT, experiment, file_of
from forceaxis import _core
from forceaxis.cycles import live
from forceaxis.cycles.part import run as run_part
from forceaxis.cycles.records import RecordFolder
from steps import found_by

SESSION = Path(__file__).with_name("cycle_session.py")
WAYS = ("can", "gateway", "modbus")
START_S = 0.1  # the examples start their cycle then
LONGEST_S = 6.0  # no cycle of an example is longer
# Its surface moves. From one tick to the next a value changes by 0.3 N at most, and the press
# stands elsewhere within its last count; the bounds of the elements are 30 N apart.
MOVED, MOVED_N = ("polishing",), 0.5
pytestmark = pytest.mark.long  # a minute of real time
PRESSED = draws.some("parts", IDS, 5)
LINKED = draws.some("linked parts", IDS, 5)


@pytest.fixture(scope="module")
def parts(tmp_path_factory, vcan):
    yield from found_by(vcan, tmp_path_factory.mktemp("parts"), 200, SESSION, "parts", *PRESSED)


@pytest.fixture(scope="module")
def links(tmp_path_factory, vcan):
    yield from found_by(vcan, tmp_path_factory.mktemp("links"), 120, SESSION, "links", *LINKED)


@pytest.fixture(scope="module")
def ways(tmp_path_factory, vcan):
    yield from found_by(vcan, tmp_path_factory.mktemp("ways"), 180, SESSION, "ways")


@pytest.fixture(scope="module")
def killed(tmp_path_factory, vcan):
    yield from found_by(vcan, tmp_path_factory.mktemp("killed"), 600, SESSION, "killed")


def simulated(file, overrides, start_tick):
    """The cycle of an experiment whose start comes before another tick, with what it needs to be
    compared with an axis: the values of its elements, None where nothing was found."""
    shift_s = start_tick / 1500 - START_S
    later = re.sub(
        r"^time_s = ([\d.]+)$",
        lambda found: f"time_s = {float(found[1]) + shift_s:.9f}",
        file.read_text(),
        flags=re.MULTILINE,
    )
    longer = [*overrides, f"experiment.duration_s={start_tick / 1500 + LONGEST_S}"]
    cycle = _core.run(str(file), longer, text=later).cycle
    nothing = ("not reached", "aborted")
    return cycle.state, cycle.outcome, [
        (f.name, f.verdict, None if f.verdict in nothing else f.value)
        for f in cycle.figures
    ]  # fmt: skip


@pytest.mark.parametrize("kind", PRESSED)
def test_parts_have_the_verdicts_and_the_values_of_the_simulation(parts, tmp_path, kind):
    """Plant and firmware are those of the simulation, and the press stands before the cycle. So a
    part has the values of the simulated one to the last count, whenever the command comes. Only
    where the surface moves it counts when the cycle begins: between two ticks that are known."""
    (name, overrides), found = BY_ID[kind], parts[kind]
    pressed = found["part"]
    figures = [(e["name"], e["verdict"], e["value"]) for e in pressed["elements"]]
    assert (pressed["state"], pressed["number"]) == (kind.split("-")[1], 1)
    file, (before, after) = experiment(tmp_path, name), found["ticks"]
    ticks = sorted({round(tick) for tick in np.linspace(before - 1, after + 1, 6)})
    others = [simulated(file, overrides, tick) for tick in (ticks if name in MOVED else ticks[:1])]
    for state, outcome, _ in others:
        assert (pressed["state"], pressed["outcome"]) == (state, outcome)
    if name not in MOVED:
        assert figures == others[0][2]
        return
    for i, (element, verdict, value) in enumerate(figures):
        assert {other[i][:2] for *_, other in others} == {(element, verdict)}
        values = [other[i][2] for *_, other in others]
        assert min(values) - MOVED_N <= value <= max(values) + MOVED_N


@pytest.mark.parametrize("part", PRESSED)
def test_each_example_is_loaded_and_without_it_no_part_is_pressed(parts, part):
    found, wanted = parts[part], live.live_program(file_of(part.split("-")[0]))
    assert isinstance(found["early"], str) and "`load_program`" in found["early"]
    assert int(found["loaded"]["crc"], 16) == wanted.program.crc
    assert found["loaded"]["number"] == wanted.program.number


def test_over_can_frames_in_lock_step_trace_and_part_are_those_in_process(links):
    for key in LINKED:
        name, overrides = BY_ID[key]
        here = _core.run(str(file_of(name)), list(overrides))
        assert links[key]["hashes"] == [here.trace_hash] * 2, key
        assert links[key]["cycle"] == asdict(here.cycle), key


@pytest.mark.parametrize("way", WAYS)
def test_the_commands_press_a_part_by_each_way(ways, way):
    found = ways[way]
    early, loaded, pressed = (found[step] for step in ("early", "loaded", "part"))
    assert early["status"] == 1
    assert "forceaxis cycle load" in early["said"] and early["said"].count("\n") == 1
    assert loaded["status"] == 0, loaded["said"]
    assert int(loaded["result"]["crc"], 16) == live.live_program(EXPERIMENT).program.crc
    assert pressed["status"] == 0, pressed["said"]
    assert (pressed["result"]["state"], pressed["result"]["number"]) == ("good", 1)
    assert pressed["result"]["elements"] == ways["can"]["part"]["result"]["elements"]


@pytest.mark.parametrize("way", WAYS)
def test_each_way_reads_the_curve_of_its_part(ways, way):
    """By blocks over CAN, five points at a time over the others; all of them see the same press."""
    with (ways.folder / way / "curve.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    curve = run_part(EXPERIMENT).curve
    assert 300 < len(rows) <= 1000
    names = [phase.name for phase in live.live_program(EXPERIMENT).program.phases]
    assert list(dict.fromkeys(row["phase"] for row in rows)) == [
        names[number] for number in dict.fromkeys(curve.phase.tolist())
    ]
    times = [float(row["time_s"]) for row in rows]
    assert times == sorted(set(times)) and times[0] < 0.002
    forces, travels = ([float(row[key]) for row in rows] for key in ("force_N", "travel_m"))
    assert travels[0] == pytest.approx(curve.travel_m[0], abs=1e-4)
    assert times[-1] == pytest.approx(len(curve.time_s) / 1500, abs=0.4)
    assert max(forces) == pytest.approx(curve.force_N.max(), rel=0.05)
    assert max(travels) == pytest.approx(curve.travel_m.max(), abs=2e-4)


def test_a_result_is_recorded_beside_the_owner_of_the_axis(ways):
    found = ways["gateway"]["beside"]
    said, pressed = found["recorded"], found["pressed"]
    assert said["status"] == 0, said["said"]
    (record,) = said["result"]
    assert (record["number"], record["serial"], record["state"]) == (2, "B-1", "good")
    same = ("number", "power_up", "program_crc", "elements", "begin_tick", "parameters_crc")
    assert {n: record[n] for n in same} == {n: pressed[n] for n in same}
    assert found["left"] == {"cycle_results_waiting": 0, "command_source": "lcm"}
    file = ways.folder / "gateway/records/parts/00000_0000000002.json"
    assert json.loads(file.read_text()) == record


def test_the_bounds_are_taught_with_the_parts_of_an_axis(ways):
    """Each new bound is a value of a part."""
    said = ways["gateway"]["beside"]["taught"]
    assert said["status"] == 0, said["said"]
    folder = ways.folder / "gateway"
    with RecordFolder(folder / "records") as records:
        found = list(records.records())
    assert (len(found), [record.serial for record in found].count("B-2")) == (300, 1)
    bounds = {bound["name"]: (bound["least"], bound["most"]) for bound in said["result"]["bounds"]}
    assert set(bounds) == {"shoulder", "work", "seating_force"}
    for name, (least, most) in bounds.items():
        values = {e.value for record in found for e in record.elements if e.name == name}
        assert {least, most} <= values and least <= most
    program = live.live_program(EXPERIMENT, program=folder / "new.toml").program
    taught = {e.name: (e.least, e.most) for e in program.elements if e.name in bounds}
    assert taught == bounds


def test_a_part_whose_command_is_killed_is_aborted_and_stays_until_it_is_recorded(killed):
    found = killed["command"]
    assert found["said"]["status"] == -signal.SIGKILL and found["over"] == 1
    assert found["axis"] == {"cycle_state": "aborted", "cycle_outcome": "stopped"}
    assert found["records"]["status"] == 0, found["records"]["said"]
    (record,) = found["records"]["result"]
    assert (record["number"], record["state"], record["phase"]) == (1, "aborted", "seat")
    assert {element["verdict"] for element in record["elements"]} <= {"aborted", "good"}


def test_a_part_whose_axis_is_killed_is_never_good_and_the_recorder_waits_for_the_axis(killed):
    """The axis loses its power while the bearing is pressed. The next part has the same number in
    the next power-up."""
    found = killed["axis"]
    assert found["said"] == {
        "status": 1, "out": "", "said": "forceaxis: axis 1 at the gateway: the axis is silent\n"
    }  # fmt: skip
    assert found["loaded"]["status"] == 0, found["loaded"]["said"]
    later = found["part"]
    assert (later["power_up"], later["number"], later["state"]) == (2, 1, "good")
    assert found["watch"]["status"] == 0
    waits, again = found["watch"]["said"].splitlines()
    assert waits.endswith("; waiting") and again.endswith("the axis answers again")
    recorded = [(r["power_up"], r["number"], r["state"]) for r in found["records"]]
    assert recorded == [(2, 1, "good")]
