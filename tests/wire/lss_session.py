"""The session of test_lss.py on real CAN, in one guest: run under tools/vcan with a folder to write
to. python-canopen is the LSS master of four axis_nodes without id; its steps have what it saw.
"""

import contextlib
import itertools
import subprocess
import sys
import time
from pathlib import Path

import canopen
from canopen.lss import CS_INQUIRE_SERIAL_NUMBER, LssError
from steps import Steps

ROOT = Path(__file__).resolve().parents[2]
AXIS_NODE = ROOT / "build/release/host/axis_node"
EXPERIMENT = ROOT / "sim/experiments/contact.toml"
EDS = ROOT / "firmware/objects/generated/forceaxis.eds"
VENDOR, PRODUCT, REVISION = 0, int.from_bytes(b"FAX1", "big"), 1
SERIALS = [0x100, 0x1, 0x80000000, 0x101]
CHOSEN = 3  # of them: selected alone, and recorded with
BYTES = 30 * 1024
UNCONFIGURED = 255
# Without an answer the fast scan takes a bit for 1; one that is late fails the scan.
SCAN_S, ANSWER_S = 0.06, 3.0
SCANS = 40  # at most, of all nodes


class Bus:
    """Four axis_nodes, and the master. `ids`: how many frames of each identifier were received."""

    def __init__(self, folder):
        self.folder = folder
        self.nodes = []
        self.ids = {}
        self.network = canopen.Network()
        self.network.connect(interface="socketcan", channel="vcan0")
        self.network.notifier.add_listener(self.count)
        self.lss = self.network.lss
        self.lss.RESPONSE_TIMEOUT = ANSWER_S

    def count(self, message):
        self.ids[message.arbitration_id] = self.ids.get(message.arbitration_id, 0) + 1

    def start(self):
        """They tick by themselves: no plant ever comes."""
        for i, serial in enumerate(SERIALS):
            words = [
                AXIS_NODE, EXPERIMENT, "--link", "socketcan", "--first-axis", i + 1,
                "--start-timeout", "0.05", "--hold", "600", "--can", "vcan0", "--node-id",
                UNCONFIGURED, "--serial", serial, "--store", self.folder / f"store{i}",
            ]  # fmt: skip
            node = subprocess.Popen(
                [str(w) for w in words],
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
            )  # fmt: skip
            assert "ready" in node.stdout.readline()
            self.nodes.append(node)

    def stop(self, but=None):
        """Ends the nodes, all but one of them."""
        for i, node in enumerate(self.nodes):
            if i != but:
                node.terminate()
                node.communicate(timeout=30)
        self.nodes = [] if but is None else [self.nodes[but]]

    def heard(self, seconds):
        """The node ids that send anything but LSS within a time."""
        self.ids = {}
        time.sleep(seconds)
        return sorted({i & 0x7F for i in self.ids if i != 0x7E4})

    def waiting(self):
        self.lss.send_switch_state_global(self.lss.WAITING_STATE)

    def scan(self):
        """The address of one node, which is in configuration then; None: there is none. A scan that
        missed an answer on a busy machine is repeated."""
        for _ in range(SCANS):
            self.waiting()
            self.lss.RESPONSE_TIMEOUT = SCAN_S
            found, address = self.lss.fast_scan()
            self.lss.RESPONSE_TIMEOUT = ANSWER_S
            if not found and address is None and not self.is_any():
                return None
            with contextlib.suppress(LssError):
                if found and self.lss.inquire_lss_address(CS_INQUIRE_SERIAL_NUMBER) == address[3]:
                    return address
        raise TimeoutError(f"no node after {SCANS} scans")

    def is_any(self):
        """Whether a node without id answers."""
        before = self.ids.get(0x7E4, 0)
        self.lss.send_identify_non_configured_remote_slave()
        time.sleep(0.3)
        return self.ids.get(0x7E4, 0) > before

    def node(self, node_id):
        node = self.network.add_node(node_id, str(EDS))
        node.sdo.RESPONSE_TIMEOUT = ANSWER_S
        return node


