"""What carries an axis, on stand-ins of a CAN bus and of a Modbus client.
tests/wire/test_axis_ways.py has both on real buses."""

import contextlib
import math
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import can
import canopen
import numpy as np
import pytest
from forceaxis.axis import gateway, modbus, scan
from forceaxis.axis.axis import Axis
from forceaxis.axis.can import OWN_NODE, CanLink
from forceaxis.axis.gateway import GatewayLink
from forceaxis.axis.link import NoAnswer, RecorderLink, Refused
from forceaxis.axis.modbus import ModbusLink
from forceaxis.cycles import live
from forceaxis.objects import BY_NAME
from pymodbus.pdu.mei_message import ReadDeviceInformationResponse

EDS = Path(__file__).resolve().parents[3] / "firmware/objects/generated/forceaxis.eds"


class Recorded(RecorderLink):
    """A connection to an axis with a finished recording, which another source owns by now."""

    where, source = "an axis", 0

    def __init__(self):
        self.values = {"recorder_state": 3, "recorder_trigger_index": 1}
        self._armed = ("force",), 1
        assert BY_NAME["recorder_state"].enum[3] == "done"

    def read(self, names):
        return {name: self.values[name] for name in names}

    def write(self, values):
        raise Refused("recorder_arm: another source owns the axis", 0x08000021)

    def _samples(self, signals):
        return np.arange(4).reshape(4, 1)

    def acquire(self):
        pass

    release = close = acquire


def test_a_finished_recording_is_handed_out_whoever_owns_the_axis():
    held = Recorded().recording(0.1)
    assert held.raw[:, 0].tolist() == [0, 1, 2, 3] and held.trigger_sample == 1


# CAN: a node of python-canopen stands in for the axis.


@pytest.fixture
def node(request):
    """(the stand-in's values by name, a bus at which it is)."""
    channel = request.node.name
    network = canopen.Network()
    network.NOTIFIER_CYCLE = 0.05
    network.connect(interface="virtual", channel=channel)
    local = network.create_node(1, str(EDS))
    heard = []
    network.subscribe(0x700 + OWN_NODE, lambda *message: heard.append(message))
    local.heard = heard

    def value(name):
        known = BY_NAME[name]
        record = local.sdo[known.index]
        return record[known.sub] if known.sub else record

    local.value = value
    for i in range(1, 5):
        value(f"consumer_heartbeat_{i}").raw = 0
    value("command_source").raw = 0
    yield local, can.Bus(interface="virtual", channel=channel)
    network.disconnect()


def consumers(local):
    return [local.value(f"consumer_heartbeat_{i}").raw for i in range(1, 5)]


@contextlib.contextmanager
def acquired(bus):
    """A link that owns the stand-in, closed at the end."""
    link = CanLink("virtual", 1, bus=bus)
    try:
        link.acquire()
        yield link
    finally:
        link.close()


def test_can_a_name_without_end_is_no_answer(node):
    local, bus = node
    local.sdo[0x1008].raw = "n" * 5000  # as good as without end: 700 segments
    link = CanLink("virtual", 1, bus=bus)
    try:
        with pytest.raises(NoAnswer, match="1008h of at most 256 bytes"):
            link.text(0x1008)
        assert link.read(["command_source"]) == {"command_source": 0}  # and the link goes on
    finally:
        link.close()


OURS = OWN_NODE << 16 | 1000


@pytest.mark.parametrize(
    ("before", "meanwhile", "after"),
    [
        ([0, 0, 0, 0], [OURS, 0, 0, 0], [0, 0, 0, 0]),
        # Another master is watched, and stays so.
        ([5 << 16 | 300, 0, 0, 0], [5 << 16 | 300, OURS, 0, 0], [5 << 16 | 300, 0, 0, 0]),
        # What a killed program of this kind has left is its own entry.
        ([0, OURS, 0, 0], [OURS, 0, 0, 0], [0, 0, 0, 0]),
        # A time that somebody has set for this id is put back.
        ([0, OWN_NODE << 16 | 400, 0, 0], [0, OURS, 0, 0], [0, OWN_NODE << 16 | 400, 0, 0]),
    ],
)
def test_can_the_axis_watches_the_owner_while_it_may_be_enabled(node, before, meanwhile, after):
    local, bus = node
    for i, raw in enumerate(before, 1):
        local.value(f"consumer_heartbeat_{i}").raw = raw
    with acquired(bus) as link:
        link.write({"force_gain": 1792})
        link.write({"controlword": 7})
        # What enables nothing needs no supervision, and makes none.
        assert consumers(local) == [raw if raw != OURS else 0 for raw in before]
        assert not local.heard
        link.write({"controlword": 15})
        assert consumers(local) == meanwhile
        assert local.heard
        link.write({"store_all": 0x65766173})
        assert consumers(local) == after  # the stored set has no entry of this program
        link.write({"controlword": 15})
        assert OURS in consumers(local)
        link.release()
        assert consumers(local) == after


