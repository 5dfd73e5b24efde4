"""The released image for the STM32G474 on models of its peripherals: what differs from the
STM32F446. The tests of the other chip that hold for this one as well run again with `--all`."""

import itertools
import re
import struct
import subprocess
import types
import zlib

import pytest
import test_board
import test_board_watch
import test_bringup
import test_buses
import test_flash
import unicorn
from chip import NMI, PVD, RAM, UID_WORDS, Stuck, release, segments
from chip_g4 import BOARD, FDCAN1, FDCAN2, FDCAN2_SENT, IMAGE, Chip
from conftest import build
from forceaxis import objects
from peripherals import NEVER, SUPPLY_V, bits
from test_board import LSB_V, OFF, enable
from test_board_watch import (
    FAULT,
    INTERNAL,
    SUPPLY,
    emergencies,
    handle,
    refuses_option_bytes,
)
from test_buses import sdo_read
from test_flash import SAVE, STATES, reported, save

# Tests of the other chip that name its registers or values; this file has their counterparts.
OTHERS = {
    "test_clocks", "test_without_its_clock_the_axis_stays_off",
    "test_the_tick_runs_within_10_ms_of_boot",
    "test_a_reset_of_the_node_with_a_full_store_is_done_before_the_watchdog_fires",
    "test_version_hash_and_source_are_in_the_image_and_read_back",
    "test_buses_interrupt_the_tick_and_not_the_other_way_round",
    "test_the_image_leaves_the_store_and_the_ram_it_may_not_have",
    "test_every_vector_leads_somewhere", "test_the_dac_stands_at_mid_scale_before_it_is_enabled",
    "test_the_outputs_of_cycles_are_low_unless_the_firmware_sets_them",
    "test_scaling_of_the_dac", "test_the_conversion_is_of_this_tick_and_done_in_time",
    "test_a_reset_by_the_watchdog_is_reported_once",
    "test_who_feeds_the_watchdog_is_one_function_and_the_erase",
    "test_the_input_of_the_st_link_is_the_clock_and_is_watched",
    "test_a_start_with_clocks_that_something_else_has_set",
    "test_a_tick_that_becomes_slow_or_fast_is_off_in_20_ms",
    "test_a_tick_that_is_slow_or_fast_from_the_start_is_found",
    "test_brown_out_level_3_is_read_back_at_power_up",
    "test_a_handler_ends_when_its_stores_are_complete",
    "test_the_write_protection_of_the_loader_is_read_back_at_power_up",
    "test_a_supply_below_2_9_v_switches_off_by_interrupt_before_the_brown_out",
    "test_a_dac_that_does_what_it_should_is_no_fault",
    "test_a_clock_that_stops_is_off_reset_and_reported",
    "test_a_fault_of_the_core_is_kept_reported_and_an_incident",
    "test_a_frame_that_could_not_be_pushed_is_not_told",
    "test_every_cause_of_a_reset_is_an_object_and_an_emergency",
    "test_the_crc_is_that_of_the_manual_s_unit", "test_the_regions_of_the_memory_protection",
    "test_one_wrong_bit_of_the_image_is_found_at_power_up",
    "test_edges_of_can_are_fast_enough", "test_bit_timing",
    "test_bit_timing_of_the_internal_oscillator",
    "test_extended_frames_are_not_taken",
    "test_bus_off_stops_the_axis_and_is_recovered_after_128_times_11_bits",
    "test_a_controller_that_does_not_answer_never_blocks_a_tick", "test_the_line_is_115200_8e1",
    "test_an_overrun_of_the_line_costs_one_frame",
    "test_what_was_saved_is_there_after_a_power_cut",
    "test_a_power_cut_anywhere_leaves_the_old_set_or_the_new_one",
    "test_the_second_sector_is_used_when_the_first_is_full",
    "test_a_write_error_is_reported_and_the_old_set_stays", "test_protected_sectors_are_a_failure",
    "test_a_flash_that_is_busy_for_ever_ends_by_the_watchdog",
    "test_an_erase_and_a_write_follow_the_order_of_the_manual",
    "test_an_erase_runs_from_ram_without_interrupts_and_the_watchdog_lives",
    "test_the_ticks_that_an_erase_costs_are_counted_and_made_up_for",
    "test_the_cache_is_emptied_after_an_erase",
    "test_a_corrupted_sector_falls_back_to_the_other_then_to_defaults_with_an_emcy",
}  # fmt: skip
SHARED = (test_board, test_board_watch, test_buses, test_flash)


def again(test):
    """The same test, marked as long."""
    copy = types.FunctionType(test.__code__, test.__globals__, test.__name__)
    copy.__dict__.update(test.__dict__)
    copy.pytestmark = [*getattr(test, "pytestmark", []), pytest.mark.long.mark]
    copy.__doc__ = test.__doc__
    return copy


globals().update(
    (name, again(function))
    for name, function in itertools.chain(*(vars(module).items() for module in SHARED))
    if name.startswith("test_") and name not in OTHERS and callable(function)
)


def most_long(first, *others):
    """Parameters of which only the first one runs without `--all`."""
    rows = [value if isinstance(value, tuple) else (value,) for value in others]
    return [first, *(pytest.param(*row, marks=pytest.mark.long) for row in rows)]


