"""The gateway scenarios of test_gateway.py, in one guest: run under tools/vcan with a folder.

Each scenario is a function and a step of its own, so that one failure hides no other.
"""

import contextlib
import re
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

from forceaxis import objects
from forceaxis.axis import session as sessions
from forceaxis.axis.gateway import GatewayLink
from forceaxis.bus.client import AxisClient, NoAnswer, Refused
from forceaxis.bus.lcm import TABLE_HASH, Bus, decode, default_url, now_us
from forceaxis.bus.messages import axis_command_t, axis_event_t, axis_state_t
from forceaxis.objects import BY_NAME
from forceaxis.thesis import session as thesis_session
from gateway_clients import (
    PORT,
    Can,
    Tcp,
    drive_by_lcm,
    drive_by_modbus,
    drive_on,
    gateway,
    operational,
    registers,
    until,
)
from gateway_nodes import other_table, two_axes, two_axes_end
from lossy_link import LossyLink, at_random
from pymodbus.client import ModbusTcpClient
from steps import Steps

# The far end of a network that loses datagrams.
CLIENTS = "udpm://239.255.76.67:7668?ttl=0"


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
        # More commands than answers are kept, refused at once since their kind is unknown, then the
        # patient one again.
        other.write("0x200E", 55)
        command.kind, command.timeout_us, sent = 99, 60_000_000, 0
        for _ in range(21):
            received.clear()
            for _ in range(100):
                sent += 1
                command.command_id = 5 + sent
                bus.publish("AXIS_1_COMMAND", command)
            until(lambda: sum(e.command_run_id == bus.run_id for e in received) >= 100)
        received.clear()
        command.command_id, command.kind, command.timeout_us = 5, 1, 2**63 - 1
        command.value = [44]
        bus.publish("AXIS_1_COMMAND", command)
        found["forgotten"] = [[e.kind, e.text] for e in until(answers) or []]
        found["unchanged"] = [sent, other.read("0x200E")]
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
    found["lossy"] = lossy_captures()
    found["handed_out"] = handed_out()
    axis.take()
    return found


def lossy_captures():
    """Recordings over networks that lose 30 and 50 % of all datagrams, and what was lost."""
    found = []
    for seed, share in enumerate((0.3, 0.5)):
        lost = at_random(seed, share)
        with LossyLink(CLIENTS, default_url(), lost) as network, AxisClient(1, CLIENTS, 4) as axis:
            axis.take()
            held = axis.capture(["tick_count"], samples=200, decimation=1, trigger_edge="immediate")
            ticks = held.values("tick_count").astype(int)
            steps = sorted({int(s) for s in ticks[1:] - ticks[:-1]})
            found.append([held.total, held.missing, steps, network.dropped > 0])
    return found


def handed_out():
    """A recording ends when its client no longer owns the axis."""
    with contextlib.closing(GatewayLink(1, timeout_s=4)) as link:
        link.client.take()
        link.arm(["tick_count"], {"length": 300, "decimation": 3})
        link.client.release()
        held = link.recording(20)
        owner, recorder = link.client.read_all(["command_source", "recorder_state"]).values()
        return [len(held.raw), owner, recorder]


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


def goes_on(now, axis):
    """Starts the gateway again if the step before has ended it."""
    if now.gateway.poll() is not None:
        now.gateway = gateway()
        until(lambda: operational(axis), 8)


def killed(now, axis, drive):
    """The gateway is killed: when the axis reports it, and what the next gateway reads."""
    found = {"driven": drive()}
    frames = []

    def is_lost(identifier, data):
        return identifier == 0x081 and data[:2] == b"\x30\x81"

    listener = threading.Thread(target=lambda: frames.extend(Can().frames(5.0, is_lost)))
    listener.start()
    time.sleep(0.3)
    now.gateway.kill()
    now.gateway.wait()
    listener.join()
    beats = [t for t, identifier, _ in frames if identifier == 0x77F]
    emergencies = [t for t, *frame in frames if is_lost(*frame)]
    found["silence_ms"] = 1000 * (emergencies[0] - beats[-1]) if beats and emergencies else None
    found["emergencies"] = len(emergencies)
    now.gateway = gateway()
    state = until(lambda: operational(axis), 8)
    found["fault"] = BY_NAME["fault"].enum[state.fault] if state else None
    found["statusword"] = state.statusword & 0x4F if state else None
    found["owner"] = axis.read("command_source")
    axis.take()
    axis.write("controlword", 0x80)
    axis.release()
    return found


