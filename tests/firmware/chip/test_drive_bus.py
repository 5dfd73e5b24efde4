"""An axis on a CiA 402 drive at the second CAN of the released image: in every tick what the same
firmware and the same master do in process, and faults by name."""

import pytest
from chip import Chip, release
from converters import NOISE, Ad7193, Ads1256
from drive_bench import BITS, FORCE, LAW, SETTINGS, Board, Process, bench, stored
from forceaxis.objects import BY_NAME
from peripherals import NEVER


def press(test):
    """Enables the drive, presses, is disabled."""
    for name, value in LAW.items():
        assert test.axis.write(name, value) == 0, name
    test.tick(300)
    assert test.axis.write("mode", FORCE) == 0
    test.tick(700)
    assert test.axis.write("force_setpoint", 80 * 256) == 0
    test.tick(700)
    assert test.axis.write("mode", 0) == 0
    test.tick(60)


@pytest.mark.long
def test_the_trace_is_that_of_the_run_in_process():
    with bench(Board(SETTINGS), "on the chip") as there:
        press(there)
        assert there.axis.chip.board.mistakes == []
    assert there.first < 5  # ticks until the controller has joined the bus
    with bench(Process(SETTINGS, there.first - 1), "in process") as here:
        press(here)
    assert here.axis.trace.ticks == there.axis.trace.ticks
    assert here.axis.trace.hash() == there.axis.trace.hash()
    assert here.commands == there.commands
    codes = [code for _, _, _, code, _ in here.axis.trace.ticks]
    print(f"\n{len(codes)} ticks, {len(set(codes))} codes, {here.axis.trace.hash()}")
    assert len(set(codes)) > 20
    # The last set-point in counts of 8 bits, 16 codes each, above the middle of the range.
    assert abs(here.axis.trace.ticks[-70][1] - (2048 + 16 * 80)) <= 16


class Cell:
    """The force of the drive as a voltage at a converter on the chip; keeps which conversions were
    read before each tick."""

    def __init__(self, device, full_v):
        self.device, self.full_v, self.before = device, full_v, []

    def volts(self, force_code):
        return (force_code - 2048) / 2048 * self.full_v


class CellBoard(Board):
    def __init__(self, settings, device, full_v):
        super().__init__(settings, device)
        self.cell = Cell(device, full_v)

    def take(self, force_code):
        self.cell.device.volts = self.cell.volts(force_code)
        sent = super().take(force_code)
        self.cell.before.append(self.cell.device.conversions)
        return sent


class CellProcess(Process):
    """Has the conversions of the chip as numbers, and computes their codes itself."""

    def __init__(self, settings, joins_after, cell):
        super().__init__(settings, joins_after)
        self.cell, self.last = cell, (0, 0)

    def take(self, force_code):
        tick = len(self.trace.ticks)
        number = self.cell.before[tick]
        is_new = tick == 0 or number != self.cell.before[tick - 1]
        if is_new:
            code = round(self.cell.volts(force_code) / self.cell.full_v * 2**23)
            self.last = (code + NOISE[number % len(NOISE)] + 2**23) * 2**BITS // 2**24, 0
        else:
            self.last = self.last[0], self.last[1] + 1
        return self.tick(*self.last)


@pytest.mark.long
@pytest.mark.parametrize(("kind", "full_v"), [("ads1256", 5.0), ("ad7193", 2.5)])
def test_with_a_converter_the_trace_is_that_of_the_run_in_process(kind, full_v):
    """Force from 24 bits by SPI, velocity by CAN: one hash."""
    number = BY_NAME["force_converter"].enum.index(kind)
    settings = SETTINGS | {"force_converter": number}
    device = {"ads1256": Ads1256, "ad7193": Ad7193}[kind]()
    with bench(CellBoard(settings, device, full_v), "on the chip") as there:
        press(there)
        assert there.axis.chip.board.mistakes == [] and device.mistakes == []
    with bench(CellProcess(settings, there.first - 1, there.axis.cell), "here") as here:
        press(here)
    assert here.axis.trace.ticks == there.axis.trace.ticks
    assert here.axis.trace.hash() == there.axis.trace.hash()
    codes = [code for _, _, _, code, _ in here.axis.trace.ticks]
    print(f"\n{kind}: {len(codes)} ticks, {len(set(codes))} codes, {here.axis.trace.hash()}")
    assert len(set(codes)) > 20
    assert abs(here.axis.trace.ticks[-70][1] - (2048 + 16 * 80)) <= 16
    assert there.axis.ages == {0}


# Failures: name of the fault, reason of the master, and the most ticks until the axis is off and
# the drive is commanded to stop. Table of docs/drive_stop_times.md, and a tick for CAN to report.


@pytest.fixture
def pressing(request):
    with bench(Board(SETTINGS), request.node.name) as made:
        for name, value in LAW.items():
            assert made.axis.write(name, value) == 0, name
        made.tick(300)
        assert made.axis.write("mode", FORCE) == 0
        made.until(lambda: made.axis.trace.ticks[-1][1] > 2048 + 16 * 20, 3000)
        yield made


