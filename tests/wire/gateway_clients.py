"""Speaks to a gateway and its axis: raw CAN, Modbus TCP by hand, the gateway as a process, and an
axis that is driven over each bus."""

import socket
import struct
import subprocess
import tempfile
import time

from forceaxis.bus.client import AxisClient, NoAnswer
from forceaxis.experiments import link
from forceaxis.objects import BY_NAME

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

    def frames(self, seconds, last=lambda identifier, data: False):
        """[(time, id, data)] of a while, which ends half a second after a frame that is `last`."""
        received, end = [], time.monotonic() + seconds
        while (remaining := end - time.monotonic()) > 0:
            frame = self.receive(remaining)
            if frame:
                received.append((time.monotonic(), *frame))
                if last(*frame):
                    end = min(end, time.monotonic() + 0.5)
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


def gateway(*args, ready=True, port=PORT, heartbeat_ms=HEARTBEAT_MS, sdo_ms=3000):
    errors = tempfile.TemporaryFile("w+")  # noqa: SIM115 - it lives as long as the program
    words = [link.program("gateway"), "--modbus-port", str(port), *args]
    words += ["--heartbeat-ms", str(heartbeat_ms), "--sdo-timeout-ms", str(sdo_ms)]
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


def operational(axis):
    try:
        s = axis.state(0.5)
    except NoAnswer:
        return None
    ready = s.nmt_state == 5 and s.fault != s.NOT_AVAILABLE and s.statusword != s.NOT_AVAILABLE
    return s if ready else None


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
