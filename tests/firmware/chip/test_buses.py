"""CAN and the serial line of the released image."""

import pytest
from chip import Chip, release
from forceaxis import objects
from peripherals import bits
from pymodbus.framer import FramerRTU

ACTIVE, PASSIVE, OFF = 0, 1, 2
NODE = 1
FAULT = objects.BY_NAME["fault"].enum


def sdo_read(chip, index, sub=0):
    """Expedited upload over the bus."""
    chip.board.can.sent.clear()
    chip.board.can.receive(0x600 + NODE, bytes([0x40, index & 255, index >> 8, sub, 0, 0, 0, 0]))
    chip.tick(3)
    answers = [d for i, d, _ in chip.board.can.sent if i == 0x580 + NODE]
    assert len(answers) == 1
    return answers[0]


# CAN.


def permitted_difference(can):
    """Of the bit rates of two nodes (Bosch, CAN 2.0, 9): twice the smaller of both bounds."""
    segment_2, jump = bits(can[0x1C], 20, 3) + 1, bits(can[0x1C], 24, 2) + 1
    quanta = 1 + bits(can[0x1C], 16, 4) + 1 + segment_2
    assert jump <= segment_2
    return 2 * min(segment_2 / (2 * (13 * quanta - segment_2)), jump / (20 * quanta))


def test_bit_timing_of_the_internal_oscillator():
    """Its 1 % beside a node with a crystal."""
    chip = Chip()
    chip.board.rcc.hse_hz = None
    release(chip)
    assert chip.board.can.bit_rate() == 1e6
    assert permitted_difference(chip.board.can) > 0.015
    assert sdo_read(chip, 0x1000)[0] == 0x43


def test_bit_timing(chip):
    can = chip.board.can
    assert can.bit_rate() == 1e6
    # CiA 301: 87.5 %; the nearest of 14 quanta.
    assert abs(can.sample_point() - 0.875) <= 0.5 / 14
    assert permitted_difference(can) > 2 * 0.0015  # of two nodes with the crystals of CiA 301
    assert can[0x1C] >> 30 == 0  # neither silent nor loop-back
    assert not can[0x00] & 0x40, "returns from bus off by itself"
    assert not can[0x00] & 0x10, "does not repeat what was disturbed"
    assert can[0x00] & 4, "does not keep the order of frames"


def lss(chip, *data):
    """A request of the LSS master; the answers."""
    chip.board.can.sent.clear()
    chip.board.can.receive(0x7E5, bytes(data).ljust(8, b"\0"))
    chip.tick(3)
    return [d for i, d, _ in chip.board.can.sent if i == 0x7E4]


def test_every_bit_rate_of_lss_has_its_timing(chip):
    can = chip.board.can
    assert lss(chip, 0x04, 1) == []
    for place, rate in enumerate((1000, 800, 500, 250, 125, None, 50, 20, 10)):
        has = rate not in (800, None)  # of 800 kbit/s 42 MHz is no multiple
        assert lss(chip, 0x13, 0, place)[0][:2] == bytes([0x13, 0 if has else 1])
        before = can.bit_rate()
        lss(chip, 0x15, 10)  # silent for 10 ms, then at the new rate for 10 ms
        chip.tick(6)
        assert can.bit_rate() == before
        can.sent.clear()
        chip.tick(20)
        assert can.sent == []
        assert can.bit_rate() == (1000 * rate if has else before)
        assert abs(can.sample_point() - 0.875) <= 0.5 / 14
        chip.tick(40)
        assert chip.read("bit_rate") == can.bit_rate() / 1000
        assert sdo_read(chip, 0x2311)[4:6] == chip.read("bit_rate").to_bytes(2, "little")
    assert chip.board.mistakes == []


def test_without_straps_and_stored_id_the_node_answers_lss_alone():
    chip = Chip()
    chip.board.gpioc.wires = {}
    release(chip)
    chip.tick(400)
    assert chip.board.can.sent == []
    assert lss(chip, 0x4C) == [b"\x50" + bytes(7)]
    assert lss(chip, 0x04, 1) == []
    assert lss(chip, 0x11, 9) == [b"\x11" + bytes(7)]
    assert lss(chip, 0x04, 0) == []
    assert chip.board.can.sent[0] == (0x709, b"\0", False)
    assert chip.board.mistakes == []


def test_the_node_boots_up_on_the_bus(chip):
    assert chip.board.can.sent[0] == (0x700 + NODE, b"\0", False)
    assert chip.board.mistakes == []


