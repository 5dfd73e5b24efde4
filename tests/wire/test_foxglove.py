"""`forceaxis monitor --foxglove`: what a scripted client of the protocol receives of an axis that
runs in real time, beside a log that lcm-logger makes of the same bus."""

import asyncio
import contextlib
import json
import os
import re
import signal
import struct
import subprocess
import sys
import time
from functools import partial

import aiohttp
import pytest
from forceaxis.bus import log as logs
from forceaxis.bus import recordings
from forceaxis.bus.foxglove_server import LAYOUT
from forceaxis.bus.lcm import Bus, decode
from forceaxis.bus.messages import sim_clock_t, sim_truth_t
from live_bus import (  # noqa: F401
    FORCEAXIS,
    ROOT,
    ended_by,
    forceaxis,
    gateway,
    namespace,
    refused,
    until,
    url_fixture,
)

EXPERIMENT = ROOT / "sim/experiments/contact.toml"
NODES = ROOT / "build/release/host"
SESSION_S = 3
MESSAGE_DATA = 0x01


@contextlib.contextmanager
def served(url, *words):
    """(process, address) of a server for Foxglove, ended by SIGTERM."""
    process = subprocess.Popen(
        [FORCEAXIS, "monitor", "--foxglove", "--port", "0", "--on", f"lcm@{url}", *words],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    with ended_by(process, signal.SIGTERM):
        line = process.stdout.readline()
        found = re.fullmatch(r"foxglove {5}(ws://127\.0\.0\.1:\d+)\n", line)
        assert found, line + process.stderr.read()
        assert process.stdout.readline().startswith("layout ")
        yield process, found[1]


@contextlib.contextmanager
def running_axis(url, run_id):
    """The processes of firmware and plant, which publish the plant's signals in real time."""
    words = [EXPERIMENT, "--pace", "real", "--run-id", str(run_id), "--start-timeout", "20"]
    words += ["--set", f"experiment.duration_s={SESSION_S}", "--lcm-url", url]
    environment = {**os.environ, "LCM_DEFAULT_URL": url}
    nodes = [
        subprocess.Popen([NODES / name, *words, *more], stdout=subprocess.PIPE, env=environment)
        for name, more in (("axis_node", []), ("plant_node", ["--live"]))
    ]
    try:
        yield nodes
    finally:
        for node in nodes:
            node.kill()
            node.communicate()


class Client:
    """Subscribes to every topic that a server advertises, and keeps all messages."""

    def __init__(self, address):
        self.address = address
        self.channels, self.messages, self.info = {}, {}, None

    async def receive(self, done, rest_s=0.0):
        """Receives until done(), and for `rest_s` more."""
        end, latest = None, time.monotonic() + 60
        protocols = ("foxglove.sdk.v1",)
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(self.address, protocols=protocols, max_msg_size=0) as socket,
        ):
            while end is None or time.monotonic() < end:
                assert time.monotonic() < latest, (sorted(self.messages), sorted(self.topics()))
                if end is None and done():
                    end = time.monotonic() + rest_s
                with contextlib.suppress(TimeoutError):
                    await self.take(socket, await socket.receive(timeout=0.2))
            return socket.protocol

    async def take(self, socket, message):
        if message.type is aiohttp.WSMsgType.BINARY:
            code, number, time_ns = struct.unpack_from("<BIQ", message.data)
            assert code == MESSAGE_DATA
            topic = self.channels[number]["topic"]
            self.messages.setdefault(topic, []).append((time_ns, message.data[13:]))
            return
        assert message.type is aiohttp.WSMsgType.TEXT, message
        table = json.loads(message.data)
        if table["op"] == "serverInfo":
            self.info = table
        if table["op"] == "advertise":
            self.channels |= {one["id"]: one for one in table["channels"]}
            await self.subscribe(socket, *(one["id"] for one in table["channels"]))
        # foxglove-sdk 0.30 may advertise a channel a moment before a client can subscribe to it.
        if table["op"] == "status":
            unknown = re.fullmatch(r"Unknown channel ID: (\d+)", table["message"])
            assert unknown, table
            await self.subscribe(socket, int(unknown[1]))

    async def subscribe(self, socket, *channels):
        new = [{"id": one, "channelId": one} for one in channels]
        await socket.send_json({"op": "subscribe", "subscriptions": new})

    def topics(self):
        return {one["topic"]: one for one in self.channels.values()}


def numbers(schema):
    """Yields (path, schema) of every number of a JSON schema."""
    for name, one in schema["properties"].items():
        if one["type"] == "object":
            yield from ((f"{name}.{path}", inner) for path, inner in numbers(one))
        elif one["type"] == "number":
            yield name, one


def number_of(message):
    """The tick of a message, or its sequence number, as its JSON has them."""
    names = ("first_tick", "tick", "seq")
    return next(getattr(message, name) for name in names if hasattr(message, name))