def selected_alone(bus):
    """One node is given an id and gives it back; nobody else sends anything."""
    bus.start()
    silent = bus.heard(0.5)
    found = bus.lss.send_switch_state_selective(VENDOR, PRODUCT, REVISION, SERIALS[CHOSEN])
    bus.lss.configure_node_id(20)
    before = bus.heard(0.3)
    bus.waiting()
    given = bus.heard(0.7)
    node_id = bus.node(20).sdo[0x2308].raw
    bus.lss.send_switch_state_selective(VENDOR, PRODUCT, REVISION, SERIALS[CHOSEN])
    bus.lss.configure_node_id(UNCONFIGURED)
    bus.waiting()
    bus.network.send_message(0, [130, 20])
    time.sleep(0.1)
    return {
        "silent": silent, "found": found, "before": before, "given": given, "node_id": node_id,
        "back": bus.heard(0.5),
    }  # fmt: skip


def scanned(bus):
    """Each of the four is found, gets id and bit rate, and stores them."""
    found, begin = [], time.monotonic()
    while len(found) <= len(SERIALS) and (address := bus.scan()) is not None:
        bus.lss.configure_node_id(10 + len(found))
        bus.lss.configure_bit_timing(2 + len(found) % 2)
        bus.lss.store_configuration()
        found.append(address)
        bus.waiting()
    seconds = time.monotonic() - begin
    print(f"fast scan of {len(found)} nodes: {seconds:.1f} s", file=sys.stderr)
    return {"found": found, "heard": bus.heard(0.7)}


def restarted(bus, scan):
    """Id and bit rate after another start of the process."""
    bus.stop()
    bus.start()
    heard = bus.heard(0.7)
    nodes = {}
    for i, address in enumerate(scan["found"]):
        node = bus.node(10 + i)
        values = [node.sdo[index].raw for index in (0x2308, 0x2310, 0x2311)]
        nodes[address[3]] = [*values, node.sdo[0x1018][4].raw]
    return {"heard": heard, "nodes": nodes}


def uploaded(node, **options):
    begin = time.monotonic()
    with node.sdo.open(0x2120, 0, "rb", buffering=0, **options) as stream:
        data = b"".join(iter(lambda: stream.read(7), b""))
    return data, time.monotonic() - begin


def recorded(bus, scan):
    """A recording of 30 KiB, by blocks and by segments."""
    bus.stop(but=CHOSEN)  # the machine's time for the one
    place = [address[3] for address in scan["found"]].index(SERIALS[CHOSEN])
    node = bus.node(10 + place)
    node.sdo[0x2100][1].raw = 0x201F00  # tick_count, 4 bytes
    node.sdo[0x2106].raw = BYTES // 4
    node.sdo[0x2107].raw = 1
    end = time.monotonic() + 60
    while node.sdo[0x2108].raw != 3:
        assert time.monotonic() < end, "no recording"
        time.sleep(0.2)
    blocks, fast = uploaded(node, block_transfer=True)
    segments, slow = uploaded(node)
    print(f"30 KiB: {fast:.2f} s by blocks, {slow:.2f} s by segments", file=sys.stderr)
    ticks = [int.from_bytes(blocks[i : i + 4], "little") for i in range(0, len(blocks), 4)]
    return {
        "bytes": [len(blocks), len(segments)],
        "equal": blocks == segments,
        "steps": sorted({b - a for a, b in itertools.pairwise(ticks)}),
    }


def main():
    folder = Path(sys.argv[1])
    bus = Bus(folder)
    try:
        with Steps(folder) as steps:
            steps("selected", selected_alone, bus)
            steps["scanned"] = scanned(bus)  # the others need what it found
            steps("restarted", restarted, bus, steps["scanned"])
            steps("recorded", recorded, bus, steps["scanned"])
    finally:
        for node in bus.nodes:
            node.kill()
        bus.network.disconnect()


if __name__ == "__main__":
    main()
