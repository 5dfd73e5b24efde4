"""Start-up, clocks, pins, outputs, encoder, converters, tick and watchdog of the released image."""

import re
import struct
import subprocess
import zlib

import pytest
from chip import BOARD, FLASH, IMAGE, INDEX, ROOT, SLOTS, Chip, release
from forceaxis import objects
from peripherals import NEVER, SUPPLY_V

OFF = (0, 0, 0.0)
LSB_V = 20 / 4096
STATES = objects.BY_NAME["store_state"].enum


def enable(chip, code):
    """Open loop with a code that is output at once."""
    assert chip.write("bump_decay_shift", 0) == 0
    assert chip.write("open_loop_code", code) == 0
    assert chip.write("mode", objects.BY_NAME["mode"].enum.index("open_loop")) == 0


# Start-up.


def test_what_the_manual_forbids_does_not_happen(chip):
    enable(chip, 100)
    chip.tick(20)
    assert chip.board.mistakes == []


def test_clocks(chip):
    rcc = chip.board.rcc
    assert (rcc.core_hz(), rcc.apb1_hz(), rcc.apb2_hz()) == (168e6, 42e6, 84e6)
    assert chip.board.flash[0x00] & 0x707 == 0x705  # five wait states, prefetch, both caches


def test_the_tick_is_exactly_1500_hz(chip):
    assert chip.board.rcc.core_hz() / chip.board.tim4.period() == 1500
    begin = chip.board.time_s()
    chip.tick(15)
    assert chip.board.time_s() - begin == pytest.approx(0.01, abs=2e-6)