def leaves(row):
    for name, value in row.items():
        if isinstance(value, dict):
            yield from ((f"{name}.{path}", inner) for path, inner in leaves(value))
        else:
            yield name, value


def clock_ended(client):
    """Whether the simulator has published its end, after which it publishes nothing."""
    clocks = client.messages.get("/sim/clock", [])
    return any(json.loads(data)["clock_state"] == sim_clock_t.CLOCK_ENDED for _, data in clocks)


def live_session(url, folder):
    """Returns (client, own log, log of lcm-logger) of a session of an axis in real time."""
    log, record = folder / "bus.log", folder / "own.log"
    with subprocess.Popen(
        ["lcm-logger", "--quiet", f"--lcm-url={url}", log], stderr=subprocess.PIPE
    ) as logger:
        try:
            with served(url, "--record", record) as (process, address):
                assert until(log.exists)
                time.sleep(0.3)  # until the logger receives
                client = Client(address)
                with running_axis(url, os.getpid()) as nodes:
                    asyncio.run(client.receive(lambda: clock_ended(client), rest_s=0.5))
                    for node in nodes:
                        node.wait(10)
                    assert [node.returncode for node in nodes] == [0, 0]
            assert process.returncode == 128 + signal.SIGTERM
        finally:
            logger.send_signal(signal.SIGINT)
            logger.communicate(timeout=10)
    return client, record, log


def test_a_live_session_has_no_gap_and_the_bytes_of_the_log(url, tmp_path):
    # UDP itself loses datagrams when the computer is too busy; then the session is repeated.
    for name in "abcd":
        (tmp_path / name).mkdir()
        client, record, log = live_session(url, tmp_path / name)
        if all(one.lost == 0 for one in recordings.info(record).channels.values()):
            break
    else:
        raise AssertionError("UDP has lost datagrams in each of four sessions")
    topics = client.topics()
    channels = ["AXIS_1_LINK_INPUTS", "AXIS_1_LINK_OUTPUTS", "SIM_TRUTH", "SIM_CLOCK"]
    shown = ["/axis_1/link_inputs", "/axis_1/link_outputs", "/sim/truth", "/sim/clock"]
    assert set(topics) == {*(f"/lcm/{channel}" for channel in channels), *shown}
    assert set(client.messages) == set(topics)
    assert client.info["capabilities"] == []

    # Every message after the subscription to its topic, byte for byte as in the log of the command.
    # That of lcm-logger has nothing else, but perhaps another copy of a record that was repeated.
    for channel, topic in zip(channels, shown, strict=True):
        own, other = (
            [entry.data for entry in logs.LogReader(file) if entry.channel == channel]
            for file in (record, log)
        )
        received = [data for _, data in client.messages[f"/lcm/{channel}"]]
        assert 0.7 * len(own) < len(received) and received == own[-len(received) :]
        sent = {number_of(message): message for message in map(partial(decode, channel), own)}
        more = set(other) - set(own)
        assert len(more) <= 0.1 * len(own) < len(other)
        assert {number_of(decode(channel, data)) for data in more} <= set(sent)
        carried = topics[f"/lcm/{channel}"]
        assert carried["encoding"] == "lcm" and carried["schemaEncoding"] == "lcm"
        # The values are those of the messages, and every number has its unit in the schema.
        rows = [json.loads(data) for _, data in client.messages[topic]]
        units = {path: one["unit"] for path, one in numbers(json.loads(topics[topic]["schema"]))}
        for row in rows:
            message, found = sent[row.get("tick", row.get("seq"))], dict(leaves(row))
            assert {p for p, value in found.items() if not isinstance(value, str)} <= set(units)
            if isinstance(message, sim_truth_t):
                values = [v for p, v in found.items() if p not in ("tick", "time_s")]
                assert values == list(message.value[0])
            elif channel == channels[0]:
                assert (found["encoder"], found["adc0"]) == (message.encoder, message.adc0)
            elif channel == channels[1]:
                assert (found["dac"], found["fault"]) == (message.dac, message.fault)

    # 1500 Hz without a gap: each tick once, in order.
    for topic in shown[:2]:
        ticks = [json.loads(data)["seq"] for _, data in client.messages[topic]]
        assert ticks == list(range(ticks[0], 1500 * SESSION_S + 1)), topic
        times = [time_ns for time_ns, _ in client.messages[topic]]
        assert times == sorted(times)
    units = {p: o["unit"] for p, o in numbers(json.loads(topics["/sim/truth"]["schema"]))}
    assert units["sensor.force_N"] == "N" and units["robot.velocity_m_per_s"] == "m/s"
    units = {p: o["unit"] for p, o in numbers(json.loads(topics[shown[0]]["schema"]))}
    assert units["encoder"] == "count" and units["adc0"] == "ADC code"


