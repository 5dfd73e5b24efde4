"""`forceaxis axis stop` of several axes: each axis is commanded before the program waits for one,
whichever axes are dead, however a line is spelled, and if the program is ended."""

import contextlib
import os
import pty
import signal
import socketserver
import struct
import threading
import tty

import pytest
import verbs
from forceaxis.axis import address
from forceaxis.axis.link import NoAnswer
from forceaxis.cli import axis_stop
from forceaxis.cli.live_options import AxisConnection
from forceaxis.objects import BY_NAME

CONTROLWORD, STATUSWORD, OPTION = (
    BY_NAME[name].modbus for name in ("controlword", "statusword", "quick_stop_option")
)
READ_HOLDING, READ_INPUT, WRITE = 3, 4, 6
ENABLED, QUICK_STOP_ACTIVE, DISABLED = 0x37, 0x17, 0x50  # statuswords of CiA 402
NO_TARGET = bytes([WRITE | 0x80, 11])  # the gateway of a dead unit has no answer from it


class Units:
    """Modbus units that stop when each of `together` has its command, or never without `stops`. A
    unit of `dead` does not answer. `commands`: the units in the order of their stop commands."""

    def __init__(self, together, dead=(), stops=True):
        self.together, self.dead, self.stops = set(together), set(dead), stops
        self.commands, self.on_command = [], lambda _unit: None

    def answer(self, unit, request):
        """The answer to a request, a PDU of Modbus. That of a dead unit is None."""
        function, register, value = struct.unpack_from(">BHH", request)
        if function == WRITE and register == CONTROLWORD and value == 2:
            self.commands.append(unit)
            self.on_command(unit)
        if unit in self.dead:
            return None
        if function == WRITE:
            return request
        words = [self.read(unit, register + i, function == READ_INPUT) for i in range(value)]
        return struct.pack(f">BB{value}H", function, 2 * value, *words)

    def read(self, unit, register, is_input):
        if not is_input:
            return 2 if register == OPTION else 0
        if register != STATUSWORD:
            return 0
        if unit not in self.commands:
            return ENABLED
        return DISABLED if self.stops and self.together <= {*self.commands} else QUICK_STOP_ACTIVE


@contextlib.contextmanager
def tcp(units):
    """A server of Modbus TCP; yields the start of an address."""

    class Client(socketserver.StreamRequestHandler):
        def handle(self):
            while len(head := self.rfile.read(7)) == 7:
                number, _, length, unit = struct.unpack(">HHHB", head)
                answer = units.answer(unit, self.rfile.read(length - 1)) or NO_TARGET
                self.wfile.write(struct.pack(">HHHB", number, 0, len(answer) + 1, unit) + answer)

    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), Client) as server:
        server.daemon_threads = True
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        yield f"tcp://127.0.0.1:{server.server_address[1]}"
        server.shutdown()


def crc(data):
    """CRC of a frame of Modbus RTU (MODBUS over serial line V1.02, 6.2.2)."""
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ 0xA001 * (value & 1)
    return struct.pack("<H", value)


@contextlib.contextmanager
def rtu(units):
    """A serial line of Modbus RTU; yields its device."""
    ours, theirs = pty.openpty()
    tty.setraw(theirs)

    def serve():
        frame = b""
        with contextlib.suppress(OSError):
            while True:
                frame += os.read(ours, 256)
                while len(frame) >= 8:  # each request here has 8 bytes
                    unit, request, frame = frame[0], frame[1:6], frame[8:]
                    if answer := units.answer(unit, request):
                        whole = bytes([unit]) + answer
                        os.write(ours, whole + crc(whole))

    threading.Thread(target=serve, daemon=True).start()
    yield os.ttyname(theirs)
    os.close(theirs)
    os.close(ours)


def stop(*on, more=()):
    return verbs.forceaxis("axis", "stop", *(w for text in on for w in ("--on", text)), *more)


def stopped(done):
    return sorted(line.partition(": ")[0] for line in done.stdout.splitlines() if "stopped" in line)


@pytest.mark.parametrize("bus", [tcp, rtu])
def test_every_axis_of_a_line_is_commanded_before_one_has_stopped(bus):
    units = Units(together=(1, 2, 3))
    with bus(units) as place:
        form = f"serial:{place}:{{}}" if bus is rtu else f"{place}/{{}}"
        done = stop(*(form.format(unit) for unit in (1, 2, 3)))
    assert done.returncode == 0, done.stderr
    assert units.commands[:3] == [1, 2, 3] and len(stopped(done)) == 3


def test_each_dead_axis_delays_the_others_by_one_time_out():
    units = Units(together=(1, 2), dead=(5, 6, 7))
    with tcp(units) as place:
        done = stop(*(f"{place}/{unit}" for unit in (5, 6, 1, 7, 2)))
    assert units.commands[:5] == [5, 6, 1, 7, 2]
    assert done.returncode == 1 and stopped(done) == [f"{place}/1", f"{place}/2"]
    told = [line.partition(": ")[2].partition(": ")[0] for line in done.stderr.splitlines()]
    assert sorted(told) == [f"{place}/{unit}" for unit in (5, 6, 7)]


