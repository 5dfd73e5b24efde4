"""The gateway scenarios of test_gateway.py, in one guest: run under tools/vcan, prints JSON.

Each scenario is a function; what it raises is its result, so that one failure hides no other.
"""

import json
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import traceback
from pathlib import Path

from forceaxis import objects
from forceaxis.bus import gateway as sessions
from forceaxis.bus.client import AxisClient, NoAnswer, Refused
from forceaxis.bus.lcm import TABLE_HASH, Bus, decode, now_us
from forceaxis.bus.messages import axis_command_t, axis_event_t, axis_state_t
from forceaxis.bus.state_names import BY_NAME
from forceaxis.experiments import link
from forceaxis.thesis import session as thesis_session
from pymodbus.client import ModbusTcpClient

PORT = 1502
CAN_FRAME = "=IB3x8s"


class Can:
    """A raw socket on vcan0."""

    def __init__(self):
        self.socket = socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self.socket.bind(("vcan0",))

    def send(self, identifier, data):
        self.socket.send(struct.pack(CAN_FRAME, identifier, len(data), data.ljust(8, b"\0")))

    def receive(self, timeout_s):
        """(id, data) or None."""
        self.socket.settimeout(max(timeout_s, 1e-3))
        try:
            identifier, length, data = struct.unpack(CAN_FRAME, self.socket.recv(16))
        except TimeoutError:
            return None
        return identifier, data[:length]

    def frames(self, seconds):
        """[(time, id, data)] of a while."""
        received, end = [], time.monotonic() + seconds
        while (remaining := end - time.monotonic()) > 0:
            frame = self.receive(remaining)
            if frame:
                received.append((time.monotonic(), *frame))
        return received

    def write(self, node, index, sub, value, size):
        """An expedited download on the default channel, as CANopen's own master would."""
        command = 0x23 | (4 - size) << 2
        data = struct.pack("<BHBI", command, index, sub, value)
        self.send(0x600 + node, data)
        end = time.monotonic() + 1
        while time.monotonic() < end:
            frame = self.receive(0.2)
            # The gateway polls on the same channel, but only uploads.
            answered = frame and frame[0] == 0x580 + node and frame[1][0] in (0x60, 0x80)
            if answered and frame[1][1:4] == data[1:4]:
                return frame[1][0]
        return None

    def read(self, node, index, sub):
        """An expedited upload on the default channel: the number, unsigned."""
        request = struct.pack("<BHBI", 0x40, index, sub, 0)
        self.send(0x600 + node, request)
        end = time.monotonic() + 1
        while time.monotonic() < end:
            frame = self.receive(0.2)
            # Responses to the gateway's polls have another object.
            if frame and frame[0] == 0x580 + node and frame[1][1:4] == request[1:4]:
                assert frame[1][0] & 0xE3 == 0x43, frame[1].hex()
                return int.from_bytes(frame[1][4 : 8 - (frame[1][0] >> 2 & 3)], "little")
        return None


class Tcp:
    """Modbus TCP by hand."""

    def __init__(self):
        self.socket = socket.create_connection(("127.0.0.1", PORT), timeout=3)
        self.transaction = 0

    def frame(self, unit, pdu):
        self.transaction += 1
        return struct.pack(">HHHB", self.transaction, 0, len(pdu) + 1, unit) + pdu

    def ask(self, unit, pdu):
        self.socket.sendall(self.frame(unit, pdu))
        return self.answer()

    def answer(self, timeout_s=3.0):
        """PDU of the response to the latest request; None: no response, b"": closed."""
        self.socket.settimeout(timeout_s)
        try:
            header = self.exactly(7)
        except TimeoutError:
            return None
        if header is None:
            return b""
        transaction, protocol, length, _unit = struct.unpack(">HHHB", header)
        assert protocol == 0 and transaction <= self.transaction
        return self.exactly(length - 1)

    def exactly(self, count):
        got = b""
        while len(got) < count:
            piece = self.socket.recv(count - len(got))
            if not piece:
                return None
            got += piece
        return got


def registers(client, start, count, kind="holding", unit=1):
    read = client.read_holding_registers if kind == "holding" else client.read_input_registers
    answer = read(start, count=count, device_id=unit)
    return answer.exception_code if answer.isError() else answer.registers


# A busy machine stalls a guest for some tenths of a second: no heartbeat is lost then.
HEARTBEAT_MS = 300


def gateway(*args, ready=True, port=PORT, heartbeat_ms=HEARTBEAT_MS):
    errors = tempfile.TemporaryFile("w+")  # noqa: SIM115 - it lives as long as the program
    words = [link.program("gateway"), "--modbus-port", str(port), *args]
    words += ["--heartbeat-ms", str(heartbeat_ms), "--sdo-timeout-ms", "3000"]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=errors, text=True)
    process.errors = lambda: (errors.seek(0), errors.read())[1]
    if ready:
        process.ready = process.stdout.readline()
    return process


