"""What the board finds of itself: supply, clocks, outputs, memories, faults of the core. Outputs go
off within the stated time, on models that follow the manual."""

import struct

import pytest
import unicorn
from chip import (
    BOARD,
    FLASH,
    HARD_FAULT,
    IMAGE,
    NMI,
    PVD,
    RAM,
    SLOT_BYTES,
    SLOTS,
    STORE,
    STORE_BYTES,
    Chip,
    release,
    segments,
)
from forceaxis import objects
from peripherals import CRC_TABLE
from test_board import LSB_V, OFF, enable
from unicorn import arm_const

FAULT = objects.BY_NAME["fault"].enum
STATE = {bit.key: 1 << bit.bit for bit in objects.BY_NAME["board_state"].bits}
INTERNAL, OPTION_BYTES, SUPPLY = STATE["clock_internal"], STATE["option_bytes"], STATE["supply"]
IMAGE_DAMAGED, RAM_FAILED, REFERENCE = STATE["image"], STATE["ram"], STATE["reference"]
DAC, ENABLE, TICK, TICK_UNKNOWN = (STATE[k] for k in ("dac", "enable", "tick", "tick_unknown"))
# RCC_CSR, RM0390 6.3.21.
POWER_UP = 1 << 27 | 1 << 26 | 1 << 25
BY_SOFTWARE = 1 << 28 | 1 << 26


def emergencies(chip):
    """(code, first manufacturer byte, the next four)"""
    return [struct.unpack("<HxBI", d) for i, d, _ in chip.board.can.sent if i == 0x081]


def handle(chip, number, stack=None):
    """A handler that does not return, called with such a stack pointer."""
    chip.limit, chip.steps, chip.problem = 1 << 60, 0, None
    if stack is not None:
        chip.uc.reg_write(arm_const.UC_ARM_REG_SP, stack)
    chip.uc.reg_write(arm_const.UC_ARM_REG_LR, 0xFFFFFFF9)
    chip.uc.emu_start(chip.vectors[number], 0xFFFFFFFE, count=400)
    assert chip.problem is None, chip.problem


def restarted(chip, flags):
    """The same RAM and flash after a reset with these flags."""
    other = Chip(bytes(chip.board.flash.bytes))
    other.uc.mem_write(RAM, bytes(chip.uc.mem_read(RAM, 128 * 1024)))
    other.board.rcc.registers[0x74] = flags
    return release(other)


# Clocks.


def test_the_input_of_the_st_link_is_the_clock_and_is_watched(chip):
    rcc = chip.board.rcc
    assert rcc[0x00] >> 18 & 1 and rcc[0x00] >> 16 & 1  # HSEBYP, HSEON
    assert rcc[0x04] >> 22 & 1 and rcc.is_within_bounds()  # PLLSRC
    assert rcc[0x00] >> 19 & 1  # CSSON
    assert rcc.core_hz() == 168e6
    assert chip.read("board_state") & INTERNAL == 0


def test_without_it_the_internal_oscillator_is_in_use_and_says_so():
    chip = Chip()
    chip.board.rcc.hse_hz = None
    release(chip)
    assert chip.board.rcc.core_hz() == 168e6 and chip.board.rcc.is_within_bounds()
    assert chip.read("board_state") & INTERNAL
    assert chip.read("fault") == 0
    assert chip.board.mistakes == []


def test_a_clock_that_stops_is_off_reset_and_reported(chip):
    """RM0390 6.2.7: NMI. The handler switches off and resets; the next start has no input."""
    enable(chip, 700)
    chip.tick(3)
    chip.board.rcc.hse_stops()
    assert chip.board.rcc.nmi
    handle(chip, NMI)
    assert chip.terminals() == OFF and chip.board.scb.reset_asked
    again = Chip()
    again.uc.mem_write(RAM, bytes(chip.uc.mem_read(RAM, 128 * 1024)))
    again.board.rcc.registers[0x74] = BY_SOFTWARE
    again.board.rcc.hse_hz = None
    release(again)
    assert again.read("board_state") & INTERNAL and again.read("fault") == 0


def test_a_start_with_clocks_that_something_else_has_set(chip):
    """A loader may have left the PLL running; the registers are not those of a reset."""
    other = Chip()
    rcc = other.board.rcc
    rcc.registers |= {0x00: 0x03010083 | 1 << 17 | 1 << 18, 0x04: 0x24405408, 0x08: 0xA}
    other.board.flash.registers[0x00] = 5
    release(other)
    assert (rcc.core_hz(), rcc.apb1_hz(), rcc.apb2_hz()) == (168e6, 42e6, 84e6)
    assert other.board.mistakes == []