def test_can_no_free_place_refuses_before_the_controlword(node):
    local, bus = node
    for i in range(1, 5):
        local.value(f"consumer_heartbeat_{i}").raw = i << 16 | 500
    local.value("controlword").raw = 0
    with acquired(bus) as link:
        with pytest.raises(Refused, match="free heartbeat consumer"):
            link.write({"controlword": 15})
        assert local.value("controlword").raw == 0


def test_can_another_node_of_the_own_id_is_refused(node):
    local, bus = node
    with acquired(bus) as link:
        local.network.send_message(0x700 + OWN_NODE, [5])
        link.read(["fault"])
        with pytest.raises(Refused, match="expected no other node with the node id 126"):
            link.write({"controlword": 15})
        assert OURS not in consumers(local)


def test_can_the_heartbeat_goes_on_during_a_long_transfer(node):
    local, bus = node
    with acquired(bus) as link:
        link.write({"controlword": 15})
        with link._asking("a transfer"):
            before = len(local.heard)
            time.sleep(0.5)
            assert len(local.heard) >= before + 2  # one in 100 ms
        link.release()
        time.sleep(0.05)
        before = len(local.heard)
        time.sleep(0.2)
        assert len(local.heard) == before  # nobody waits for it any more


def test_can_refusals_and_silence_are_named(node):
    local, bus = node
    del local.object_dictionary[BY_NAME["force_gain"].index]
    link = CanLink("virtual", 1, bus=bus, timeout_s=0.3)
    try:
        with pytest.raises(Refused, match="force_gain: there is no such object") as caught:
            link.read(["force_gain"])
        assert caught.value.code == 0x06020000
        local.network.unsubscribe(0x601)
        with pytest.raises(NoAnswer, match="node 1 on virtual: expected an answer about force"):
            link.read(["force"])
    finally:
        link.close()


class StoppedNode(threading.Thread):
    """Makes the stand-in a node that NMT has stopped: it sends heartbeats and answers nothing until
    the NMT command start."""

    def __init__(self, local):
        super().__init__(daemon=True)
        self.local, self.commands, self.end = local, [], threading.Event()
        local.network.unsubscribe(0x601)
        local.network.subscribe(0x000, self.command)
        local.value("nmt_state").raw = 4

    def command(self, _can_id, data, _timestamp):
        self.commands.append(bytes(data))
        if data == b"\x01\x01":
            self.local.value("nmt_state").raw = 5
            self.local.network.subscribe(0x601, self.local.sdo.on_request)

    def run(self):
        while not self.end.wait(0.05):
            self.local.network.send_message(0x701, [self.local.value("nmt_state").raw])


@pytest.fixture
def stopped(node):
    local, bus = node
    made = StoppedNode(local)
    made.start()
    yield made, local, bus
    made.end.set()
    made.join()


def test_can_a_node_that_nmt_has_stopped_is_named_and_started(stopped):
    made, local, bus = stopped
    local.value("controlword").raw = 0
    link = CanLink("virtual", 1, bus=bus, timeout_s=0.3)
    try:
        with pytest.raises(NoAnswer, match=r"stopped by NMT .*`axis.start\(\)`"):
            link.read(["force"])
        with pytest.raises(NoAnswer, match="stopped by NMT"):
            link.acquire()  # starts nobody whom somebody else has stopped
        assert made.commands == []
        link.start()
        assert made.commands[0] == b"\x01\x01"
        assert link.read(["command_source"]) == {"command_source": 0}
        assert local.value("controlword").raw == 0  # nothing is enabled
    finally:
        link.close()


def test_can_a_scan_names_a_stopped_node_and_the_command_that_starts_it(stopped):
    _, _, bus = stopped
    (found,) = scan.on_can("can7", bus, 0.3)
    assert (found.id, found.state) == (1, "stopped by NMT")
    assert "start the node can7:1 with `axis.start()`" in found.note


def test_can_another_client_of_the_same_channel_is_named_before_a_cycle(node):
    local, bus = node
    link = CanLink("virtual", 1, bus=bus)
    try:
        link.read(["command_source"])
        assert link.disturbance() is None  # own requests are none
        local.network.send_message(0x601, [0x40, 0x01, 0x10, 0, 0, 0, 0, 0])
        assert "use lcm:1 behind that gateway" in link.disturbance()
        with pytest.raises(Refused, match="would interrupt the reading of a recording or a curve"):
            live.expect_readable(Axis(link))
    finally:
        link.close()