@pytest.fixture(scope="module", autouse=True)
def image_of_this_board():
    build(BOARD.folder)


@pytest.fixture(autouse=True)
def of_this_chip(monkeypatch):
    for module in (*SHARED, test_bringup):
        monkeypatch.setattr(module, "Chip", Chip)


@pytest.fixture
def chip():
    return release(Chip())


def restarted(chip, flags=1 << 27 | 1 << 26):
    """The same RAM and flash after a reset with these flags of RCC_CSR."""
    other = Chip(bytes(chip.board.flash.bytes))
    other.board.flash.damaged |= chip.board.flash.damaged
    other.uc.mem_write(RAM, bytes(chip.uc.mem_read(RAM, 128 * 1024)))
    other.board.rcc.registers[0x94] = flags
    return release(other)


def restarted_with(chip, **settings):
    """The same after it has stored these settings."""
    for name, value in settings.items():
        assert chip.write(name, value) == 0
    assert chip.write("store_all", SAVE) == 0
    while STATES[chip.read("store_state")] == "saving":
        chip.tick()
    return restarted(chip)


def test_the_tests_of_the_other_chip_are_named_as_they_are():
    names = set().union(*(vars(module) for module in SHARED))
    assert names >= OTHERS


# Clocks and supply.


def test_the_crystal_is_the_clock_by_way_of_range_1_boost_and_is_watched(chip):
    """RM0440 6.1.5, 7.2: the model notes a step that is left out or comes too early."""
    rcc = chip.board.rcc
    assert (rcc.core_hz(), rcc.apb1_hz(), rcc.apb2_hz()) == (168e6, 42e6, 84e6)
    assert rcc.is_within_bounds() and rcc.has_hse() and chip.board.pwr.is_boost()
    assert bits(rcc[0x00], 19) and not bits(rcc[0x00], 18)  # CSSON, no HSEBYP
    assert chip.board.flash[0x00] & 0x70F == 0x704  # four wait states, prefetch, both caches
    enable(chip, 100)
    chip.tick(20)
    assert chip.read("board_state") & INTERNAL == 0
    assert chip.board.mistakes == []


@pytest.mark.parametrize("never", most_long("regulator", "pll", "switch"))
def test_without_its_clock_the_axis_stays_off(never):
    chip = Chip()
    if never == "pll":
        chip.board.rcc.lock_reads = NEVER
    elif never == "switch":
        chip.board.rcc.switches = False
    else:
        chip.board.pwr.write = lambda offset, value: (
            chip.board.pwr.registers.update({offset: value}),
            setattr(chip.board.pwr, "changing", NEVER),
        )
    release(chip)
    assert chip.board.rcc.core_hz() == 16e6
    assert FAULT[chip.read("fault")] == "sensor_invalid"
    assert chip.write("mode", 1) != 0
    chip.tick(10)
    assert chip.board.trail == [OFF]
    assert chip.board.can[0x18] == 1 and chip.board.can[0x1C] == 0x06000A03  # as after a reset
    assert abs(16e6 / chip.board.usart[0x0C] / 115200 - 1) < 0.005
    assert chip.board.mistakes == []


def test_without_the_crystal_the_internal_oscillator_is_in_use_and_says_so():
    chip = Chip()
    chip.board.rcc.hse_hz = None
    release(chip)
    assert chip.board.rcc.core_hz() == 168e6 and chip.board.rcc.is_within_bounds()
    assert chip.read("board_state") & INTERNAL and chip.read("fault") == 0
    can = chip.board.can
    assert can.bit_rate() == 1e6 and can.sample_point() == pytest.approx(11 / 14)
    assert sdo_read(chip, 0x1000)[0] == 0x43
    assert chip.board.mistakes == []


def test_a_start_with_clocks_that_something_else_has_set():
    """A loader may have left the PLL running; the registers are not those of a reset."""
    chip = Chip()
    rcc = chip.board.rcc
    rcc.registers |= {0x00: 0x03000500, 0x08: 0xF, 0x0C: 0x01005532}
    chip.board.flash.registers[0x00] = 4
    release(chip)
    assert (rcc.core_hz(), rcc.apb1_hz(), rcc.apb2_hz()) == (168e6, 42e6, 84e6)
    assert chip.board.mistakes == []


def test_a_crystal_that_stops_is_off_reset_and_reported(chip):
    enable(chip, 700)
    chip.tick(3)
    chip.board.rcc.hse_stops()
    assert chip.board.rcc.nmi
    handle(chip, NMI)
    assert chip.terminals() == OFF and chip.board.scb.reset_asked


@pytest.mark.long
def test_the_boot_is_done_10_ms_after_the_crystal_runs():
    """Halfwords of what is executed stand for cycles, at 16 MHz until the PLL is the clock."""
    chip = Chip(checked=True)
    slow = []

    def watch(_address, _size):
        if chip.board.rcc.core_hz() > 16e6:
            slow.append(chip.steps)
            chip.watch = None

    chip.watch = watch
    release(chip)
    boot_s = slow[0] / 16e6 + (chip.boot_steps - slow[0]) / 168e6
    print(f"\n{slow[0]} and {chip.boot_steps} halfwords, {1e3 * boot_s:.1f} ms")
    boot_s -= chip.board.rcc.hse_start_s
    assert boot_s < 10e-3 and chip.read("board_state") & (4 | 8) == 0


