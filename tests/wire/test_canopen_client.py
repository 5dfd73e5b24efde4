"""python-canopen, an independent implementation, as the client of the firmware's node."""

import ctypes
import itertools
import queue
import struct
import threading
import time
from pathlib import Path

import can
import canopen
import pytest
from forceaxis._core import cycle_program
from forceaxis.cycles.program import with_program

ROOT = Path(__file__).resolve().parents[2]
EDS = ROOT / "firmware/objects/generated/forceaxis.eds"
NODE = 5


class AxisBus(can.BusABC):
    """A CAN bus with one axis on it, whose ticks pass in real time."""

    def __init__(self):
        super().__init__(channel="axis")
        self.library = ctypes.CDLL(str(ROOT / "build/release/tests/wire/libcanopen_bus.so"))
        self.library.axis_new.restype = ctypes.c_void_p
        self.axis = ctypes.c_void_p(self.library.axis_new(NODE))
        self.frames = queue.Queue()
        self.lock = threading.Lock()
        self.open = True
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def run(self):
        begin, ticks = time.monotonic(), 0
        while self.open:
            due = int((time.monotonic() - begin) * 1500)
            with self.lock:
                while ticks < due:
                    ticks += 1
                    self.library.axis_ticks(self.axis, 1)
                    self.drain()
            time.sleep(0.001)

    def drain(self):
        data = (ctypes.c_uint8 * 8)()
        while (head := self.library.axis_transmit(self.axis, data)) >= 0:
            self.frames.put(
                can.Message(
                    arbitration_id=head // 16,
                    data=bytes(data)[: head % 16],
                    is_extended_id=False,
                    timestamp=time.time(),
                )
            )

    def send(self, msg, timeout=None):
        with self.lock:
            self.library.axis_receive(
                self.axis, msg.arbitration_id, msg.is_remote_frame, bytes(msg.data), len(msg.data)
            )
            self.drain()

    def _recv_internal(self, timeout):
        try:
            return self.frames.get(timeout=timeout), False
        except queue.Empty:
            return None, False

    def shutdown(self):
        self.open = False
        self.thread.join()
        super().shutdown()
        self.library.axis_delete(self.axis)


@pytest.fixture
def node():
    network = canopen.Network(bus=AxisBus())
    network.connect()
    try:
        found = network.add_node(NODE, str(EDS))
        assert found.nmt.wait_for_heartbeat(2) == "PRE-OPERATIONAL"
        yield found
    finally:
        network.disconnect()


def test_every_object_of_the_data_sheet_can_be_read(node):
    count = 0
    for entry in node.object_dictionary.values():
        for variable in [entry] if hasattr(entry, "data_type") else entry.values():
            if "r" not in variable.access_type or variable.data_type == 15:
                continue  # a domain, which is empty
            if variable.index == 0x1003 and variable.subindex > 0:
                continue  # no error yet, so there is none to read
            upload = node.sdo.upload(variable.index, variable.subindex)
            assert variable.data_type == 9 or len(upload) == len(variable) // 8, variable.name
            count += 1
    assert count > 250
    assert node.sdo[0x1008].raw == "forceaxis"


def test_boots_after_every_reset(node):
    # Not wait_for_bootup(): the message arrives before that starts to wait.
    received = queue.Queue()
    node.network.subscribe(0x700 + NODE, lambda _id, data, _time: received.put(bytes(data)))
    for command in ("RESET", "RESET COMMUNICATION"):
        node.nmt.state = command
        while received.get(timeout=2) != b"\0":
            pass
        node.nmt.state = "OPERATIONAL"
        while received.get(timeout=2) != b"\5":
            pass


def test_pdos_are_mapped_and_used(node):
    node.tpdo.read()
    node.rpdo.read()
    node.tpdo[3].clear()
    node.tpdo[3].add_variable(0x6064)
    node.tpdo[3].add_variable(0x201F)
    node.tpdo[3].trans_type = 255
    node.tpdo[3].inhibit_time = 100
    node.tpdo[3].event_timer = 20
    node.tpdo[3].enabled = True
    node.rpdo[4].clear()
    node.rpdo[4].add_variable(0x6071)
    node.rpdo[4].add_variable(0x607A)
    node.rpdo[4].enabled = True
    node.tpdo.save()
    node.rpdo.save()
    node.nmt.state = "OPERATIONAL"
    assert node.tpdo[3].wait_for_reception(2) is not None
    first = node.tpdo[3][1].raw
    assert node.tpdo[3].wait_for_reception(2) is not None
    # 10 ms of inhibit time are 15 ticks; a busy machine may have let more pass.
    assert node.tpdo[3][1].raw - first >= 15
    node.rpdo[4][0].raw = -123
    node.rpdo[4][1].raw = 456789
    node.rpdo[4].transmit()
    assert node.sdo[0x6071].raw == -123
    assert node.sdo[0x607A].raw == 456789