def test_an_axis_whose_first_command_was_disturbed_gets_another_before_any_is_waited_for():
    units = Units(together=(1, 2))
    lost = iter([1])

    def lose_first(unit):
        if unit == next(lost, None):
            units.commands.remove(unit)
            units.dead = {unit}
        else:
            units.dead = set()

    units.on_command = lose_first
    with tcp(units) as place:
        done = stop(f"{place}/1", f"{place}/2")
    assert (done.returncode, units.commands[:2]) == (0, [2, 1]), done.stderr


@pytest.mark.parametrize(
    ("number", "status"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)], ids=["SIGTERM", "SIGINT"]
)
def test_a_program_that_is_ended_commands_each_axis_first(number, status):
    units = Units(together=(1, 2), stops=False)
    # The system may deliver a signal to any thread: here to that of the server.
    units.on_command = lambda _unit: (
        units.commands == [1] and signal.pthread_kill(threading.get_ident(), number)
    )
    before = signal.signal(signal.SIGTERM, lambda *_: None)
    try:
        with tcp(units) as place:
            done = stop(f"{place}/1", f"{place}/2")
    finally:
        signal.signal(signal.SIGTERM, before)
    assert (done.returncode, units.commands[:2]) == (status, [1, 2]), done.stderr
    assert done.stderr.count("\n") == 1 and "interrupted; each axis that can" in done.stderr
    assert f"without a report yet: {place}/1, {place}/2" in done.stderr


def test_two_spellings_of_a_serial_line_are_one_line(tmp_path):
    units = Units(together=(1, 2))
    with rtu(units) as device:
        (tmp_path / "by-id").symlink_to(device)
        done = stop(f"serial:{tmp_path}/by-id@115200:1", f"serial:{device}:2", f"serial:{device}:1")
    assert done.returncode == 0, done.stderr
    assert stopped(done) == sorted([f"serial:{tmp_path}/by-id@115200:1", f"serial:{device}:2"])


def test_a_second_bit_rate_of_a_device_is_told_and_the_axes_of_the_first_are_stopped(monkeypatch):
    links = []

    def silent(own, *_):
        links.append(str(own))
        raise NoAnswer("silent")

    monkeypatch.setattr(address.SerialAddress, "link", silent)
    done = stop("serial:/dev/x:1", "serial:/dev/../dev/x@9600:2", "serial:/dev/x:3")
    assert links[:3] == ["serial:/dev/x:1", "serial:/dev/../dev/x@9600:2", "serial:/dev/x:3"]
    assert done.stderr.splitlines()[0] == (
        "forceaxis: warning: serial:/dev/../dev/x@9600:2: expected the bit rate of "
        "serial:/dev/x:1, 115200 bit/s, on the same device, got 9600 bit/s"
    )


@pytest.mark.quick
@pytest.mark.parametrize(
    ("texts", "lines"),
    [
        ("tcp://h/1 tcp://H:502/2 tcp://h:503/1", "tcp://h/1 tcp://H:502/2, tcp://h:503/1"),
        ("tcp://h/1 tcp://H:502/1", "tcp://h/1"),
        ("serial:/dev/x:1 serial:/dev/x@115200:1 serial:/dev/x", "serial:/dev/x:1"),
        ("serial:/dev/x:1 serial:/dev/y:1", "serial:/dev/x:1, serial:/dev/y:1"),
        ("can0:5 can0:5@125 can0:6 can1:5", "can0:5, can0:6, can1:5"),
        ("lcm:1 lcm:2 sim:contact", "lcm:1, lcm:2, sim:contact"),
    ],
)
def test_what_may_not_be_open_at_the_same_time_is_one_line(texts, lines):
    each = [AxisConnection((address.numbered(address.parse(text)),)) for text in texts.split()]
    found = [" ".join(str(one.address) for one in line) for line in axis_stop.lines_of(each)]
    assert ", ".join(found) == lines


def test_the_axes_that_are_named_are_stopped_beside_wrong_addresses(monkeypatch):
    monkeypatch.setenv("FORCEAXIS_AXIS", "sim:contact")
    done = stop("sim:contact", "lcm", "can0:200", "sim:nonesuch")
    assert done.returncode == 2 and stopped(done) == ["sim:contact"]
    told = done.stderr.splitlines()
    assert len(told) == 3 and all("expected" in line for line in told), told
    for text in ("lcm: ", "can0:200: ", "nonesuch: "):
        assert sum(f"{text}expected" in line for line in told) == 1
    done = stop("sim:contact", "can0:200", more=("--set", "k_w=1 N/m", "--json"))
    assert done.returncode == 2 and '"axis": "sim:contact"' in done.stdout
    done = stop("can0:200")  # the axis of the environment was not named
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)


def test_a_warning_of_a_connection_is_printed_for_each_of_several_axes():
    scale = ("--set", "firmware.force_scale=1000000")
    one, other = (stop("sim:contact", *more, more=scale).stderr for more in ((), ("sim:hold_p",)))
    for done, names in ((one, ["contact"]), (other, ["contact", "hold_p"])):
        told = sorted(line for line in done.splitlines() if "expected force_scale" in line)
        assert len(told) == len(names)
        for name, line in zip(names, told, strict=True):
            assert line.startswith("forceaxis: warning: ") and f"{name}.toml: " in line
