"""A converter of 24 bits at SPI2 of the released image, in front of models by the data sheets."""

import pytest
from chip import DMA1_STREAM3, EXTI15_10, Chip
from converters import Ad7193, Ads1256
from drive_bench import stored
from forceaxis.objects import BY_NAME, mask

FAULT = BY_NAME["fault"].enum
KINDS = {"ads1256": Ads1256, "ad7193": Ad7193}
BITS = 16
OPEN_LOOP = BY_NAME["mode"].enum.index("open_loop")
_FLASH = {}


def flash(kind, gain="x1"):
    settings = {
        "force_converter": BY_NAME["force_converter"].enum.index(kind),
        "force_converter_gain": BY_NAME["force_converter_gain"].enum.index(gain),
        "adc_bits": BITS, "force_age_max": 3,
    }  # fmt: skip
    if (kind, gain) not in _FLASH:
        _FLASH[kind, gain] = bytes(stored(settings))
    return _FLASH[kind, gain]


def chip_with(kind, gain="x1", device=None):
    chip = Chip(flash(kind, gain))
    chip.board.converter = device or KINDS[kind]()
    chip.close_contacts()
    chip.boot()
    chip.tick(8)
    return chip


@pytest.mark.parametrize("kind", KINDS)
def test_it_is_configured_as_the_data_sheet_says(kind):
    chip = chip_with(kind)
    device = chip.board.converter
    assert device.mistakes == [] and chip.board.mistakes == []
    assert (
        FAULT[chip.read("fault")] == "none"
        and chip.read("board_state") & mask("board_state", "converter") == 0
    )
    assert device.continuous
    assert device.rate() == (7500 if kind == "ads1256" else pytest.approx(4805, abs=1))
    assert chip.board.nvic.priority(14) == chip.board.nvic.priority(40) < 0x80


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("gain", ["x1", "x64"])
def test_its_voltage_is_the_force(kind, gain):
    chip = chip_with(kind, gain)
    device, times = chip.board.converter, int(gain[1:])
    full_v = 2.5 * (2 if kind == "ads1256" else 1) / times
    for share in (-0.9, -0.25, 0.0, 1e-3, 0.5, 0.9):
        device.volts = share * full_v
        chip.tick(2)
        raw = chip.read("force_raw")
        assert abs(raw - (share + 1) * 2 ** (BITS - 1)) <= 1, share
        assert FAULT[chip.read("fault")] == "none"
    assert chip.board.mistakes == [] and device.mistakes == []


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("fault", ["absent", "identity", "forgets", "silent", "stuck 0", "stuck 1"])
def test_a_converter_that_cannot_be_configured_is_a_fault_for_good(kind, fault):
    device = KINDS[kind]()
    if fault == "identity":
        other = type("Other", (KINDS[kind],), {"ID": 0x05})
        device = other()
    elif fault == "forgets":
        command = device.exchange

        def forget(sent, now_s, bit_s):
            answer = command(sent, now_s, bit_s)
            if kind == "ads1256":
                device.registers[2] = 0x20
            else:
                device.registers[2] |= 0x10000
            return answer

        device.exchange = forget
    elif fault == "silent":
        device.silent = True
    elif fault.startswith("stuck"):
        device.stuck = int(fault[-1])
    chip = Chip(flash(kind, "x8"))
    chip.board.converter = None if fault == "absent" else device
    chip.close_contacts()
    chip.boot()
    chip.tick(2)
    assert FAULT[chip.read("fault")] == "board_unfit"
    assert chip.read("board_state") & mask("board_state", "converter")
    assert chip.write("fault_reset", 1) == 0
    chip.tick(2)
    assert FAULT[chip.read("fault")] == "board_unfit"
    assert chip.terminals() == (0, 0, 0.0)


@pytest.mark.parametrize(
    ("kind", "gain"), [("ads1256", "x128"), ("ad7193", "x2"), ("ad7193", "x4")]
)
def test_a_gain_that_it_lacks_is_a_fault(kind, gain):
    chip = chip_with(kind, gain)
    assert FAULT[chip.read("fault")] == "board_unfit"


def enabled(kind):
    chip = chip_with(kind)
    assert chip.write("mode", OPEN_LOOP) == 0
    chip.tick(3)
    assert chip.terminals()[0] == 1
    return chip