def test_frames_in_and_out(chip):
    answer = sdo_read(chip, 0x1018, 1)
    assert answer[:4] == b"\x43\x18\x10\x01"
    assert sdo_read(chip, 0x1000)[0] == 0x43
    # Software version over the bus, in segments.
    chip.board.can.sent.clear()
    chip.board.can.receive(0x601, bytes([0x40, 0x0A, 0x10, 0, 0, 0, 0, 0]))
    chip.tick(2)
    text, toggle = b"", 0
    size = int.from_bytes(chip.board.can.sent[-1][1][4:], "little")
    while len(text) < size:
        chip.board.can.receive(0x601, bytes([0x60 | toggle, 0, 0, 0, 0, 0, 0, 0]))
        chip.tick(2)
        part = chip.board.can.sent[-1][1]
        text += part[1 : 8 - (part[0] >> 1 & 7)]
        toggle ^= 0x10
    assert text.decode() == chip.text(0x100A)


@pytest.mark.parametrize("length", range(9))
def test_every_length_and_identifier_arrives_as_it_was(chip, length):
    """Read back from the port's own calls, below the protocols."""
    at = 0x2001FF00
    for can_id in (0, 1, 0x2A5, 0x7FF):
        data = bytes(range(0x10, 0x10 + length))
        chip.board.can.receive(can_id, data, remote=length == 3)
        chip.interrupts()
        assert chip.call("port_can_receive", at) & 1
        frame = bytes(chip.uc.mem_read(at, 12))
        assert int.from_bytes(frame[:2], "little") == can_id
        assert frame[2] == length and frame[3] == (length == 3)
        assert frame[4 : 4 + length] == data
        chip.uc.mem_write(at, frame)
        chip.board.can.sent.clear()
        assert chip.call("port_can_transmit", at) & 1
        chip.board.can.transmit()
        assert chip.board.can.sent == [(can_id, data, length == 3)]
    assert not chip.call("port_can_receive", at) & 1


def test_extended_frames_are_not_taken(chip):
    chip.board.can.receive(0x601, bytes(8), extended=True)
    chip.board.can.receive(0x601 << 18, bytes(8), extended=True)
    assert chip.board.can.fifo == []


def test_mailboxes_keep_the_order_and_refuse_a_fourth(chip):
    at = 0x2001FF00
    sent = [0x7FF, 0x001, 0x400]
    for can_id in sent:
        chip.uc.mem_write(at, can_id.to_bytes(2, "little") + bytes(10))
        assert chip.call("port_can_transmit", at) & 1
    assert not chip.call("port_can_transmit", at) & 1
    chip.board.can.sent.clear()
    chip.board.can.transmit()
    assert [i for i, _, _ in chip.board.can.sent] == sent
    assert chip.call("port_can_transmit", at) & 1


def test_what_finds_no_room_waits_for_a_mailbox(chip):
    """On a busy bus no frame is lost or reordered."""
    can = chip.board.can
    can.transmit, transmit = (lambda: None), can.transmit
    for i in range(3):  # three answers of three servers would be sent; the boxes are full
        chip.uc.mem_write(0x2001FF00, (0x700).to_bytes(2, "little") + bytes(10))
        assert chip.call("port_can_transmit", 0x2001FF00) & 1, i
    can.receive(0x601, bytes([0x40, 0, 0x10, 0, 0, 0, 0, 0]))
    chip.tick(5)
    can.sent.clear()
    can.transmit = transmit
    chip.tick(2)
    ids = [i for i, _, _ in can.sent]
    assert ids[:3] == [0x700] * 3 and 0x581 in ids[3:]


def test_an_overrun_is_counted_and_reported(chip):
    can = chip.board.can
    before = chip.read("can_lost")
    for i in range(5):  # the interrupt does not come in between
        can.receive(0x100 + i, b"\x01")
    chip.tick(3)
    assert chip.read("can_lost") == before + 1
    assert any(i == 0x081 and d[:2] == b"\x10\x81" for i, d, _ in can.sent)  # 8110h
    chip.tick(3)
    assert chip.read("can_lost") == before + 1


def test_a_ring_that_is_full_is_counted(chip):
    """More than the tick takes in, with interrupts in time."""
    before = chip.read("can_lost")
    for i in range(40):
        chip.board.can.receive(0x100, bytes([i]))
        chip.interrupts()
    chip.tick(12)
    assert chip.read("can_lost") == before + 8


def test_as_many_frames_as_the_bus_carries_between_two_ticks(chip):
    """14 frames without data at 1 Mbit/s, whose interrupt comes with each."""
    before = chip.read("can_lost")
    for _ in range(14):
        chip.board.can.receive(0x321)
        chip.interrupts()
    chip.tick(8)
    assert chip.read("can_lost") == before