def test_the_second_clock_is_compared_after_10_ms():
    chip = Chip()
    chip.board.rtc.lsi_hz = 40e3
    release(chip)
    assert chip.read("board_state") & TICK_UNKNOWN
    chip.tick(15)
    assert chip.read("board_state") & (TICK | TICK_UNKNOWN) == 0
    assert abs(chip.read("tick_deviation")) < 60  # measured by 20 counts


@pytest.mark.parametrize(
    "hse_hz, lsi_hz", [(4e6, 17e3), (4e6, 47e3), (6e6, 32e3), (10.8e6, 47e3), (16e6, 17e3)]
)
def test_a_tick_that_becomes_slow_or_fast_is_off_in_20_ms(chip, hse_hz, lsi_hz):
    chip = Chip()
    chip.board.rtc.lsi_hz = lsi_hz
    release(chip)
    enable(chip, 500)
    chip.tick(20)
    assert chip.terminals()[0] == 1
    chip.board.rcc.hse_hz = hse_hz
    ticks = 0
    begin = chip.board.lsi_counts
    while chip.terminals() != OFF:
        chip.tick()
        ticks += 1
        assert ticks <= 31
    took_s = (chip.board.lsi_counts - begin) / lsi_hz
    assert took_s < 31 / 1500 * 8e6 / hse_hz
    assert FAULT[chip.read("fault")] == "clock_wrong"
    wanted = 1000 * (8e6 / hse_hz - 1)
    chip.tick(20)
    assert chip.read("tick_deviation") == pytest.approx(wanted, abs=0.08 * (1000 + wanted))
    assert chip.write("mode", 1) != 0


@pytest.mark.parametrize("hse_hz", [4e6, 6e6, 12e6, 16e6])
def test_a_tick_that_is_slow_or_fast_from_the_start_is_found(hse_hz):
    """The second clock is measured by the internal oscillator before the input is the clock."""
    chip = Chip()
    chip.board.rcc.hse_hz = hse_hz
    release(chip)
    chip.tick(16)
    assert FAULT[chip.read("fault")] == "clock_wrong"
    assert chip.board.trail == [OFF]


@pytest.mark.parametrize("share", [0.88, 1.12])
def test_a_second_clock_that_drifts_is_no_fault(chip, share):
    enable(chip, 500)
    chip.tick(20)
    chip.board.rtc.lsi_hz *= share
    chip.tick(60)
    assert chip.terminals()[0] == 1


def test_a_second_clock_that_wanders_after_a_power_up_is_reset_with_its_domain():
    """A battery at VBAT, or a supply that has dipped, keeps the clock selected from before: the LSI
    then wanders until the backup domain is reset (ES0430, "Unstable LSI when it clocks RTC")."""
    chip = Chip()
    chip.board.rcc.registers[chip.board.rtc.BACKUP] = 0x8200  # RTCEN, RTCSEL: LSI
    chip.board.rtc.wander = 0.4
    release(chip)
    enable(chip, 500)
    chip.tick(100)
    assert chip.terminals()[0] == 1 and chip.read("fault") == 0
    assert chip.board.mistakes == []


def test_a_second_clock_that_stops_is_the_watchdog_that_stops(chip):
    enable(chip, 500)
    chip.tick(20)
    chip.board.rtc.lsi_hz = 0.0
    chip.tick(31)
    assert chip.terminals() == OFF and FAULT[chip.read("fault")] == "clock_wrong"


# Supply.


def test_brown_out_level_3_is_read_back_at_power_up():
    """RM0390 3.9.13: BOR_LEV, bits 3:2 of FLASH_OPTCR; 0 is level 3, 3 off, as delivered."""
    for level in (1, 2, 3):
        chip = Chip()
        chip.board.flash.registers[0x14] = 0x0FFEAAE1 | level << 2
        refuses_option_bytes(chip)


@pytest.mark.parametrize("options", [0x0FFFAAE1, 0x8FFEAAE1])
def test_the_write_protection_of_the_loader_is_read_back_at_power_up(options):
    """RM0390 3.8.6: nWRP0, bit 16 of FLASH_OPTCR, is 0 where sector 0 is protected from programming
    and erasing; with SPRMOD, bit 31, it is a protection from reading."""
    chip = Chip()
    chip.board.flash.registers[0x14] = options
    refuses_option_bytes(chip)


