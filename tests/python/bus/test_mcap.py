"""Recordings as MCAP: the trace of a run and the messages of a bus, read by the reader of the
format's own project and by every command that takes a recording."""

import json
import struct
import sys

import lcm
import numpy as np
import pyarrow.csv
import pytest
import verbs
from forceaxis.bus import log as logs
from forceaxis.bus.lcm import NOT_AVAILABLE, blank
from forceaxis.bus.messages import axis_capture_t, axis_state_t, sim_truth_t
from forceaxis.bus.topics import SampleTimes, Topics, json_schema, lcm_text, nested
from mcap.reader import make_reader

EXPERIMENT = "press_fit"
FORCE_SCALE_UN = 2_500_000


def forceaxis(*arguments):
    done = verbs.forceaxis(*arguments)
    assert done.returncode == 0, done.stderr
    return done


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The folder of a run with a trace, and its recording."""
    folder = tmp_path_factory.mktemp("run")
    forceaxis("run", EXPERIMENT, "--set", "experiment.duration_s=2", "--out", folder,
              "--record", folder / "run.mcap")  # fmt: skip
    return folder


def leaves(row, above=""):
    for name, value in row.items():
        if isinstance(value, dict) and "type" not in value:
            yield from leaves(value, f"{above}{name}.")
        else:
            yield above + name, value


def units_of(schema):
    """{path: unit} of the numbers of a JSON schema."""
    found = {}
    for name, one in schema["properties"].items():
        if one["type"] == "object":
            found |= {f"{name}.{path}": unit for path, unit in units_of(one).items()}
        elif one["type"] == "number":
            found[name] = one["unit"]
    return found


def read(path, topic):
    """[(time in ns, object)] and the schema of a topic, by the reader of the package mcap."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        found = list(reader.iter_messages(topics=[topic]))
    schema, channel, _ = found[0]
    assert (channel.message_encoding, schema.encoding) == ("json", "jsonschema")
    return [(m.log_time, json.loads(m.data)) for _, _, m in found], json.loads(schema.data)


def test_the_recording_of_a_run_is_its_trace(run):
    messages, schema = read(run / "run.mcap", "/sim/truth")
    trace = np.load(run / "trace.npz")
    assert len(messages) == len(trace["tick"]) == 3001
    rows = [dict(leaves(row)) for _, row in messages]
    named = {}  # {column of the trace: field}
    for field in rows[0]:
        column = next(c for c in sorted(trace, key=len, reverse=True) if field.startswith(c))
        named[column] = field
    assert set(named) == set(trace) and len(named) > 20
    for column, field in named.items():
        assert [row[field] for row in rows] == trace[column].tolist(), column
    units = units_of(schema)
    assert set(units) == set(rows[0])
    expected = {"encoder_count": "count", "dac_code": "code", "time_s": "s", "tick": "tick"}
    assert expected.items() <= units.items()
    assert {"N", "m", "m/s", "V"} <= set(units.values())
    # The samples are as far apart as ticks are.
    times = np.array([time_ns for time_ns, _ in messages])
    assert abs(np.diff(times) - 1e9 / 1500).max() < 2000


def test_the_same_run_gives_the_same_file(run, tmp_path):
    forceaxis(
        "run", EXPERIMENT, "--set", "experiment.duration_s=2", "--record", tmp_path / "r.mcap"
    )
    assert (tmp_path / "r.mcap").read_bytes() == (run / "run.mcap").read_bytes()


