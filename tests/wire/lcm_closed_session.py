"""The scenarios of test_lcm_closed.py, in one guest: run under tools/vcan.

usage: lcm_closed_session.py FOLDER [DATAGRAMS BYTES]     with numbers: a flood, of Modbus TCP too

The route for multicast leads to a veth, as on a machine with a network. So this machine's own
messages come back as local copies of what goes out there, and those of the other machine come in on
the same interface.
"""

import re
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import tcp_flood
from forceaxis.bus.client import AxisClient
from forceaxis.bus.lcm import NOT_AVAILABLE, TABLE_HASH, Bus, decode, now_us
from forceaxis.bus.messages import axis_command_t
from forceaxis.experiments import link
from forceaxis.thesis import session as thesis_session
from foreign_network import (
    FOREIGN,
    NETWORK,
    OWN,
    ForeignNetwork,
    dropped,
    fragments,
    listener,
    received,
    sender,
    short,
)
from steps import Steps

FLOOD = Path(__file__).resolve().parents[2] / "build/release/tests/wire/lcm_flood"
CHANNEL = "AXIS_1_COMMAND"
COUNT_AT = 8 + 9 * 8  # of num_items in an encoded command


def command(kind, items=(), number=1, run_id=77, signals=(), timeout_us=5_000_000):
    made = axis_command_t()
    made.utime, made.wall_utime, made.run_id, made.command_id = NOT_AVAILABLE, now_us(), run_id, 1
    made.command_id, made.axis, made.objects_hash = number, 1, TABLE_HASH
    made.kind, made.timeout_us = kind, timeout_us
    made.num_items, made.object = len(items), [name for name, _ in items]
    made.value = [value for _, value in items]
    made.num_signals, made.signal = len(signals), list(signals)
    return made.encode()


def enabling(run_id):
    """A client's whole session: it takes the axis, enables it and moves it."""
    written = [
        [("position_gain", 1024), ("velocity_gain", 5120)],
        [("modes_of_operation", -2), ("open_loop_code", 200)],
        *([("controlword", word)] for word in (6, 7, 15)),
    ]
    take = command(axis_command_t.KIND_TAKE, (), 1, run_id)
    return [take] + [
        command(axis_command_t.KIND_WRITE, items, number, run_id)
        for number, items in enumerate(written, 2)
    ]


class Answers:
    """The answers on AXIS_1_EVENT: {(run_id, command_id): [kind, text]}."""

    def __init__(self):
        self.answers, self.notes = {}, []
        self.bus = Bus(None, self.take, "AXIS_1_EVENT")

    def take(self, channel, data, _):
        event = decode(channel, data)
        if event.command_id == NOT_AVAILABLE:
            self.notes.append([event.kind, event.code, event.text])
        else:
            self.answers[event.command_run_id, event.command_id] = [event.kind, event.text]

    def of(self, run_id, wait_s=0.0):
        """Answers to a client, after at most wait_s for the first one."""
        end = time.monotonic() + wait_s
        while True:
            got = {n: a for (r, n), a in list(self.answers.items()) if r == run_id}
            if got or time.monotonic() > end:
                return got
            time.sleep(0.02)


class Gateway:
    def __init__(self, *args, modbus_port=0):
        self.errors = tempfile.TemporaryFile("w+")  # noqa: SIM115 - it outlives this
        words = [link.program("gateway"), "--watch-ms", "1000", *args]
        words += ["--modbus-port", str(modbus_port)]
        self.process = subprocess.Popen(
            words, stdout=subprocess.PIPE, stderr=self.errors, text=True
        )
        self.ready = re.sub("pid [0-9]+", "pid N", self.process.stdout.readline())

    def said(self):
        self.errors.seek(0)
        return self.errors.read()

    def end(self):
        self.process.terminate()
        return self.process.wait(10)