def refuses_option_bytes(chip):
    """A chip with other option bytes is never enabled, also after a reset of its fault."""
    release(chip)
    chip.tick(2)
    assert FAULT[chip.read("fault")] == "board_unfit"
    assert chip.read("board_state") & OPTION_BYTES
    assert chip.write("fault_reset", 1) == 0
    assert chip.write("mode", 1) == 0
    chip.tick(3)
    assert chip.board.trail == [OFF], "a reset of the fault enables it"
    assert FAULT[chip.read("fault")] == "board_unfit"


def test_a_supply_below_2_9_v_switches_off_by_interrupt_before_the_brown_out(chip):
    """Not by a tick: the interrupt alone, above all others. 2.7 V is the brown-out's."""
    enable(chip, 500)
    chip.tick(3)
    assert chip.board.nvic.priority(PVD) < min(chip.board.nvic.priority(i) for i in (9, 20, 38))
    chip.board.supply(2.95)
    chip.interrupts()
    assert chip.terminals()[0] == 1
    chip.board.supply(2.85)
    chip.interrupts()
    assert chip.terminals() == OFF
    chip.tick()
    assert chip.terminals() == OFF and FAULT[chip.read("fault")] == "supply_wrong"
    assert chip.read("board_state") & SUPPLY
    # Back again: the fault stays until it is reset.
    chip.board.supply(3.3)
    chip.tick(3)
    assert chip.terminals() == OFF and chip.read("board_state") & SUPPLY
    assert chip.write("fault_reset", 1) == 0
    enable(chip, 500)
    chip.tick(2)
    assert chip.terminals()[0] == 1 and chip.read("board_state") & SUPPLY == 0


@pytest.mark.parametrize("at", range(0, 40, 5))
def test_a_supply_that_falls_while_the_tick_puts_out_its_code(chip, at):
    """Wherever the interrupt comes in port_act(), the outputs are off behind it."""
    enable(chip, 500)
    chip.tick(3)
    outputs = RAM + 0x1FE00
    chip.uc.mem_write(outputs, struct.pack("<hBBh", 500, 1, 1, 8000))
    chip.board.supply(2.8)
    chip.call_interrupted("port_act", at, PVD, outputs)
    chip.board.exti.registers[0x14] = 0
    assert chip.terminals() == OFF


def test_a_supply_that_falls_within_the_look_at_it_stays_low(chip):
    """Wherever the detector's interrupt comes in supply_look(), the tick knows of it."""
    for at in range(12):
        chip.board.supply(3.3)
        chip.tick(2)
        assert not chip.call("supply_is_low") & 1
        # The detector rises when the interrupt runs, so what was read before was 0.
        original, chip.board.pwr.is_low = chip.board.pwr.is_low, lambda: False
        handler = chip.interrupt

        def rises(irq, handler=handler, original=original):
            chip.board.pwr.is_low = original
            chip.board.supply_v = 2.85
            handler(irq)

        chip.interrupt = rises
        chip.call_interrupted("supply_look", at, PVD)
        chip.interrupt = handler
        chip.board.pwr.is_low = original
        assert chip.stopped_at is None or chip.call("supply_is_low") & 1, f"undone after {at}"
        chip.board.exti.registers[0x14] = 0
        chip.write("fault_reset", 1)
    assert chip.stopped_at is None, "the look has more instructions than were tried"


@pytest.mark.parametrize("volts, wrong", [(3.0, False), (3.55, False), (2.92, True), (3.75, True)])
def test_the_adc_s_reference_tells_a_supply_that_is_out_of_its_band(chip, volts, wrong):
    """VREFINT is 1.21 V: its code is 1502 at 3.3 V, as the chip's calibration says."""
    enable(chip, 500)
    chip.tick(3)
    chip.board.supply_v = volts
    chip.tick(5)
    assert (chip.terminals() == OFF) == wrong
    assert bool(chip.read("board_state") & REFERENCE) == wrong
    assert FAULT[chip.read("fault")] == ("supply_wrong" if wrong else "none")


# Outputs, read back.