@pytest.mark.parametrize(
    "share, lsi_hz", most_long((0.75, 34e3), (0.5, 29.5e3), (1.35, 32e3), (2.0, 29.5e3))
)
def test_a_tick_that_becomes_slow_or_fast_is_off_in_20_ms(share, lsi_hz):
    chip = Chip()
    chip.board.rtc.lsi_hz = lsi_hz
    release(chip)
    enable(chip, 500)
    chip.tick(20)
    assert chip.terminals()[0] == 1
    chip.board.rcc.hse_hz = 24e6 * share
    # At less than two thirds of the rate the converters also rest for too long.
    chip.board.adc.IDLE_MAX_S = chip.board.adc1.IDLE_MAX_S = 1.0
    chip.tick(31)
    assert chip.terminals() == OFF and FAULT[chip.read("fault")] == "clock_wrong"
    wanted = 1000 * (1 / share - 1)
    chip.tick(20)
    assert chip.read("tick_deviation") == pytest.approx(wanted, abs=0.08 * (1000 + wanted))


OPTIONS = {  # RM0440 3.4.1: what a field of FLASH_OPTR must not be
    "level 3": (8, 7, 3), "level 0": (8, 7, 0), "bank 2": (20, 1, 1), "one bank": (22, 1, 0),
    "pin PB8": (26, 1, 1), "system memory": (27, 1, 0), "parity of the RAM": (24, 1, 0),
}  # fmt: skip


@pytest.mark.parametrize("name", most_long(*OPTIONS))
def test_option_bytes_are_read_back_at_power_up(name):
    at, mask, value = OPTIONS[name]
    chip = Chip()
    options = chip.board.flash.reset[0x20]
    chip.board.flash.registers[0x20] = options & ~(mask << at) | value << at
    refuses_option_bytes(chip)
    # Pages and banks of another layout are not erased.
    if name in ("bank 2", "one bank"):
        assert chip.write("store_all", SAVE) != 0 and chip.board.flash.erased == []


@pytest.mark.parametrize("held", most_long(0x007E0000, 0x0000007F, 0x007F0001, 0x00000000))
def test_the_write_protection_of_the_program_is_read_back_at_power_up(held):
    """RM0440 3.7.9, 3.5.4: WRP1A protects the pages WRP1A_STRT to WRP1A_END of bank 1, and none if
    the first one is above the last one, as the chip is delivered."""
    chip = Chip()
    chip.board.flash.registers[0x2C] = held
    refuses_option_bytes(chip)


def test_a_supply_below_2_9_v_switches_off_by_interrupt_before_the_brown_out(chip):
    enable(chip, 500)
    chip.tick(3)
    nvic = chip.board.nvic
    assert nvic.priority(PVD) < min(nvic.priority(i) for i in (9, FDCAN1, 38)) < nvic.priority(30)
    chip.board.supply(2.95)
    chip.interrupts()
    assert chip.terminals()[0] == 1
    chip.board.supply(2.85)
    chip.interrupts()
    assert chip.terminals() == OFF
    chip.tick()
    assert FAULT[chip.read("fault")] == "supply_wrong" and chip.read("board_state") & SUPPLY


@pytest.mark.parametrize(
    "flags, cause, code",
    [
        (1 << 27 | 1 << 26, 8 + 4, None), (1 << 26, 4, None), (1 << 25, 0, None),
        (1 << 28 | 1 << 26, 16 + 4, 0x6000), (1 << 29 | 1 << 26, 32 + 4, 0xFF07),
        (1 << 30 | 1 << 26, 64 + 4, 0xFF07), (1 << 31 | 1 << 26, 128 + 4, 0x6000),
    ],
)  # fmt: skip
def test_every_cause_of_a_reset_is_an_object_and_an_emergency(flags, cause, code):
    """RM0440 7.4.29: bit 27 is a power-up as well as a brown-out, bit 25 loads option bytes."""
    chip = Chip()
    chip.board.rcc.registers[0x94] = flags
    release(chip)
    assert chip.read("reset_cause") == cause
    assert [c for c, _, _ in emergencies(chip)] == ([] if code is None else [code])
    assert chip.board.rcc[0x94] >> 24 == 0


def test_a_fault_of_the_core_is_kept_and_reported(chip):
    enable(chip, 700)
    chip.tick(4)
    sp = chip.uc.reg_read(test_board_watch.arm_const.UC_ARM_REG_SP) - 32
    chip.uc.mem_write(sp, struct.pack("<8I", 0, 1, 2, 3, 12, 0x0800C101, 0x0800D234, 0x01000000))
    chip.board.scb.registers |= {0x28: 0x8200, 0x2C: 0x40000000, 0x38: 0x20030000}
    handle(chip, 3, sp)
    assert chip.terminals() == OFF
    other = restarted(chip, 1 << 28 | 1 << 26)
    assert other.read("core_fault_pc") == 0x0800D234 and other.read("core_fault_cfsr") == 0x8200
    assert (0x6000, 16 + 4, 0x0800D234) in emergencies(other)


# The image.


