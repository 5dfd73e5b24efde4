"""The monitor against a stand-in gateway: headless, in terminals of many sizes, as a snapshot."""

import fcntl
import json
import os
import pty
import select
import struct
import subprocess
import termios
import time

import lcm
import pytest
from forceaxis.bus import log as logs
from forceaxis.bus.lcm import (
    TABLE_HASH,
    Bus,
    blank,
)
from forceaxis.bus.messages import (
    axis_state_t,
)
from forceaxis.bus.monitor import AxisPanel
from forceaxis.bus.monitor_state import Watch
from forceaxis.bus.sources import LiveSource
from gateway_stand_in import OPERATION_ENABLED, SCALE_UN, state_of
from live_bus import (  # noqa: F401
    FORCEAXIS,
    forceaxis,
    gateway,
    namespace,
    refused,
    until,
    url_fixture,
)
from monitor_pilot import chart_text, head_text, panel_text, run_monitor, settle
from own_network import OWN_NETWORK


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
        assert f"{1000 + k:,}".replace(",", " ") + " count" in shown
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
        run_monitor(LiveSource(watch, url), watch, steps, folder=tmp_path)
    (path,) = tmp_path.glob("*.log")
    # liblcm's own reader opens it and reads the same messages.
    theirs = [(e.timestamp, e.channel, e.data) for e in lcm.EventLog(str(path), "r")]
    assert theirs == [tuple(e) for e in logs.LogReader(path)]
    assert len(theirs) > 100
    assert not [c for _, c, _ in theirs if c.endswith("_COMMAND")]  # the monitor never writes
    assert watch.axes[1].gaps["STATE"].doubled > 0


def test_losses_shown_are_those_that_were_injected(url):
    watch = Watch()
    source = LiveSource(watch, url, axis=2)
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
        run_monitor(LiveSource(watch, url), watch, steps)


@pytest.mark.parametrize("size", [(80, 24), (60, 16), (200, 60), (40, 10)])
def test_the_monitor_fits_the_terminal_or_says_what_it_needs(url, size):
    watch = Watch()

    async def steps(app, pilot):
        await settle(pilot, lambda: len(watch.axes) == 6)
        await settle(pilot, lambda: len(app.query(AxisPanel)) == 6 or size == (40, 10))
        await pilot.pause(0.1)
        small = str(app.query_one("#small").render())
        if size != (40, 10):
            keys = app.query_one("Footer").children
            assert max(key.region.right for key in keys) <= size[0], "a key is cut off"
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
        run_monitor(LiveSource(watch, url), watch, steps, size=size)


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
            s.nmt_state = s.NMT_STOPPED
            one.publish("AXIS_1_STATE", s)
            await settle(pilot, lambda: "NODE STOPPED, was operation" in panel_text(app, 1))
            s.nmt_state = s.NMT_OPERATIONAL
            one.publish("AXIS_1_STATE", s)
            await settle(pilot, lambda: "SILENT, was operation enabled" in panel_text(app, 1))
            # The gateway goes on with values of a node that no longer sends them.
            for _ in range(2):
                s.age_us = 8_100_000
                one.publish("AXIS_1_STATE", s)
                await pilot.pause(0.3)
                assert "SILENT, was operation enabled" in panel_text(app, 1)
            assert "got another type" in str(app.query_one("#events").render())
            everything = blank(axis_state_t)  # a gateway without data yet
            one.publish("AXIS_1_STATE", everything)
            await settle(pilot, lambda: "no state yet" in panel_text(app, 1))

    run_monitor(LiveSource(watch, url), watch, steps)