def frames_lost(test):
    for _ in range(5):  # the interrupt does not come in between
        test.axis.chip.board.can2.receive(0x123, bytes(8))


def unplugged(test):
    test.deaf = True


def stays_in_fault(test):
    test.drive.fail(0x2310)


def switches_off(test):
    test.drive.state = "switch on disabled"


def starts_again(test):
    test.drive.power_up()


@pytest.mark.parametrize(
    ("fail", "fault", "reason", "most"),
    [
        (lambda test: test.axis.chip.board.can2.errors(off=True), "drive_fault", "bus_off", 2),
        (frames_lost, "drive_fault", "frames_lost", 2),
        (unplugged, "drive_fault", "tpdo_missing", 10),
        (stays_in_fault, "drive_fault", "drive_emergency", 2),
        (switches_off, "drive_lost", "drive_off", 5),
        (starts_again, "drive_fault", "booted", 2),
    ],
    ids=["bus off", "frames lost", "unplugged", "emergency", "off", "booted"],
)
def test_a_failure_switches_the_axis_off_by_name(pressing, fail, fault, reason, most):
    fail(pressing)
    ticks = pressing.until(lambda: pressing.axis.trace.ticks[-1][3:] == (0, 0), 20)
    assert ticks <= most
    assert pressing.axis.chip.terminals() == (0, 0, 0.0)
    assert pressing.fault() == fault
    reasons = BY_NAME["drive_reason"].enum
    pressing.tick(3)
    assert reasons[pressing.axis.read("drive_reason")] == reason
    if reason == "drive_emergency":
        assert pressing.axis.read("drive_error_code") == 0x2310
    if reason not in ("bus_off", "booted"):
        # The quick stop ends when the drive has left it.
        stops = [command for command in pressing.commands[-3:] if command[0] != 0x0F]
        assert stops[0] == (0x02, 0) and set(stops) <= {(0x02, 0), (0x00, 0)}
    assert pressing.axis.chip.board.mistakes == []


@pytest.mark.long
def test_a_drive_that_failed_comes_back_at_the_next_enabling(pressing):
    pressing.axis.chip.board.can2.errors(off=True)
    pressing.tick(600)  # the controller is back after 128 times 11 recessive bits
    assert pressing.drive.state != "operation enabled", "without a heartbeat it stops by itself"
    assert pressing.axis.write("fault_reset", 1) == 0
    assert pressing.axis.write("mode", FORCE) == 0
    pressing.until(lambda: pressing.drive.state == "operation enabled", 4500)
    pressing.tick(600)
    assert pressing.fault() == "none"
    assert pressing.axis.trace.ticks[-1][3:] != (0, 0)


@pytest.mark.long
def test_a_bus_that_is_off_at_power_up_is_a_fault_of_the_enabled_axis():
    axis = Board(SETTINGS)
    axis.chip.board.can2.dominant = True
    with bench(axis, "stuck") as test:
        test.tick(1600)
        assert test.fault() == "none"
        assert axis.write("mode", FORCE) == 0
        test.tick(3)
        assert test.fault() == "drive_fault"
        assert axis.chip.terminals() == (0, 0, 0.0)
    assert axis.chip.board.can2.sent == [] and axis.chip.board.mistakes == []


def test_without_the_clock_the_drive_is_never_commanded():
    chip = Chip(stored(SETTINGS))
    chip.board.rcc.lock_reads = NEVER
    release(chip)
    chip.tick(20)
    assert BY_NAME["fault"].enum[chip.read("fault")] == "sensor_invalid"
    assert chip.board.can2[0x00] == 0x00010002 and chip.board.mistakes == []


def test_the_bus_of_the_drive_leaves_the_bus_of_the_axis_alone(pressing):
    """Bus off of one controller, and its new start, cost the other one no frame."""
    chip, lost = pressing.axis.chip, pressing.axis.read("can_lost")
    chip.board.can.errors(off=True)
    pressing.tick(2)
    assert pressing.fault() == "can_off"
    for _ in range(10):
        chip.board.can2.receive(0x123, bytes(8))
        chip.interrupts()
        pressing.tick()
    assert pressing.axis.read("drive_reason") == 0 and pressing.axis.read("can_lost") == lost
    assert pressing.drive.state in ("quick stop active", "switch on disabled")


def test_bit_rate_and_pins():
    axis = Board(SETTINGS | {"drive_bit_rate": 500})
    second = axis.chip.board.can2
    with bench(axis, "500"):
        axis.chip.tick(5)
    assert second.bit_rate() == 500e3 and axis.chip.board.can.bit_rate() == 1e6
    assert second.sample_point() == axis.chip.board.can.sample_point()
    assert axis.chip.board.nvic.priority(63) == axis.chip.board.nvic.priority(64) < 0x80
    assert second.connected()


def test_an_axis_without_a_drive_leaves_the_second_bus_alone(chip):
    chip.tick(20)
    assert not chip.board.rcc.clocked(0x40, 26)
    assert chip.board.gpiob.mode(5) == chip.board.gpiob.mode(6) == 0