def until(holds, timeout_s=5.0):
    end = time.monotonic() + timeout_s
    while time.monotonic() < end:
        value = holds()
        if value:
            return value
        time.sleep(0.02)
    return None


def states(axis):
    until(lambda: operational(axis), 10)
    until(lambda: axis.state(1).force_scale_uN > 0)  # the last one that is polled
    got, end = [], time.monotonic() + 2
    while time.monotonic() < end:
        got.append(axis.state(1))
    first, last = got[0], got[-1]
    return {
        "rate": len(got) / 2,
        "ticks": last.tick - first.tick,
        "utime": last.utime - first.utime,
        "ages_us": [min(s.age_us for s in got), max(s.age_us for s in got)],
        "nmt": last.nmt_state,
        "hash": last.objects_hash == TABLE_HASH,
        "missing": [
            name for name in last.__slots__ if getattr(last, name) == axis_state_t.NOT_AVAILABLE
        ],
        "lost": sum(g.lost for g in axis.gaps.values()),
        "set": axis.read("force_gain"),
    }


def lock(axis, modbus):
    found = {}
    try:
        axis.write("force_gain", 2.0)
    except Refused as error:
        found["before"] = [str(error), error.code]
    axis.take()
    event = axis.wait_event(axis_event_t.EVENT_LOCK)
    found["lock_event"] = [event.code, event.text]
    axis.write("force_gain", 7.0)
    found["modbus_reads"] = registers(modbus, BY_NAME["force_gain"].modbus, 1)
    found["modbus_write"] = modbus.write_register(
        BY_NAME["force_gain"].modbus, 256, device_id=1
    ).exception_code
    found["modbus_takes"] = modbus.write_register(
        BY_NAME["command_source"].modbus, 1, device_id=1
    ).isError()
    try:
        axis.write("force_gain", 2.0)
    except Refused as error:
        found["after"] = [str(error), error.code]
    found["modbus_writes"] = modbus.write_register(
        BY_NAME["force_gain"].modbus, 1280, device_id=1
    ).isError()
    found["lcm_reads"] = axis.read("force_gain")
    return found


def refusals(axis):
    """The texts and codes of refusals that a client receives."""
    axis.take()
    axis.write("watchdog", 30_000)  # refused commands do not feed it
    tried = {
        "range": ("latency_ticks", 3),
        "read_only": ("0x6041", 1),
        "no_object": ("0x5000", 1),
        "type": ("0x2019", 70000),
    }
    found = {}
    for key, (name, value) in tried.items():
        # Bypasses the client's own checks, which use the same table.
        try:
            axis._command(axis_command_t.KIND_WRITE, [(name, value)])
            found[key] = "taken"
        except Refused as error:
            found[key] = [str(error), error.code]
    before = axis.read("output_limit")
    try:
        axis._command(
            axis_command_t.KIND_WRITE,
            [("output_limit", 1000), ("latency_ticks", 3), ("adc_bits", 9)],
        )
    except Refused as error:
        found["items"] = list(zip(error.event.object, error.event.value, strict=True))
    found["stays_done"] = [before, axis.read("output_limit")]
    axis.write("output_limit", before)
    try:
        axis.read("recorder_arm")
    except Refused as error:
        found["write_only"] = [str(error), error.code]
    return found


def repetitions():
    """A duplicate command, a late one, one of another object table."""
    received = []
    bus = Bus(None, lambda channel, data, _: received.append(decode(channel, data)), "AXIS_1_EVENT")
    other = AxisClient(1)
    try:
        command = axis_command_t()
        command.utime, command.axis = axis_state_t.NOT_AVAILABLE, 1
        command.objects_hash, command.kind = TABLE_HASH, axis_command_t.KIND_WRITE
        command.command_id, command.timeout_us = 1, 5_000_000
        command.num_items, command.object, command.value = 1, ["force_tare"], [11]

        def answers():
            return [
                e
                for e in received
                if (e.command_run_id, e.command_id) == (bus.run_id, command.command_id)
            ]

        bus.publish("AXIS_1_COMMAND", command)
        until(answers)
        other.write("0x200E", 22)
        bus.publish("AXIS_1_COMMAND", command)
        until(lambda: len(answers()) == 2)
        found = {
            "answers": [[e.kind, e.text, list(e.value)] for e in answers()],
            "value": other.read("0x200E"),
        }
        command.command_id, command.objects_hash = 2, 0x12345678
        bus.publish("AXIS_1_COMMAND", command)
        found["other_table"] = [[e.kind, e.text] for e in until(answers)]
        command.command_id, command.kind, command.object = 3, axis_command_t.KIND_READ, ["0x200E"]
        bus.publish("AXIS_1_COMMAND", command)
        found["by_address"] = [[e.kind, list(e.value)] for e in until(answers)]
        # Bus.publish uses the current time, so the late command is published directly.
        command.command_id, command.kind, command.objects_hash = 4, 1, TABLE_HASH
        command.value, command.wall_utime, command.timeout_us = (
            [33],
            now_us() - 3_000_000,
            1_000_000,
        )
        bus._lcm.publish("AXIS_1_COMMAND", command.encode())
        time.sleep(0.5)
        found["late"] = [len(answers()), other.read("0x200E")]
        # An unlimited timeout: the sum of the two exceeds 64 bits.
        command.command_id, command.value, command.timeout_us = 5, [44], 2**63 - 1
        bus.publish("AXIS_1_COMMAND", command)
        found["patient"] = [[e.kind, list(e.value)] for e in until(answers) or []]
        return found
    finally:
        bus.close()
        other.close()