def test_the_image_leaves_bank_2_and_the_ram_it_may_not_have():
    for address, data in segments(IMAGE):
        assert address >= 0x08000000 and address + len(data) <= 0x08040000
    lines = subprocess.run(
        ["arm-none-eabi-objdump", "-h", str(IMAGE)], capture_output=True, text=True, check=True
    ).stdout
    rows = re.findall(r"^\s+\d+ (\.\w+)\s+(\w+)\s+(\w+)", lines, re.M)
    used = sum(int(size, 16) for _, size, at in rows if int(at, 16) >= 0x20000000)
    assert used <= BOARD.limits.ram_bytes <= 80 * 1024 + 16 * 1024  # SRAM1 and SRAM2
    assert sum(len(data) for _, data in segments(IMAGE)) <= BOARD.limits.flash_bytes


def test_every_vector_leads_somewhere(chip):
    fail = chip.symbols["board_fail"] | 1
    assert [chip.vectors[i] for i in (3, 4, 5, 6, 11, 12, 14)] == [fail] * 7
    assert chip.vectors[NMI] == chip.symbols["flash_nmi"] | 1
    handlers = {
        PVD: "supply", 9: "index", FDCAN1: "can", 30: "tick", 38: "serial", FDCAN2: "drive_bus",
        FDCAN2_SENT: "drive_bus_sent",
    }  # fmt: skip
    for irq, name in handlers.items():
        assert chip.vectors[16 + irq] == chip.symbols[f"{name}_interrupt"] | 1
    used = {1, 2, 3, 4, 5, 6, 11, 12, 14, 15} | {16 + irq for irq in handlers}
    assert all(chip.vectors[i] == 0 for i in set(range(1, 104)) - used)


@pytest.mark.parametrize("place", most_long("code", "vectors", "check"))
def test_one_wrong_bit_of_the_image_is_found_at_power_up(place):
    chip = Chip(checked=True)
    end = chip.symbols["code_end"]
    at = {"vectors": 0x080001F0, "code": end - 5, "check": end}[place]
    (byte,) = chip.uc.mem_read(at, 1)
    chip.uc.mem_write(at, bytes([byte ^ 0x10]))
    release(chip)
    assert chip.read("board_state") & test_board_watch.IMAGE_DAMAGED
    assert chip.board.trail == [OFF]


def test_the_regions_of_the_memory_protection(chip):
    mpu, at = chip.board.mpu, chip.symbols
    for address in (0, 4, 0x07FFFFFC):
        assert mpu.rights(address) == (False, False, False)
    for address in (0x08000000, at["code_end"], 0x0803FFFC):
        assert mpu.rights(address) == (True, False, True)
    for address in (0x08040000, 0x0807FFFC):
        assert mpu.rights(address) == (True, True, False)
    assert mpu.rights(RAM) == (False, False, False)
    for address in (RAM + 32, at["ram_end"], 0x48000000, 0x50000800, 0x1FFF7590, 0xE000ED00):
        assert mpu.rights(address)[:2] == (True, True)


def test_identity_and_serial_number(chip):
    assert chip.text(0x1009) == "stm32g474"
    assert re.fullmatch(r"\d+\.\d+\.\d+ [0-9a-f]{8} [0-9a-f]{12}\+?", chip.text(0x100A))
    unique = struct.pack("<3I", *UID_WORDS)
    assert chip.read("serial_number") & 0xFFFFFFFF == zlib.crc32(unique)


# Outputs and inputs.


def test_reset_leaves_0_v_and_disabled_wherever_the_boot_is_stopped():
    for step in (1, 300, 2_000, 20_000, 50_000):
        chip = Chip()
        assert chip.terminals() == OFF  # before the first instruction
        chip.close_contacts()
        chip.steps, chip.limit = 0, 1 << 60
        chip.uc.emu_start(chip.entry | 1, 0xFFFFFFFE, count=step)
        assert chip.board.trail == [OFF], step


def test_the_dac_is_set_up_while_it_is_off_and_stands_at_mid_scale_before_it_is_on():
    chip = Chip()
    dac, seen = chip.board.dac, []
    original = dac.write

    def write(offset, value):
        seen.append((offset, value))
        assert chip.board.gpiob.mode(0) == 3  # the amplifier's pin is no output yet
        original(offset, value)

    dac.write = write
    chip.close_contacts()
    chip.boot()
    order = [offset for offset, _ in seen]
    on = next(i for i, (offset, value) in enumerate(seen) if offset == 0 and value & 1)
    assert order.index(0x3C) < on and (0x08, 2048) in seen[:on]


@pytest.mark.parametrize("code", most_long(2047, -2048, -1800, -1, 0, 700, 1799, 1801))
def test_the_dac_within_the_reach_of_its_buffer_is_no_fault(chip, code):
    """0.2 V to 3.1 V at the pin, 8.79 V at the stage."""
    enable(chip, code)
    chip.tick(12)
    assert chip.board.dac[0x2C] == code + 2048
    volts = min(max(code * LSB_V, -8.7879), 8.7879)
    assert chip.terminals() == (1, 1, pytest.approx(volts, abs=1e-3))
    assert FAULT[chip.read("fault")] == "none"