def test_the_recording_of_a_run_has_the_states_of_its_axis(run):
    """As a gateway publishes them, so that `monitor --replay` shows the run."""
    states, schema = read(run / "run.mcap", "/axis_1/state")
    trace = np.load(run / "trace.npz")
    ticks = [row["tick"] for _, row in states]
    assert ticks == list(range(0, 3001, 50))
    assert [row["position_cnt"] for _, row in states] == trace["encoder"][ticks].tolist()
    assert [row["dac_code"] for _, row in states] == trace["dac"][ticks].tolist()
    # 0.01 N for each code above 0, as the model of the experiment says.
    force_N = 0.01 * trace["adc0"]
    assert [row["force_N"] for _, row in states] == pytest.approx(force_N[ticks], abs=1e-6)
    assert max(force_N[ticks]) > 100
    assert units_of(schema)["force_N"] == "N"
    shown = json.loads(
        forceaxis("monitor", "--replay", run / "run.mcap", "--once", "--json").stdout
    )
    axis = shown["axes"]["1"]
    assert axis["tick"] == 3000 and axis["force_N"] == pytest.approx(force_N[-1])
    assert (axis["fault"], axis["lost"], axis["silent"]) == ("none", 0, False)


def test_the_states_are_those_of_a_gateway_whatever_converters_the_axis_has(tmp_path):
    """A gateway publishes the upper 16 bits of a sensor of 24 bits, and whole codes of 12 bits."""
    folder = tmp_path / "press"
    forceaxis("new", folder, "--yes", "--no-design", "--drive", "velocity", "--sensor-bits", 24,
              "--output-bits", 16, "--sensor-full-scale-n", 25000)  # fmt: skip
    forceaxis("run", folder / "contact.toml", "--out", tmp_path, "--record", tmp_path / "run.mcap")
    states, _ = read(tmp_path / "run.mcap", "/axis_1/state")
    trace = np.load(tmp_path / "trace.npz")
    ticks = [row["tick"] for _, row in states]
    # 25 kN over half of the codes of 16 bits.
    force_N = (trace["adc0"][ticks].astype(float) - 32768) * 25000 / 32768
    assert [row["force_N"] for _, row in states] == pytest.approx(force_N, abs=1)
    assert 200 < max(force_N) < 25000
    codes = trace["dac"][ticks] / 16
    assert abs(np.array([row["dac_code"] for _, row in states]) - codes).max() <= 0.5
    assert max(codes) > 10


def test_commands_that_read_a_recording_read_mcap(run, tmp_path):
    forceaxis("recording", "convert", run / "run.mcap", tmp_path / "run.log")
    info = [json.loads(forceaxis("recording", "info", file, "--json").stdout)
            for file in (run / "run.mcap", tmp_path / "run.log")]  # fmt: skip
    assert {**info[0], "file": ""} == {**info[1], "file": ""}
    assert info[0]["channels"]["SIM_TRUTH"]["lost"] == 0 and info[0]["damage"] is None
    forceaxis("recording", "export", run / "run.mcap", "--out", tmp_path / "tables", "--npz")
    table, trace = np.load(tmp_path / "tables/SIM_TRUTH.npz"), np.load(run / "trace.npz")
    for name in trace:
        (column,) = [c for c in table if c == name or c.startswith(f"{name}_")][:1]
        assert np.array_equal(table[column], trace[name]), name


def test_pyarrow_reads_the_exported_tables(run, tmp_path):
    """A reader of CSV that nobody here wrote finds types of columns and the values of NPZ."""
    forceaxis("recording", "export", run / "run.mcap", "--out", tmp_path)
    files = sorted(tmp_path.glob("*.csv"))
    assert "SIM_TRUTH" in [file.stem for file in files]
    compared = 0
    for file in files:
        table, numbers = pyarrow.csv.read_csv(file), np.load(file.with_suffix(".npz"))
        assert table.column_names == list(numbers)
        for name in numbers:
            column = table[name]
            is_number = numbers[name].dtype.kind in "iuf"
            if pyarrow.types.is_null(column.type):  # each field is empty
                expected = np.isnan(numbers[name]) if is_number else numbers[name] == ""
                assert expected.all(), name
                continue
            if not is_number:
                assert column.to_pylist() == numbers[name].tolist(), name
                continue
            assert pyarrow.types.is_integer(column.type) or pyarrow.types.is_floating(column.type)
            found = column.to_numpy().astype(float)
            assert np.array_equal(found, numbers[name].astype(float), equal_nan=True), name
            compared += len(found)
    assert compared > 50_000


