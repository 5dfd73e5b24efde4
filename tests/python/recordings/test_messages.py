"""Messages of other programs in MCAP files: in JSON and in CDR of ROS 2. Files are written with the
libraries of the format; every expected number is one of the arrays below."""

import json
import struct

import numpy as np
import pytest
from foreign_files import imported, run
from mcap.writer import Writer
from mcap_ros2.writer import Writer as RosWriter
from verbs import forceaxis

BEGIN_NS = 1_778_767_384_000_000_000
STEPS = np.arange(400)
FORCE_N = np.round(3 + 0.25 * STEPS, 2)


def messages(folder, *topics, chunk=1 << 20):
    """Writes an MCAP file of (topic, encoding, messages as bytes, log times in ns)."""
    with (folder / "log.mcap").open("wb") as stream:
        writer = Writer(stream, chunk_size=chunk)
        writer.start()
        for topic, encoding, rows, times_ns in topics:
            channel = writer.register_channel(topic, encoding, 0)
            for data, at in zip(rows, times_ns, strict=True):
                writer.add_message(channel, int(at), data, 0)
        writer.finish()
    return folder / "log.mcap"


def rows(**columns):
    return [
        json.dumps(dict(zip(columns, row, strict=True))).encode()
        for row in zip(*columns.values(), strict=True)
    ]


LOGGED_NS = BEGIN_NS + STEPS * 1_000_000  # a message is logged every ms
SLOW_NS = BEGIN_NS + STEPS * 575_000  # the log lags behind more and more, to 15 % of the time


STAMPS = {
    "own seconds": ("time_s", (STEPS * 5e-4).tolist()),
    "seconds since 1970": ("timestamp", [BEGIN_NS / 1e9 + k * 5e-4 for k in STEPS.tolist()]),
    "ns since 1970": ("timestamp", (BEGIN_NS + STEPS * 500_000).tolist()),
    "two parts": ("stamp", [{"sec": (BEGIN_NS + k * 500_000) // 10**9,
                             "nanosec": (BEGIN_NS + k * 500_000) % 10**9}
                            for k in STEPS.tolist()]),
}  # fmt: skip


@pytest.mark.parametrize("stamp", STAMPS)
def test_the_time_of_a_message_itself_is_its_time(tmp_path, stamp):
    """The sensor samples at 2000 Hz; the log, with its time of arrival, says 1739 Hz."""
    name, times = STAMPS[stamp]
    file = messages(tmp_path, ("/f", "json", rows(**{name: times}, force_N=FORCE_N), SLOW_NS))
    for more in ((), ("--time", "time_s:s") if stamp == "own seconds" else ()):
        found, said = imported(file, "--map", "force=force_N", *more)
        # seconds since 1970 were rounded to 0.24 us before the file was written
        near = 1e-3 if stamp == "seconds since 1970" else 1e-7
        assert found["force"].rate_hz == pytest.approx(2000, rel=near)
        np.testing.assert_array_equal(found["force"].values, FORCE_N)
        assert f"the times are those of /f/{name}" in said
    found, said = imported(file, "--map", "force=force_N", "--time", "log_time_ns")
    assert found["force"].rate_hz == pytest.approx(1e9 / 575_000, rel=1e-7)


@pytest.mark.parametrize(
    ("name", "times", "why"),
    [
        ("stamp_ns", [0] * 400, "are no ascending times"),
        ("t", [21.5, 21.4] * 200, "have no known unit"),
        ("timestamp", STEPS.tolist(), "have no known unit"),
        ("time_ms", (12.5 + STEPS * 1e-3).tolist(), "last 0.000399 s and not 0.399 s as the log"),
        ("stamp_ns", [0, *LOGGED_NS[1:].tolist()], "last 1.78e+09 s and not 0.399 s"),
        ("stamp_ns", [*LOGGED_NS[:9].tolist(), 0, *LOGGED_NS[10:].tolist()], "no ascending times"),
        ("time_s", (STEPS * 1.3e-3).tolist(), "last 0.519 s and not 0.399 s as the log"),
    ],
)
def test_what_is_no_time_leaves_that_of_the_log_and_says_so(tmp_path, name, times, why):
    file = messages(tmp_path, ("/f", "json", rows(**{name: times}, force_N=FORCE_N), LOGGED_NS))
    found, said = imported(file, "--map", "force=force_N")
    assert found["force"].rate_hz == pytest.approx(1000, rel=1e-7) and why in said