@pytest.mark.parametrize("code, held_v", [(0, 1.9), (1000, 1.65), (2047, 2.9), (-2048, 0.4)])
def test_a_dac_whose_pin_is_held_is_off_in_four_ticks(chip, code, held_v):
    enable(chip, code)
    chip.tick(4)
    chip.board.dac.stuck_v = held_v
    chip.tick(4)
    assert chip.board.gpiob.level(0) == 0 and FAULT[chip.read("fault")] == "output_wrong"


def test_the_outputs_of_cycles_are_low_unless_the_firmware_sets_them(chip):
    port = chip.board.gpiob
    assert [(port.mode(pin), port.level(pin)) for pin in range(12, 16)] == [(1, 0)] * 4
    for levels in (0b1010, 0b0101):
        chip.call("pins_write_digital", levels)
        assert [port.level(pin) for pin in range(12, 16)] == [levels >> i & 1 for i in range(4)]
        assert chip.terminals() == OFF


def test_the_conversion_is_of_this_tick_and_done_in_time(chip):
    before = chip.board.adc.conversions
    chip.board.adc.volts = {6: 1.0, 7: 2.0}
    chip.tick(7)
    assert chip.board.adc.conversions - before == 7
    assert chip.board.adc.group() == [3, 4]
    assert chip.board.adc.duration_s() < 3e-6
    codes = [chip.read("force_raw"), chip.read("current_raw")]
    assert codes == [int(v / SUPPLY_V * 256) for v in (1.0, 2.0)]


@pytest.mark.parametrize("which", ["adc", "adc1"])
def test_a_converter_whose_calibration_does_not_end_never_blocks(which):
    chip = Chip()
    getattr(chip.board, which).ready_reads = NEVER
    release(chip)
    chip.tick(5)
    assert FAULT[chip.read("fault")] == "sensor_invalid" and chip.board.trail == [OFF]
    assert chip.board.mistakes == []


def test_no_conversion_comes_more_than_1_ms_after_the_one_before(chip):
    """ES0430 2.7.9: such a result may be wrong. In the model it is: the reference would be out of
    its band, and the force of the first tick at the end of its range."""
    assert chip.read("board_state") & (test_board_watch.REFERENCE | test_board_watch.DAC) == 0
    rests = {}
    for name, adc in (("ADC1", chip.board.adc1), ("ADC2", chip.board.adc)):

        def is_rested(name=name, adc=adc, original=adc.is_rested):
            rests.setdefault(name, []).append(chip.board.time_s() - adc.rested_s)
            return original()

        adc.is_rested = is_rested
    chip.tick(40)
    assert all(len(times) >= 39 and max(times) < 1e-3 for times in rests.values())
    assert FAULT[chip.read("fault")] == "none"


def test_the_force_of_the_first_tick_is_right():
    """The calibration is some milliseconds before, in which the store is read."""
    chip = Chip()
    chip.close_contacts()
    chip.board.adc.volts = {6: 1.0, 7: 2.0}

    def watch(address, _size):
        if address == chip.symbols["fw_init"]:
            chip.board.advance(168_000 * 5)
            chip.watch = None

    chip.watch = watch
    chip.boot()
    chip.tick()
    codes = [chip.read("force_raw"), chip.read("current_raw")]
    assert codes == [int(v / SUPPLY_V * 256) for v in (1.0, 2.0)]


@pytest.mark.long
def test_a_converter_of_the_force_that_this_board_lacks_is_not_replaced(chip):
    kind = objects.BY_NAME["force_converter"].enum.index("ads1256")
    other = restarted_with(chip, force_converter=kind)
    assert FAULT[other.read("fault")] == "board_unfit" and other.read("board_state") & 1024


# CAN.


def test_bit_timing(chip):
    """CiA 301: the sample point at 87.5 %, from the crystal itself."""
    can = chip.board.can
    assert bits(chip.board.rcc[0x88], 24, 2) == 0
    assert can.bit_rate() == 1e6 and can.sample_point() == 0.875
    jump, segment_2 = bits(can[0x1C], 25, 7) + 1, bits(can[0x1C], 0, 7) + 1
    assert jump <= segment_2 and 2 * segment_2 / (2 * (13 * 24 - segment_2)) > 2 * 0.0015
    assert can[0x18] & 0xFFFF == 0  # classic frames, repeated, neither silent nor loop-back
    assert chip.board.gpioa[0x08] >> 24 & 3 >= 1  # edges of PA12


@pytest.mark.parametrize("kbit_s", most_long(10, 1000, 500, 250, 125, 50, 20))
def test_every_bit_rate_has_its_timing(chip, kbit_s):
    chip.call("port_can_rate", kbit_s)
    test_buses.polls_until(chip, test_buses.ACTIVE, 20)
    for _ in range(3):
        chip.board.can.tick()
        chip.call("port_can_bus")
    assert chip.board.can.bit_rate() == kbit_s * 1000
    assert chip.board.can.sample_point() == 0.875
    assert chip.board.mistakes == []


