"""Live over LCM: words, losses, monitor, logs and the axis client, against a stand-in gateway.

The bus is private: a network namespace of this process's own where that is allowed (as in
tools/test), else a port of its own with ttl 0.
"""

import asyncio
import csv
import ctypes
import fcntl
import json
import os
import pty
import runpy
import select
import socket
import struct
import subprocess
import sys
import termios
import threading
import time
import tracemalloc
from contextlib import contextmanager
from pathlib import Path

import lcm
import numpy as np
import pytest
import verbs
from forceaxis import objects
from forceaxis._core import InputError
from forceaxis.bus import log as logs
from forceaxis.bus import log_tables, state_names
from forceaxis.bus.client import AxisClient, NoAnswer, Refused, from_raw, to_raw
from forceaxis.bus.gateway import MODES, Session
from forceaxis.bus.lcm import (
    NOT_AVAILABLE,
    TABLE_HASH,
    Bus,
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
    axis_state_t,
    sim_truth_t,
)
from forceaxis.bus.monitor import AxisPanel, Monitor
from forceaxis.bus.monitor_state import Watch
from forceaxis.bus.sources import Live, Replay
from gateway_stand_in import OPERATION_ENABLED, SCALE_UN, Gateway, sample, state_of, truth
from own_network import OWN_NETWORK

ROOT = Path(__file__).resolve().parents[2]
FORCEAXIS = Path(sys.executable).parent / "forceaxis"
STAND_IN = Path(__file__).parent / "gateway_stand_in.py"
CLONE_NEWNET = 0x40000000


@pytest.fixture(scope="module", autouse=True)
def namespace():
    """Sockets made while this lasts see a network of their own, with a multicast route."""
    libc = ctypes.CDLL(None, use_errno=True)
    with open("/proc/thread-self/ns/net") as before:
        private = libc.unshare(CLONE_NEWNET) == 0
        if private:
            subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
            subprocess.run(["ip", "route", "add", "224.0.0.0/4", "dev", "lo"], check=True)
        yield
        if private:
            assert libc.setns(before.fileno(), CLONE_NEWNET) == 0


def free_url():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return f"udpm://239.255.76.67:{probe.getsockname()[1]}?ttl=0"


@pytest.fixture
def url():
    return free_url()