def messages_of_a_bus(folder):
    """A log with states, a capture, another program's messages, a doubled and a damaged message."""
    log, entries = folder / "bus.log", []
    for k in range(40):
        state = blank(axis_state_t)
        state.axis, state.seq, state.run_id, state.tick = 3, k, 7, 30 * k
        state.force_cnt_q8, state.force_scale_uN = 256 * k, FORCE_SCALE_UN
        state.num_more, state.more_name, state.more_value = 1, ["force_gain"], [256]
        entries.append(("AXIS_3_STATE", state.encode()))
    entries.append(entries[-1])  # doubled by the network
    block = blank(axis_capture_t)
    block.axis, block.seq, block.run_id, block.capture_id = 3, 0, 7, 1
    block.first_tick, block.decimation, block.first_sample = 500, 2, 0
    block.total_samples, block.trigger_sample, block.num_samples = 20, 0, 20
    block.num_signals, block.signal = 2, ["force", "dac_code"]
    block.value = [[256 * i, -i] for i in range(20)]
    entries.append(("AXIS_3_CAPTURE", block.encode()))
    entries += [("CAMERA", b"\x00\x01other"), ("AXIS_3_STATE", entries[0][1][:50])]
    writer = logs.LogWriter(log)
    for i, (channel, data) in enumerate(entries):
        writer.write(channel, data, 1_700_000_000_000_000 + 20_000 * i)
    writer.close()
    return log


def test_a_log_becomes_mcap_and_the_same_log_again(tmp_path):
    log, there, back = messages_of_a_bus(tmp_path), tmp_path / "a.mcap", tmp_path / "b.log"
    forceaxis("recording", "convert", log, there)
    forceaxis("recording", "convert", there, back)
    assert list(logs.LogReader(back)) == list(logs.LogReader(log))
    # liblcm reads the log that came back.
    assert [e.channel for e in lcm.EventLog(str(back))] == [e.channel for e in logs.LogReader(log)]
    states, schema = read(there, "/axis_3/state")
    assert len(states) == 40  # neither the doubled nor the damaged one
    units = units_of(schema)
    for k, (time_ns, row) in enumerate(states):
        assert time_ns == (1_700_000_000_000_000 + 20_000 * k) * 1000
        assert row["force_N"] == pytest.approx(k * 2.5) and row["tick"] == 30 * k
        assert "position_cnt" not in row  # not available
        assert {name for name, value in row.items() if not isinstance(value, str)} <= set(units)
    assert units["force_N"] == "N" and units["position_cnt"] == "count"
    captured, schema = read(there, "/axis_3/capture")
    assert [row["tick"] for _, row in captured] == list(range(500, 540, 2))
    assert [row["force_count"] for _, row in captured] == [float(i) for i in range(20)]
    assert units_of(schema)["force_count"] == "count"
    # Raw topics of both programs, with the type in the language of LCM.
    with there.open("rb") as file:
        summary = make_reader(file).get_summary()
    topics = {one.topic: one for one in summary.channels.values()}
    assert topics["/lcm/CAMERA"].schema_id == 0
    schema = summary.schemas[topics["/lcm/AXIS_3_STATE"].schema_id]
    assert b"int64_t force_cnt_q8;" in schema.data
    assert b"string more_name[num_more];" in schema.data


@pytest.mark.parametrize("cut", [0.3, 0.8])
def test_a_recording_that_was_cut_is_read_as_far_as_possible(cut, run, tmp_path):
    data = (run / "run.mcap").read_bytes()
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(data[: int(cut * len(data))])
    done = forceaxis("recording", "info", broken, "--json")
    assert done.stderr.count("\n") == 1 and "broken.mcap: is damaged or cut off" in done.stderr
    found = json.loads(done.stdout)["channels"]["SIM_TRUTH"]["count"]
    assert 0 < found < 21