def test_frames_in_and_out_of_the_message_memory(chip):
    assert sdo_read(chip, 0x1000)[0] == 0x43
    chip.board.can.receive(0x601, bytes(8), extended=True)
    chip.board.can.receive(0x18000601, bytes(8), extended=True, remote=True)
    assert chip.board.can.fifo == 0
    frame = RAM + 0x1FE00
    for number in range(7):  # round the memory of three
        data = bytes(range(number, number + number))
        chip.board.can.receive(0x100 + number, data, remote=number == 5)
        chip.interrupts()
        assert chip.call("port_can_receive", frame)
        can_id, length, remote = struct.unpack("<HBB", chip.uc.mem_read(frame, 4))
        assert (can_id, length, remote) == (0x100 + number, number, number == 5)
        assert bytes(chip.uc.mem_read(frame + 4, number)) == data
    assert chip.board.mistakes == []


def test_a_length_code_above_8_is_8_bytes(chip):
    chip.board.can.receive(0x100, bytes(12))
    chip.interrupts()
    frame = RAM + 0x1FE00
    assert chip.call("port_can_receive", frame)
    assert chip.uc.mem_read(frame + 2, 1)[0] == 8


def test_frames_that_arrive_together_are_all_taken_by_one_interrupt(chip):
    """RF0N is requested once for each frame and may be cleared once for several."""
    for number in range(3):
        chip.board.can.receive(0x100 + number)
    chip.interrupts()
    frame = RAM + 0x1FE00
    taken = []
    while chip.call("port_can_receive", frame):
        taken.append(struct.unpack("<H", chip.uc.mem_read(frame, 2))[0])
    assert taken == [0x100, 0x101, 0x102]


def test_bus_off_stops_the_axis_and_is_recovered_after_129_times_11_bits(chip):
    can = chip.board.can
    assert chip.write("mode", 1) == 0
    chip.tick(2)
    assert chip.terminals()[0] == 1
    can.transmit, transmit = (lambda: None), can.transmit
    can.receive(0x601, bytes([0x40, 0, 0x10, 0, 0, 0, 0, 0]))
    chip.tick()  # an answer waits
    assert can.requests
    can.transmit = transmit
    can.sent.clear()
    can.errors(off=True)
    chip.tick(2)
    assert chip.terminals() == OFF and FAULT[chip.read("fault")] == "can_off"
    assert can.requests == [], "what waited comes out when the bus is back"
    ticks = 0
    while can[0x44] & 0x80:
        assert can.sent == []
        chip.tick()
        ticks += 1
        assert ticks < 20
    assert 1 <= ticks <= 5  # 1419 bits are 2.2 ticks
    chip.tick(3)
    assert any(i == 0x081 for i, _, _ in can.sent) and all(i != 0x581 for i, _, _ in can.sent)
    assert sdo_read(chip, 0x1000)[0] == 0x43
    assert chip.board.mistakes == []


def test_frames_that_nobody_acknowledges_are_given_up_by_an_initialisation(chip):
    """RM0440 44.4.31: frames of the FIFO are not cancelled. They go when CCE is set; the node is
    then on the bus again. The model notes a cancellation."""
    can = chip.board.can
    can.partner = False
    for _ in range(40):
        can.receive(0x601, bytes([0x40, 0, 0x10, 0, 0, 0, 0, 0]))
        chip.tick(5)
        if chip.read("can_state") == test_buses.PASSIVE and len(can.requests) == 3:
            break
    assert len(can.requests) == 3
    aborted = can.aborted
    chip.tick(170)
    assert can.aborted - aborted == 3
    can.partner = True
    chip.tick(10)
    can.sent.clear()
    can.errors()
    assert sdo_read(chip, 0x1000)[0] == 0x43
    assert chip.board.mistakes == []


@pytest.mark.long
def test_a_controller_that_does_not_answer_never_blocks_a_tick():
    chip = Chip()
    chip.board.can.answers_init = False
    chip.board.can.registers[0x18] = 0
    release(chip)
    chip.tick(1600)
    assert chip.board.can.sent == [] and chip.board.trail == [OFF]
    assert chip.read("can_state") == test_buses.OFF


def test_the_second_controller_is_the_bus_of_a_drive(chip):
    """Its frames are in the second part of the message memory; one that was sent interrupts."""
    assert chip.board.can2[0x18] == 1, "an axis without a drive leaves it alone"
    other = restarted_with(chip, drive_node_id=9, drive_bit_rate=500)
    can = other.board.can2
    for _ in range(20):
        other.tick()
        can.transmit()
        other.interrupts()
    assert can.bit_rate() == 500e3 and can.sample_point() == 0.875
    assert can.sent and can.sent[0][:2] == (0x000, bytes([0x81, 9]))  # NMT: reset of the drive
    assert other.board.can.sent  # the boot-up of the axis
    assert other.board.mistakes == []


def test_frames_that_the_drive_does_not_acknowledge_are_given_up_and_the_bus_comes_back(chip):
    """The tick gives them up by an initialisation, while an interrupt of a higher priority fills
    the buffers."""
    other = restarted_with(chip, drive_node_id=9, drive_bit_rate=500)
    can = other.board.can2
    can.partner = False
    for _ in range(400):
        other.tick()
        can.transmit()
        other.interrupts()
    assert can.aborted >= 3 and can.sent == []
    can.partner = True
    can.errors()
    for _ in range(3000):
        other.tick()
        can.transmit()
        other.interrupts()
        if can.sent:
            break
    assert can.sent and other.board.mistakes == []