@contextmanager
def gateway(url, **options):
    """A stand-in that publishes; ended by SIGTERM, or by itself after --count."""
    words = [w for k, v in options.items() for w in (f"--{k}", str(v))]
    process = subprocess.Popen(
        [sys.executable, STAND_IN, "--url", url, *words], stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout.readline() == "ready\n"
        yield process
    finally:
        process.terminate()
        process.wait(5)
        process.stdout.close()


def forceaxis(*arguments):
    return verbs.forceaxis(*arguments, cwd=ROOT)


def refused(done, *words):
    assert done.returncode == 2, (done.stdout, done.stderr)
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1, done.stderr
    for word in words:
        assert word in done.stderr


def until(condition, seconds=8.0):
    """Waits for it; False after `seconds`."""
    end = time.monotonic() + seconds
    while not (held := condition()) and time.monotonic() < end:
        time.sleep(0.02)
    return held


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
    named = dict(state_names.BY_NAME["modes_of_operation"].values)
    assert named == dict(state_names.BY_NAME["modes_of_operation_display"].values)
    assert set(MODES) == {state_names.mode(n) for n in named}
    assert all(MODES[text.replace("_", " ")] == n for n, text in named.items())
    assert state_names.emergency(0) == "EMCY 0000h error reset"
    for code, text in state_names.BY_NAME["error_code"].values[1:]:
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


# The monitor.


def panel_text(app, axis):
    panel = app.query_one(f"#axis-{axis}", AxisPanel)
    return f"{panel.border_title}\n{panel.border_subtitle}\n{panel.render()}"


def chart_text(app):
    return str(app.query_one("#chart").render())


def head_text(app):
    return str(app.query_one("#head").render())


async def settle(pilot, condition, seconds=8.0):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        await pilot.pause(0.05)
        if condition():
            return
    raise AssertionError("did not come within the time")


def run_monitor(source, watch, steps, size=(120, 40), **options):
    """The app headless, driven by `steps(app, pilot)`."""

    async def session():
        app = Monitor(source, watch, **options)
        async with app.run_test(size=size) as pilot:
            await steps(app, pilot)

    try:
        asyncio.run(asyncio.wait_for(session(), 25))
    finally:
        source.close()


def test_the_monitor_shows_states_in_words_counts_losses_freezes_and_records(url, tmp_path):
    watch = Watch()

    async def steps(app, pilot):
        await settle(pilot, lambda: len(app.query(AxisPanel)) == 4)
        await settle(pilot, lambda: watch.axes[1].lost() >= 2)
        await settle(pilot, lambda: "force_max" in panel_text(app, 4))
        words = panel_text(app, 1)
        assert "operation enabled" in words and "cyclic force" in words and "force law" in words
        assert "in contact" in words and "target reached" in words and "no fault" in words
        assert "LIMIT CYCLE" in panel_text(app, 2) and "limit dac_saturation" in panel_text(app, 2)
        assert "switch on disabled" in panel_text(app, 3) and "apart" in panel_text(app, 3)
        assert "fault" in panel_text(app, 4) and "FAULT force_max FF06h" in panel_text(app, 4)
        mismatch = f"table 1234abcd in the firmware, {TABLE_HASH:08x} here"
        assert mismatch in panel_text(app, 3)
        assert "lost" in panel_text(app, 1) and "lost" in head_text(app)
        await settle(pilot, lambda: "EMCY FF06h" in str(app.query_one("#events").render()))
        assert "simulator running x 1.00" in head_text(app)
        # Numbers are those of one state: force k/256 counts of 1.96 N, position 1000 + k.
        with watch.lock:
            app.draw()
            k, shown = watch.axes[1].state.force_cnt_q8, panel_text(app, 1)
        assert f"{k / 256 * SCALE_UN * 1e-6:.2f} N" in shown
        assert f"{1000 + k:,}".replace(",", " ") + " cnt" in shown
        # Braille dots of both lines.
        assert any(0x2800 < ord(c) < 0x2900 for c in chart_text(app))
        assert "target" in chart_text(app)
        await pilot.press("f")
        await pilot.pause()
        before, heard = panel_text(app, 1) + chart_text(app), watch.received
        await settle(pilot, lambda: watch.received > heard + 50)
        assert panel_text(app, 1) + chart_text(app) == before
        assert "FROZEN" in head_text(app)
        await pilot.press("f")
        await settle(pilot, lambda: panel_text(app, 1) + chart_text(app) != before)
        await pilot.press("r")
        await settle(pilot, lambda: app.source.writer and app.source.writer.count > 100)
        assert "●" in head_text(app)
        await pilot.press("r")
        await pilot.pause()
        assert "●" not in head_text(app)
        await pilot.press("2")
        assert app.chosen == 2
        await pilot.press("right", "right", "right")
        assert app.chosen == 1
        await pilot.press("9")
        assert app.chosen == 1
        assert "axis 1 force" in chart_text(app)
        await pilot.press("q")

    with gateway(url, axes="1,2,3,4", fault=4, mismatch=3, drop=7, double=11):
        run_monitor(Live(watch, url), watch, steps, folder=tmp_path)
    (path,) = tmp_path.glob("*.log")
    # liblcm's own reader opens it and reads the same messages.
    theirs = [(e.timestamp, e.channel, e.data) for e in lcm.EventLog(str(path), "r")]
    assert theirs == [tuple(e) for e in logs.LogReader(path)]
    assert len(theirs) > 100
    assert not [c for _, c, _ in theirs if c.endswith("_COMMAND")]  # the monitor never writes
    assert watch.axes[1].gaps["STATE"].doubled > 0


def test_losses_shown_are_those_that_were_injected(url):
    watch = Watch()
    source = Live(watch, url, axis=2)
    try:
        with gateway(url, axes="1,2", rate=400, count=201, drop=7, double=11) as process:
            assert process.wait(10) == 0
            gaps = watch.axes[2].gaps["STATE"]
            sent = [k for k in range(201) if k % 7 != 3]
            assert until(lambda: gaps.received == len(sent))
        assert set(watch.axes) == {2}
        # State 200 was received, so every missing number before it counts as lost.
        assert gaps.lost == 201 - len(sent)
        assert gaps.doubled == len([k for k in sent if k % 11 == 5])
    finally:
        source.close()


def test_a_capture_is_drawn_when_it_comes_and_says_what_is_missing(url):
    watch = Watch()

    async def steps(app, pilot):
        await settle(pilot, lambda: "capture 1" in chart_text(app))
        await settle(pilot, lambda: "not here" not in chart_text(app))
        assert "700 samples, 0.467 s" in chart_text(app)
        assert "force count" in chart_text(app) and "dac_code" in chart_text(app)
        assert "-46.7 ms" in chart_text(app)
        await pilot.press("c")
        assert "target" in chart_text(app)
        await pilot.press("c")
        assert "capture 1" in chart_text(app)

    with gateway(url, capture=700):
        run_monitor(Live(watch, url), watch, steps)


@pytest.mark.parametrize("size", [(80, 24), (60, 16), (200, 60), (40, 10)])
def test_the_monitor_fits_the_terminal_or_says_what_it_needs(url, size):
    watch = Watch()

    async def steps(app, pilot):
        await settle(pilot, lambda: len(watch.axes) == 6)
        await settle(pilot, lambda: len(app.query(AxisPanel)) == 6 or size == (40, 10))
        await pilot.pause(0.1)
        small = str(app.query_one("#small").render())
        if size == (40, 10):
            assert "60 x 16" in small and "40 x 10" in small
            await pilot.resize_terminal(100, 30)
            await settle(pilot, lambda: len(app.query(AxisPanel)) == 6)
            return
        chart = app.query_one("#chart")
        assert chart.size.height >= 3
        assert any(0x2800 < ord(c) < 0x2900 for c in chart_text(app))
        # Nothing is below the screen, and no line of a chart exceeds its width.
        assert app.query_one("#events").region.bottom <= size[1]
        assert max(map(len, chart_text(app).splitlines())) <= chart.size.width
        if size[1] >= 24:
            for panel in app.query(AxisPanel):
                assert panel.region.bottom <= chart.region.y
                assert panel.content_size.height >= 1

    with gateway(url, axes="1,2,3,4,5,6", rate=30):
        run_monitor(Live(watch, url), watch, steps, size=size)


def test_silence_a_silent_node_and_two_publishers_are_named(url):
    watch = Watch()

    async def steps(app, pilot):
        await settle(pilot, lambda: "no state heard" in chart_text(app))
        s = state_of(1, 1)
        with Bus(url, lambda *_: None) as one, Bus(url, lambda *_: None) as other:
            for bus in (one, other, one):
                bus.publish("AXIS_1_STATE", s)
            s.nmt_state = s.NMT_SILENT
            one.publish("AXIS_1_STATE", s)
            one.publish("AXIS_1_EVENT", state_of(1, 1))  # another type than the channel's
            await settle(pilot, lambda: "TWO PUBLISHERS on axis 1" in head_text(app))
            await settle(pilot, lambda: "NODE SILENT" in panel_text(app, 1))
            s.nmt_state = s.NMT_OPERATIONAL
            one.publish("AXIS_1_STATE", s)
            await settle(pilot, lambda: "SILENT, was operation enabled" in panel_text(app, 1))
            assert "got another type" in str(app.query_one("#events").render())
            everything = blank(axis_state_t)  # a gateway without data yet
            one.publish("AXIS_1_STATE", everything)
            await settle(pilot, lambda: "no state yet" in panel_text(app, 1))

    run_monitor(Live(watch, url), watch, steps)


def test_the_command_runs_in_a_terminal_records_and_leaves_it_whole(url, tmp_path):
    path, (ours, theirs) = tmp_path / "new" / "session.log", pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 30, 100, 0, 0))
    settings, shown = termios.tcgetattr(theirs), b""
    with gateway(url, axes="1,2"):
        process = subprocess.Popen(
            [FORCEAXIS, "monitor", "--url", url, "--record", path],
            stdin=theirs, stdout=theirs, stderr=theirs, env=os.environ | {"TERM": "xterm-256color"},
        )  # fmt: skip
        end, asked = time.monotonic() + 15, False
        while process.poll() is None and time.monotonic() < end:
            if select.select([ours], [], [], 0.1)[0]:
                shown += os.read(ours, 65536)
            if b"operation enabled" in shown and path.stat().st_size > 20_000 and not asked:
                os.write(ours, b"q")
                asked = True
        process.kill()
    while select.select([ours], [], [], 0.1)[0]:
        shown += os.read(ours, 65536)
    assert process.returncode == 0
    assert termios.tcgetattr(theirs) == settings
    text = shown.decode(errors="replace")
    assert "Traceback" not in text
    assert f"{len(list(logs.LogReader(path)))} messages" in text
    os.close(ours)
    os.close(theirs)