@pytest.mark.parametrize("code", [-2000, -300, 0, 700, 2047])
def test_a_dac_that_does_what_it_should_is_no_fault(chip, code):
    enable(chip, code)
    chip.tick(12)
    assert chip.terminals() == (1, 1, pytest.approx(code * LSB_V))
    assert chip.read("board_state") & (DAC | ENABLE) == 0


def test_a_dac_whose_pin_is_held_is_off_in_four_ticks(chip):
    """PA4 itself, by channel 4 of the ADC; its register would say that all is right."""
    enable(chip, 500)
    chip.tick(4)
    assert chip.board.dac[0x2C] == 2548
    chip.board.dac.stuck_v = 1.9
    chip.tick(4)
    assert chip.board.gpiob.level(0) == 0
    assert FAULT[chip.read("fault")] == "output_wrong" and chip.read("board_state") & DAC


def test_one_disturbed_reading_is_no_fault(chip):
    enable(chip, 500)
    chip.tick(4)
    dac = chip.board.dac
    original = dac.pin_v
    for _ in range(4):
        dac.pin_v = lambda: 0.1
        chip.tick(2)
        dac.pin_v = original
        chip.tick(2)
    assert chip.terminals()[0] == 1


@pytest.mark.parametrize("enabled, held", [(True, 0), (False, 1)])
def test_an_enable_that_is_held_by_something_else_is_a_fault(chip, enabled, held):
    if enabled:
        enable(chip, 500)
        chip.tick(3)
    chip.board.gpiob.shorts[0] = held
    chip.tick(2)
    assert FAULT[chip.read("fault")] == "output_wrong" and chip.read("board_state") & ENABLE


def test_dynamic_enable_is_a_square_wave_while_enabled_and_low_otherwise():
    """PC10 to ground. What hangs holds a level, which a charge pump does not pass."""
    chip = Chip()
    chip.board.gpioc.wires[10] = 0
    release(chip)
    chip.tick(10)
    assert chip.board.trail == [OFF]
    enable(chip, 400)
    levels = []
    for _ in range(9):
        chip.tick()
        levels.append(chip.board.gpiob.level(0))
    assert levels == [1, 0, 1, 0, 1, 0, 1, 0, 1]
    assert chip.read("fault") == 0
    assert chip.write("mode", 0) == 0
    chip.tick(4)
    assert chip.terminals() == OFF


# Faults of the core.


@pytest.mark.parametrize(
    "number, stack",
    [(HARD_FAULT, RAM - 16), (HARD_FAULT, 0), (NMI, RAM + 8), (4, RAM - 16), (6, 0xFFFFFFF8)],
)
def test_a_broken_stack_still_switches_the_outputs_off(chip, number, stack):
    """ARMv7-M B1.5.14: after a push that failed the handler of the hard fault begins with that
    stack; a push of its own would lock the core up."""
    enable(chip, 700)
    chip.tick(3)
    assert chip.terminals()[0] == 1
    handle(chip, number, stack)
    assert chip.terminals() == OFF
    assert chip.board.scb.reset_asked


def test_a_fault_of_the_core_is_kept_reported_and_an_incident(chip):
    enable(chip, 700)
    chip.tick(40)
    sp = chip.uc.reg_read(arm_const.UC_ARM_REG_SP) - 32
    chip.uc.mem_write(sp, struct.pack("<8I", 0, 1, 2, 3, 12, 0x0800C101, 0x0800D234, 0x01000000))
    chip.board.scb.registers |= {0x28: 0x8200, 0x2C: 0x40000000, 0x38: 0x20030000}
    handle(chip, HARD_FAULT, sp)
    again = restarted(chip, BY_SOFTWARE)
    names = ("pc", "lr", "cfsr", "hfsr", "bfar")
    words = [again.read(f"core_fault_{n}") for n in names]
    assert words == [0x0800D234, 0x0800C101, 0x8200, 0x40000000, 0x20030000]
    assert again.read("reset_cause") == 16 + 4
    assert (0x6000, 16 + 4, 0x0800D234) in emergencies(again)
    again.tick(10)
    codes = dict(objects.BY_NAME["error_code"].values)
    assert codes[again.read("incident_error_code")] == "core_fault"
    # Told once: the next reset is another one.
    third = restarted(again, 1 << 26)
    assert third.read("core_fault_pc") == 0 and emergencies(third) == []