def standing(axis):
    """Who owns the axis, what it puts out and where it is."""
    state = axis.state(2)
    return [state.command_source, state.dac_code, state.position_cnt, state.statusword & 0x6F]


def wait_ready(axis):
    end = time.monotonic() + 15
    while time.monotonic() < end:
        state = axis.state(2)
        if state.nmt_state == 5 and state.command_source == 0 and state.statusword >= 0:
            return
    raise AssertionError("the axis was not set up")


def bad_lengths(home):
    """Every count and length of a command set to what it is not; the last drops are counted later.
    Returns how many were sent."""
    good = command(axis_command_t.KIND_READ, [("force", 0), ("0x6040", 0)], 1, 1, ["force"])
    names = COUNT_AT + 4
    places = [COUNT_AT, names, names + 10, names + 10 + 11 + 16, names + 10 + 11 + 20]
    count = 0
    for at in places:
        for value in (-1, -(2**31), 2**31 - 1, 2**20, 0x7FFF):
            home.send(short(CHANNEL, good[:at] + struct.pack(">i", value) + good[at + 4 :]))
            count += 1
    for size in range(0, len(good), 3):
        home.send(short(CHANNEL, good[:size]))
        count += 1
    return count


def from_home(answers, axis):
    """S1, and that a command of this machine still gets through."""
    home = sender(OWN)
    sent = bad_lengths(home)
    for _ in range(20):  # bursts, which used to abort
        sent += bad_lengths(home)
        time.sleep(0.02)
    home.send(short(CHANNEL, command(axis_command_t.KIND_READ, [("force", 0)], 1, 101)))
    return {"sent": sent, "answer": answers.of(101, 2), "reads": axis.read("force_gain")}


def from_elsewhere(answers, axis, foreign, control):
    """S2: a whole session from the other machine, and what the gateway makes of it."""
    received(control)
    for datagram in enabling(201):
        foreign.send(short(CHANNEL, datagram))
        time.sleep(0.1)
    for fragment in fragments(CHANNEL, command(4, (), 1, 202), 5, 40):
        foreign.send(fragment)
    time.sleep(0.5)
    arrived = [source for data, source in received(control) if CHANNEL.encode() in data]
    return {
        "arrived": arrived.count(FOREIGN),
        "answers": [answers.of(201), answers.of(202)],
        "axis": standing(axis),
    }


def forged(answers, axis, forge, control):
    """The same with this machine's own addresses as the source."""
    received(control)
    for run_id, source in ((301, OWN), (302, "127.0.0.1")):
        for datagram in enabling(run_id):
            forge(short(CHANNEL, datagram), source)
            time.sleep(0.1)
    time.sleep(0.5)
    arrived = [source for data, source in received(control) if CHANNEL.encode() in data]
    return {
        "arrived": [arrived.count(OWN), arrived.count("127.0.0.1")],
        "answers": [answers.of(301), answers.of(302)],
        "axis": standing(axis),
    }