def events(axis):
    """Events of the axis itself: its limits, then its speed are exceeded."""
    received = []
    bus = Bus(None, lambda channel, data, _: received.append(decode(channel, data)), "AXIS_1_EVENT")
    try:
        axis.take()
        axis.write_all({"output_limit": 100, "open_loop_code": 300, "modes_of_operation": -2})
        for word in (0x06, 0x07, 0x0F):
            axis.write("controlword", word)
        axis.wait_event(axis_event_t.EVENT_LIMIT, lambda e: e.code == 2)
        axis.write_all({"output_limit": 2048, "speed_max": 1, "open_loop_code": 500})
        axis.wait_event(axis_event_t.EVENT_FAULT)
        until(lambda: any(e.kind == axis_event_t.EVENT_EMCY for e in received))
        axis.write_all({"speed_max": 0, "controlword": 0x80})
        axis.wait_event(axis_event_t.EVENT_FAULT, lambda e: e.code == 0)
        time.sleep(0.3)
    finally:
        bus.close()
    answers = (axis_event_t.EVENT_DONE, axis_event_t.EVENT_REFUSED)
    return {
        "events": [[e.kind, e.code, e.text] for e in received if e.kind not in answers],
        "emcy": [
            dict(zip(e.object, e.value, strict=True))
            for e in received
            if e.kind == axis_event_t.EVENT_EMCY
        ],
    }


def faulted(axis):
    """A session whose axis is too fast, twice: its fault is reset, and the axis drives again."""
    found = {"faults": [], "after": []}
    kept, sessions.STATES_KEPT = sessions.STATES_KEPT, 5
    try:
        with sessions.Session(1, timeout_s=4) as own:
            for _ in range(2):
                own.enable("open loop", output_limit=2048, open_loop_code=0, speed_max=0)
                own.write_all({"speed_max": 1, "open_loop_code": 500})
                state = own.wait_for(lambda s: s.fault, "a fault")
                found["faults"].append(
                    [BY_NAME["fault"].enum[state.fault], own.read("drive_state")]
                )
                own.write_all({"open_loop_code": 0, "speed_max": 0})
                own.reset_fault()
                state = own.wait_for(lambda s: s.fault == 0, "no fault")
                found["after"].append(own.read("drive_state"))
            before, newest = own.states, own.state(2)
            until(lambda: own.states[-1].tick > newest.tick)
            found["kept"] = [len(before), len(own.states)]
            ticks = [s.tick for s in own.states]
            found["in_order"] = ticks == sorted(ticks) and before[0].tick < ticks[0]
    finally:
        sessions.STATES_KEPT = kept
    # After a session the axis is ready to switch on; the next scenario needs its initial state.
    axis.take()
    axis.write("controlword", 0)
    return found


def captures(axis):
    axis.take()
    axis.write("watchdog", 30_000)
    signals = ["tick_count", "force", "dac_code", "position", "statusword"]
    held = axis.capture(signals, samples=500, timeout_s=10)
    ticks = held.values("tick_count").astype(int)
    found = {
        "total": held.total,
        "missing": held.missing,
        "steps": sorted({int(s) for s in ticks[1:] - ticks[:-1]}),
        "first_tick": bool(held.first_tick == ticks[0]),
        "statusword": sorted({int(s) for s in held.values("statusword")}),
    }
    slow = axis.capture(["tick_count"], samples=100, decimation=3)
    ticks = slow.values("tick_count").astype(int)
    found["decimated"] = [slow.total, sorted({int(s) for s in ticks[1:] - ticks[:-1]})]
    # Armed for a trigger that never occurs, then disarmed.
    stopper = threading.Timer(0.5, lambda: stop_recorder())
    stopper.start()
    try:
        axis.capture(["force"], trigger_source=0x202500, trigger_edge="rising", trigger_level=10**6)
    except Refused as error:
        found["stopped"] = str(error)
    stopper.join()
    try:
        axis.capture(["force"], samples=60000)
    except Refused as error:
        found["too_long"] = str(error)
    return found


def stop_recorder():
    with AxisClient(1) as other:
        other.write("recorder_arm", 0)