def test_a_frame_that_could_not_be_pushed_is_not_told():
    """STKERR: what lies there is older than the fault."""
    chip = release(Chip())
    sp = chip.uc.reg_read(arm_const.UC_ARM_REG_SP) - 32
    chip.uc.mem_write(sp, struct.pack("<8I", *range(0x11, 0x19)))
    chip.board.scb.registers[0x28] = 1 << 12
    handle(chip, HARD_FAULT, sp)
    again = restarted(chip, BY_SOFTWARE)
    assert (again.read("core_fault_pc"), again.read("core_fault_cfsr")) == (0, 1 << 12)


@pytest.mark.parametrize(
    "flags, code",
    [
        (POWER_UP, None), (1 << 26, None), (1 << 25 | 1 << 26, 0x5110), (BY_SOFTWARE, 0x6000),
        (1 << 29 | 1 << 26, 0xFF07), (1 << 30 | 1 << 26, 0xFF07), (1 << 31 | 1 << 26, 0x6000),
    ],
)  # fmt: skip
def test_every_cause_of_a_reset_is_an_object_and_an_emergency(flags, code):
    chip = Chip()
    chip.board.rcc.registers[0x74] = flags
    release(chip)
    assert chip.read("reset_cause") == flags >> 24
    assert [(c, cause) for c, cause, _ in emergencies(chip)] == (
        [] if code is None else [(code, flags >> 24)]
    )


def test_a_division_by_zero_is_a_fault_and_the_vectors_are_the_image_s(chip):
    assert chip.board.scb[0x14] & 1 << 4  # CCR: DIV_0_TRP
    assert chip.board.scb[0x08] == chip.symbols["vectors_begin"]  # VTOR


# Memories.


def test_the_crc_is_that_of_the_manual_s_unit():
    """CRC-32/MPEG-2 of 4 zero bytes, C704DD7Bh, and of "123456789", 0376E6E7h, from the catalogue
    of parametrised CRC algorithms; over the image what tools/image has put behind it."""

    def crc(data):
        value = 0xFFFFFFFF
        for byte in data:
            value = (value << 8 ^ CRC_TABLE[value >> 24 ^ byte]) & 0xFFFFFFFF
        return value

    assert crc(bytes(4)) == 0xC704DD7B and crc(b"123456789") == 0x0376E6E7
    chip = Chip(checked=True)
    at = chip.symbols
    held = b""
    for begin, end in (("vectors_begin", "vectors_end"), ("code_begin", "code_end")):
        held += bytes(chip.code[at[begin] - FLASH : at[end] - FLASH])
    big_endian = b"".join(held[i : i + 4][::-1] for i in range(0, len(held), 4))
    assert chip.code[at["code_end"] - FLASH :][:4] == crc(big_endian).to_bytes(4, "little")
    # All of the image is within, but the check itself.
    image = range(SLOTS[0], SLOTS[0] + BOARD.limits.flash_bytes)
    flashed = sum(len(data) for address, data in segments(IMAGE) if address in image)
    assert len(held) <= flashed + 16 and flashed - 4 <= len(held)


@pytest.mark.parametrize("place", ["vectors", "code", "check"])
def test_one_wrong_bit_of_the_image_is_found_at_power_up(place):
    chip = Chip(checked=True)
    at = {"vectors": SLOTS[0] + 0x1F0, "code": chip.symbols["code_end"] - 5,
          "check": chip.symbols["code_end"]}[place]  # fmt: skip
    (byte,) = chip.uc.mem_read(at, 1)
    chip.uc.mem_write(at, bytes([byte ^ 0x10]))
    release(chip)
    chip.tick(2)
    assert FAULT[chip.read("fault")] == "board_unfit"
    assert chip.read("board_state") & IMAGE_DAMAGED
    assert chip.board.trail == [OFF]


def test_the_ram_is_tested_word_by_word_and_keeps_what_it_held():
    chip = Chip()
    before = {}

    def watch(address, _size):
        name = "before" if address == chip.symbols["ram_is_right"] else "after"
        if name == "before":
            before["ram"] = bytes(chip.uc.mem_read(RAM, chip.symbols["ram_end"] - RAM))
            before["return"] = chip.uc.reg_read(arm_const.UC_ARM_REG_LR) & ~1
        elif address == before.get("return"):
            before["after"] = bytes(chip.uc.mem_read(RAM, chip.symbols["ram_end"] - RAM))
            chip.watch = None

    chip.watch = watch
    release(chip)
    sp = chip.symbols["stack_top"] - RAM
    # Of the stack only what lies above the test's own frame must be the same.
    assert before["ram"][sp:] == before["after"][sp:]
    assert before["ram"][:0x800] == before["after"][:0x800]
    assert chip.read("board_state") & RAM_FAILED == 0