# One snapshot.


def test_once_json_is_one_object_of_what_is_heard(url):
    with gateway(url, axes="1,3", drop=7, mismatch=3):
        done = forceaxis("monitor", "--url", url, "--once", "--json", "--seconds", 1.5)
        one = forceaxis("monitor", "--url", url, "--once", "--axis", 3, "--seconds", 0.5)
    assert done.returncode == 0, done.stderr
    assert done.stderr == "" and done.stdout.count("\n") == 1
    shown = json.loads(done.stdout)
    assert set(shown["axes"]) == {"1", "3"}
    axis = shown["axes"]["1"]
    k = round(axis["force_cnt"] * 256)
    assert axis["drive_state"] == "operation enabled" and axis["statusword"] == OPERATION_ENABLED
    assert (axis["mode"], axis["native_mode"], axis["fault"]) == ("cyclic force", "force", "none")
    assert axis["position_cnt"] == 1000 + k and axis["command_code"] == k + 1
    assert axis["force_N"] == pytest.approx(k / 256 * 1.96, rel=1e-12)
    assert axis["target_force_N"] == pytest.approx(59.0, rel=1e-12)
    assert axis["more"] == {"force_gain": 256}
    assert axis["lost"] > 0 and 30 < axis["rate_per_s"] < 200 and axis["age_s"] < 1.5
    assert "1234abcd" in shown["axes"]["3"]["objects_mismatch"]
    assert shown["clock"]["speed"] == 1.0
    assert one.returncode == 0
    assert one.stdout.startswith("axis 3: switch on disabled, profile position, no fault")
    assert one.stdout.count("\n") == 1