def map_reads(axis, modbus):
    """Every register through Modbus and LCM: [name, modbus, lcm] where they differ."""
    differ, count = [], 0
    axis.take()
    known = [o for o in objects.OBJECTS if o.modbus >= 0]
    # Signals that change between two reads are compared by width only.
    for o in known:
        width = 2 if o.type in ("u32", "i32") else 1
        kind = "holding" if o.access == "rw" else "input"
        words = registers(modbus, o.modbus, width, kind)
        if not isinstance(words, list) or len(words) != width:
            differ.append([o.name, words, None])
            continue
        count += width
        raw = 0
        for word in words:
            raw = raw << 16 | word
        bits = 16 * width
        if o.type[0] == "i" and raw >> (bits - 1):
            raw -= 1 << bits
        address = f"0x{o.index:04X}" + (f":{o.sub}" if o.sub else "")
        value = axis.read(address)
        moving = o.access == "ro" and o.name not in ("object_table_hash", "node_id", "nmt_state")
        if value != raw and not moving:
            differ.append([o.name, raw, value])
    return {"registers": count, "objects": len(known), "differ": differ}


def map_refuses(modbus):
    modbus.write_register(BY_NAME["command_source"].modbus, 1, device_id=1)
    gain, limit = BY_NAME["position_gain"].modbus, BY_NAME["output_limit"].modbus
    wire = Tcp()
    found = {
        "hole": registers(modbus, 0x0300, 1),
        "half_read": len(registers(modbus, BY_NAME["position_setpoint"].modbus, 1)),
        "half_write": modbus.write_register(
            BY_NAME["position_setpoint"].modbus, 1, device_id=1
        ).exception_code,
        "range": modbus.write_register(limit, 2049, device_id=1).exception_code,
        "function": wire.ask(1, b"\x07").hex(),
        "counts": [wire.ask(1, struct.pack(">BHH", 3, 0, n)).hex() for n in (0, 126)],
        "short": wire.ask(1, b"\x03\x00").hex(),
        "device_id": wire.ask(1, b"\x2b\x0e\x01\x00").hex(),
        # After functions of unknown length the stream is still synchronised.
        "in_step": wire.ask(1, struct.pack(">BHH", 3, gain, 1)).hex(),
    }
    before = registers(modbus, gain, 2)
    # latency_ticks, behind output_limit, is in its range but is not written while enabled.
    modbus.write_register(BY_NAME["modes_of_operation"].modbus, 0x10000 - 2, device_id=1)
    found["enable"] = modbus.write_coil(0, True, device_id=1).isError()
    found["enabled"] = modbus.read_coils(0, count=5, device_id=1).bits[:5]
    found["discrete"] = modbus.read_discrete_inputs(0, count=7, device_id=1).bits[:7]
    was = registers(modbus, limit, 2)
    found["state"] = modbus.write_registers(limit, [1234, 1], device_id=1).exception_code
    found["taken_back"] = registers(modbus, limit, 2) == was
    found["disable"] = modbus.write_coil(0, False, device_id=1).isError()
    found["disabled"] = modbus.read_coils(0, count=1, device_id=1).bits[0]
    refused = modbus.write_registers(gain, [before[0] + 1, 0, 0, 0, 99], device_id=1)
    found["all_or_none"] = [refused.exception_code, registers(modbus, gain, 2) == before]
    found["mask"] = [
        modbus.mask_write_register(
            address=gain, and_mask=0xFF00, or_mask=0x0021, device_id=1
        ).isError(),
        registers(modbus, gain, 1)[0] == (before[0] & 0xFF00) | 0x21,
    ]
    exchanged = modbus.readwrite_registers(
        read_address=gain, read_count=2, address=gain, values=[770], device_id=1
    )
    found["exchange"] = exchanged.registers
    exchange = struct.pack(">BHHHHBH", 23, 0x0300, 1, gain, 1, 2, 771)
    found["exchange_hole"] = [wire.ask(1, exchange).hex(), registers(modbus, gain, 1)]
    # Enable, no fault reset, no halt, store.
    store = BY_NAME["store_state"].modbus
    was = registers(modbus, store, 1, "input")
    found["enable_and_store"] = [
        wire.ask(1, struct.pack(">BHHBB", 15, 0, 4, 1, 0b1001)).hex(),
        modbus.read_coils(0, count=1, device_id=1).bits[0],
        registers(modbus, store, 1, "input") == was,
    ]
    # The other word order of 32-bit values.
    order = BY_NAME["modbus_word_order"].modbus
    where = BY_NAME["target_velocity"].modbus
    modbus.write_registers(where, [0xFFFF, 0xFF00], device_id=1)
    modbus.write_register(order, 1, device_id=1)
    found["low_first"] = registers(modbus, where, 2)
    modbus.write_register(order, 0, device_id=1)
    return found