# The serial line.


def test_the_line_is_115200_8e1(chip):
    usart = chip.board.usart
    assert abs(usart.baud() / 115200 - 1) < 0.005
    control = usart[0x00]
    assert control & 1 << 12 and not control & 1 << 28 and control & 1 << 10  # 9 bits, parity
    assert not control & 1 << 9 and not control & 1 << 15 and usart[0x04] & 0x3000 == 0
    assert chip.board.gpioa.function(2) == chip.board.gpioa.function(3) == 7


def test_an_overrun_of_the_line_ends(chip):
    chip.board.usart.overrun()
    chip.interrupts()
    assert not chip.board.usart[0x1C] & 8


# Flash.


def test_what_was_saved_is_there_after_a_power_cut(chip):
    assert save(chip, 777) == "saved"
    flash = chip.board.flash
    assert flash[0x14] >> 31, "still unlocked"
    assert flash.erased == list(range(16)) and flash.words > 0  # the first sector of the store
    # A word has a double word of its own, whose second half stays erased.
    words = struct.unpack(f"<{len(flash.bytes) // 4}I", flash.bytes)
    assert words[0] == 0x32534146 and set(words[1::2]) == {0xFFFFFFFF}  # "FAS2"
    other = restarted(chip)
    assert STATES[other.read("store_state")] == "loaded" and other.read("force_gain") == 777
    assert chip.board.mistakes == [] and other.board.mistakes == []


def test_the_watchdog_is_fed_in_an_erase_and_the_buses_go_on(chip):
    """16 pages of 22 ms, 352 ms or 528 ticks; the program is in bank 1."""
    board = chip.board
    board.flash.erase_s = 0.022
    before, frames = board.iwdg.feeds, len(board.can.sent)
    ticks = chip.read("tick_count")
    begin = board.cycles
    assert save(chip, 700) == "saved"
    assert board.iwdg.feeds - before > 16 * 150
    chip.tick(5)
    assert chip.read("tick_count") - ticks == round((board.cycles - begin) / (168e6 / 1500))
    assert chip.read("overruns") == pytest.approx(527, abs=3)
    assert len(board.can.sent) >= frames and board.mistakes == []


PROGERR, WRPERR, PGAERR, SIZERR, PGSERR, RDERR = 3, 4, 5, 6, 7, 14


@pytest.mark.long
@pytest.mark.parametrize("bit", [PROGERR, WRPERR, PGAERR, SIZERR, PGSERR, RDERR])
def test_a_write_error_is_reported_and_the_old_set_stays(chip, bit):
    assert save(chip, 500) == "saved"
    chip.board.flash.fail = bit
    assert save(chip, 600) == "failed"
    assert chip.board.flash[0x14] >> 31
    chip.tick(3)
    assert reported(chip)
    chip.board.flash.fail = None
    assert restarted(chip).read("force_gain") == 500
    # The error is no longer in the way, which the manual makes an error of all that follows.
    assert save(chip, 700) == "saved"
    assert restarted(chip).read("force_gain") == 700


@pytest.mark.long
def test_protected_pages_are_a_failure(chip):
    chip.board.flash.protected = {0, 16}
    assert save(chip, 600) == "failed"
    assert bytes(chip.board.flash.bytes) == b"\xff" * 0x10000


@pytest.mark.long
def test_a_flash_that_is_busy_for_ever_ends_by_the_watchdog(chip):
    chip.board.flash.busy_reads = NEVER
    chip.steps_max = 9_000_000
    before = chip.board.iwdg.feeds
    with pytest.raises(Stuck):
        save(chip, 600)
    assert chip.terminals() == OFF
    fed = chip.board.iwdg.feeds - before
    assert 4000 < fed < 20_000  # for 50 ms
    assert chip.board.iwdg.timeout_s(29.5e3) < 25e-3


@pytest.mark.parametrize("cut", most_long(40, 0, 1, 5, 300))
def test_a_double_word_that_a_power_cut_left_damaged_is_no_fault(chip, cut):
    """RM0440 3.3.2: its read requests an NMI. The old set is loaded, the next one is stored."""
    assert save(chip, 500) == "saved"
    flash = chip.board.flash
    words = flash.words
    original = flash.program_double

    def program(at, value):
        if flash.words == words + cut and not flash.damaged:
            flash.damaged.add(at)
            flash.bytes[at : at + 8] = b"\xff\xff\xff\xff\xff\x7f\xff\xff"  # reads as blank
            raise Cut
        original(at, value)

    flash.program_double = program
    with pytest.raises(Cut):
        save(chip, 900)
    other = restarted(chip)
    assert not other.board.scb.reset_asked and other.read("fault") == 0
    assert other.read("force_gain") == 500
    assert save(other, 901) == "saved"
    assert restarted(other).read("force_gain") == 901
    assert other.board.mistakes == []


class Cut(Exception):
    """The power fails."""


@pytest.mark.long
def test_a_damaged_set_falls_back_to_the_one_before(chip):
    assert save(chip, 500) == "saved"
    first = max(i for i in range(0, 0x8000, 8) if chip.board.flash.bytes[i : i + 4] != b"\xff" * 4)
    assert save(chip, 600) == "saved"
    chip.board.flash.damaged.add(first + 8 * 40)  # within the second set
    other = restarted(chip)
    assert other.read("force_gain") == 500
    assert STATES[other.read("store_state")] == "loaded_older" and reported(other)


