"""Modbus TCP of noise and mutated real requests, none of which could enable an axis."""

import contextlib
import random
import socket
import struct
from pathlib import Path

REQUESTS = Path(__file__).with_name("modbus_requests.txt")
MOST = 3000  # bytes of one connection
PATIENCE_S = 0.02
WRITES = b"\x05\x06\x0f\x10\x16\x17"
PARAMETERS = 0x0100  # the registers from here on are none of the drive's commands


def requests():
    """The table's requests that command nothing, as frames to unit 1."""
    found = []
    for line in REQUESTS.read_text().splitlines():
        request, equals, _ = line.partition("#")[0].partition("=")
        words = request.replace("UU", "01")
        if equals and "H" not in words and "L" not in words:
            pdu = bytes.fromhex(words)
            if pdu[0] in WRITES and int.from_bytes(pdu[1:3], "big") < PARAMETERS:
                continue
            found.append(struct.pack(">HHHB", len(found), 0, len(pdu) + 1, 1) + pdu)
    return found


def mutated(frame, real, rng):
    data = bytearray(frame)
    for _ in range(rng.randint(1, 3)):
        at = rng.randrange(len(data) or 1)
        kind = rng.randrange(5)
        if not data:
            break
        if kind == 0:
            data[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            data[at] = rng.choice((0, 1, 0x7F, 0x80, 0xFF))
        elif kind == 2:
            del data[at:]
        elif kind == 3:
            data[at:at] = rng.randbytes(rng.randint(1, 64))
        else:
            data[at:] = rng.choice(real)[at:]
    return bytes(data)


def connection(real, rng):
    """What one client says: a quarter noise, else requests, three in four of them whole."""
    if rng.randrange(4) == 0:
        return rng.randbytes(rng.randint(1, 600))
    said = b""
    while len(said) < MOST and rng.randrange(40):
        frame = rng.choice(real)
        said += frame if rng.randrange(4) else mutated(frame, real, rng)
    return said


def pour(port, count, seed, meanwhile):
    """Says `count` bytes to the server; `meanwhile` is called now and then. Returns how many bytes
    were accepted, in how many connections, and how many came back."""
    real, rng = requests(), random.Random(seed)
    said = clients = answered = 0
    while said < count:
        if clients % 500 == 0:
            meanwhile()
        clients += 1
        with socket.create_connection(("127.0.0.1", port), timeout=5) as client:
            data = connection(real, rng)[: count - said]
            said += len(data)
            # The server closes what is none; what it is still about to answer is not waited for.
            with contextlib.suppress(OSError):
                client.sendall(data)
                client.settimeout(PATIENCE_S)
                while answer := client.recv(4096):
                    answered += len(answer)
    return {"bytes": said, "clients": clients, "answered": answered}