def test_a_damaged_chunk_is_noticed(run, tmp_path):
    with (run / "run.mcap").open("rb") as file:
        chunks = make_reader(file).get_summary().chunk_indexes
    data, hit = bytearray((run / "run.mcap").read_bytes()), chunks[len(chunks) // 2]
    data[hit.chunk_start_offset + hit.chunk_length // 2] ^= 0xFF
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(data)
    done = forceaxis("recording", "info", broken, "--json")
    assert "is damaged" in done.stderr
    truth = json.loads(done.stdout)["channels"]["SIM_TRUTH"]
    assert 15 < truth["count"] < 21 and truth["lost"] == 21 - truth["count"]


def test_what_cannot_be_converted_is_refused_in_one_line(run, tmp_path):
    (tmp_path / "empty.log").touch()
    (tmp_path / "text.mcap").write_text("no recording")
    for source, target, words in (
        (run / "run.mcap", tmp_path / "x.csv", (".mcap", ".log")),
        (tmp_path / "none.log", tmp_path / "x.mcap", ("none.log",)),
        (tmp_path / "empty.log", tmp_path / "x.mcap", ("empty.log", "at least one message")),
        (tmp_path / "text.mcap", tmp_path / "x.log", ("text.mcap", "at least one message")),
    ):
        done = verbs.forceaxis("recording", "convert", source, target)
        assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
        assert all(word in done.stderr for word in words) and not target.exists()


def test_without_the_package_one_line_says_what_to_install(run, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "mcap", None)
    for command in (
        ("recording", "info", run / "run.mcap"),
        ("run", EXPERIMENT, "--record", tmp_path / "x.mcap"),
    ):
        done = verbs.forceaxis(*command)
        assert done.returncode == 2 and "pip install 'forceaxis[mcap]'" in done.stderr
        assert done.stderr.count("\n") == 1 and not list(tmp_path.iterdir())


# The parts.


def test_names_are_nested_unless_one_is_the_begin_of_another():
    names = ["tick", "sensor.force_N", "a", "a.b", "x..y"]
    places = [("tick",), ("sensor", "force_N"), ("a",), ("a.b",), ("x..y",)]
    assert nested(names) == places
    schema = json.loads(json_schema("t", dict.fromkeys(names, "1") | {"text": None}))
    assert set(schema["properties"]) == {"tick", "sensor", "a", "a.b", "x..y", "text"}


def test_times_of_samples_never_go_back_whatever_the_pace():
    times, last = SampleTimes(), 0
    # Real time, a lost block, a fast simulation, another run, a late block.
    for first, received in ((0, 100), (150, 200), (450, 400), (600, 401), (0, 500), (150, 450)):
        found = times.of(range(first, first + 150), received * 1_000_000)
        assert len(found) == 150 and found == sorted(found) and found[0] >= last
        last = found[-1]
    assert times.of(range(300, 301), 10**9) == [10**9]


def test_the_type_of_a_message_is_in_the_language_of_lcm():
    text = lcm_text(sim_truth_t)
    assert "package forceaxis;" in text and "double value[num_samples][num_signals];" in text
    assert text.count(";") == len(sim_truth_t.__slots__) + 1


def test_numbers_that_json_cannot_express_have_no_field():
    block = sim_truth_t()
    block.axis, block.first_tick, block.decimation, block.run_id = 1, 0, 1, 5
    block.num_signals, block.signal, block.unit = 3, ["a.x", "a.y", "z"], ["m", "N", "1"]
    block.num_samples, block.value = 1, [[float("nan"), float("inf"), 2.0]]
    raw, sample = Topics().of("SIM_TRUTH", block.encode(), 10**6)
    assert struct.pack(">d", float("inf")) in raw.data
    assert json.loads(sample.data) == {"tick": 0, "time_s": 0.0, "a": {}, "z": 2.0}
    assert NOT_AVAILABLE not in json.loads(sample.data).values()
