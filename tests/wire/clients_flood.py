"""Item 6 of the clients' session: the axis under a flood of frames, and the 402 client after it.

The flood excludes identifiers that the node itself sends, so that each recorded frame has a known
sender, and COB-IDs, the recorder, the start of an excitation and the count of lost frames, as in
canopen_flood.cpp.
"""

import random
import signal
import socket
import struct
import subprocess
import time
from pathlib import Path

from canopen.sdo.exceptions import SdoError

FRAME = struct.Struct("=IB3x8s")
REMOTE = 0x40000000
NODE = 1
SEED = 6
SECONDS = 6
FOREIGN = "2AA"  # no node's
BURST = 30_000
OWN = {0x081, 0x181, 0x281, 0x381, 0x481, 0x581, 0x5C1, 0x5E1, 0x701}
HIDDEN = {0x1005, 0x1014, 0x2030, 0x2107, 0x2309, *range(0x1400, 0x1404), *range(0x1800, 0x1804)}
# Frequent indices of requests; other indices are rare.
INDICES = [
    0x1000, 0x1001, 0x1003, 0x1008, 0x100A, 0x1010, 0x1011, 0x1015, 0x1016, 0x1017, 0x1018, 0x1029,
    0x1600, 0x1A00, 0x1A02, 0x200A, 0x2021, 0x2301, 0x230A, 0x230B, 0x6040, 0x6041, 0x6060, 0x6061,
    0x6064, 0x607A, 0x60FF, 0x6071, 0x6098,
]  # fmt: skip
COMMANDS = [
    0x40,
    0x40,
    0x40,
    0x2F,
    0x2B,
    0x23,
    0x27,
    0x22,
    0x21,
    0x20,
    0x60,
    0x70,
    0x00,
    0x0F,
    0x80,
]


def record(log):
    """candump, writing all of vcan0 and what it could not receive to a file."""
    with log.open("w") as out:
        dump = subprocess.Popen(["candump", "-L", "-d", "-r", "80000000", "vcan0"], stdout=out)
    time.sleep(0.2)
    return dump


def overrun():
    """Frames that vcan0 dropped before any socket, because the kernel's backlog was full."""
    lines = Path("/proc/net/dev").read_text().splitlines()
    [counts] = (line.split(":")[1].split() for line in lines if line.strip().startswith("vcan0:"))
    return int(counts[3])  # received: bytes, packets, errors, dropped


def stop(dump, log):
    """Ends candump on a quiet bus; frames that it has not read yet would be lost."""
    size, end = -1, time.monotonic() + 10
    while size != log.stat().st_size and time.monotonic() < end:
        size = log.stat().st_size
        time.sleep(0.5)
    assert dump.poll() is None, f"candump ended by itself, status {dump.returncode}"
    dump.send_signal(signal.SIGINT)
    dump.wait(10)


def request(rng):
    index = rng.choice(INDICES) if rng.random() < 0.9 else rng.randrange(0x10000)
    command = rng.choice(COMMANDS) if rng.random() < 0.9 else rng.randrange(256)
    value = rng.choice((rng.randrange(4), rng.randrange(256), rng.getrandbits(32)))
    data = struct.pack("<BHBI", command, index, rng.randrange(4), value)
    return rng.choice((0x601, 0x601, 0x601, 0x641, 0x661)), data


def random_frame(rng):
    """Identifier and data of a frame that the node receives or ignores."""
    choice = rng.random()
    if choice < 0.35:
        identifier, data = request(rng)
    elif choice < 0.50:
        rpdo = rng.randrange(4)
        identifier = 0x201 + 0x100 * rpdo
        word = struct.pack("<H", rng.choice((0, 2, 6, 7, 15, 31, 128, rng.randrange(65536))))
        data = word + rng.randbytes((1, 4, 4, 2)[rpdo])
    elif choice < 0.55:
        identifier, data = 0x080, b""
    elif choice < 0.56:
        nmt = rng.choice((1, 1, 1, 1, 2, 128, 129, 130))
        identifier, data = 0, bytes([nmt, rng.choice((0, NODE, NODE, 5))])
    elif choice < 0.60:
        identifier, data = 0x702 + rng.randrange(5), b"\x05"
    else:
        identifier, data = rng.randrange(0x800), rng.randbytes(rng.randrange(9))
    if rng.random() < 0.02:
        data = data[: rng.randrange(9)]
    if rng.random() < 0.005:
        identifier, data = identifier | REMOTE, b""
    return identifier, data


def allowed(identifier, data):
    if identifier & 0x7FF in OWN:
        return False
    index = int.from_bytes(data[1:3], "little")
    return not (0x600 <= identifier & 0x7FF <= 0x67F and index in HIDDEN)


def random_frames(seconds):
    """Sends random frames, some thousand a second; returns their number."""
    rng = random.Random(SEED)
    sent = 0
    with socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as bus:
        bus.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, b"")  # only sends
        bus.bind(("vcan0",))
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            for _ in range(100):
                identifier, data = random_frame(rng)
                if allowed(identifier, data):
                    bus.send(FRAME.pack(identifier, len(data), data))
                    sent += 1
            time.sleep(0.002)
    return sent


def too_many(nodes):
    """More frames than a socket buffers, sent while axis_node is suspended; their number."""
    nodes.axis.send_signal(signal.SIGSTOP)
    words = ["cangen", "vcan0", "-I", FOREIGN, "-L", "8", "-g", "0", "-n", str(BURST), "-i"]
    subprocess.run(words, check=True, timeout=30)
    nodes.axis.send_signal(signal.SIGCONT)
    return BURST


def lost(client):
    """can_lost after the axis has caught up: earlier responses belong to frames of the flood, and
    the node may have been stopped."""
    for attempt in range(50):
        time.sleep(0.1)
        client.drive.nmt.state = "PRE-OPERATIONAL"
        try:
            return {"can_lost": client.drive.sdo[0x2309].raw, "attempts": attempt + 1}
        except SdoError:
            continue
    raise TimeoutError("no answer after the flood")


def flood(folder, steps, make_nodes, make_client, brief):
    before = overrun()
    dump = record(folder / "flood.log")
    nodes = make_nodes(folder, "flood")
    # The session under a flood of identifiers that the node ignores.
    words = ["cangen", "vcan0", "-I", FOREIGN, "-L", "8", "-g", "1", "-i"]
    noise = subprocess.Popen(words)
    client = make_client()
    steps("beside_noise", brief, client)
    client.close()
    noise.kill()
    noise.wait()
    steps("random_frames", random_frames, SECONDS)
    steps("too_many", too_many, nodes)
    client = make_client()
    steps("lost", lost, client)
    steps("reset", client.reset, "RESET")
    steps("after_flood", brief, client)
    client.close()
    steps("flood_nodes", nodes.finish)
    stop(dump, folder / "flood.log")
    steps("flood_overrun", lambda: overrun() - before)