def wide_values(axis, modbus):
    """An u32 beyond 2^31 - 1: written over each bus, read over all of them."""
    window, can = BY_NAME["following_error_window"], Can()

    def written(write, value):
        write(value)
        high, low = registers(modbus, window.modbus, 2)
        return [value, can.read(1, window.index, 0), high << 16 | low, axis.read(window.name)]

    def over_canopen(value):
        assert can.write(1, window.index, 0, value, 4) == 0x60

    def over_modbus(value):
        words = [value >> 16, value & 0xFFFF]
        assert not modbus.write_registers(window.modbus, words, device_id=1).isError()

    values, found = (3_000_000_000, 0xFFFFFFFF), {}
    axis.take()
    axis.release()
    found["canopen"] = [written(over_canopen, value) for value in values]
    modbus.write_registers(BY_NAME["command_source"].modbus, [1, 60_000], device_id=1)
    found["modbus"] = [written(over_modbus, value) for value in values]
    axis.take()
    found["lcm"] = [written(lambda value: axis.write(window.name, value), v) for v in values]
    axis.release()
    return found


def request_table():
    """The number of requests, and [number, line, response] of unexpected responses."""
    differ, count, wire = [], 0, Tcp()
    wire.ask(1, bytes.fromhex("0600070000"))  # to CANopen, should Modbus own the axis
    text = Path(__file__).with_name("modbus_requests.txt").read_text()
    digest = f"{TABLE_HASH:08x}"
    text = text.replace("HHHH", digest[:4]).replace("LLLL", digest[4:])
    for number, line in enumerate(text.splitlines(), 1):
        request, equals, answer = line.partition("#")[0].partition("=")
        if not equals:
            continue
        count += 1
        sent, expected = (bytes.fromhex(t.replace("UU", "01")) for t in (request, answer))
        got = wire.ask(1, sent)
        if got != expected:
            differ.append([number, line, got.hex() if got is not None else None])
    return {"requests": count, "differ": differ}


def streams():
    """Pieces, several requests at once, invalid frames, many clients."""
    request = struct.pack(">BHH", 4, 0, 2)
    wire = Tcp()
    found = {}
    frame = wire.frame(1, request)
    for byte in frame:
        wire.socket.sendall(bytes([byte]))
        time.sleep(0.005)
    found["pieces"] = wire.answer().hex()
    wire.socket.sendall(wire.frame(1, request) + wire.frame(7, request) + wire.frame(1, request))
    found["pipelined"] = [wire.answer().hex() for _ in range(3)]
    # An incomplete frame does not block other clients.
    stuck = Tcp()
    stuck.socket.sendall(stuck.frame(1, request)[:9])
    clients = [Tcp() for _ in range(6)]
    started = time.monotonic()
    for client in clients:
        client.socket.sendall(client.frame(1, request))
    found["clients"] = sum(len(client.answer()) == 6 for client in clients)
    found["seconds"] = time.monotonic() - started
    rubbish = Tcp()
    rubbish.socket.sendall(b"GET / HTTP/1.0\r\n\r\n")
    found["rubbish"] = rubbish.answer().hex()
    return found


def units():
    """What answers at the axis, the gateway's own units and one that is not there."""
    requests = {
        "read": struct.pack(">BHH", 4, 0, 1),
        "write": struct.pack(">BHH", 6, 7, 1),
        "echo": b"\x08\x00\x00\x12\x34",
        "server": b"\x11",
        "product": b"\x2b\x0e\x04\x01",
        "hash": b"\x2b\x0e\x04\x80",
    }
    wire = Tcp()
    return {
        str(unit): {name: wire.ask(unit, pdu).hex() for name, pdu in requests.items()}
        for unit in (1, 255, 0, 2, 254)
    }


def crowd():
    """Forty clients that say nothing or half a request: who is served, who is closed."""
    request, write = struct.pack(">BHH", 4, 0, 1), struct.pack(">BHHBHH", 16, 7, 2, 4, 1, 60000)
    owner = Tcp()
    found = {"owner": owner.ask(1, write).hex()}
    silent = [Tcp() for _ in range(40)]
    for client in silent[::2]:
        client.socket.sendall(client.frame(1, request)[:9])
    started = time.monotonic()
    found["next"] = Tcp().ask(1, request).hex()
    found["seconds"] = time.monotonic() - started
    found["owner_then"] = owner.ask(1, write).hex()
    # The first ones gave way; half a request ends after 2 s.
    found["first"] = silent[1].answer(0.5)
    time.sleep(max(0, started + 2.5 - time.monotonic()))
    found["half"] = silent[-2].answer(0.5)
    found["idle"] = silent[-1].answer(0.1)
    found["owner_last"] = owner.ask(1, struct.pack(">BHH", 6, 7, 0)).hex()
    return {k: v.hex() if isinstance(v, bytes) else v for k, v in found.items()}


def second_gateway():
    second = gateway(ready=False, port=1599)
    status = second.wait(5)
    third = gateway("--node-id", "126", ready=False)
    return {
        "status": status,
        "said": second.errors(),
        "port": [third.wait(5), third.errors()],
    }


def drive_by_modbus():
    """Operation enabled, open loop at code 0, by a client of Modbus TCP; what writes on."""
    wire = Tcp()
    requests = [(BY_NAME["command_source"].modbus, 1), (BY_NAME["watchdog"].modbus, 60000)]
    requests += [(BY_NAME["modes_of_operation"].modbus, 0xFFFE)]
    requests += [(BY_NAME["controlword"].modbus, word) for word in (6, 7, 15)]
    return all(wire.ask(1, struct.pack(">BHH", 6, *request))[0] == 6 for request in requests)