def test_signals_of_clocks_that_have_nothing_in_common_are_refused(tmp_path):
    file = messages(
        tmp_path,
        ("/f", "json", rows(time_s=(STEPS * 1e-3).tolist(), force_N=FORCE_N), LOGGED_NS),
        ("/x", "json", rows(travel_mm=FORCE_N[:100]), LOGGED_NS[:400:4]),
    )
    maps = ("--map", "position=travel_mm,force=force_N")
    said = run(file, *maps).stderr
    assert "expected signals of the same time" in said and said.count("\n") == 1
    found, _ = imported(file, *maps, "--time", "log_time_ns")
    np.testing.assert_array_equal(found["force"].values, FORCE_N)  # has more samples
    assert [round(s.rate_hz, 6) for s in found] == [250, 1000]
    assert found["force"].time_s[0] == found["position"].time_s[0] == 0


def test_signals_without_a_time_in_common_are_named(tmp_path):
    ahead = (LOGGED_NS + 2_000_000_000).tolist()  # less than ten times their length
    file = messages(
        tmp_path,
        ("/f", "json", rows(stamp_ns=ahead, force_N=FORCE_N), LOGGED_NS),
        ("/x", "json", rows(travel_mm=FORCE_N), LOGGED_NS),
    )
    maps = ("--map", "position=travel_mm,force=force_N")
    none = "signals without a time in common: position from 0 to 0.399 s and force from 2 to 2.399"
    assert none in imported(file, *maps)[1]
    assert "in common" not in imported(file, *maps, "--time", "log_time_ns")[1]


@pytest.mark.parametrize("bad", [b"", b"hello"])
def test_a_topic_that_cannot_be_decoded_leaves_the_others(tmp_path, bad):
    texts = [*rows(travel_mm=FORCE_N[:9]), bad, *rows(travel_mm=FORCE_N[10:])]
    file = messages(
        tmp_path,
        ("/f", "json", rows(force_N=FORCE_N), LOGGED_NS),
        ("/x", "json", texts, LOGGED_NS),
    )
    found, said = imported(file, "--map", "force=force_N")
    np.testing.assert_array_equal(found["force"].values, FORCE_N)
    assert "messages not read: " in said and "expected messages in json on /x, got" in said
    assert said.count("on /x") == 1
    done = run(file, "--map", "position=travel_mm")
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert "expected messages in json on /x, got" in done.stderr


DAMAGED = {
    "unknown text": (b"wstring text\n", b"\0\1\0\0\1\0\0\0x\0\0\0"),
    "unknown type": (b"other_pkg/Unknown u\n", bytes(12)),
    "short": (b"float64 a\nfloat64 b\n", b"\0\1\0\0" + bytes(8)),
}


@pytest.mark.parametrize("kind", DAMAGED)
def test_a_topic_of_ros_2_that_cannot_be_decoded_leaves_the_others(tmp_path, kind):
    definition, data = DAMAGED[kind]
    with (tmp_path / "log.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        good, bad = (
            writer.register_channel(topic, "cdr", writer.register_schema(name, "ros2msg", text))
            for topic, name, text in (
                ("/f", "press_msgs/msg/F", b"float64 force\n"), ("/x", "x/msg/X", definition)
            )
        )  # fmt: skip
        for at, force in zip(LOGGED_NS.tolist(), FORCE_N, strict=True):
            writer.add_message(bad, at, data, at)
            writer.add_message(good, at, b"\0\1\0\0" + struct.pack("<d", force), at)
        writer.finish()
    found, said = imported(tmp_path / "log.mcap", "--map", "force=/f/force:N")
    np.testing.assert_array_equal(found["force"].values, FORCE_N)
    assert "messages not read: " in said and "expected messages in cdr on /x, got" in said


def test_two_senders_on_one_topic_are_not_mixed(tmp_path):
    both = [("/f", "json", rows(force_N=sign * FORCE_N), LOGGED_NS) for sign in (1, -1)]
    file = messages(tmp_path, *both)
    found, said = imported(file, "--map", "force=/f/force_N,x=/f #2/force_N")
    assert "/f has another channel, /f #2" in said
    np.testing.assert_array_equal(found["force"].values, FORCE_N)
    np.testing.assert_array_equal(found["x"].values, -FORCE_N)