def test_once_with_nothing_to_hear_is_status_1(url):
    done = forceaxis("monitor", "--url", url, "--once", "--json", "--seconds", 0.2, "--axis", 5)
    assert done.returncode == 1
    assert json.loads(done.stdout)["axes"] == {}
    assert "expected a state of axis 5 within 0.2 s" in done.stderr and done.stderr.count("\n") == 1


def test_no_multicast_route_is_one_line_that_says_how():
    for verb in ("monitor --once", "monitor --once --url udpm://239.255.76.67:7667?ttl=0"):
        done = subprocess.run(
            [*OWN_NETWORK, FORCEAXIS, *verb.split()],
            capture_output=True, text=True, check=False, timeout=30,
        )  # fmt: skip
        refused(done, "multicast route", "ip route add 224.0.0.0/4 dev lo")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["monitor"], ["terminal", "--once"]),
        (["monitor", "--once", "--axis", 0], ["--axis"]),
        (["monitor", "--once", "--axis", 128], ["--axis"]),
        (["monitor", "--once", "--url", "foo://x"], ["foo://x", "udpm://"]),
        (["monitor", "--once", "--url", "udpm://nowhere:1"], ["nowhere", "udpm://"]),
        (["monitor", "--once", "--url", "udpm://239.255.76.67:99999"], ["99999", "udpm://"]),
        (["monitor", "--once", "--speed", 2], ["--speed", "--replay"]),
        (["monitor", "--json"], ["--json", "--once"]),
        (["monitor", "--once", "--replay", "no/such.log"], ["no/such.log"]),
        (["monitor", "--once", "--replay", "README.md"], ["README.md", "LCM log"]),
        (["monitor", "--once", "--replay", "tests"], ["tests"]),
        (["monitor", "--once", "--record", "README.md"], ["README.md", "new file"]),
        (["monitor", "--replay", "a.log", "--record", "b.log"], ["--replay", "--record"]),
        (["log", "info", "no/such.log"], ["no/such.log"]),
        (["log", "info", "README.md"], ["README.md", "LCM log"]),
        (["log", "export", "README.md", "--out", "out/x"], ["README.md", "LCM log"]),
        (["log", "export", "README.md"], ["--out"]),
        (["log", "exprot"], ["exprot"]),
    ],
)
def test_bad_usage_is_one_line_and_status_2(arguments, words):
    refused(forceaxis(*arguments), *words)