def drive_by_lcm():
    with AxisClient(1, timeout_s=4) as client:
        client.take()
        client.write_all({"watchdog": 60_000, "open_loop_code": 0, "modes_of_operation": -2})
        for word in (6, 7, 15):
            client.write("controlword", word)
    return True


def drive_on(can):
    """Operation enabled, open loop at code 0, by CANopen's own master. The gateway polls on the
    same SDO channel, so requests may collide: then it is repeated."""
    requests = [(0x2301, 0, 1), (0x6060, 0xFE, 1), *((0x6040, word, 2) for word in (6, 7, 15))]
    return all(
        any(can.write(1, index, 0, value, size) == 0x60 for _ in range(10))
        for index, value, size in requests
    )


def killed(process, axis, drive):
    """The gateway is killed: when the axis reports it, and what the next gateway reads."""
    found = {"driven": drive()}
    frames = []
    listener = threading.Thread(target=lambda: frames.extend(Can().frames(3.0)))
    listener.start()
    time.sleep(0.3)
    process.send_signal(signal.SIGKILL)
    process.wait()
    listener.join()
    beats = [t for t, identifier, _ in frames if identifier == 0x77F]
    emergencies = [(t, d.hex()) for t, i, d in frames if i == 0x081 and d[:2] == b"\x30\x81"]
    found["silence_ms"] = 1000 * (emergencies[0][0] - beats[-1]) if beats and emergencies else None
    found["emergencies"] = len(emergencies)
    again = gateway()
    state = until(lambda: operational(axis), 8)
    found["fault"] = BY_NAME["fault"].enum[state.fault] if state else None
    found["statusword"] = state.statusword & 0x4F if state else None
    found["owner"] = axis.read("command_source")
    axis.take()
    axis.write("controlword", 0x80)
    axis.release()
    return found, again


def operational(axis):
    try:
        s = axis.state(0.5)
    except NoAnswer:
        return None
    ready = s.nmt_state == 5 and s.fault != s.NOT_AVAILABLE and s.statusword != s.NOT_AVAILABLE
    return s if ready else None


def ended(process, drive):
    """SIGTERM while the axis is driven."""
    found = {"driven": drive()}
    received = []
    listener = threading.Thread(target=lambda: received.extend(Can().frames(2.0)))
    listener.start()
    time.sleep(0.1)
    process.terminate()
    found["status"] = process.wait(5)
    listener.join()
    found["emergencies"] = [f"{d[1]:02x}{d[0]:02x}" for _, i, d in received if i == 0x081]
    words = [d[0] | d[1] << 8 for _, i, d in received if i == 0x181]
    found["statusword"] = [words[0] & 0x6F, words[-1] & 0x4F]
    found["said"] = process.errors()
    return found


def lost_axis(running, axis):
    """The axis is killed: what the gateway reports on each bus."""
    running["plant_node"].kill()
    running["axis_node"].kill()
    event = axis.wait_event(axis_event_t.EVENT_HEARTBEAT_LOST, timeout_s=10)
    state = until(lambda: s if (s := axis.state(1)).nmt_state == -1 else None)
    found = {"event": [event.code, event.text], "stale": state.age_us > 0 and state.nmt_state == -1}
    later = axis.state(1)
    time.sleep(0.3)
    found["age_grows"] = axis.state(1).age_us > later.age_us
    found["modbus"] = Tcp().ask(1, struct.pack(">BHH", 4, 0, 1)).hex()
    try:
        axis.read("force")
    except Refused as error:
        found["command"] = str(error)
    return found


class OtherTable(threading.Thread):
    """Node 2: heartbeats, and SDO answers of a firmware with another object table."""

    def __init__(self):
        super().__init__(daemon=True)
        self.can, self.stop, self.downloads, self.starts = Can(), threading.Event(), 0, 0

    def run(self):
        beat = 0.0
        while not self.stop.is_set():
            if time.monotonic() >= beat:
                self.can.send(0x702, b"\x7f")
                beat = time.monotonic() + 0.1
            frame = self.can.receive(0.05)
            if frame and frame[0] == 0 and frame[1][1] in (0, 2):
                self.starts += 1
            if not frame or frame[0] not in (0x602, *range(0x680, 0x6E0, 2)) or len(frame[1]) != 8:
                continue
            index, sub = struct.unpack("<HB", frame[1][1:4])
            if frame[1][0] >> 5 != 2:
                self.downloads += 1
            value = {(0x1018, 2): 1178687537, (0x2300, 0): 0x12345678}.get((index, sub), 7)
            answer = struct.pack("<BHBI", 0x43, index, sub, value)
            self.can.send(0x582 if frame[0] == 0x602 else frame[0] + 1, answer)