def test_buses_interrupt_the_tick_and_not_the_other_way_round(chip):
    tick = chip.board.nvic.priority(30)
    assert chip.board.nvic.priority(20) < tick
    assert chip.board.nvic.priority(38) < tick
    # BASEPRI of port_lock() keeps the tick away and lets the buses in.
    listing = subprocess.run(
        ["arm-none-eabi-objdump", "-d", "--disassemble=port_lock", str(IMAGE)],
        capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    assert "BASEPRI" in listing
    mask = int(re.search(r"movs\s+r\d, #(\d+)", listing).group(1))
    assert chip.board.nvic.priority(20) < mask <= tick


@pytest.mark.parametrize("never", ["pll", "switch"])
def test_without_its_clock_the_axis_stays_off(never):
    chip = Chip()
    if never == "pll":
        chip.board.rcc.lock_reads = NEVER
    else:
        chip.board.rcc.switches = False
    release(chip)
    assert chip.board.rcc.core_hz() == 16e6
    assert chip.read("fault") == objects.BY_NAME["fault"].enum.index("sensor_invalid")
    assert chip.write("mode", 1) != 0
    chip.tick(10)
    assert chip.board.trail == [OFF]
    # The polls end: at 16 MHz and at least a cycle an instruction, within 10 ms but for the store.
    assert chip.board.rcc.reads <= 5000
    # CAN would have the wrong bit rate and is not started; the serial line has the right one.
    assert chip.board.can[0x00] == 0x00010002
    assert abs(16e6 / chip.board.usart[0x08] / 115200 - 1) < 0.005
    assert chip.board.mistakes == []


def full_store(entries, address=0x200A00):
    """Both sectors full of whole sets of so many entries, each a force_gain of its own."""
    signature = zlib.crc32(b"u16|code/count|0.00390625|0|65535||")
    out = b""
    for sector in range(2):
        sets, number = b"", 0
        while True:
            number += 1
            sequence = sector * 10000 + number
            body = struct.pack("<IiI", address, 256 + number, signature) * entries
            head = struct.pack(
                "<4s3I", b"FAS2", int(objects.OBJECTS_HASH[:8], 16), sequence, len(body)
            )
            record = head + body + struct.pack("<I", zlib.crc32(head + body))
            if len(sets) + len(record) > 16384:
                break
            sets += record
        out += sets.ljust(16384, b"\xff")
    return out


@pytest.mark.parametrize("entries", [None, 5, 20, 60, 169])
def test_the_tick_runs_within_10_ms_of_boot(entries):
    """With the checks of image and RAM. Halfwords of what is executed are an upper bound of the
    instructions and stand for cycles, at 16 MHz until the PLL is the clock; the PLL locks in
    300 us."""
    chip = Chip(None if entries is None else full_store(entries), checked=True)
    slow = []

    def watch(_address, _size):
        if chip.board.rcc.core_hz() > 16e6:
            slow.append(chip.steps)
            chip.watch = None

    chip.watch = watch
    release(chip)
    boot_s = slow[0] / 16e6 + (chip.boot_steps - slow[0]) / 168e6 + 300e-6
    print(f"\n{entries} entries: {slow[0]} and {chip.boot_steps} halfwords, {1e3 * boot_s:.1f} ms")
    assert boot_s < 10e-3 and chip.read("board_state") & (4 | 8) == 0
    assert chip.read("store_state") == (0 if entries is None else 1)


@pytest.mark.parametrize("address", [0x200A00, 0x203F00], ids=["usable", "unusable"])
@pytest.mark.parametrize("entries", [5, 20, 60, 169])
def test_a_reset_of_the_node_with_a_full_store_is_done_before_the_watchdog_fires(entries, address):
    """Also where no set of them can be used."""
    chip = release(Chip(full_store(entries, address)))
    assert chip.read("store_state") == STATES.index("loaded" if address == 0x200A00 else "failed")
    chip.board.can.sent.clear()
    chip.board.can.receive(0, bytes([0x81, 0]))  # NMT, all nodes
    worst = 0
    for _ in range(4):
        chip.tick()
        worst = max(worst, chip.main_steps)
    assert (0x701, b"\0", False) in chip.board.can.sent and worst > 100_000
    print(f"\n{entries} entries: {worst} instructions")
    # The fastest oscillator of the watchdog, and 1.5 cycles an instruction.
    assert 1.5 * worst / 168e6 < chip.board.iwdg.timeout_s(47e3)


def test_version_hash_and_source_are_in_the_image_and_read_back(chip):
    text = chip.text(0x100A)
    assert re.fullmatch(r"\d+\.\d+\.\d+ [0-9a-f]{8} [0-9a-f]{12}\+?", text)
    assert text.split()[1] == objects.OBJECTS_HASH[:8]
    assert len(text) <= 30  # the part that a Modbus client reads
    # At a fixed place, so that programs find it in an image file.
    at = SLOTS[0] - FLASH + 0x200
    assert chip.code[at : at + len(text) + 1] == text.encode() + b"\0"
    binary = IMAGE.with_suffix(".bin").read_bytes()
    assert binary[at : at + len(text)] == text.encode()
    assert chip.text(0x1009) == "stm32f446"


def test_the_image_leaves_the_store_and_the_ram_it_may_not_have():
    lines = subprocess.run(
        ["arm-none-eabi-objdump", "-h", str(IMAGE)], capture_output=True, text=True, check=True
    ).stdout
    used = flash = 0
    for name, size, vma, lma in re.findall(r"^\s+\d+ (\.\w+)\s+(\w+)\s+(\w+)\s+(\w+)", lines, re.M):
        size, vma, lma = int(size, 16), int(vma, 16), int(lma, 16)
        if name.startswith(".debug"):
            continue
        if vma >= 0x20000000:
            used += size
        if name == ".loader":
            assert lma + size <= 0x08004000
        elif name not in (".bss", ".noinit", ".stack", ".slot_trailer"):
            flash += size
            assert lma >= SLOTS[0] and lma + size <= SLOTS[0] + BOARD.limits.flash_bytes
    print(f"\nflash {flash} bytes, RAM {used} bytes")
    assert flash <= BOARD.limits.flash_bytes
    assert used <= BOARD.limits.ram_bytes


def test_the_stack_is_where_it_cannot_reach_variables(chip):
    assert chip.symbols["stack_bottom"] == 0x20000000
    assert chip.vectors[0] == chip.symbols["stack_top"]
    assert chip.symbols["stack_top"] % 8 == 0


def test_every_vector_leads_somewhere(chip):
    fail = chip.symbols["board_fail"] | 1
    assert [chip.vectors[i] for i in (2, 3, 4, 5, 6, 11, 12, 14)] == [fail] * 8
    assert chip.vectors[15] == chip.symbols["tick_interrupt"] | 1
    peripherals = {
        16 + 1: "supply", 16 + 9: "index", 16 + 20: "can", 16 + 30: "tick", 16 + 38: "serial",
        16 + 63: "drive_bus_sent", 16 + 64: "drive_bus",
        16 + 14: "spi_force_read", 16 + 40: "spi_force_ready",
    }  # fmt: skip
    for number, name in peripherals.items():
        assert chip.vectors[number] == chip.symbols[f"{name}_interrupt"] | 1
    others = set(range(1, 81)) - {1, 2, 3, 4, 5, 6, 11, 12, 14, 15} - peripherals.keys()
    assert all(chip.vectors[i] == 0 for i in others)


# Outputs.


def test_reset_leaves_0_v_and_disabled():
    chip = Chip()
    assert chip.terminals() == OFF  # before the first instruction
    release(chip)
    chip.tick(100)
    assert chip.board.trail == [OFF]  # and never anything else


def test_a_reset_anywhere_in_the_boot_leaves_0_v_and_disabled():
    """Wherever it is stopped, nothing but 0 V and disabled ever stood at the terminals."""
    for step in range(0, 60_000, 2_500):
        chip = Chip()
        chip.close_contacts()
        chip.steps, chip.limit = 0, 1 << 60
        chip.uc.emu_start(chip.entry | 1, 0xFFFFFFFE, count=step or 1)
        assert chip.board.trail == [OFF], step


def test_the_dac_stands_at_mid_scale_before_it_is_enabled(chip):
    seen = []
    chip = Chip()
    dac = chip.board.dac
    original = dac.write

    def write(offset, value):
        seen.append((offset, value, chip.board.gpiob.mode(0)))
        original(offset, value)

    dac.write = write
    chip.close_contacts()
    chip.boot()
    assert seen[0][:2] == (0x08, 2048)
    enabled = next(i for i, s in enumerate(seen) if s[0] == 0x00 and s[1] & 1)
    assert enabled > 0
    # The amplifier's pin was no output yet.
    assert all(mode == 0 for _, _, mode in seen)
    assert dac[0x00] & 7 == 3  # on, without buffer, without trigger


def test_the_amplifier_is_enabled_at_mid_scale_and_disabled_after_it(chip):
    enable(chip, 1000)
    chip.tick()
    on = (1, 1, pytest.approx(1000 * LSB_V))
    assert chip.board.trail == [OFF, (1, 1, 0.0), on]
    chip.tick(5)
    assert chip.write("mode", 0) == 0
    chip.tick()
    assert chip.board.trail[3:] == [(1, 1, 0.0), OFF]


def test_a_fault_is_off_in_its_tick(chip):
    enable(chip, -500)
    chip.tick(3)
    chip.board.gpioc.wires[0] = 0  # the enable chain opens
    chip.tick()
    assert chip.terminals() == OFF
    assert chip.board.trail[-2][:1] == (1,) and chip.board.trail[-2][2] == 0.0
    assert chip.read("fault") == objects.BY_NAME["fault"].enum.index("enable_lost")


def test_the_outputs_of_cycles_are_low_unless_the_firmware_sets_them(chip):
    port = chip.board.gpioa
    enable(chip, 100)
    assert [(port.mode(pin), port.level(pin)) for pin in range(8, 12)] == [(1, 0)] * 4
    for levels in (0b1010, 0b0101, 0b1111):
        chip.call("pins_write_digital", levels)
        assert [port.level(pin) for pin in range(8, 12)] == [levels >> i & 1 for i in range(4)]
    chip.tick()  # no cycle runs
    assert [port.level(pin) for pin in range(8, 12)] == [0] * 4


def test_the_amplifier_stays_off_while_the_dac_does_not_stand_at_mid_scale(chip):
    chip.board.dac.registers[0x2C] = 2049  # a converter that does not follow
    original = chip.board.dac.write
    chip.board.dac.write = lambda offset, value: None
    enable(chip, 100)
    chip.tick(5)
    assert chip.board.gpiob.level(0) == 0
    chip.board.dac.write = original
    chip.tick(2)  # the first sets mid-scale, the second enables
    assert chip.terminals() == (1, 1, pytest.approx(100 * LSB_V))


@pytest.mark.parametrize("code", [-2048, -2047, -1, 0, 1, 2046, 2047])
def test_scaling_of_the_dac(chip, code):
    enable(chip, code)
    chip.tick()
    assert chip.board.dac[0x2C] == code + 2048
    assert chip.terminals()[2] == pytest.approx(code * LSB_V)


def test_a_fault_of_the_core_is_safe_and_resets(chip):
    enable(chip, 700)
    chip.tick(2)
    chip.limit = 1 << 60
    context = chip.uc.context_save()
    chip.steps = 0
    chip.uc.emu_start(chip.vectors[3], 0xFFFFFFFE, count=200)  # it does not return
    chip.uc.context_restore(context)
    assert chip.terminals() == OFF
    assert chip.board.scb.reset_asked


# Inputs.


def test_digital_inputs_fail_safe():
    chip = Chip()
    assert chip.board.gpioc.wires == {4: 0}
    chip.boot()
    chip.tick(2)  # no wire connected: chain open, both switches reached
    assert chip.read("digital_inputs") == 2 + 4
    for pin, bit in ((0, 1), (1, 2), (2, 4), (9, 16)):
        before = chip.read("digital_inputs")
        chip.board.gpioc.wires[pin] = 1
        chip.tick()
        assert chip.read("digital_inputs") == before ^ bit


def index_seen(chip, level_a, level_b, during=None):
    """Whether the tick after a pulse on the index, with such levels of the tracks, shows it."""
    chip.board.gpioa.wires |= {0: level_a, 1: level_b}
    chip.board.pulse(3, during or chip.interrupts)
    chip.interrupts()
    chip.tick()
    return bool(chip.read("digital_inputs") & 8)


def test_an_index_pulse_between_two_ticks_is_seen_in_one(chip):
    chip.tick(2)
    assert not chip.read("digital_inputs") & 8
    assert index_seen(chip, 1, 1)
    chip.tick()
    assert not chip.read("digital_inputs") & 8
    chip.board.pulse(2)  # no other pin is latched
    chip.tick()
    assert not chip.read("digital_inputs") & 8


def test_an_index_counts_only_where_it_is_defined_and_a_spike_does_not(chip):
    """In the quarter of a line in which A and B are high, and for as long as it takes to look."""
    for level_a, level_b in ((0, 0), (0, 1), (1, 0)):
        assert not index_seen(chip, level_a, level_b)
    assert not index_seen(chip, 1, 1, during=lambda: None)  # over before anybody looks
    assert index_seen(chip, 1, 1)


def test_noise_on_the_index_takes_no_more_time_than_four_edges_a_tick(chip):
    chip.board.gpioa.wires |= {0: 0, 1: 0}
    served = []
    for _ in range(100):
        chip.board.pulse(3, lambda: served.append(chip.requested() == INDEX) or chip.interrupts())
    assert sum(served) == 4
    chip.tick()
    assert index_seen(chip, 1, 1)


LOOK = 80  # instructions, more than pins_din() has


def test_an_index_pulse_within_the_look_at_it_is_seen_by_this_tick_or_the_next(chip):
    """Wherever the interrupt comes in the function that takes the pulses, none is lost."""
    chip.board.gpioa.wires |= {0: 1, 1: 1}
    for at in range(LOOK):
        chip.board.gpioc.wires[3] = 1
        chip.call_interrupted("pins_din", at, INDEX)
        if chip.stopped_at is None:
            break
        taken = bool(chip.call_result & 8)
        chip.board.gpioc.wires[3] = 0
        chip.board.exti.registers[0x14] = 0
        chip.tick()
        seen = bool(chip.read("digital_inputs") & 8)
        assert taken or seen, f"lost after {at} instructions"
    assert 10 < at < LOOK - 1, "the look has more instructions than were tried"


def test_the_line_of_the_index_is_open_again_wherever_noise_comes_in_the_look(chip):
    """Four edges close the line until the next tick; a fourth within the look must not close it for
    good."""
    for at in range(LOOK):
        chip.board.gpioa.wires |= {0: 0, 1: 0}
        for _ in range(3):
            chip.board.pulse(3, chip.interrupts)
        chip.call_interrupted("pins_din", at, INDEX)
        if chip.stopped_at is None:
            break
        chip.board.exti.write(0x14, 1 << 3)
        chip.tick(2)
        assert index_seen(chip, 1, 1), f"closed for good after {at} instructions"
    assert 10 < at < LOOK - 1, "the look has more instructions than were tried"


@pytest.mark.parametrize(
    "straps, node", [((), 255), ((0,), 1), ((1,), 2), ((0, 2), 5), (range(5), 31)]
)
def test_straps_give_the_node_id(straps, node):
    chip = Chip()
    chip.board.gpioc.wires = {4 + i: 0 for i in straps}
    chip.boot()
    assert chip.read("node_id") == node


def test_serial_number_is_of_the_chip(chip):
    unique = struct.pack("<3I", 0x00350027, 0x33365110, 0x31323736)
    assert chip.read("serial_number") & 0xFFFFFFFF == zlib.crc32(unique)


def test_the_encoder_counts_both_ways(chip):
    for counts in (1, 7, -20, 100000, -300000):
        before = chip.read("position")
        chip.board.tim5.turn(counts)
        chip.tick()
        assert chip.read("position") - before == counts
        assert chip.read("velocity") == counts


@pytest.mark.parametrize("late_us", [0, 2, 30, 500])
def test_encoder_and_inputs_are_those_at_the_begin_of_the_tick_however_late_it_runs(chip, late_us):
    """TIM4 captures the count and starts the ADC; what changes before the interrupt runs is of the
    next tick."""
    board = chip.board
    board.adc.volts = {6: 1.0, 7: 2.0}
    board.tim5.turn(40)
    original = board.advance

    def advance(cycles):  # the first step after the overflow is that of the delay
        original(cycles)
        if board.tim4.pending():
            board.advance = original
            board.tim5.turn(1000)
            board.adc.volts = {6: 3.0, 7: 3.0}

    before = chip.read("position")
    board.advance = advance
    chip.tick(late_cycles=168 * late_us)
    assert board.advance == original
    assert chip.read("position") - before == 40
    codes = [chip.read("force_raw"), chip.read("current_raw")]
    assert codes == [int(v / SUPPLY_V * 256) for v in (1.0, 2.0)]
    chip.tick()
    assert chip.read("position") - before == 1040


def test_a_count_that_was_not_captured_is_no_position(chip):
    enable(chip, 300)
    chip.tick(3)
    chip.board.tim5.registers[0x20] = 0  # the channel is off
    chip.tick()
    assert chip.terminals() == OFF
    assert chip.read("fault") == objects.BY_NAME["fault"].enum.index("sensor_invalid")


@pytest.mark.parametrize("late_us", [0, 10, 50, 600])
def test_the_latest_tick_and_the_longest_tick_are_objects(chip, late_us):
    chip.tick(3)
    assert chip.read("tick_late_max") <= 1
    chip.tick(late_cycles=168 * late_us)
    chip.tick(3)
    assert late_us <= chip.read("tick_late_max") <= late_us + 1
    board, read = chip.board, chip.board.tim5.read
    board.adc.ready_reads = 1

    def slow(offset):
        board.advance(168 * 20)  # 20 us
        board.tim5.read = read
        return read(offset)

    board.tim5.read = slow
    chip.tick(2)
    assert 20 <= chip.read("tick_time_max") <= 24


def test_the_encoder_wraps(chip):
    """Through 2^31 and through 0, without a jump of the velocity."""
    for start in (0x7FFFFFF0, 0xFFFFFFF0):
        chip.board.tim5.registers[0x24] = start
        chip.tick(2)
        for _ in range(4):
            chip.board.tim5.turn(9)
            chip.tick()
            assert chip.read("velocity") == 9
        for _ in range(4):
            chip.board.tim5.turn(-9)
            chip.tick()
            assert chip.read("velocity") == -9


@pytest.mark.parametrize("adc_bits", [8, 10, 12, 16])
def test_scaling_of_the_adc(chip, adc_bits):
    """A code is the input in 2^-bits of the supply, rounded down; beyond 12 are zeros."""
    assert chip.write("adc_bits", adc_bits) == 0
    for force_v, current_v in ((0.0, 3.29), (0.5, 2.0), (1.7, 0.013), (3.3, 3.3)):
        chip.board.adc.volts = {6: force_v, 7: current_v}
        chip.tick()
        for name, volts in (("force_raw", force_v), ("current_raw", current_v)):
            exact = min(int(volts / SUPPLY_V * 4096), 4095)
            assert chip.read(name) == (exact << 4) >> (16 - adc_bits), (name, volts)


def test_the_conversion_is_of_this_tick_and_done_in_time(chip):
    before = chip.board.adc.conversions
    chip.tick(7)
    assert chip.board.adc.conversions - before == 7
    assert chip.board.adc.group() == [6, 7]
    assert chip.board.adc.duration_s() < 5e-6
    # What may drive the inputs, with a quarter of a code of error: the pages say 10 kOhm.
    assert min(chip.board.adc.source_max_ohm(c) for c in (6, 7)) > 10e3


def test_an_adc_that_is_never_ready_costs_less_than_5_us_and_the_sensors(chip):
    enable(chip, 300)
    chip.tick(3)
    usual = chip.tick_steps
    adc = chip.board.adc
    adc.ready_reads, adc.reads = NEVER, 0
    chip.tick()
    # A poll has seven reads of the ADC and one of the counter that ends it.
    poll_s = (7 * adc.READ_CYCLES + 4) / 168e6
    polls = adc.reads - 1  # the first read is that of the single conversion of the last tick
    assert adc.duration_s() < polls * poll_s <= 5e-6 + poll_s
    assert chip.tick_steps - usual < 5e-6 * 168e6 + 600
    assert chip.terminals() == OFF
    assert chip.read("fault") == objects.BY_NAME["fault"].enum.index("sensor_invalid")
    assert chip.read("mode") == 0


def test_a_conversion_that_comes_late_is_not_taken_for_the_next_one(chip):
    adc = chip.board.adc
    adc.volts = {6: 1.0, 7: 1.0}
    adc.ready_reads = 200
    chip.tick()
    assert chip.read("fault") != 0
    adc.finish()  # between two ticks
    adc.ready_reads = NEVER
    chip.tick()
    assert adc.waiting is not None  # a new conversion was started; the old result was not used
    assert chip.write("fault_reset", 1) == 0
    chip.tick()
    assert chip.read("fault") == objects.BY_NAME["fault"].enum.index("sensor_invalid")


# Tick and watchdog.


def test_a_missed_tick_is_counted(chip):
    before = chip.read("overruns")
    chip.tick(5)
    assert chip.read("overruns") == before
    tim5 = chip.board.tim5
    original = tim5.read

    def read(offset):  # the next tick begins during this one
        tim5.read = original
        chip.board.tim4.wrap()
        return original(offset)

    tim5.read = read
    chip.tick(2)
    assert chip.read("overruns") == before + 1
    chip.tick(3)
    assert chip.read("overruns") == before + 1


def test_the_watchdog_fires_some_20_ms_after_the_last_tick(chip):
    iwdg = chip.board.iwdg
    assert iwdg.started
    assert iwdg.timeout_s(32e3) == pytest.approx(20e-3)
    # At either end of the oscillator's range the timeout is some ticks, and not many.
    assert iwdg.timeout_s(47e3) > 5 / 1500 and iwdg.timeout_s(17e3) < 40e-3


def test_a_main_loop_that_hangs_costs_the_axis_its_outputs_and_then_the_reset(chip):
    """Heartbeats, NMT and time-outs depend on the main loop."""
    iwdg = chip.board.iwdg
    enable(chip, 400)
    chip.tick(3)
    before = iwdg.feeds
    chip.tick(15, hung=True)  # 10 ms
    assert chip.terminals() == (1, 1, pytest.approx(400 * LSB_V))
    assert iwdg.feeds - before == 15
    chip.tick(hung=True)
    assert chip.terminals() == OFF
    chip.tick(100, hung=True)
    assert iwdg.feeds - before == 15, "it would never be reset"
    assert chip.board.trail[-1] == OFF
    # It resumes before the watchdog expires: the fault stays latched, and is reported.
    chip.tick(2)
    assert chip.read("fault") == objects.BY_NAME["fault"].enum.index("main_loop_lost")
    assert any(i == 0x081 and d[:2] == b"\x00\x61" for i, d, _ in chip.board.can.sent)  # 6100h
    assert chip.terminals() == OFF and iwdg.feeds - before == 16


def test_the_watchdog_is_fed_by_the_tick_and_by_nothing_else(chip):
    iwdg = chip.board.iwdg
    before = iwdg.feeds
    chip.tick(10)
    assert iwdg.feeds - before == 10
    before = iwdg.feeds
    chip.board.usart.incoming += list(b"\x01\x03\x00\x00\x00\x02\xc4\x0b")
    chip.main(20)
    chip.board.can.receive(0x601, bytes(8))
    chip.interrupts()
    assert iwdg.feeds == before
    # Nor before the first tick: a start that hangs is detected.
    other = Chip()
    other.boot()
    assert other.board.iwdg.started and other.board.iwdg.feeds == 1
    # The one feeding brings the 20 ms into force: without it 4096 counts of a quarter, 0.5 s.
    assert other.board.iwdg.timeout_s(32e3) == pytest.approx(20e-3)


@pytest.mark.parametrize("flag, reported", [(1 << 29, True), (1 << 27 | 1 << 26, False)])
def test_a_reset_by_the_watchdog_is_reported_once(flag, reported):
    """RM0390, 6.3.21: 29 the watchdog, 27 the power-up, 26 the pin."""
    chip = Chip()
    chip.board.rcc.registers[0x74] = flag
    release(chip)
    assert any(i == 0x081 and d[:2] == b"\x07\xff" for i, d, _ in chip.board.can.sent) == reported
    assert chip.board.rcc[0x74] >> 24 == 0
    chip.board.can.sent.clear()
    chip.board.can.receive(0, bytes([0x81, 0]))  # NMT: the node starts again, the chip does not
    chip.tick(4)
    assert [i for i, _, _ in chip.board.can.sent] == [0x701]


def test_who_feeds_the_watchdog_is_one_function_and_the_erase():
    """In three places of the sources: the erase of each chip, the first feeding, and the tick's."""
    uses = [
        f"{path.parent.name}/{path.name}"
        for path in sorted((ROOT / "firmware").rglob("*.c"))
        for _ in range(path.read_text().count("IWDG_KEY_FEED"))
    ]
    assert uses == ["stm32/watchdog.c", "stm32/watchdog.c", "stm32f4/flash.c", "stm32g4/flash.c"]