def ended(now, drive):
    """SIGTERM while the axis is driven."""
    found = {"driven": drive()}
    received = []
    listener = threading.Thread(target=lambda: received.extend(Can().frames(2.0)))
    listener.start()
    time.sleep(0.1)
    now.gateway.terminate()
    found["status"] = now.gateway.wait(5)
    listener.join()
    found["emergencies"] = [f"{d[1]:02x}{d[0]:02x}" for _, i, d in received if i == 0x081]
    words = [d[0] | d[1] << 8 for _, i, d in received if i == 0x181]
    found["statusword"] = [words[0] & 0x6F, words[-1] & 0x4F]
    found["said"] = now.gateway.errors()
    return found


def nmt_stopped(can, axis, now):
    """Another master stops the node of an axis that drives, then one that no gateway has set up."""
    found = {"driven": drive_on(can)}
    before = len(now.gateway.errors())
    can.send(0, b"\x02\x01")
    axis.wait_event(axis_event_t.EVENT_NODE, lambda e: e.code == 4)
    found["back"] = bool(until(lambda: operational(axis), 15))
    time.sleep(1.2)  # a second start would come by then
    said = now.gateway.errors()[before:]
    found["starts"] = said.count("node is stopped, the gateway starts it; a start enables no drive")
    found["unanswered"] = said.count("no answer in time")
    found["drive"] = axis.read("drive_state")
    now.gateway.terminate()
    now.gateway.wait(10)
    can.send(0, b"\x02\x01")
    time.sleep(0.5)
    now.gateway = gateway()
    found["found"] = bool(until(lambda: operational(axis), 15))
    found["drive_then"] = axis.read("drive_state")
    # Another master makes it pre-operational.
    can.send(0, b"\x80\x01")
    axis.wait_event(axis_event_t.EVENT_NODE, lambda e: e.code == 127)
    found["operational"] = bool(until(lambda: operational(axis), 15))
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
    except NoAnswer as error:
        found["command"] = str(error)
    return found


@contextlib.contextmanager
def recorded_bus(file):
    """Records the frames of the bus in a file of candump."""
    with file.open("w") as log:
        dump = subprocess.Popen(["candump", "-L", "-r", "8000000", "vcan0"], stdout=log)
        try:
            yield
        finally:
            dump.terminate()
            dump.wait(10)


def main():
    folder = Path(sys.argv[1])
    with recorded_bus(folder / "bus.log"), Steps(folder) as steps:
        scenarios(folder, steps)


def scenarios(folder, steps):
    with thesis_session.machine(
        folder, programs=("axis_node", "plant_node"), duration_s=80
    ) as running:
        can, now = Can(), SimpleNamespace(gateway=gateway("--set", "force_gain=3"))
        steps["ready"] = re.sub("pid [0-9]+", "pid N", now.gateway.ready)
        with AxisClient(1, timeout_s=4) as axis:
            modbus = ModbusTcpClient("127.0.0.1", port=PORT, timeout=3)
            modbus.connect()
            steps("states", states, axis)
            steps("lock", lock, axis, modbus)
            steps("refusals", refusals, axis)
            steps("repetitions", repetitions)
            steps("events", events, axis)
            steps("faulted", faulted, axis)
            steps("captures", captures, axis)
            steps("map_reads", map_reads, axis, modbus)
            steps("map_refuses", map_refuses, modbus)
            steps("request_table", request_table)
            steps("wide_values", wide_values, axis, modbus)
            steps("streams", streams)
            steps("units", units)
            steps("crowd", crowd)
            steps("second_gateway", second_gateway)
            modbus.close()
            steps["said"] = now.gateway.errors()
            drives = {"canopen": lambda: drive_on(can), "modbus": drive_by_modbus}
            drives["lcm"] = drive_by_lcm
            for owner, drive in drives.items():
                steps(f"killed_{owner}", killed, now, axis, drive)
                goes_on(now, axis)
            for owner, drive in drives.items():
                steps(f"ended_{owner}", ended, now, drive)
                goes_on(now, axis)
            steps("nmt_stopped", nmt_stopped, can, axis, now)
            goes_on(now, axis)
            steps("lost_axis", lost_axis, running, axis)
            now.gateway.terminate()
            now.gateway.wait(5)
    steps("other_table", other_table)
    steps("two_axes_end", two_axes_end)
    steps("two_axes", two_axes)


if __name__ == "__main__":
    main()