def fragmented(answers, forge):
    """Messages in fragments: larger than a datagram, torn, of two senders, and one of this machine
    into which the other one throws a fragment of its own."""
    found, many = {}, [("no_such_object", 0)] * 4000
    large = command(axis_command_t.KIND_READ, many, 1, 401, timeout_us=60_000_000)
    found["bytes"] = len(large)
    bus = Bus(None, lambda *_: None, "NOTHING")
    bus._lcm.publish(CHANNEL, large)  # liblcm itself makes the fragments
    found["large"] = answers.of(401, 5)
    bus.close()

    one, two = sender(OWN), sender(OWN)
    port = one.getsockname()[1]
    read = lambda run_id: command(axis_command_t.KIND_READ, [("force", 0)], 1, run_id)  # noqa: E731
    a, b = fragments(CHANNEL, read(402), 7, 50), fragments(CHANNEL, read(403), 7, 50)
    for pair in zip(a, b, strict=True):
        one.send(pair[0])
        two.send(pair[1])
    found["interleaved"] = [answers.of(402, 2), answers.of(403, 2)]

    torn = [fragments(CHANNEL, read(404), sequence, 50) for sequence in range(10, 15)]
    del torn[0][1]  # lost
    del torn[1][-1]  # never ends
    torn[2][1] = torn[2][1][:12] + struct.pack(">I", 49) + torn[2][1][16:]  # overlaps
    torn[3][1:] = fragments(CHANNEL, command(4, (), 1, 404), 13, 50)[1:]  # of two messages
    torn[4][0] = torn[4][0][:8] + b"\xff\xff\xff\xff" + torn[4][0][12:]  # huge
    for datagrams in torn:
        for datagram in datagrams:
            one.send(datagram)
    time.sleep(0.5)
    found["torn"] = answers.of(404)

    pieces = fragments(CHANNEL, read(405), 9, 50)
    one.send(pieces[0])
    for piece in pieces[1:]:
        forge(piece[:20] + bytes(len(piece) - 20), OWN, port)
        time.sleep(0.05)
        one.send(piece)
    found["thrown_in"] = answers.of(405, 2)
    return found


def let_in(answers, network, foreign, run_id):
    """A gateway that allows a network: its ready line, what it answers to the other machine,
    and where that leaves the axis."""
    gateway = Gateway("--lcm-remote", "192.168.7.0/255.255.255.0", "--lcm-remote", network)
    try:
        with AxisClient(1, timeout_s=4) as axis:
            wait_ready(axis)
            before = standing(axis)
            for datagram in enabling(run_id):
                foreign.send(short(CHANNEL, datagram))
                time.sleep(0.1)
            got = answers.of(run_id, 1)
            time.sleep(0.5)
            return {"ready": gateway.ready, "answers": got, "axis": [before, standing(axis)]}
    finally:
        gateway.end()


class Watch(threading.Thread):
    """What the axis itself says on CAN: statuswords and positions of its TPDOs, until stopped."""

    def __init__(self):
        super().__init__(daemon=True)
        self.can = socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self.can.bind(("vcan0",))
        self.can.settimeout(0.2)
        self.states, self.positions, self.frames = set(), set(), 0
        self.stop = threading.Event()

    def run(self):
        while not self.stop.is_set():
            try:
                identifier, _, data = struct.unpack("=IB3x8s", self.can.recv(16))
            except TimeoutError:
                continue
            if identifier == 0x181:
                self.states.add(data[0] & 0x6F)
            elif identifier == 0x281:
                self.positions.add(struct.unpack("<i", data[:4])[0])
                self.frames += 1


def harmless(control):
    """Real datagrams none of which could enable an axis, and what else this machine says."""
    hour_us = 3_600_000_000  # what is mutated and still a command is not too late, so carried out
    kinds = [
        (axis_command_t.KIND_READ, [("force", 0), ("position", 0), ("0x6041", 0)], ()),
        (axis_command_t.KIND_READ, [("0x2010:3", 0)] * 20, ()),
        (axis_command_t.KIND_WRITE, [("force_gain", 1000), ("velocity_gain", 512)], ()),
        (axis_command_t.KIND_TAKE, (), ()),
        (axis_command_t.KIND_RELEASE, (), ()),
        (axis_command_t.KIND_CAPTURE, [("recorder_length", 50)], ["force", "dac_code"]),
    ]
    made = []
    for number, (kind, items, signals) in enumerate(kinds, 1):
        data = command(kind, items, number, 601, signals, hour_us)
        made += [short(CHANNEL, data), *fragments(CHANNEL, data, number, 100)]
    time.sleep(1)
    return made + [data for data, _ in received(control)][:40]


def save(path, datagrams):
    path.write_bytes(b"".join(struct.pack("<I", len(d)) + d for d in datagrams))
    return path


def resident_kb(pid):
    return int(re.search(r"VmRSS:\s+([0-9]+)", Path(f"/proc/{pid}/status").read_text())[1])