def ticks_to_off(chip, most):
    for ticks in range(1, most + 1):
        chip.tick()
        if chip.terminals() == (0, 0, 0.0):
            return ticks
    return None


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_no_conversion_is_an_old_force(kind):
    chip = enabled(kind)
    chip.board.converter.silent = True
    # Ages 0 to 3 are permitted; the first tick may still have had a reading.
    assert ticks_to_off(chip, 10) in (4, 5)
    assert FAULT[chip.read("fault")] == "force_old"


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("level", [0, 1])
def test_a_line_that_stands_still_is_a_sensor_fault(kind, level):
    chip = enabled(kind)
    chip.board.converter.stuck = level
    # The AD7193 sends its status and the parity. The ADS1256 sends neither, so 16 equal readings
    # show the stuck line, which takes 3.2 ticks.
    assert ticks_to_off(chip, 10) <= (5 if kind == "ads1256" else 2)
    assert FAULT[chip.read("fault")] == "sensor_invalid"


def overrange(device):
    device.volts = 3.0


def no_reference(device):
    device.reference_v = 0.0


def flipped_bit(device):
    convert = device.convert

    def flip():
        convert()
        device.data ^= 0x000400

    device.convert = flip


LATER = (pytest.param(fail, marks=pytest.mark.long) for fail in (no_reference, flipped_bit))


@pytest.mark.parametrize("fail", [overrange, *LATER])
def test_the_status_of_the_ad7193_is_a_sensor_fault_in_its_tick(fail):
    chip = enabled("ad7193")
    fail(chip.board.converter)
    assert ticks_to_off(chip, 3) <= 1
    assert FAULT[chip.read("fault")] == "sensor_invalid"


@pytest.mark.long
def test_a_conversion_that_ends_while_another_is_read_is_not_lost():
    chip = enabled("ads1256")
    chip.board.exti.write(0x14, 1 << 12)
    device, take = chip.board.converter, chip.board.dma.finish

    def finish():
        take()
        device.convert()
        device.ready = True  # its edge comes before the handler clears the line
        chip.board.dma.finish = take

    chip.board.dma.finish = finish
    before = device.conversions
    chip.tick(30)
    assert device.conversions > before + 100
    assert FAULT[chip.read("fault")] == "none"


@pytest.mark.parametrize("irq", [DMA1_STREAM3, pytest.param(EXTI15_10, marks=pytest.mark.long)])
def test_a_reading_that_interrupts_the_look_at_the_index_does_not_end_the_readings(irq):
    """The line of the index is closed by noise and opened by the tick; the line of the converter by
    its interrupts. Wherever one interrupts the other, both are open afterwards."""
    chip = chip_with("ads1256")
    device, board, readings = chip.board.converter, chip.board, []
    begin = board.dma.begin
    board.dma.begin = lambda: (readings.append(1), begin())
    board.gpioa.wires |= {0: 0, 1: 0}
    for at in range(80):
        for _ in range(4):
            board.pulse(3, chip.interrupts)
        if irq == EXTI15_10:
            device.run(device.next_s)
            board.exti.edge(12, False)
        else:
            device.run(device.next_s)
            board.exti.edge(12, False)
            chip.interrupt(EXTI15_10)
            board.dma.finish()
        chip.call_interrupted("pins_din", at, irq)
        if chip.stopped_at is None:
            break
        chip.interrupts()
        before = len(readings)
        chip.tick(2)
        assert len(readings) > before + 5, f"no readings after {at} instructions"
        assert FAULT[chip.read("fault")] == "none"
    assert 10 < at < 79 and board.mistakes == []


def test_an_edge_that_was_served_already_starts_no_reading():
    """The request of a line goes some time after its pending bit was cleared (ES0298 2.10.3), so
    the handler can be entered once more: while the converter is not ready it begins nothing."""
    chip = chip_with("ad7193")
    board = chip.board
    chip.interrupts()
    assert not board.converter.ready and board.dma.done_s is None
    chip.interrupt(EXTI15_10)
    assert board.dma.done_s is None
    chip.tick(20)
    assert FAULT[chip.read("fault")] == "none" and board.mistakes == []
