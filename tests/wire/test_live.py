"""Live over LCM: types, words, losses and the axis client, against a stand-in gateway."""

import json
import os
import runpy
import struct
import subprocess
import sys
import threading
import time
import tracemalloc
import types
from pathlib import Path

import numpy as np
import pytest
from forceaxis import objects
from forceaxis._core import InputError
from forceaxis.axis.axis import MODES
from forceaxis.axis.session import Session
from forceaxis.bus import client, state_names
from forceaxis.bus.client import AxisClient, NoAnswer, Refused, from_raw, to_raw
from forceaxis.bus.lcm import (
    TABLE_HASH,
    Gaps,
    Undecodable,
    blank,
    connect,
    decode,
)
from forceaxis.bus.messages import (
    axis_capture_t,
    axis_command_t,
    axis_event_t,
)
from forceaxis.bus.monitor_state import Watch
from forceaxis.bus.sources import LiveSource
from forceaxis.results import to_json
from gateway_stand_in import Gateway, sample, state_of
from live_bus import (  # noqa: F401
    ROOT,
    free_url,
    gateway,
    namespace,
    until,
    url_fixture,
)
from lossy_link import LossyLink, at_random

# Types and words.


def gen_messages(*arguments):
    command = [sys.executable, ROOT / "tools/gen_messages.py", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_the_python_types_are_what_the_lcm_files_give():
    done = gen_messages("--check")
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_stale_type_is_noticed(tmp_path):
    (tmp_path / "host/lcm").mkdir(parents=True)
    text = (ROOT / "host/lcm/axis.lcm").read_text()
    (tmp_path / "host/lcm/axis.lcm").write_text(text)
    assert gen_messages("--root", tmp_path).returncode == 0
    assert gen_messages("--root", tmp_path, "--check").returncode == 0
    changed = text.replace("int64_t force_raw;", "int32_t force_raw;")
    (tmp_path / "host/lcm/axis.lcm").write_text(changed)
    done = gen_messages("--root", tmp_path, "--check")
    assert done.returncode == 1
    assert "axis_state_t.py is stale" in done.stdout


def test_every_type_begins_with_the_same_four_fields():
    for name in (
        "axis_state",
        "axis_command",
        "axis_event",
        "axis_capture",
        "sim_clock",
        "sim_truth",
    ):
        module = __import__(f"forceaxis.bus.messages.{name}_t", fromlist=["_"])
        fields = getattr(module, f"{name}_t")
        assert fields.__slots__[:4] == ["utime", "wall_utime", "seq", "run_id"]
        assert fields.__typenames__[:4] == ["int64_t"] * 4


# Bits 6, 5, 3, 2, 1, 0 of the statusword, typed from CiA 402; x: whatever.
PATTERNS = {
    "0x0000": "not ready to switch on",
    "1x0000": "switch on disabled",
    "010001": "ready to switch on",
    "010011": "switched on",
    "010111": "operation enabled",
    "000111": "quick stop active",
    "0x1111": "fault reaction active",
    "0x1000": "fault",
}


def test_every_statusword_is_named_as_cia_402_names_it():
    for word in range(0x10000):
        bits = "".join(str(word >> b & 1) for b in (6, 5, 3, 2, 1, 0))
        named = [
            text
            for pattern, text in PATTERNS.items()
            if all(p in ("x", b) for p, b in zip(pattern, bits, strict=True))
        ]
        assert len(named) <= 1
        expected = named[0] if named else f"statusword {word:04X}h"
        assert state_names.drive_state(word) == expected


def test_words_for_numbers_that_nobody_knows():
    assert state_names.mode(10) == "cyclic force"
    assert state_names.mode(-77) == "mode -77"
    # The names are those of the table.
    named = dict(objects.BY_NAME["modes_of_operation"].values)
    assert named == dict(objects.BY_NAME["modes_of_operation_display"].values)
    assert set(MODES) == {state_names.mode(n) for n in named}
    assert all(MODES[text.replace("_", " ")] == n for n, text in named.items())
    assert state_names.emergency(0) == "EMCY 0000h error reset"
    for code, text in objects.BY_NAME["error_code"].values[1:]:
        assert state_names.emergency(code) == f"EMCY {code:04X}h {text.replace('_', ' ')}"
    assert state_names.enum("fault", 6) == "force_max"
    assert state_names.enum("fault", 200) == "200"
    assert state_names.enum("no_such_object", 3) == "3"
    assert state_names.emergency(0x8130) == "EMCY 8130h heartbeat lost"
    assert state_names.emergency(0x1234) == "EMCY 1234h"
    assert "target reached" in state_names.status_bits(0x1637, 10)
    assert "homing error" in state_names.status_bits(0x2000, 6)


def test_engineering_values_and_enum_texts_become_raw_ones_and_back():
    assert to_raw("force_gain", 7.5) == 1920
    assert from_raw("force_gain", 1920) == 7.5
    assert to_raw("mode", "force") == 3
    assert from_raw("mode", 3) == "force"
    assert to_raw("0x2010:3", "0x10") == 16
    assert from_raw("0x2010:3", 16) == 16
    for name, value in (
        ("force_gain", 256), ("force_gain", "much"), ("force_gain", float("nan")),
        ("mode", "flying"), ("no_such", 1), ("0x2010:3", 2**33), ("force_gain", None),
    ):  # fmt: skip
        with pytest.raises(InputError, match=name):
            to_raw(name, value)


# Losses.


def test_gaps_are_counted_and_what_comes_late_is_not_lost():
    gaps = Gaps()
    taken = [gaps.take(9, seq) for seq in (5, 6, 8, 8, 7, 7, 12)]
    assert taken == [True, True, True, False, True, False, True]
    assert (gaps.received, gaps.lost, gaps.doubled, gaps.late) == (5, 3, 2, 1)
    assert not gaps.rivals


def test_a_restarted_publisher_is_no_loss_and_two_at_once_are_named():
    gaps = Gaps()
    for run, seq in ((1, 100), (1, 101), (2, 0), (2, 1)):
        assert gaps.take(run, seq)
    assert (gaps.lost, gaps.restarts, gaps.rivals) == (0, 1, False)
    gaps.take(1, 102)
    assert gaps.rivals


def test_a_number_far_ahead_costs_no_memory():
    gaps = Gaps()
    gaps.take(1, 0)
    gaps.take(1, 2**60)
    assert gaps.lost == 2**60 - 1
    assert gaps.take(1, 2**60 - 1)
    assert gaps.lost == 2**60 - 2


# The client.


def test_commands_are_answered_though_datagrams_get_lost(url):
    with gateway(url, axes="1,2", rate=20), AxisClient(1, url) as axis:
        assert axis.state().position_cnt >= 1000
        # The stand-in drops every fifth response, so several commands are repeated.
        for gain in (0.5, 1.0, 1.5, 7.25):
            axis.write("force_gain", gain)
            assert axis.read("force_gain") == gain
        axis.write_all({"mode": "force", "force_setpoint": 30})
        assert axis.read_all(["mode", "force_setpoint"]) == {
            "mode": "force",
            "force_setpoint": 30.0,
        }
        axis.write("0x2010:1", 5)
        assert axis.read("0x2010:1") == 5
        axis.take()
        axis.release()
        with pytest.raises(Refused, match="position: read-only") as caught:
            axis.write_all({"force_gain": 2, "position": 5})
        assert caught.value.code == 0x06010002
        assert list(caught.value.event.object) == ["force_gain", "position"]
        assert axis.read("force_gain") == 2.0
        with pytest.raises(InputError, match=r"255\.996"):
            axis.write("force_gain", 300)
        with pytest.raises(NoAnswer):
            axis.wait_event(axis_event_t.EVENT_FAULT, timeout_s=0.1)


class Watched(Gateway):
    """A stand-in that records writes, and whose axis may be owned by another client."""

    def __init__(self, url):
        super().__init__(url, [1])
        self.values[1, "watchdog"], self.foreign, self.written = 700, False, []
        self.running = True
        self.thread = threading.Thread(target=self.run)

    def command(self, channel, data):
        c = decode(channel, data)
        if (c.run_id, c.command_id) not in self.answers and c.kind != axis_command_t.KIND_READ:
            items = list(zip(c.object, c.value, strict=True))
            self.written.append((self.foreign, c.kind, items))
            if self.foreign and c.kind == axis_command_t.KIND_WRITE:
                answer = 1, axis_event_t.EVENT_REFUSED, "the axis belongs to modbus", 0x08000021, c
                self.answers[c.run_id, c.command_id] = answer
        super().command(channel, data)

    def run(self):
        k = 0
        while self.running:
            self.lcm.handle_timeout(10)
            self.send("AXIS_1_STATE", state_of(1, k))
            k += 1

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.running = False
        self.thread.join()


def test_a_session_keeps_its_axis_by_writing_its_watchdog_as_it_is(url):
    with Watched(url) as axis, Session(1, url) as session:
        assert until(lambda: len(axis.written) > 4)
        assert axis.written[0][1] == axis_command_t.KIND_TAKE
        assert axis.written[1:] == [(False, axis_command_t.KIND_WRITE, [("watchdog", 700)])] * len(
            axis.written[1:]
        )
        # A value that the session changes is kept.
        for value in range(1000, 1020):
            session.write("watchdog", value)
            time.sleep(0.03)
        assert until(lambda: axis.written[-3:] == axis.written[-1:] * 3)
        assert axis.values[1, "watchdog"] == 1019
        writes = [items[0][1] for _, kind, items in axis.written if kind == 1]
        assert writes == sorted(writes)
        # Another client acquires the axis: the session's further writes are refused.
        axis.foreign, before = True, len(axis.written)
        assert until(lambda: len(axis.written) > before + 2)
        assert {kind for foreign, kind, _ in axis.written if foreign} == {1}


def test_a_session_that_is_closed_twice_stays_closed(url):
    with Watched(url) as axis:
        with Session(1, url) as session:
            session.close()
            sent = len(axis.written)
        assert len(axis.written) == sent
        session.close()
        with Session(1, url):  # the axis is free again
            assert axis.written[-1][1] in (axis_command_t.KIND_TAKE, axis_command_t.KIND_WRITE)


def test_a_client_captures_what_the_recorder_holds(url):
    with gateway(url, axes="1", rate=20), AxisClient(1, url) as axis:
        held = axis.capture(["force", "position"], samples=500, decimation=1, timeout_s=5)
        assert held.complete and held.missing == 0
        assert held.values("force").tolist() == [sample(1, 0, i) / 256 for i in range(500)]
        assert held.values("position").tolist() == [sample(1, 1, i) for i in range(500)]
        assert held.ticks()[:2].tolist() == [3000, 3001]
        done = axis.wait_event(axis_event_t.EVENT_CAPTURE)
        assert done.code == 500
        with pytest.raises(InputError, match="no_such"):
            axis.capture(["no_such"])
        with pytest.raises(InputError, match="1 to 8"):
            axis.capture([])


def recording_over(axis, samples):
    """Acquires, writes, records and releases; every request and block may be lost on its way."""
    axis.take()
    axis.write("force_gain", 7.25)
    assert axis.read("force_gain") == 7.25
    held = axis.capture(["force"], samples=samples, timeout_s=3600)
    assert held.missing == 0
    assert held.values("force").tolist() == [sample(1, 0, i) / 256 for i in range(samples)]
    axis.release()


@pytest.mark.parametrize("share", [0.01, 0.1, 0.2, 0.3, 0.4, 0.5])
def test_a_recording_is_complete_over_a_network_that_loses_datagrams(url, share, monkeypatch):
    """Up to half of all datagrams in both directions. FORCEAXIS_LOSSY=1000 records so often."""
    monkeypatch.setattr(client, "PROGRESS_WAIT_S", client.LATE_BLOCKS_WAIT_S)
    with gateway(url, axes="1", rate=20):
        for seed in range(int(os.environ.get("FORCEAXIS_LOSSY", "1"))):
            clients = free_url()
            with LossyLink(clients, url, at_random(seed, share)), AxisClient(1, clients) as axis:
                recording_over(axis, 700)


def test_a_closed_connection_keeps_neither_descriptors_nor_threads(url):
    """A program that connects again and again would have more descriptors than LCM can have."""
    before = len(os.listdir("/proc/self/fd")), threading.active_count()
    native = len(os.listdir("/proc/self/task"))
    for _ in range(20):
        AxisClient(1, url).close()
    assert (len(os.listdir("/proc/self/fd")), threading.active_count()) == before
    assert len(os.listdir("/proc/self/task")) <= native


def is_block(channel, _data):
    return channel.endswith("_CAPTURE")


def is_news_of_a_recording(channel, data):
    if not channel.endswith("_EVENT"):
        return is_block(channel, data)
    return decode(channel, data).kind == axis_event_t.EVENT_CAPTURE


@pytest.mark.parametrize("chosen", [is_news_of_a_recording, is_block])
def test_a_recording_of_which_nothing_was_received_is_asked_for(url, chosen, monkeypatch):
    """All blocks of the first transmission are lost, and also the event that ends it."""
    monkeypatch.setattr(client, "PROGRESS_WAIT_S", 0.2)
    blocks = []

    def lost(channel, data):
        blocks.extend([channel] * is_block(channel, data))
        return len(blocks) <= 11 and chosen(channel, data)

    clients = free_url()
    with (
        gateway(url, axes="1", rate=20),
        LossyLink(clients, url, lost) as link,
        AxisClient(1, clients) as axis,
    ):
        recording_over(axis, 700)
        assert link.dropped >= 11


@pytest.mark.parametrize(("nmt", "age_us"), [(-1, 1000), (4, 1000), (5, 8_100_000)])
def test_a_session_does_not_take_the_last_values_of_a_dead_axis_for_a_contact(nmt, age_us):
    """The gateway publishes the last values of an axis on, here those of a contact."""
    session = object.__new__(Session)
    session.axis, session._bus = 1, types.SimpleNamespace(trouble=None, url="")
    dead = state_of(1, 1)
    dead.nmt_state, dead.age_us = nmt, age_us
    session.state = lambda timeout_s: time.sleep(0.01) or dead
    with pytest.raises(NoAnswer, match=r"expected a contact .* the axis is silent"):
        session.wait_for(lambda s: s.contact == 1, "a contact", 0.1)
    dead.nmt_state, dead.age_us = 5, 1000
    assert session.wait_for(lambda s: s.contact == 1, "a contact", 0.5) is dead


def test_a_capture_of_which_everything_is_always_lost_ends(url, monkeypatch):
    monkeypatch.setattr(client, "LATE_BLOCKS_WAIT_S", 0.05)
    clients = free_url()
    with (
        gateway(url, axes="1", rate=20),
        LossyLink(clients, url, is_block),
        AxisClient(1, clients) as axis,
        pytest.raises(NoAnswer, match="expected the samples of a capture, but none were received"),
    ):
        axis.capture(["force"], samples=100)


def test_a_capture_of_which_a_block_is_lost_says_so(url):
    """The block of samples 64 to 127 is lost: those samples are NaN, the others complete."""
    watch, gateway = Watch(), Gateway(url, [1])
    source = LiveSource(watch, url)
    try:
        gateway.capture(1, None, 200, lose=1)
        assert until(lambda: 1 in watch.axes and watch.axes[1].capture)
        assert until(lambda: len(watch.events) == 1)
        _, held = watch.axes[1].capture
        assert held.missing == 64 and not held.complete
        values = held.values("force")
        assert np.flatnonzero(np.isnan(values)).tolist() == list(range(64, 128))
        assert values[128] == sample(1, 0, 128) / 256
        assert watch.axes[1].lost() == 1
    finally:
        source.close()


def test_a_full_disk_ends_the_recording_and_not_the_watching(url):
    watch = Watch()
    source = LiveSource(watch, url)
    try:
        source.record(Path("/dev/shm") / f"forceaxis-{os.getpid()}.log")
        os.unlink(source.writer.path)
        source.writer._file.close()
        source.writer._file = Path("/dev/full").open("wb", buffering=0)  # noqa: SIM115
        with gateway(url, axes="1", count=20):
            assert until(lambda: watch.received > 10)
        assert "No space left" in source.trouble and source.writer is None
    finally:
        source.close()


def test_a_trigger_that_does_not_fire_is_not_a_missing_gateway(url):
    with gateway(url, axes="1"), AxisClient(1, url) as axis:
        with pytest.raises(NoAnswer) as error:
            axis.capture(["force"], timeout_s=0.3, trigger_level=2**31 - 1)
        assert "the trigger condition has not occurred" in str(error.value)
        assert "gateway" not in str(error.value)
        with pytest.raises(NoAnswer) as error:
            axis.wait_event(axis_event_t.EVENT_FAULT, timeout_s=0.3)
        assert "running?" not in str(error.value)


def test_the_example_ends_in_one_line(monkeypatch):
    def nobody(*_):
        raise NoAnswer(
            "axis 1: expected a capture within 30 s, the trigger condition has not occurred"
        )

    monkeypatch.setattr("forceaxis.gateway.Session", nobody)
    with pytest.raises(SystemExit) as end:
        runpy.run_path(str(ROOT / "examples" / "session.py"), run_name="__main__")
    assert str(end.value).startswith("session.py: axis 1: expected a capture")


def test_nobody_answers(url):
    with AxisClient(3, url, timeout_s=0.3) as axis:
        begun = time.monotonic()
        with pytest.raises(NoAnswer, match="gateway"):
            axis.write("force_gain", 1)
        assert 0.25 < time.monotonic() - begun < 5
        with pytest.raises(NoAnswer):
            axis.state()
    with pytest.raises(InputError, match="axis"):
        AxisClient(0, url)
    with pytest.raises(InputError, match="udpm"):
        connect("nonsense://")


def test_a_block_that_lies_about_its_size_asks_for_no_memory():
    watch, block = Watch(), blank(axis_capture_t)
    block.axis, block.seq, block.run_id, block.capture_id = 1, 0, 1, 1
    block.total_samples, block.num_signals, block.signal = 2**40, 1, ["force"]
    block.first_sample, block.num_samples, block.value = 0, 1, [[5]]
    watch.take("AXIS_1_CAPTURE", block.encode(), 0)
    assert "does not fit" in watch.events[-1].text
    assert watch.axes[1].capture[1].total == 0
    # A block beyond the last sample: the capture has its size, and no sample of the block.
    block.seq, block.total_samples, block.first_sample = 1, 10, 10
    watch.take("AXIS_1_CAPTURE", block.encode(), 0)
    assert len(watch.events) == 2 and "does not fit" in watch.events[-1].text
    assert watch.axes[1].capture[1].missing == watch.axes[1].capture[1].total == 10


def command_of(names):
    command = blank(axis_command_t)
    command.num_items, command.object, command.value = len(names), names, [1] * len(names)
    command.num_signals, command.signal = 1, ["force"]
    return command.encode()


@pytest.mark.parametrize("count", [-1, -(2**31), 2**31 - 1, 2**20])
def test_a_count_that_lies_is_seen_before_it_is_believed(count):
    lie = struct.pack(">i", count)
    capture = blank(axis_capture_t)
    capture.num_signals = capture.num_samples = 0
    rows = capture.encode()  # ends with num_signals, num_samples: rows of nothing take no bytes
    command, items = command_of(["force_gain"]), 8 + 9 * 8
    lies = [
        ("AXIS_1_CAPTURE", rows[:-4] + lie),
        ("AXIS_1_CAPTURE", rows[:-8] + lie + rows[-4:]),
        ("AXIS_1_COMMAND", command[:items] + lie + command[items + 4 :]),
        ("AXIS_1_COMMAND", command[: items + 4] + lie + command[items + 8 :]),  # of a string
    ]
    tracemalloc.start()
    try:
        for channel, data in lies:
            with pytest.raises(Undecodable):
                decode(channel, data)
        assert tracemalloc.get_traced_memory()[1] < 100_000
    finally:
        tracemalloc.stop()


def test_a_message_that_is_cut_off_or_goes_on_is_none():
    whole = command_of(["force_gain", "0x6040"])
    assert decode("AXIS_1_COMMAND", whole).object == ["force_gain", "0x6040"]
    for size in range(len(whole)):
        with pytest.raises(Undecodable):
            decode("AXIS_1_COMMAND", whole[:size])
    with pytest.raises(Undecodable):
        decode("AXIS_1_COMMAND", whole + b"\0")
    unended = whole.replace(b"0x6040\0", b"0x60400")
    with pytest.raises(Undecodable):
        decode("AXIS_1_COMMAND", unended)
    rows = blank(axis_capture_t)
    rows.num_signals, rows.num_samples, rows.value = 0, 5, [[]] * 5
    with pytest.raises(Undecodable):
        decode("AXIS_1_CAPTURE", rows.encode())


def test_random_bytes_on_every_channel_are_counted_and_harmless():
    watch, random = Watch(), np.random.default_rng(1)
    good = state_of(1, 3).encode()
    for i in range(3000):
        data = bytearray(good if i % 2 else random.bytes(int(random.integers(0, 300))))
        if i % 2:
            at = int(random.integers(8, len(data)))
            data[at] ^= 1 << int(random.integers(8))
        channel = ("AXIS_1_STATE", "AXIS_2_EVENT", "SIM_CLOCK", "AXIS_3_CAPTURE")[i % 4]
        watch.take(channel, bytes(data), i)
        json.dumps(to_json(watch.snapshot("", i)), allow_nan=False) if i % 100 == 0 else None
    assert watch.undecodable > 1000


def test_the_hash_that_is_compared_is_the_tables():
    assert f"{TABLE_HASH:08x}" == objects.OBJECTS_HASH[:8]
    state = decode("AXIS_1_STATE", state_of(1, 0).encode())
    assert state.objects_hash == TABLE_HASH