def test_refusals_have_their_codes(node):
    with pytest.raises(canopen.SdoAbortedError) as refusal:
        node.sdo[0x1400][2].raw = 252
    assert refusal.value.code == 0x06090030
    with pytest.raises(canopen.SdoAbortedError) as refusal:
        node.sdo.download(0x6041, 0, b"\0\0")
    assert refusal.value.code == 0x06010002
    with pytest.raises(canopen.SdoAbortedError) as refusal:
        node.sdo.upload(0x1003, 1)
    assert refusal.value.code == 0x08000024
    with pytest.raises(canopen.SdoAbortedError) as refusal:
        node.sdo[0x1003][0].raw = 1
    assert refusal.value.code == 0x06090030
    with pytest.raises(canopen.SdoAbortedError) as refusal:
        node.sdo[0x1800][1].raw = 0x80000180 + NODE
    assert refusal.value.code == 0x06090030


def test_the_recording_comes_in_one_piece(node):
    node.sdo[0x2100][1].raw = 0x201F00
    node.sdo[0x2106].raw = 1000
    node.sdo[0x2107].raw = 1
    for _ in range(200):
        if node.sdo[0x2108].raw == 3:
            break
        time.sleep(0.01)
    data = node.sdo.upload(0x2120, 0)
    ticks = [int.from_bytes(data[i : i + 4], "little") for i in range(0, len(data), 4)]
    assert ticks == list(range(ticks[0], ticks[0] + 1000))


def noise(seed, count):
    """The values of the excitation's noise, Q15: the upper half of Knuth's generator."""
    state = seed * 2654435769
    for _ in range(count):
        state = (state * 1664525 + 1013904223) % (1 << 32)
        yield (state >> 16) - (1 << 16 if state >> 31 else 0)