def test_a_bit_of_the_ram_that_is_stuck_is_found():
    """One that reads 1 whatever is written to it, in the last word in use."""
    chip = Chip()
    at = chip.symbols["ram_end"] - 4

    def stuck(uc, _access, address, _size, value, _data):
        uc.mem_write(address, (value | 1 << 9).to_bytes(4, "little"))

    import unicorn

    # After the write it is put right, before the next instruction reads it.
    def follow(uc, _address, _size, _data):
        (word,) = struct.unpack("<I", uc.mem_read(at, 4))
        if not word >> 9 & 1:
            uc.mem_write(at, struct.pack("<I", word | 1 << 9))

    begin = chip.symbols["ram_is_right"]
    chip.uc.hook_add(unicorn.UC_HOOK_CODE, follow, None, begin, begin + 0x60)
    release(chip)
    chip.tick(2)
    assert chip.read("board_state") & RAM_FAILED
    assert FAULT[chip.read("fault")] == "board_unfit"


def test_the_regions_of_the_memory_protection(chip):
    """Null page, code read-only, what is stored not executed, a guard below the stack."""
    mpu, at = chip.board.mpu, chip.symbols
    for address in (0, 4, 0x1000, 0x07FFFFFC):
        assert mpu.rights(address) == (False, False, False)
    end = SLOTS[0] + SLOT_BYTES
    loader_and_reserve = (FLASH, STORE - 4, STORE + STORE_BYTES, 0x0800FFFC)
    image = (at["vectors_begin"], at["code_begin"], at["code_end"], end - 68)
    for address in (*loader_and_reserve, *image):
        assert mpu.rights(address) == (True, False, True)
    archive = (0x08010000, 0x0801FFFC, 0x08060000, 0x0807FFFC)
    slots = (end - 64, end - 4, SLOTS[1], SLOTS[1] + SLOT_BYTES - 4)
    for address in (STORE, STORE + STORE_BYTES - 4, *archive, *slots):
        assert mpu.rights(address) == (True, True, False)
    for address in (RAM, RAM + 28):
        assert mpu.rights(address) == (False, False, False)
    for address in (RAM + 32, at["ram_end"], 0x40020000, 0x1FFF7A10, 0xE000ED00):
        assert mpu.rights(address)[:2] == (True, True)
    assert mpu.rights(at["erase_from_ram"])[2] if "erase_from_ram" in at else True


def test_the_debugger_does_not_stop_the_watchdog_for_good():
    """DBGMCU_APB1_FZ, bit 12: set by openocd's script, kept over all resets but a power-up."""
    chip = Chip()
    chip.board.dbgmcu.registers[0x08] = 0x1800
    release(chip)
    assert chip.board.dbgmcu[0x08] & 1 << 12 == 0


def test_edges_of_can_are_fast_enough(chip):
    """OSPEEDR of PB9: the slowest rate is for 2 MHz, a bit of CAN is 1 us."""
    assert chip.board.gpiob[0x08] >> 18 & 3 >= 1


HANDLERS = {"tick": 30, "index": 9, "can": 20, "serial": 38, "supply": PVD}


@pytest.mark.parametrize("irq", HANDLERS.values(), ids=HANDLERS.keys())
def test_a_handler_ends_when_its_stores_are_complete(chip, irq):
    """Cortex-M4 erratum 838869: a store that overlaps the return can make the core enter the
    handler of another interrupt. DSB is F3BF 8F4F (ARMv7-M A7.7.33)."""
    pending = [False]

    def stores(*_):
        pending[0] = True

    def executes(uc, address, size, _data):
        if bytes(uc.mem_read(address, size)) == b"\xbf\xf3\x4f\x8f":
            pending[0] = False

    chip.uc.hook_add(unicorn.UC_HOOK_MEM_WRITE, stores)
    chip.uc.hook_add(unicorn.UC_HOOK_CODE, executes)
    chip.uc.ctl_flush_tb()
    chip.board.supply_v = 2.8
    chip.board.nvic.registers.update({0: 0xFFFFFFFF, 4: 0xFFFFFFFF, 8: 0xFFFFFFFF})
    pending[0] = True
    chip.interrupt(irq)
    assert not pending[0]