def pour(sock, count, seed, path, meanwhile):
    """Runs lcm_flood on a socket; `meanwhile` is called now and then. How many it sent, and the
    seconds."""
    words = [FLOOD, str(sock.fileno()), str(count), str(seed), path]
    started = time.monotonic()
    with subprocess.Popen(
        words, pass_fds=[sock.fileno()], stdout=subprocess.PIPE, text=True
    ) as running:
        while running.poll() is None:
            meanwhile()
            time.sleep(0.5)
        return int(running.stdout.read()), time.monotonic() - started


def flood(count, tcp_bytes):
    """Half of the datagrams come from this machine, half from another one, which says whole
    sessions between them; then Modbus TCP. The gateway, a session of the axis, and their memory."""
    network, port, found = ForeignNetwork(), 1502, {"resident_kb": []}
    foreign, control, folder = network.sender(), listener(OWN), Path(tempfile.mkdtemp())
    nodes = ("axis_node", "plant_node")
    with thesis_session.machine(folder, programs=nodes, endless=True) as running:
        gateway = Gateway(modbus_port=port)
        try:
            processes = gateway.process, running["axis_node"]
            with AxisClient(1, timeout_s=4) as axis:
                wait_ready(axis)
            home = save(folder / "home", harmless(control))
            control.close()
            away = save(folder / "away", [short(CHANNEL, d) for d in enabling(602)])
            watch = Watch()
            watch.start()

            def sample():
                found["resident_kb"].append([resident_kb(p.pid) for p in processes])

            def intrude():
                sample()
                for datagram in enabling(time.monotonic_ns()):
                    foreign.send(short(CHANNEL, datagram))

            before = dropped(gateway.process.pid)
            found["home"] = pour(sender(OWN), count // 2, 1, home, sample)
            after = dropped(gateway.process.pid)
            # The other socket drops all that is this machine's.
            found["lost"] = min(after[inode] - before[inode] for inode in before)
            found["away"] = pour(foreign, count - count // 2, 1, away, intrude)
            found["tcp"] = tcp_flood.pour(port, tcp_bytes, 1, sample)
            watch.stop.set()
            watch.join()
            found["states"], found["positions"] = sorted(watch.states), sorted(watch.positions)
            found["frames"] = watch.frames
            with AxisClient(1, timeout_s=10) as axis:
                found["reads"] = axis.read("force_raw")
            found["alive"] = [process.poll() is None for process in processes]
        finally:
            found["status"] = gateway.end()
            found["said"] = gateway.said()
    return found


def closed(folder, steps):
    network = ForeignNetwork()
    foreign, forge, control = network.sender(), network.forger(), listener(OWN)
    with thesis_session.machine(folder, programs=("axis_node", "plant_node"), duration_s=300):
        gateway, answers = Gateway(), Answers()
        steps["ready"] = gateway.ready
        with AxisClient(1, timeout_s=4) as axis:
            wait_ready(axis)
            steps["before"] = standing(axis)
            steps("from_home", from_home, answers, axis)
            steps("from_elsewhere", from_elsewhere, answers, axis, foreign, control)
            steps("forged", forged, answers, axis, forge, control)
            steps("fragmented", fragmented, answers, forge)
            steps["after"] = standing(axis)
        steps["alive"] = gateway.process.poll() is None
        steps["status"] = gateway.end()
        steps["said"] = gateway.said()
        steps["notes"] = [n for n in answers.notes if "LCM" in n[2]]
        steps("other_allowed", let_in, answers, "10.8.0.0/16", foreign, 501)
        steps("allowed", let_in, answers, NETWORK, foreign, 502)


def main():
    folder, numbers = Path(sys.argv[1]), map(int, sys.argv[2:])
    with Steps(folder) as steps:
        if len(sys.argv) > 2:
            steps("flood", flood, *numbers)
        else:
            closed(folder, steps)


if __name__ == "__main__":
    main()