def test_error_passive_is_reported_and_ends(chip):
    can = chip.board.can
    can.sent.clear()
    can.errors(passive=True)
    chip.tick(2)
    assert any(i == 0x081 and d[:2] == b"\x20\x81" for i, d, _ in can.sent)  # 8120h
    can.errors()
    can.sent.clear()
    chip.tick(2)
    assert any(i == 0x081 and d[:2] == b"\x00\x00" for i, d, _ in can.sent)


def test_bus_off_stops_the_axis_and_is_recovered_after_128_times_11_bits(chip):
    can = chip.board.can
    assert chip.write("mode", 1) == 0
    chip.tick(2)
    assert chip.terminals()[0] == 1
    can.transmit, transmit = (lambda: None), can.transmit
    can.receive(0x601, bytes([0x40, 0, 0x10, 0, 0, 0, 0, 0]))
    chip.tick()  # an answer waits in a mailbox
    assert can.requests
    can.transmit = transmit
    can.sent.clear()
    can.errors(off=True)
    chip.tick(2)  # the main loop sees it after the first one
    assert chip.terminals() == (0, 0, 0.0)
    assert FAULT[chip.read("fault")] == "can_off"
    assert can.requests == [], "what waited comes out when the bus is back"
    ticks = 0
    while can[0x18] & 4:
        assert can.sent == []
        chip.tick()
        ticks += 1
        assert ticks < 20
    # 1408 bits are 2.1 ticks, the first of them is over; one more to enter initialisation.
    assert 2 <= ticks <= 5
    chip.tick(3)
    assert any(i == 0x081 for i, _, _ in can.sent)
    assert all(i != 0x581 for i, _, _ in can.sent)
    assert sdo_read(chip, 0x1000)[0] == 0x43
    assert can.bit_rate() == 1e6
    assert chip.board.mistakes == []


def polls_until(chip, wanted, most):
    """Ticks, of polls and the bus alone, until the port reports that state."""
    for ticks in range(1, most + 1):
        chip.board.can.tick()
        if chip.call("port_can_bus") == wanted:
            return ticks
    raise AssertionError(f"not in {most} ticks")


@pytest.mark.parametrize("kbit_s", [1000, 500, 250, 125, 50, 20, 10])
def test_bus_off_again_and_again(chip, kbit_s):
    """RM0090 32.7.6: 128 times 11 recessive bits, which initialisation does not see. On an idle bus
    that is their time; joining and a poll each way are some ticks."""
    can = chip.board.can
    chip.call("port_can_rate", kbit_s)
    assert chip.call("port_can_bus") == ACTIVE
    ticks = (128 + 1) * 11 * 1.5 / kbit_s
    for _ in range(4):
        polls_until(chip, ACTIVE, 100)
        can.errors(off=True)
        assert polls_until(chip, OFF, 2)
        assert ticks - 1 <= polls_until(chip, ACTIVE, 400) <= ticks + 5
        assert can.bit_rate() == 1000 * kbit_s
    assert chip.board.mistakes == []


@pytest.mark.parametrize("kbit_s", [1000, 10])
def test_bus_off_ends_on_a_bus_without_a_gap(chip, kbit_s):
    """11 recessive bits come once in each frame of at most 135 bits; the patience outlasts them."""
    can = chip.board.can
    chip.call("port_can_rate", kbit_s)
    polls_until(chip, ACTIVE, 100)
    for _ in range(20):
        can.tick()
        chip.call("port_can_bus")
    can.busy = True
    can.errors(off=True)
    assert polls_until(chip, OFF, 2)
    ticks = 128 * 135 * 1.5 / kbit_s
    assert ticks - 1 <= polls_until(chip, ACTIVE, 4000) <= ticks * 135 / 128 + 6


def test_frames_that_nobody_acknowledged_are_not_sent_later(chip):
    """Alone on the bus a node is error passive, its frames wait in the mailboxes and behind them.
    When others are back, no frame older than 100 ms comes."""
    can = chip.board.can
    assert chip.write("producer_heartbeat_time", 20) == 0
    can.transmit, transmit = (lambda: None), can.transmit
    can.errors(passive=True)
    chip.tick(120)
    assert len(can.requests) == 3 and can.aborted == 0  # a bus that is only busy loses nothing
    chip.tick(40)
    assert can.aborted >= 3
    chip.tick(600)
    can.errors()
    can.transmit = transmit
    can.sent.clear()
    chip.tick(2)
    # 100 ms of heartbeats every 20 ms, and the emergency that the bus is free again.
    assert len([i for i, _, _ in can.sent if i == 0x701]) <= 6
    assert sdo_read(chip, 0x1000)[0] == 0x43