def test_a_start_of_the_excitation_triggers_the_recorder(node):
    """Pressed at 30 counts: the sample at the trigger is the waveform's first value."""
    sdo, before = node.sdo, 7
    sdo[0x200E].raw = -30 * 256  # a tare that makes no reading one in contact
    sdo[0x2005].raw = 9  # seed
    sdo[0x2032].raw, sdo[0x2034].raw = 100, 0  # codes; no ramp
    sdo[0x6060].raw = -1
    for word in (6, 7, 15):
        sdo[0x6040].raw = word
    sdo[0x2100][1].raw, sdo[0x2100][2].raw = 0x203900, 0x203800
    sdo[0x2103].raw, sdo[0x2105].raw, sdo[0x2106].raw = 4, before, 200
    sdo[0x2107].raw = 1
    time.sleep(0.05)
    assert sdo[0x2108].raw == 1
    sdo[0x2030].raw = 1
    with pytest.raises(canopen.SdoAbortedError) as refusal:
        sdo[0x2030].raw = 1  # it runs already
    assert refusal.value.code == 0x08000022
    for _ in range(200):
        if sdo[0x2108].raw == 3:
            break
        time.sleep(0.01)
    data, at = sdo.upload(0x2120, 0), sdo[0x210B].raw
    assert at == before
    samples = [struct.unpack_from("<iB", data, 5 * i) for i in range(len(data) // 5)]
    assert samples[:at] == [(0, 0)] * at
    wanted = [(100 * 256 * value >> 15, 11) for value in noise(9, len(samples) - at)]
    assert samples[at:] == wanted
    sdo[0x6040].raw = 0x10F  # halt
    time.sleep(0.05)
    assert (sdo[0x2038].raw, sdo[0x2039].raw) == (5, 0)


def record_everything(node):
    """A finished recording that of 12 KiB."""
    node.sdo[0x2100][1].raw = 0x201F00
    node.sdo[0x2106].raw = 3072
    node.sdo[0x2107].raw = 1
    for _ in range(500):
        if node.sdo[0x2108].raw == 3:
            return
        time.sleep(0.01)
    pytest.fail("no recording")


def uploaded(node, index, sub, **options):
    begin = time.monotonic()
    with node.sdo.open(index, sub, "rb", buffering=0, **options) as stream:
        data = b"".join(iter(lambda: stream.read(7), b""))
    return data, time.monotonic() - begin


def test_the_recording_comes_by_blocks(node):
    record_everything(node)
    segments, slow = uploaded(node, 0x2120, 0)
    assert len(segments) == 12288
    for with_crc in (True, False):
        blocks, fast = uploaded(node, 0x2120, 0, block_transfer=True, request_crc_support=with_crc)
        assert blocks == segments
        print(f"12 KiB: {fast:.2f} s by blocks, {slow:.2f} s by segments")
    text, _ = uploaded(node, 0x1008, 0, block_transfer=True)
    assert text == b"forceaxis"


def test_values_are_written_by_blocks(node):
    for value in (0x12345678, -5):
        data = value.to_bytes(4, "little", signed=True)
        with node.sdo.open(0x607A, 0, "wb", size=4, block_transfer=True) as stream:
            stream.write(data)
        assert node.sdo[0x607A].raw == value
    with (
        pytest.raises(canopen.SdoAbortedError) as refusal,
        node.sdo.open(0x200F, 0, "wb", size=1, block_transfer=True) as stream,
    ):
        stream.write(bytes([17]))
    assert refusal.value.code == 0x06090031


def put(node, record, **options):
    with node.sdo.open(0x2435, 1, "wb", size=len(record), **options) as stream:
        stream.write(record)


def test_a_program_is_downloaded_and_selected(node):
    record = cycle_program(ROOT / "sim/experiments/press_fit.toml").record
    number = int.from_bytes(record[16:20], "little")
    for options in (
        {},
        {"block_transfer": True},
        {"block_transfer": True, "request_crc_support": False},
    ):
        put(node, record, **options)
        assert node.sdo[0x2435][3].raw == 1
        node.sdo[0x2435][2].raw = number
        assert node.sdo[0x2435][4].raw == int.from_bytes(record[-4:], "little")
        wrong = bytearray(record)
        wrong[50] ^= 1
        with pytest.raises(canopen.SdoAbortedError) as refusal:
            put(node, bytes(wrong), **options)
        assert refusal.value.code == 0x06090030
        assert node.sdo[0x2435][5].raw == 4, "wrong_crc"
        assert node.sdo[0x2435][3].raw == 1
        node.sdo[0x2435][7].raw = number
        assert node.sdo[0x2435][2].raw == node.sdo[0x2435][3].raw == 0


PROGRAM = """
title = "Waits"
number = 7

[[phase]]
name = "one"
do = "wait"
force_max = "100 N"
travel_max = "1 mm"
time_max = "2 s"

[[phase.end]]
when = "time"
value = "0.1 s"
next = "two"

[[phase]]
name = "two"
do = "wait"
force_max = "100 N"
travel_max = "1 mm"
time_max = "2 s"

[[phase.end]]
when = "time"
value = "0.2 s"
next = "end"
"""


def test_the_curve_of_a_cycle_is_uploaded(node, tmp_path):
    curve = 0x243B, 6
    with pytest.raises(canopen.SdoAbortedError) as refusal:
        node.sdo.upload(*curve)
    assert refusal.value.code == 0x08000024, "no cycle yet"
    program = tmp_path / "waits.toml"
    program.write_text(PROGRAM)
    compiled = cycle_program(ROOT / "sim/experiments/press_fit.toml", with_program((), program))
    put(node, compiled.record)
    node.sdo[0x2435][2].raw = 7
    node.sdo[0x6060].raw = -9
    for word in (6, 7, 15, 31):
        node.sdo[0x6040].raw = word
        time.sleep(0.05)
    with pytest.raises(canopen.SdoAbortedError) as refusal:
        node.sdo.upload(*curve)
    assert refusal.value.code == 0x08000022, "it runs"
    for _ in range(200):
        if node.sdo[0x2434][1].raw == 3:
            break
        time.sleep(0.01)
    segments, _ = uploaded(node, *curve)
    assert len(segments) == 12 * node.sdo[0x243B][4].raw
    for options in ({}, {"request_crc_support": False}):
        blocks, _ = uploaded(node, *curve, block_transfer=True, **options)
        assert blocks == segments
    points = [struct.unpack_from("<Iii", segments, at) for at in range(0, len(segments), 12)]
    # 15 ticks from point to point by default, from the begin of each phase on; nothing moves.
    times = [*range(1, 451, 15), 450]
    assert points == [(at, 0, int(at > 150)) for at in times]


def test_segments_that_are_lost_are_asked_for_again(node):
    record_everything(node)
    expected, _ = uploaded(node, 0x2120, 0)
    # The client's own loss: a segment now and then does not reach it.
    receive, count = node.network.notify, itertools.count(1)

    def lossy(can_id, data, timestamp):
        if can_id != 0x580 + NODE or data[0] & 0x80 or next(count) % 50:
            receive(can_id, data, timestamp)

    node.network.notify = lossy
    blocks, _ = uploaded(node, 0x2120, 0, block_transfer=True)
    assert blocks == expected and next(count) > 1800


def test_a_broken_pdo_is_an_emergency(node):
    node.nmt.state = "OPERATIONAL"
    node.network.send_message(0x300 + NODE, b"\0")
    emergency = node.emcy.wait(0x8210, timeout=2)
    assert emergency is not None
    assert emergency.data[0] == 2
    assert node.sdo[0x1003][1].raw & 0xFFFF == 0x8210