def test_every_verb_has_help_with_an_example():
    for verb in ("monitor", "log", "log info", "log export"):
        assert (
            f"forceaxis {verb}"
            in forceaxis(*verb.split(), "--help").stdout.partition("Example:")[2]
        )


# Logs.

COUNT = 61


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A log of a whole session of the stand-in: two axes, every seventh state missing."""
    url = free_url()
    path = tmp_path_factory.mktemp("log") / "session.log"
    source = Live(Watch(), url)
    source.record(path)
    with gateway(url, axes="1,2", rate=100, count=COUNT, drop=7, double=11, capture=150) as process:
        assert process.wait(10) == 0
    time.sleep(0.3)
    source.close()
    return path


def test_exported_values_are_those_that_were_sent(recorded, tmp_path):
    done = forceaxis("log", "export", recorded, "--out", tmp_path, "--json")
    assert done.returncode == 0 and done.stderr == "", done.stderr
    summary = json.loads(done.stdout)
    assert summary["undecodable"] == 0 and summary["not_exported"] == []
    sent = [k for k in range(COUNT) if k % 7 != 3]
    for axis in (1, 2):
        table = np.load(tmp_path / f"AXIS_{axis}_STATE.npz")
        states = [state_of(axis, k) for k in sent]
        assert table["seq"].tolist() == sent  # duplicates once, lost ones never
        for name in axis_state_t.__slots__:
            if name in ("utime", "wall_utime", "seq", "run_id") or "more" in name:
                continue
            if getattr(states[0], name) == NOT_AVAILABLE:
                assert np.isnan(table[name]).all()
                continue
            assert table[name].tolist() == [getattr(s, name) for s in states], name
        assert table["utime_us"].tolist() == [20_000 * k for k in sent]
        assert set(table["drive_state"]) == {"operation enabled"}
        assert table["force_gain_code_per_count"].tolist() == [axis] * len(sent)
        with (tmp_path / f"AXIS_{axis}_STATE.csv").open() as file:
            rows = list(csv.DictReader(file))
        assert [int(r["position_cnt"]) for r in rows] == [1000 * axis + k for k in sent]
        assert rows[0]["mode_text"] == "cyclic force"
    with (tmp_path / "AXIS_1_EVENT.csv").open() as file:
        events = list(csv.DictReader(file))
    assert [e["kind_text"] for e in events] == ["drive state", "mode", "capture"]
    assert events[1]["text"] == "mode cyclic force" and events[1]["command_id"] == ""
    capture = np.load(tmp_path / "AXIS_1_CAPTURE_1.npz")
    assert capture["tick"].tolist() == list(range(3000, 3150))
    assert capture["force_count"].tolist() == [sample(1, 0, i) / 256 for i in range(150)]
    assert capture["dac_code"].tolist() == [sample(1, 1, i) for i in range(150)]
    assert capture["time_s"].tolist() == [t / 1500 for t in range(3000, 3150)]
    plant = np.load(tmp_path / "SIM_TRUTH.npz")
    ticks = [30 * k + i for k in range(0, COUNT, 5) for i in range(30)]
    assert plant["tick"].tolist() == ticks
    assert plant["robot.position_m"].tolist() == [truth(t, 0) for t in ticks]
    with (tmp_path / "SIM_TRUTH.csv").open() as file:
        column = [float(r["sensor.force_N"]) for r in csv.DictReader(file)]
    assert column == [truth(t, 1) for t in ticks]


def test_export_of_one_kind_and_for_a_reader(recorded, tmp_path):
    done = forceaxis("log", "export", recorded, "--out", tmp_path, "--csv")
    assert done.returncode == 0
    assert "AXIS_1_STATE.csv" in done.stdout and "npz" not in done.stdout
    assert not list(tmp_path.glob("*.npz"))


def test_info_counts_messages_and_losses(recorded):
    done = forceaxis("log", "info", recorded, "--json")
    assert done.returncode == 0 and done.stderr == ""
    summary = json.loads(done.stdout)
    row = summary["channels"]["AXIS_1_STATE"]
    assert row["type"] == "axis_state_t" and row["runs"] == 1
    left_out = [k for k in range(COUNT) if k % 7 == 3]
    doubled = [k for k in range(COUNT) if k % 7 != 3 and k % 11 == 5]
    # The last state is sent, so all missing ones are before it.
    assert (COUNT - 1) % 7 != 3
    assert row["lost"] == len(left_out) and row["doubled"] == len(doubled)
    assert row["count"] == COUNT - len(left_out) + len(doubled)
    assert summary["messages"] == sum(r["count"] for r in summary["channels"].values())
    assert 0.4 < summary["span_s"] < 15  # 61 states at 100 a second
    text = forceaxis("log", "info", recorded).stdout
    assert "AXIS_2_STATE" in text and f"{summary['messages']} messages" in text


def test_a_log_that_is_cut_off_gives_what_is_whole(recorded, tmp_path):
    whole = list(logs.LogReader(recorded))
    data, path = recorded.read_bytes(), tmp_path / "cut.log"
    path.write_bytes(data[:-5])
    done = forceaxis("log", "info", path)
    assert done.returncode == 0
    assert done.stderr.count("\n") == 1
    assert "cut off" in done.stderr and f"{len(whole) - 1} messages saved" in done.stderr
    done = forceaxis("log", "export", path, "--out", tmp_path / "out", "--json")
    assert done.returncode == 0 and "cut off" in done.stderr
    # Everything before the cut is read, wherever it is.
    starts = [0]
    for entry in whole:
        starts.append(starts[-1] + logs.HEADER.size + len(entry.channel) + len(entry.data))
    for cut in range(starts[3] - 40, starts[3] + 40):
        path.write_bytes(data[:cut])
        reader = logs.LogReader(path)
        saved = list(reader)
        assert saved == whole[: sum(1 for s in starts[1:] if s <= cut)]
        assert (reader.damage is None) == (cut in starts)


def test_damage_inside_a_log_costs_only_what_it_hit(recorded, tmp_path):
    whole, path = list(logs.LogReader(recorded)), tmp_path / "damaged.log"
    good = recorded.read_bytes()
    start = sum(logs.HEADER.size + len(e.channel) + len(e.data) for e in whole[:10])
    cases = {
        "lengths that lie": (start + 24, struct.pack(">I", 5000)),
        "a length beyond the file": (start + 24, b"\x0f\xff\xff\xff"),
        "no mark": (start, b"\0\0\0\0"),
    }
    for what, (at, bytes_) in cases.items():
        path.write_bytes(good[:at] + bytes_ + good[at + len(bytes_) :])
        reader = logs.LogReader(path)
        assert list(reader) == whole[:10] + whole[11:], what
        assert "is damaged" in reader.damage and f"{len(whole) - 1} messages saved" in reader.damage
    # Bytes of another program's type on our channel are counted, not shown.
    entry = next(e for e in whole if e.channel == "AXIS_1_STATE")
    with path.open("wb") as file:
        name = b"AXIS_1_STATE"
        for data in (b"\x12" * 40, entry.data):
            header = logs.HEADER.pack(logs.SYNC, 0, 1, len(name), len(data))
            file.write(header + name + data)
    summary = log_tables.export(path, tmp_path / "out")
    assert summary["undecodable"] == 1
    assert [t["rows"] for t in summary["tables"]] == [1]


def block_of(kind):
    """Two samples of one signal."""
    block = blank(kind)
    block.run_id, block.seq, block.first_tick, block.decimation = 1, 0, 5, 3
    block.num_signals, block.signal, block.num_samples, block.value = 1, ["x"], 2, [[4], [5]]
    if kind is axis_capture_t:
        block.first_sample, block.total_samples, block.trigger_sample = 2, 8, 2
    else:
        block.unit = [""]
    return block


@pytest.mark.parametrize(
    ("kind", "damage", "ticks"),
    [
        (sim_truth_t, {"first_tick": 2**63 - 2}, [5, 8]),
        (sim_truth_t, {"first_tick": 2**63 - 1}, [5, 8]),
        (axis_capture_t, {"first_tick": 2**63 - 2}, range(-1, 21, 3)),
        (axis_capture_t, {"first_tick": -(2**63) + 1}, range(-1, 21, 3)),
        (axis_capture_t, {"decimation": 2**31 - 1, "first_tick": 2**63 - 2**32}, range(-1, 21, 3)),
    ],
)
def test_ticks_beyond_64_bits_cost_only_their_block(kind, damage, ticks, tmp_path):
    channel = "SIM_TRUTH" if kind is sim_truth_t else "AXIS_1_CAPTURE"
    path, damaged, good = tmp_path / "damaged.log", block_of(kind), block_of(kind)
    for name, value in damage.items():
        setattr(damaged, name, value)
    good.seq = 1
    with path.open("wb") as file:
        for message in (damaged, good):
            data = message.encode()
            header = logs.HEADER.pack(logs.SYNC, 0, 1, len(channel), len(data))
            file.write(header + channel.encode() + data)
    done = forceaxis("log", "export", path, "--out", tmp_path / "out")
    assert (done.returncode, done.stderr) == (0, "")
    assert "1 messages that are damaged" in done.stdout
    with np.load(next((tmp_path / "out").glob("*.npz"))) as table:
        assert table["tick"].tolist() == list(ticks)
        assert table["x"][np.isin(table["tick"], [5, 8])].tolist() == [4, 5]


@pytest.mark.parametrize("channel", ["../outside", "a/b", "\0"])
def test_a_channel_of_any_name_is_a_file_in_the_folder(channel, tmp_path):
    path, data = tmp_path / "odd.log", block_of(sim_truth_t).encode()
    header = logs.HEADER.pack(logs.SYNC, 0, 1, len(channel), len(data))
    path.write_bytes(header + channel.encode() + data)
    summary = log_tables.export(path, tmp_path / "out")
    assert {f.name for f in tmp_path.iterdir()} == {"odd.log", "out"}
    assert {f.name for f in (tmp_path / "out").iterdir()} == set(summary["tables"][0]["files"])


def test_a_foreign_log_has_channels_but_no_tables(tmp_path):
    path = tmp_path / "foreign.log"
    log = lcm.EventLog(str(path), "w")
    log.write_event(1_000_000, "EXAMPLE", b"something else")
    log.close()
    summary = json.loads(forceaxis("log", "info", path, "--json").stdout)
    assert summary["channels"]["EXAMPLE"]["type"] is None
    refused(forceaxis("log", "export", path, "--out", tmp_path / "o"), "foreign.log", "forceaxis")
    # Our types are known on any channel.
    log = lcm.EventLog(str(path), "w", overwrite=True)
    state = state_of(1, 5)
    state.run_id, state.seq = 1, 0
    log.write_event(1_000_000, "COPY_OF_STATE", state.encode())
    log.close()
    summary = json.loads(forceaxis("log", "info", path, "--json").stdout)
    assert summary["channels"]["COPY_OF_STATE"]["type"] == "axis_state_t"
    assert log_tables.export(path, tmp_path / "o")["tables"][0]["rows"] == 1


def test_lcm_logplayer_plays_a_recorded_log_and_the_monitor_replays_it(recorded, url):
    heard = []
    with Bus(url, lambda channel, data, _: heard.append((channel, data))):
        player = Path(sys.executable).parent / "lcm-logplayer"
        done = subprocess.run(
            [player, f"--lcm-url={url}", "--speed=4", str(recorded)],
            capture_output=True, text=True, check=False, timeout=20,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        whole = [(e.channel, e.data) for e in logs.LogReader(recorded)]
        assert until(lambda: len(heard) == len(whole))
    assert heard == whole

    watch = Watch()

    async def steps(app, pilot):
        await settle(pilot, lambda: len(app.query(AxisPanel)) == 2)
        await pilot.press("f")
        at = app.source.now_us()
        await pilot.pause(0.3)
        assert app.source.now_us() - at < 0.15 * 1e6  # a frozen replay waits
        await pilot.press("f")
        await settle(pilot, lambda: app.source.ended)
        await settle(pilot, lambda: "END" in head_text(app))
        assert "operation enabled" in panel_text(app, 1)
        last = state_of(1, COUNT - 1)
        assert f"{last.position_cnt:,}".replace(",", " ") + " cnt" in panel_text(app, 1)
        await pilot.press("r")
        assert app.source.writer is None

    begun = time.monotonic()
    run_monitor(Replay(watch, recorded, speed=2), watch, steps)
    assert time.monotonic() - begun < 10
    assert watch.axes[1].lost() == len([k for k in range(COUNT) if k % 7 == 3])


def test_a_replay_can_be_snapshot(recorded):
    done = forceaxis("monitor", "--replay", recorded, "--once", "--json")
    shown = json.loads(done.stdout)
    assert shown["axes"]["2"]["position_cnt"] == 2000 + COUNT - 1
    assert shown["axes"]["1"]["age_s"] < 1


# The client.


def test_commands_are_answered_though_datagrams_get_lost(url):
    with gateway(url, axes="1,2", rate=20), AxisClient(1, url, retry_s=0.1) as axis:
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


def test_a_client_captures_what_the_recorder_holds(url):
    with gateway(url, axes="1", rate=20), AxisClient(1, url, retry_s=0.1) as axis:
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


def test_a_capture_of_which_a_block_is_lost_says_so(url):
    """The block of samples 64 to 127 is lost: those samples are NaN, the others complete."""
    watch, gateway = Watch(), Gateway(url, [1])
    source = Live(watch, url)
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
    source = Live(watch, url)
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
        assert "its trigger has not fired" in str(error.value)
        assert "gateway" not in str(error.value)
        with pytest.raises(NoAnswer) as error:
            axis.wait_event(axis_event_t.EVENT_FAULT, timeout_s=0.3)
        assert "running?" not in str(error.value)


def test_the_example_ends_in_one_line(monkeypatch):
    def nobody(*_):
        raise NoAnswer("axis 1: expected a capture within 30 s, its trigger has not fired")

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
    assert "does not fit" in watch.events[-1][3]
    assert watch.axes[1].capture[1].total == 0
    # A block beyond the last sample: the capture has its size, and no sample of the block.
    block.seq, block.total_samples, block.first_sample = 1, 10, 10
    watch.take("AXIS_1_CAPTURE", block.encode(), 0)
    assert len(watch.events) == 2 and "does not fit" in watch.events[-1][3]
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
        json.dumps(watch.snapshot(i), allow_nan=False) if i % 100 == 0 else None
    assert watch.undecodable > 1000


def test_the_hash_that_is_compared_is_the_tables():
    assert f"{TABLE_HASH:08x}" == objects.OBJECTS_HASH[:8]
    state = decode("AXIS_1_STATE", state_of(1, 0).encode())
    assert state.objects_hash == TABLE_HASH