def test_a_bus_that_is_stuck_is_bus_off_after_a_second_and_never_blocks_a_tick():
    chip = Chip()
    chip.board.can.dominant = True
    release(chip)
    worst = 0
    for _ in range(1600):
        chip.tick()
        worst = max(worst, chip.tick_steps)
    assert worst < 3000
    assert chip.board.can.sent == []
    chip.board.can.dominant = False
    chip.tick(20)
    assert any(i == 0x081 and d[:2] == b"\x40\x81" for i, d, _ in chip.board.can.sent)  # 8140h
    assert sdo_read(chip, 0x1000)[0] == 0x43


def test_a_controller_that_does_not_answer_never_blocks_a_tick():
    chip = Chip()
    chip.board.can.answers_init = False
    chip.board.can.registers[0x04] &= ~1
    release(chip)
    chip.tick(1600)
    assert chip.board.can.sent == []
    assert chip.board.trail == [(0, 0, 0.0)]


# The serial line.


def crc(frame):
    """The frame and its CRC."""
    return frame + FramerRTU.compute_CRC(frame).to_bytes(2, "big")


def ask(chip, request):
    chip.board.usart.sent.clear()
    chip.board.usart.drive.clear()
    chip.board.usart.incoming += list(request)
    for _ in range(12):
        chip.main()
        chip.tick()
    return bytes(chip.board.usart.sent)


def test_the_line_is_115200_8e1(chip):
    usart = chip.board.usart
    assert abs(usart.baud() / 115200 - 1) < 0.005
    control = usart[0x0C]
    assert control & 1 << 12 and control & 1 << 10 and not control & 1 << 9  # 9 bits, parity, even
    assert not control & 1 << 15 and usart[0x10] & 0x3000 == 0  # 16 samples a bit, 1 stop bit
    assert chip.board.gpioa.function(2) == chip.board.gpioa.function(3) == 7


def test_modbus_requests_are_answered(chip):
    answer = ask(chip, crc(bytes([NODE, 3, 0x01, 0x0C, 0, 1])))  # force_gain
    assert answer == crc(bytes([NODE, 3, 2]) + chip.read("force_gain").to_bytes(2, "big"))
    assert set(chip.board.usart.drive) == {1}  # the line's driver is on for each byte
    assert chip.board.gpiob.level(12) == 0  # and off afterwards
    assert chip.board.mistakes == []


def test_answers_longer_than_what_the_main_loop_takes_at_once(chip):
    for _ in range(20):
        answer = ask(chip, crc(bytes([NODE, 0x2B, 14, 2, 0])))
        assert answer == crc(answer[:-2]) and chip.text(0x100A).encode() in answer
        assert set(chip.board.usart.drive) == {1}


@pytest.mark.parametrize("at", range(0, 60, 4))
def test_the_lines_driver_is_on_whenever_the_interrupt_comes(chip, at):
    """The second part of an answer is handed over while the first one ends."""
    usart = chip.board.usart
    buffer = 0x2001FE00
    chip.uc.mem_write(buffer, b"abcd")
    assert chip.call("port_serial_transmit", buffer, 2) == 2
    while len(usart.sent) < 2:
        chip.interrupt(38)
    chip.interrupt(38)  # nothing pending: waits for the end of the last bit
    # The next call, with the interrupt somewhere within.
    chip.call_interrupted("port_serial_transmit", at, 38, buffer + 2, 2)
    chip.interrupts()
    assert bytes(usart.sent) == b"abcd"
    assert usart.drive == [1] * 4
    assert chip.board.gpiob.level(12) == 0


def test_an_overrun_of_the_line_costs_one_frame(chip):
    chip.board.usart.overrun()
    chip.interrupts()
    assert not chip.board.usart[0x00] & 8
    request = crc(bytes([NODE, 3, 0x01, 0x0C, 0, 1]))
    assert ask(chip, request[:3] + request[4:]) == b""  # a byte is missing
    chip.tick(10)
    assert ask(chip, request) != b""


def test_bytes_that_find_no_room_are_dropped_and_the_line_recovers(chip):
    chip.board.usart.incoming += [0x55] * 1000
    chip.interrupts()
    for _ in range(40):
        chip.main()
    chip.tick(10)
    assert ask(chip, crc(bytes([NODE, 3, 0x01, 0x0C, 0, 1]))) != b""