def test_nmt_is_refused_where_it_does_not_exist(registers):
    with pytest.raises(
        Refused, match="expected a connection over CAN or to a gateway, because NMT"
    ):
        ModbusLink("tcp://somewhere").start()


# Modbus: a client that has registers of its own.


class Registers:
    """What pymodbus' client does, on a dictionary of registers."""

    class Answer:
        def __init__(self, registers=(), exception_code=0):
            self.registers, self.exception_code = list(registers), exception_code

        def isError(self):
            return self.exception_code != 0

    def __init__(self):
        self.holding, self.input, self.asked = {}, {}, 0
        self.information = {2: b"0.1.0 904ee356", 4: b"forceaxis"}

    def _read(self, table, address, count):
        self.asked += 1
        return self.Answer(table.get(address + i, 0) for i in range(count))

    def read_holding_registers(self, address, *, count, device_id):
        return self._read(self.holding, address, count)

    def read_input_registers(self, address, *, count, device_id):
        return self._read(self.input, address, count)

    def read_device_information(self, *, read_code, object_id, device_id):
        if object_id not in self.information:
            return self.Answer(exception_code=1)
        return ReadDeviceInformationResponse(read_code, self.information)

    def write_registers(self, address, words, *, device_id):
        self.asked += 1
        if device_id != 1:
            return self.Answer(exception_code=10)
        self.holding |= {address + i: word for i, word in enumerate(words)}
        return self.Answer()

    def write_register(self, address, word, *, device_id):
        return self.write_registers(address, [word], device_id=device_id)

    def close(self):
        pass


@pytest.fixture
def registers(monkeypatch):
    made = Registers()
    monkeypatch.setattr(modbus, "client", lambda *_: made)
    return made


@pytest.mark.parametrize("low_first", [0, 1])
def test_modbus_words_signs_and_widths(registers, low_first):
    registers.holding[BY_NAME["modbus_word_order"].modbus] = low_first
    link = ModbusLink("tcp://somewhere")
    values = {
        "target_position": -70_000, "target_force": -750, "modes_of_operation": -1,
        "force_scale": 3_000_000_000 // 2, "recorder_length": 65535,
    }  # fmt: skip
    link.write(values)
    assert link.read(values) == values
    at = BY_NAME["target_position"].modbus
    words = [registers.holding[at], registers.holding[at + 1]]
    # -70000 = FFFE EE90h
    assert words == ([0xEE90, 0xFFFE] if low_first else [0xFFFE, 0xEE90])
    registers.input[BY_NAME["position_actual"].modbus] = 0xFFFF
    registers.input[BY_NAME["position_actual"].modbus + 1] = 0xFFFF
    assert link.read(["position_actual"]) == {"position_actual": -1}


@pytest.mark.parametrize("low_first", [0, 1])
def test_modbus_reads_neighbours_by_one_request(registers, low_first):
    registers.holding[BY_NAME["modbus_word_order"].modbus] = low_first
    link = ModbusLink("tcp://somewhere")
    words = {f"cycle_data_{i}": 0x8001_0000 + i for i in range(1, 17)}
    others = {"recorder_length": 65535, "cycle_curve_step_force": 3, "cycle_curve_step_time": 7}
    link.write({**words, **others})
    link.read(["watchdog"])  # the order of the words is known from here on
    before = registers.asked
    assert link.read([*words, *others]) == {**words, **others}
    assert registers.asked == before + 3  # the steps of force and time are neighbours too
    before = registers.asked
    assert list(link.read(["cycle_data_2", "cycle_data_1"])) == ["cycle_data_2", "cycle_data_1"]
    assert registers.asked == before + 2  # not in this order
    many = [o.name for o in BY_NAME.values() if o.modbus >= 0]
    assert set(link.read(many)) == set(many)


@pytest.mark.parametrize("kept", [0, 1])
def test_modbus_answers_with_fewer_or_more_registers_are_no_values(registers, kept, monkeypatch):
    link = ModbusLink("tcp://somewhere")
    link.read(["watchdog"])
    registers.input[BY_NAME["force"].modbus] = 0x1234
    for way in ("read_input_registers", "read_holding_registers"):
        ask = getattr(registers, way)

        def other(address, *, count, device_id, ask=ask):
            answer = ask(address, count=count, device_id=device_id)
            answer.registers = [*answer.registers, 7][: kept * (count + 1)]
            return answer

        monkeypatch.setattr(registers, way, other)
    for name in ("force", "position_actual", "target_position", "force_gain"):
        with pytest.raises(NoAnswer, match=f"expected . registers about {name}, got .; another"):
            link.read([name])