def test_states_of_two_axes_are_in_newtons_and_nothing_is_written(url, tmp_path):
    commands, record = [], tmp_path / "session.mcap"
    with (
        Bus(url, lambda channel, *_: commands.append(channel), "AXIS_[0-9]+_COMMAND"),
        served(url, "--record", str(record)) as (process, address),
        gateway(url, axes="1,2", fault=2, capture=150),
    ):
        client = Client(address)
        asyncio.run(client.receive(lambda: len(client.messages.get("/axis_2/state", [])) > 30))
    assert commands == [] and process.returncode == 128 + signal.SIGTERM
    topics = client.topics()
    state = json.loads(client.messages["/axis_1/state"][-1][1])
    # The stand-in's sensor has 1.96 N in a count; its force is k/256 counts at tick 30 k.
    assert state["force_N"] == pytest.approx(state["tick"] / 30 / 256 * 1.96)
    assert state["target_force_N"] == pytest.approx(0.5 * 118)
    assert state["drive_state"] == "operation enabled"
    units = {p: o["unit"] for p, o in numbers(json.loads(topics["/axis_1/state"]["schema"]))}
    assert {p for p, v in state.items() if not isinstance(v, str)} <= set(units)
    expected = {"force_N": "N", "position_cnt": "count", "force_cnt_q8": "1/256 count",
                "age_us": "us", "force_scale_uN": "uN/count", "output_V": "V", "tick": "tick",
                "velocity_cnt_per_s": "count/s", "rated_force_mN": "mN", "seq": "1",
                "force_permille": "permille", "force_raw": "ADC code"}  # fmt: skip
    assert expected.items() <= units.items()
    # The same session is in the recording, which ends complete.
    done = forceaxis("recording", "info", record, "--json")
    assert done.returncode == 0 and done.stderr == "", done.stderr
    channels = json.loads(done.stdout)["channels"]
    assert channels["AXIS_1_STATE"]["lost"] == 0 and channels["AXIS_2_STATE"]["count"] > 30


def test_the_layout_shows_fields_that_exist(url):
    with served(url) as (_, address), gateway(url, axes="1", fault=1):
        client = Client(address)
        seen = lambda: {"/axis_1/state", "/sim/truth"} <= set(client.messages)  # noqa: E731
        asyncio.run(client.receive(lambda: seen() and "/axis_1/event" in client.topics()))
    text = LAYOUT.read_text()
    shown = re.findall(r'"(?:value|topicPath)": "(/[^"]*)"', text)
    assert len(shown) > 8
    fields = {
        f"{topic}.{path}"
        for topic, messages in client.messages.items()
        if not topic.startswith("/lcm/")
        for path, _ in leaves(json.loads(messages[-1][1]))
    }
    assert set(shown) <= fields | set(client.topics()) | {"/axis_1/state.target_position_cnt"}


def test_the_server_ends_with_an_open_client_and_the_status_of_the_signal(url):
    async def visit(process, address):
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(address, protocols=("foxglove.sdk.v1",)) as socket,
        ):
            await socket.receive(timeout=10)
            process.send_signal(signal.SIGINT)
            while not socket.closed:
                await socket.receive(timeout=10)

    with served(url) as (process, address):
        asyncio.run(visit(process, address))
        assert process.wait(10) == 130
        assert process.stderr.read() == ""


def test_a_recording_is_served_too(url, tmp_path):
    record = tmp_path / "run.mcap"
    done = forceaxis("run", EXPERIMENT, "--set", "experiment.duration_s=2", "--record", record)
    assert done.returncode == 0, done.stderr
    process = subprocess.Popen(
        [FORCEAXIS, "monitor", "--foxglove", "--port", "0", "--replay", record, "--speed", "10"],
        stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        address = process.stdout.readline().split()[1]
        client = Client(address)
        asyncio.run(client.receive(lambda: _last_tick(client) == 3000))
    finally:
        process.terminate()
        assert process.wait(10) == 143
        process.stdout.close()


def _last_tick(client):
    messages = client.messages.get("/sim/truth")
    return json.loads(messages[-1][1])["tick"] if messages else None


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--foxglove", "--web"], ["--foxglove", "--web"]),
        (["--foxglove", "--once"], ["--foxglove", "--once"]),
        (["--foxglove", "--host", "no.such.host.invalid"], ["--host", "no.such.host.invalid"]),
        (["--foxglove", "--replay", "no/such.mcap"], ["no/such.mcap"]),
    ],
)
def test_bad_usage_is_one_line_and_status_2(arguments, words):
    refused(forceaxis("monitor", *arguments), *words)


def test_without_the_package_one_line_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "foxglove", None)
    refused(forceaxis("monitor", "--foxglove"), "pip install 'forceaxis[foxglove]'")


def test_a_port_in_use_is_refused(url):
    with served(url) as (_, address):
        port = address.rpartition(":")[2]
        refused(
            forceaxis("monitor", "--foxglove", "--port", port, "--on", f"lcm@{url}"),
            "--port",
            "free",
        )