def other_table():
    node = OtherTable()
    node.start()
    process = gateway("--axes", "2")
    found = {}
    with AxisClient(2, timeout_s=3) as axis:
        until(lambda: process.errors())
        state = until(lambda: s if (s := axis.state(3)).objects_hash > 0 else None)
        found["said"] = process.errors()
        found["hash"] = state.objects_hash
        try:
            axis.take()
        except Refused as error:
            found["write"] = str(error)
        found["by_address"] = axis.read("0x1018:2")
        found["modbus"] = Tcp().ask(2, struct.pack(">BHH", 6, 0x0114, 1)).hex()
    found["downloads"], found["starts"] = node.downloads, node.starts
    process.terminate()
    found["status"] = process.wait(5)
    node.stop.set()
    node.join()
    return found


class Driven(threading.Thread):
    """A node with this object table that is in operation. By quick stop it stops when every one of
    `together` has received its command; never, if `stops` is false."""

    def __init__(self, node, stops=True):
        super().__init__(daemon=True)
        self.node, self.stops, self.together = node, stops, [self]
        self.can, self.end = Can(), threading.Event()
        self.commanded, self.started = threading.Event(), threading.Event()
        self.unwatched = False
        self.values = {(o.index, o.sub): o.default for o in objects.OBJECTS}
        state = BY_NAME["drive_state"]
        self.state, self.states = (state.index, state.sub), state.enum
        self.values[0x2300, 0] = TABLE_HASH
        self.sizes = {(o.index, o.sub): int(o.type[1:]) // 8 for o in objects.OBJECTS}

    def value(self, where):
        if where != self.state:
            return self.values.get(where, 0)
        stopped = self.stops and all(other.commanded.is_set() for other in self.together)
        return self.states.index("switch_on_disabled" if stopped else "operation_enabled")

    def run(self):
        beat = 0.0
        while not self.end.is_set():
            if time.monotonic() >= beat:
                self.can.send(0x700 + self.node, b"\x05")
                beat = time.monotonic() + 0.05
            frame = self.can.receive(0.05)
            if frame and frame[0] == 0 and frame[1] == bytes([1, self.node]):
                self.started.set()
            if frame and frame[0] == 0x600 + self.node and frame[1][0] != 0x80:
                self.answer(frame[1])

    def answer(self, request):
        where = struct.unpack("<HB", request[1:4])
        if request[0] >> 5 == 2:
            size = self.sizes.get(where, 1)
            value = self.value(where) % (1 << 8 * size)
            answer = struct.pack("<BHBI", 0x43 | (4 - size) << 2, *where, value)
        else:
            self.values[where] = struct.unpack("<I", request[4:])[0]
            answer = struct.pack("<BHBI", 0x60, *where, 0)
            if where == (0x6040, 0) and self.values[where] == 2:
                self.commanded.set()
            if where[0] == 0x1016 and self.values[where] == 0:
                self.unwatched = True
        self.can.send(0x580 + self.node, answer)


def two_axes_end():
    """Two axes are stopped together; a second signal ends the gateway immediately."""
    found = {}
    for name, stops in (("together", True), ("at_once", False)):
        nodes = [Driven(2, stops), Driven(3, stops)]
        for node in nodes:
            node.together = nodes
            node.start()
        process = gateway("--axes", "2,3")
        assert all(node.started.wait(10) for node in nodes), process.errors()
        time.sleep(0.3)  # the set-up ends with the NMT start
        process.terminate()
        commanded = [node.commanded.wait(5) for node in nodes]
        if not stops:
            process.terminate()
        status = process.wait(10)
        found[name] = [commanded, [node.unwatched for node in nodes], status]
        for node in nodes:
            node.end.set()
            node.join()
    return found


def start_node(name, *args):
    words = [link.program(name), thesis_session.EXPERIMENT, "--axes", "2", "--link", "socketcan"]
    words += ["--start-timeout", "20", "--set", "experiment.duration_s=60", *args]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert "ready" in process.stdout.readline(), name
    return process


def standing(clients):
    """Of each axis: position, CiA 402 state and number, as published; a slow axis may have none."""

    def whole(client):
        s = client.state()
        return s if axis_state_t.NOT_AVAILABLE not in (s.position_cnt, s.statusword) else None

    states = [until(lambda client=client: whole(client), 10) for client in clients]
    return [[s.position_cnt, s.statusword & 0x6F, s.axis] for s in states]


def two_axes():
    """One gateway, two axes: each is moved over one bus while the other must not move."""
    nodes = [start_node("axis_node", "--can", "vcan0"), start_node("plant_node", "--pace", "real")]
    sets = ["--set", "force_gain=3", "--set", "2:force_gain=7"]
    # A busy guest may not run two axes in real time; times are counted in ticks.
    process = gateway("--axes", "1,2", *sets, heartbeat_ms=1000)
    modbus = ModbusTcpClient("127.0.0.1", port=PORT, timeout=3)
    assert modbus.connect()
    try:
        with AxisClient(2, timeout_s=4) as second, sessions.Session(1, timeout_s=4) as first:
            until(lambda: operational(second), 10)
            return move_each(first, second, modbus) | {"said": process.errors()}
    finally:
        modbus.close()
        process.terminate()
        process.wait(5)
        for node in nodes:
            node.kill()
            node.communicate()


def move_each(first, second, modbus):
    def write(unit, name, *words):
        """None or the exception."""
        where = BY_NAME[name].modbus
        answer = modbus.write_registers(where, list(words), device_id=unit)
        return answer.exception_code if answer.isError() else None

    def position(unit):
        high, low = registers(modbus, BY_NAME["position_actual"].modbus, 2, "input", unit)
        return (high << 16 | low) - (high >> 15 << 32)

    both = first, second
    gain = BY_NAME["force_gain"].modbus
    found = {
        "gains": [
            [axis.read("force_gain") for axis in both],
            [registers(modbus, gain, 1, unit=unit) for unit in (1, 2)],
        ],
        "node_ids": [registers(modbus, BY_NAME["node_id"].modbus, 1, "input", u) for u in (1, 2)],
        "owners": [axis.read("command_source") for axis in both],
        "taken": write(1, "command_source", 1),
        "owners_then": [axis.read("command_source") for axis in both],
    }
    first.take()
    # Axis 1 by LCM.
    first.write_all({"position_gain": 4.0, "velocity_gain": 20.0})
    first.home()
    before = standing(both)
    first.enable("profile position", trajectory_velocity=60_000)
    first.move(2000)
    found["by_lcm"] = [before, standing(both)]
    # Axis 2 by Modbus.
    assert write(2, "command_source", 1, 60_000) is None  # and its watchdog
    found["refused"] = [write(unit, "force_gain", 512) for unit in (1, 2)]
    before = standing(both)
    target = before[1][0] + 1500
    for name, *words in (
        ("position_gain", 1024),
        ("velocity_gain", 5120),
        ("modes_of_operation", 1),
        ("target_position", target >> 16 & 0xFFFF, target & 0xFFFF),
        *(("controlword", word) for word in (6, 7, 15, 0x1F)),
    ):
        assert write(2, name, *words) is None, name
    until(lambda: second.state().statusword & 1 << 10 and abs(position(2) - target) < 10, 20)
    found["by_modbus"] = [before, standing(both)]
    found["modbus_sees"] = [position(1), position(2)]
    found["gains_after"] = [axis.read("force_gain") for axis in both]
    found["owners_after"] = [axis.read("command_source") for axis in both]
    # One is disabled while the other remains enabled.
    write(2, "controlword", 0)
    until(lambda: second.state().statusword & 0x6F == 0x40)
    found["off"] = standing(both)
    found["lost"] = sum(g.lost for axis in both for g in axis.gaps.values())
    return found


def main():
    results = {}

    def keep(name, scenario, *args):
        started = time.monotonic()
        try:
            results[name] = scenario(*args)
        except Exception:
            results[name] = {"raised": traceback.format_exc()}
        if os.environ.get("GATEWAY_BENCH_TIMES"):
            print(f"{name}: {time.monotonic() - started:.1f} s", file=sys.stderr)

    folder = Path(tempfile.mkdtemp())
    with thesis_session.machine(
        folder, programs=("axis_node", "plant_node"), duration_s=60
    ) as running:
        can, process = Can(), gateway("--set", "force_gain=3")
        results["ready"] = re.sub("pid [0-9]+", "pid N", process.ready)
        with AxisClient(1, timeout_s=4) as axis:
            modbus = ModbusTcpClient("127.0.0.1", port=PORT, timeout=3)
            modbus.connect()
            keep("states", states, axis)
            keep("lock", lock, axis, modbus)
            keep("refusals", refusals, axis)
            keep("repetitions", repetitions)
            keep("events", events, axis)
            keep("faulted", faulted, axis)
            keep("captures", captures, axis)
            keep("map_reads", map_reads, axis, modbus)
            keep("map_refuses", map_refuses, modbus)
            keep("request_table", request_table)
            keep("wide_values", wide_values, axis, modbus)
            keep("streams", streams)
            keep("units", units)
            keep("crowd", crowd)
            keep("second_gateway", second_gateway)
            modbus.close()
            results["said"] = process.errors()
            drives = {"canopen": lambda: drive_on(can), "modbus": drive_by_modbus}
            drives["lcm"] = drive_by_lcm
            for owner, drive in drives.items():
                name = f"killed_{owner}"
                keep(name, killed, process, axis, drive)
                if isinstance(results[name], tuple):
                    results[name], process = results[name]
                else:
                    process = gateway()
                    until(lambda: operational(axis), 8)
            for owner, drive in drives.items():
                keep(f"ended_{owner}", ended, process, drive)
                process = gateway()
                until(lambda: operational(axis), 8)
            keep("lost_axis", lost_axis, running, axis)
            process.terminate()
            process.wait(5)
    keep("other_table", other_table)
    keep("two_axes_end", two_axes_end)
    keep("two_axes", two_axes)
    print(json.dumps(results))


if __name__ == "__main__":
    main()