def test_modbus_refuses_what_has_no_register_before_it_sends(registers):
    link = ModbusLink("tcp://somewhere")
    with pytest.raises(Refused, match="bank_gain_1: this object has no Modbus register; connect"):
        link.write({"force_gain": 1, "bank_gain_1": 1})
    with pytest.raises(Refused, match="bank_gain_1"):
        link.read(["force_gain", "bank_gain_1"])
    with pytest.raises(Refused, match="a recording cannot be read over Modbus"):
        link.arm(["force"], {})
    assert registers.asked == 0
    with pytest.raises(Refused, match="force_gain: the gateway has no axis of this unit"):
        ModbusLink("tcp://somewhere", 2).write({"force_gain": 1})


def test_modbus_texts_are_those_of_the_identification(registers):
    link = ModbusLink("tcp://somewhere")
    assert [link.text(index) for index in (0x1008, 0x100A)] == ["forceaxis", "0.1.0 904ee356"]
    registers.information = {}  # a device without function 43
    assert [link.text(index) for index in (0x1008, 0x1009, 0x100A)] == [None, None, None]


# Gateway: a client that refuses commands stands in for a gateway that sets up the axis.


class SettingUp:
    """Refuses `times` commands with a text, and then answers 0 for each object."""

    def __init__(self, text, times):
        self.text, self.left = text, times

    def read_raw(self, names):
        if self.left:
            self.left -= 1
            raise Refused(self.text)
        return dict.fromkeys(names, 0)

    def write_raw(self, values):
        self.read_raw(values)
        self.written = values


@pytest.mark.parametrize(("ready_s", "answers"), [(60.0, True), (0.0, False)])
def test_gateway_read_waits_until_the_axis_is_set_up(monkeypatch, ready_s, answers):
    monkeypatch.setattr(gateway, "RETRY_PERIOD_S", 0.001)
    link = GatewayLink(1, client=SettingUp("the axis is not set up yet", 3), ready_s=ready_s)
    if answers:
        assert link.read(["command_source"]) == {"command_source": 0}
    else:
        with pytest.raises(NoAnswer, match="not set up yet"):
            link.read(["command_source"])


def test_gateway_write_without_the_axis_waits_until_the_axis_is_set_up(monkeypatch):
    monkeypatch.setattr(gateway, "RETRY_PERIOD_S", 0.001)
    client = SettingUp("the axis is not set up yet", 3)
    GatewayLink(1, client=client).write({"cycle_acknowledge": 7})
    assert (client.left, client.written) == (0, {"cycle_acknowledge": 7})


@pytest.mark.parametrize("controlword", [0, 2, 6, 7])
def test_a_stop_over_a_gateway_is_sent_once_and_its_refusal_is_told_at_once(controlword):
    """A stop never waits until the axis is set up."""
    client = SettingUp("the axis is not set up yet", math.inf)
    link = GatewayLink(1, client=client, ready_s=1.0)
    sent = []
    client.write_raw = lambda values: sent.append(values) or client.read_raw(values)
    with pytest.raises(Refused, match="not set up yet"):
        link.write({"controlword": controlword})
    with pytest.raises(Refused, match="not set up yet"):
        Axis(link).stop()
    assert sent == [{"controlword": controlword}, {"controlword": 2}]


@pytest.mark.parametrize("values", [{"controlword": 15}, {"controlword": 128}, {"force_gain": 1}])
def test_any_other_write_over_a_gateway_waits_until_the_axis_is_set_up(monkeypatch, values):
    monkeypatch.setattr(gateway, "RETRY_PERIOD_S", 0.001)
    client = SettingUp("the axis is not set up yet", 3)
    GatewayLink(1, client=client).write(values)
    assert (client.left, client.written) == (0, values)


def test_gateway_write_of_the_owner_is_not_repeated_after_a_restart_of_the_axis():
    client = SettingUp("the node is stopped by NMT and not set up yet", 1)
    link = GatewayLink(1, client=client)
    link._keeper = SimpleNamespace(close=lambda: None)
    with pytest.raises(Refused, match="not set up yet"):
        link.write({"controlword": 15})
    assert not hasattr(client, "written")


def test_gateway_read_repeats_no_other_refusal():
    client = SettingUp("the axis is silent", 1)
    with pytest.raises(Refused, match="silent"):
        GatewayLink(1, client=client).read(["command_source"])
    assert client.left == 0