@pytest.mark.parametrize("share", [0.3, 0.7, 0.97])
def test_of_a_cut_file_the_complete_messages_are_imported(tmp_path, share):
    file = messages(tmp_path, ("/f", "json", rows(force_N=FORCE_N), LOGGED_NS), chunk=2000)
    data = file.read_bytes()
    file.write_bytes(data[: int(share * len(data))])
    found, said = imported(file, "--map", "force=force_N")
    count = len(found["force"].values)
    np.testing.assert_array_equal(found["force"].values, FORCE_N[:count])
    assert "is damaged or cut off (" in said and f"), {count} messages saved" in said
    for verb in (("convert", file, tmp_path / "whole.mcap"), ("export", file, "--out", tmp_path)):
        done = forceaxis("recording", *verb)
        assert done.returncode == 2 and f"got {count} of another program (json)" in done.stderr
        assert "`forceaxis recording import` reads them" in done.stderr


@pytest.mark.parametrize("suffix", ["mcap", "log"])
def test_of_a_cut_log_of_the_product_the_complete_messages_are_imported(tmp_path, suffix):
    file = tmp_path / f"source.{suffix}"
    done = forceaxis(
        "run", "contact", "--set", "experiment.duration_s=1", "--set", "verdict.window_s=0.3",
        "--record", file,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    whole, _ = imported(file, "--map", "force=sensor.force_N")
    data = file.read_bytes()
    file.write_bytes(data[: len(data) * 2 // 3])
    cut, said = imported(file, "--map", "force=sensor.force_N")
    count = len(cut["force"].values)
    assert 100 < count < len(whole["force"].values) and "messages saved" in said
    np.testing.assert_array_equal(cut["force"].values, whole["force"].values[:count])


WRENCH = """\
std_msgs/Header header
geometry_msgs/Wrench wrench
float64[] extra
================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================
MSG: geometry_msgs/Wrench
geometry_msgs/Vector3 force
geometry_msgs/Vector3 torque
================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""
VALUE = "uint8 flags\nfloat32[3] position\nbool contact\n"


def test_messages_of_ros_2_have_the_times_of_their_headers(tmp_path):
    with (tmp_path / "ros.mcap").open("wb") as stream:
        writer = RosWriter(stream)
        wrench = writer.register_msgdef("geometry_msgs/msg/WrenchStamped", WRENCH)
        value = writer.register_msgdef("press_msgs/msg/Value", VALUE)
        for k, force in enumerate(FORCE_N):
            at = BEGIN_NS + 123_456_789 + k * 500_000
            header = {"stamp": {"sec": at // 10**9, "nanosec": at % 10**9}, "frame_id": "tool"}
            force = {"x": 0, "y": -force, "z": force}
            message = {
                "header": header,
                "wrench": {"force": force, "torque": dict.fromkeys("xyz", 0)},
                "extra": [0.0] * 500,
            }
            writer.write_message("/ft", wrench, message, log_time=at + k % 5 * 300_000)
            if k % 4 == 0:
                message = {"flags": 3, "position": [k / 4, 1, 2], "contact": k > 100}
                writer.write_message("/value", value, message, log_time=at)
        writer.finish()
    maps = "force=wrench.force.z:N,position=/value/position.0:mm,x=contact"
    found, said = imported(tmp_path / "ros.mcap", "--map", maps)
    np.testing.assert_array_equal(found["force"].values, FORCE_N)
    np.testing.assert_allclose(found["position"].values, STEPS[:100] / 1e3, rtol=1e-12)
    np.testing.assert_array_equal(found["x"].values, STEPS[:400:4] > 100)
    assert [round(s.rate_hz, 6) for s in found] == [2000, 500, 500]
    assert found["force"].time_s[0] == pytest.approx(0.123456789, abs=1e-9)
    assert "lists of more than 64 items left out: extra" in said
    done = run(tmp_path / "ros.mcap", "--map", "force=wrench.force.z")
    assert done.returncode == 2 and "expected the unit" in done.stderr