def test_the_command_runs_in_a_terminal_records_and_leaves_it_whole(url, tmp_path):
    path, (ours, theirs) = tmp_path / "new" / "session.log", pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 30, 100, 0, 0))
    settings, shown = termios.tcgetattr(theirs), b""
    with gateway(url, axes="1,2"):
        process = subprocess.Popen(
            [FORCEAXIS, "monitor", "--on", f"lcm@{url}", "--record", path],
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
        done = forceaxis("monitor", "--on", f"lcm@{url}", "--once", "--json", "--seconds", 1.5)
        one = forceaxis("monitor", "--on", f"lcm:3@{url}", "--once", "--seconds", 0.5)
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


def test_once_says_which_axis_is_silent_since_when_and_is_status_1(url):
    # A node that was killed, one that NMT stopped, one whose PDOs no longer come; one that lives.
    with gateway(url, axes="1,2,4,5", dead="2:-1,4:4,5:5"):
        done = forceaxis("monitor", "--on", f"lcm@{url}", "--once", "--seconds", 0.5)
        data = forceaxis("monitor", "--on", f"lcm@{url}", "--once", "--json", "--seconds", 0.5)
        live = forceaxis("monitor", "--on", f"lcm:1@{url}", "--once", "--seconds", 0.5)
    first, second, fourth, fifth = done.stdout.splitlines()
    assert first.startswith("axis 1: operation enabled") and "/s" in first
    for line, head in (
        (second, "axis 2: SILENT for 8.1 s, was operation enabled"),
        (fourth, "axis 4: SILENT for 8.1 s, stopped by NMT, was operation enabled"),
        (fifth, "axis 5: SILENT for 8.1 s, was operation enabled"),
    ):
        assert line.startswith(head) and "/s" not in line
    assert "axis 2, 4, 5 is silent" in done.stderr and done.stderr.count("\n") == 1
    axes = json.loads(data.stdout)["axes"]
    assert {number: axis["silent"] for number, axis in axes.items()} == {
        "1": False, "2": True, "4": True, "5": True
    }  # fmt: skip
    assert [done.returncode, data.returncode, live.returncode] == [1, 1, 0]


def test_the_list_of_axes_names_silent_and_stopped_nodes(url):
    with gateway(url, axes="2,4", dead="2:-1,4:4"):
        done = forceaxis("axis", "list", "--on", f"lcm@{url}", "--json")
    rows = [(row["id"], row["state"], row["note"]) for row in json.loads(done.stdout)]
    assert [row[:2] for row in rows] == [(2, "silent"), (4, "stopped by NMT")]
    assert "check power and bus" in rows[0][2] and "enables no drive" in rows[1][2]


def test_once_with_nothing_to_hear_is_status_1(url):
    done = forceaxis("monitor", "--on", f"lcm:5@{url}", "--once", "--json", "--seconds", 0.2)
    assert done.returncode == 1
    assert json.loads(done.stdout)["axes"] == {}
    assert "expected a state of axis 5 within 0.2 s" in done.stderr and done.stderr.count("\n") == 1


def test_no_multicast_route_is_one_line_that_says_how():
    for verb in ("monitor --once", "monitor --once --on lcm@udpm://239.255.76.67:7667?ttl=0"):
        done = subprocess.run(
            [*OWN_NETWORK, FORCEAXIS, *verb.split()],
            capture_output=True, text=True, check=False, timeout=30,
        )  # fmt: skip
        refused(done, "multicast route", "ip route add 224.0.0.0/4 dev lo")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["monitor"], ["terminal", "--once"]),
        (["monitor", "--once", "--on", "lcm:0"], ["--on"]),
        (["monitor", "--once", "--on", "lcm:128"], ["--on"]),
        (["monitor", "--once", "--on", "lcm@foo://x"], ["foo://x", "udpm://"]),
        (["monitor", "--once", "--on", "lcm@udpm://nowhere:1"], ["nowhere", "udpm://"]),
        (["monitor", "--once", "--on", "lcm@udpm://239.255.76.67:99999"], ["99999", "udpm://"]),
        (["monitor", "--once", "--speed", 2], ["--speed", "--replay"]),
        (["monitor", "--json"], ["--json", "--once"]),
        (["monitor", "--once", "--replay", "no/such.log"], ["no/such.log"]),
        (["monitor", "--once", "--replay", "README.md"], ["README.md", "LCM log"]),
        (["monitor", "--once", "--replay", "tests"], ["tests"]),
        (["monitor", "--once", "--record", "README.md"], ["README.md", "new file"]),
        (["monitor", "--replay", "a.log", "--record", "b.log"], ["--replay", "--record"]),
        (["recording", "info", "no/such.log"], ["no/such.log"]),
        (["recording", "info", "README.md"], ["README.md", "rows of numbers"]),
        (["recording", "export", "README.md", "--out", "out/x"], ["README.md", "LCM log"]),
        (["recording", "export", "README.md"], ["--out"]),
        (["log", "exprot"], ["exprot"]),
    ],
)
def test_bad_usage_is_one_line_and_status_2(arguments, words):
    refused(forceaxis(*arguments), *words)


def test_every_verb_has_help_with_an_example():
    for verb in ("monitor", "recording", "recording info", "recording export"):
        assert (
            f"forceaxis {verb}"
            in forceaxis(*verb.split(), "--help").stdout.partition("Example:")[2]
        )