@pytest.mark.parametrize("bank", [0, 1 << 21])
def test_a_damaged_double_word_that_nobody_asked_for_is_a_fault_of_the_core(chip, bank):
    """Of the program, whatever bank the register names: 3.3.2, its address may be an older one."""
    enable(chip, 700)
    chip.tick(3)
    chip.board.flash.registers[0x18] = 1 << 31 | bank | 0x1230
    handle(chip, NMI)
    assert chip.terminals() == OFF and chip.board.scb.reset_asked


def test_a_corrected_bit_of_the_program_does_not_hide_a_damaged_double_word():
    """RM0440 3.3.2: with ECCC set by the program, address and bank of the damaged double word are
    not told. The chip starts, and counts what was corrected."""
    chip = Chip()
    chip.board.flash.report(30, 0x1230, bank_2=False)
    chip.board.flash.damaged |= {0, 8, 0x8000}
    release(chip)
    assert not chip.board.scb.reset_asked and chip.read("fault") == 0
    assert STATES[chip.read("store_state")] in ("failed", "empty")
    assert chip.read("flash_corrected") == 1
    assert save(chip, 901) == "saved" and restarted(chip).read("force_gain") == 901
    assert chip.board.mistakes == []


def test_corrected_errors_are_counted(chip):
    assert save(chip, 500) == "saved"
    assert chip.read("flash_corrected") == 0
    chip.board.flash.weak = {0, 16, 24}
    other = Chip(bytes(chip.board.flash.bytes))
    other.board.flash.weak = {0, 16, 24}
    release(other)
    assert other.read("force_gain") == 500 and other.read("flash_corrected") >= 1
    before = other.read("flash_corrected")
    for _ in range(3):  # of the program, between two ticks
        other.board.flash.report(30, 0x4000, bank_2=False)
        other.tick()
    assert other.read("flash_corrected") == before + 3
    assert not other.board.flash[0x18] >> 30
    other.tick(5)
    assert other.read("flash_corrected") == before + 3


def test_bank_2_is_changed_without_the_data_cache(chip):
    """ES0430 2.2.2: a read of bank 1 while bank 2 is written corrupts the cache. It is off for each
    double word and each page, reset before it is on, and on otherwise. The model notes mistakes."""
    flash, seen = chip.board.flash, []
    changed = flash.changed
    flash.changed = lambda: (seen.append(bits(flash[0x00], 10)), changed())
    assert save(chip, 800) == "saved"
    assert len(seen) > 16 + 100 and not any(seen)
    assert flash[0x00] & 0x1700 == 0x0700 and not flash.is_stale
    assert chip.board.mistakes == []


def test_a_restart_touches_each_ram_by_a_read_first():
    """ES0430 2.2.7: the first write after a reset to each part of the SRAM may be lost, unless the
    part has been accessed."""
    parts = (0x20000000, 0x20008000, 0x20010000, 0x20014000)
    chip, first = Chip(), {}

    def note(_uc, access, address, _size, _value, _data):
        part = max(at for at in parts if at <= address)
        first.setdefault(part, access)

    chip.uc.hook_add(
        unicorn.UC_HOOK_MEM_READ | unicorn.UC_HOOK_MEM_WRITE, note, None, RAM, RAM + 0x17FFF
    )
    chip.close_contacts()
    chip.boot()
    assert first == dict.fromkeys(parts, unicorn.UC_MEM_READ)


# Bring-up.


def prepared(what):
    def prepare(board):
        if what == "options":
            board.flash.registers[0x20] = 0xFFEFF8AA
        elif what == "crystal":
            board.rcc.hse_hz = None
        elif what == "enable":
            board.gpiob.shorts[0] = 1
        elif what == "output":
            board.dac.stuck_v = 1.0
        elif what == "partner":
            board.can.partner = False

    return prepare


@pytest.mark.long
def test_a_board_that_is_right_passes_every_step_of_the_bring_up(monkeypatch):
    monkeypatch.setattr(test_bringup.bringup, "RATE_TIME_S", 0.2)
    monkeypatch.setattr(test_bringup.bringup, "READINGS", 5)
    protocol = test_bringup.brought_up(test_bringup.new_board())
    assert [(s.name, s.text) for s in protocol.steps if s.verdict != test_bringup.PASSED] == []
    assert protocol.passed


@pytest.mark.parametrize(
    "step, what, words",
    most_long(
        ("board", "options", ["option bytes", "`write_image`"]),
        ("board", "crystal", ["24 MHz", "PF0"]), ("outputs", "enable", ["PB0"]),
        ("outputs", "output", ["PA4"]), ("can", "partner", ["acknowledges"]),
    ),
)  # fmt: skip
def test_a_fault_of_this_board_is_named_by_its_step(step, what, words):
    board = test_bringup.new_board(prepared(what))
    (found,) = test_bringup.brought_up(board, (step,)).steps
    assert found.verdict == test_bringup.FAILED
    assert all(word in found.text for word in words), found.text
