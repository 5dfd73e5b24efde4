"""The update and the loader as the released images do them, in front of the model of the flash:
which sectors they erase, which words they program, and what the loader starts."""

import functools
import random
import struct
from dataclasses import replace

import pytest
from chip import FLASH, IMAGE, RAM, RAM_BYTES, SLOT_BYTES, SLOTS, Chip, Stuck, release
from forceaxis import objects
from forceaxis.chip import update_file
from unicorn import arm_const

REQUEST, ANSWER = 0x601, 0x581
TRAILER = slice(SLOT_BYTES - 64, SLOT_BYTES)
BLANK = update_file.BLANK
ERASED = b"\xff" * SLOT_BYTES
SOFTWARE_RESET = 1 << 28 | 1 << 26  # RCC_CSR: SFTRSTF, PINRSTF


@functools.cache
def records():
    """The images for both slots, of the update file that tools/image has built."""
    return update_file.read(IMAGE.with_suffix(".update"))


def table():
    """The object table that an update has to name."""
    return records()[0].table


def trailer(record, sequence, confirmed=0, tries=()):
    words = [update_file.TRAILER_MAGIC, len(record.image), record.crc, sequence, confirmed, *tries]
    return update_file.TRAILER.pack(*words, *[BLANK] * (16 - len(words)))


def slot(record, *facts):
    """The bytes of a slot with an image and its trailer."""
    return record.image.ljust(SLOT_BYTES - 64, b"\xff") + trailer(record, *facts)


def ask(chip, data):
    """A frame to the SDO server; its answer, None without one."""
    chip.board.can.sent.clear()
    chip.board.can.receive(REQUEST, bytes(data).ljust(8, b"\0"))
    chip.main()
    chip.tick()
    found = [d for i, d, _ in chip.board.can.sent if i == ANSWER]
    return found[0] if found else None


def begin(chip, size):
    return ask(chip, struct.pack("<BHBI", 0xC6, 0x1F50, 1, size))


def blocks(chip, data, size):
    """The first `size` bytes of a block download; the last answer."""
    answer = begin(chip, len(data))
    if answer[0] == 0x80:
        return answer
    block = answer[4]
    for at in range(0, size, 7 * block):
        for number in range(block):
            piece = data[at + 7 * number : at + 7 * number + 7]
            answer = ask(chip, bytes([number + 1]) + piece)
            if answer is not None and answer[0] == 0x80:
                return answer
        assert answer is not None and answer[0] == 0xA2 and answer[1] == block
        block = answer[2]
    return answer


def test_the_other_slot_is_erased_and_programmed_as_the_manual_says(chip):
    """Erase with the head, from the RAM with the watchdog fed; words as they come, read back."""
    flash, record = chip.board.flash, records()[1]
    flash.busy_reads = 500
    feeds, store = chip.board.iwdg.feeds, bytes(flash.bytes)
    running = bytes(flash.slots[:SLOT_BYTES])
    data = record.download(table())
    blocks(chip, data, 770)
    written = 770 - 64 - 7 - 3  # a segment is held until the next one, and words are complete
    other = bytes(flash.slots[SLOT_BYTES:])
    assert flash.erased == [6] and chip.board.iwdg.feeds - feeds > 400
    assert other[:written] == data[64 : 64 + written]
    assert other[written + 4 :] == ERASED[written + 4 :]
    assert bytes(flash.slots[:SLOT_BYTES]) == running and bytes(flash.bytes) == store
    assert chip.read("program_flash_status") == 1
    assert chip.write("mode", objects.BY_NAME["mode"].enum.index("open_loop")) != 0
    assert chip.board.mistakes == [] and chip.terminals() == (0, 0, 0.0)


@pytest.mark.parametrize(
    "change, reason",
    [
        (lambda r: replace(r, board="nucleo-g474re").download(table()), "other_board"),
        (lambda r: replace(r, address=SLOTS[0]).download(table()), "other_link"),
        (lambda r: r.download(1), "other_table"),
        (lambda r: r.download(table())[:-8], "wrong_length"),
    ],
)
def test_what_is_wrong_leaves_the_slot_untouched(chip, change, reason):
    data = change(records()[1])
    before = bytes(chip.board.flash.slots)
    assert blocks(chip, data, 154)[0] == 0x80
    assert objects.BY_NAME["program_refusal"].enum[chip.read("program_refusal")] == reason
    assert bytes(chip.board.flash.slots) == before and chip.board.flash.erased == []


def test_a_restart_is_a_reset_that_nobody_has_to_explain(chip):
    """100 ms after its answer. The next start finds the software reset in RCC_CSR, and the word
    that the command has left in the RAM: no emergency, no fault of the core."""
    assert chip.write("program_control", 1) == 0
    chip.tick(140)
    assert not chip.board.scb.reset_asked
    chip.steps_max = 100_000
    with pytest.raises(Stuck):
        chip.tick(20)
    assert chip.board.scb.reset_asked
    after = Chip()
    after.uc.mem_write(RAM, bytes(chip.uc.mem_read(RAM, RAM_BYTES)))
    after.board.rcc.registers[0x74] = SOFTWARE_RESET
    release(after)
    after.tick(5)
    assert after.read("reset_cause") & 1 << 4 == 0 and after.read("core_fault_pc") == 0
    assert not any(i == 0x81 for i, _, _ in after.board.can.sent)


@pytest.mark.parametrize("seed", [0, *(pytest.param(s, marks=pytest.mark.long) for s in (1, 2, 3))])
def test_no_sequence_of_commands_programs_the_loader_or_the_parameters(chip, seed):
    """The model of the flash refuses every address but those of the other slot and the word that
    confirms the running image (Flash.program_slot, Flash.erase)."""
    dice, flash = random.Random(seed), chip.board.flash
    store, running = bytes(flash.bytes), bytes(flash.slots[:SLOT_BYTES])
    data = records()[1].download(table())
    parts = [f"cycle_data_{n}" for n in range(1, 17)]
    for _ in range(60):
        match dice.randrange(6):
            case 0:
                blocks(chip, data, dice.choice([77, 154]))
            case 1:
                head = bytearray(data[:77])
                head[dice.randrange(64)] ^= 1 << dice.randrange(8)
                blocks(chip, bytes(head) + data[77:], 154)
            case 2:
                chip.write("program_control", dice.choice([0, 1, 3, 4, 127, 128]))
                chip.tick(dice.choice([1, 5]))
            case 3:
                chip.write("cycle_data_offset", dice.choice([0, 0, 4, 64, 65532]))
                words = struct.unpack("<16I", data[:64])
                for name, word in zip(parts, words, strict=True):
                    value = word if dice.random() < 0.95 else dice.getrandbits(32)
                    chip.write(name, value - (1 << 32) if value >> 31 else value)
            case 4:
                ask(chip, dice.randbytes(8))
            case _:
                chip.write("cycle_data_end", dice.randrange(1, 4097))
                chip.tick(dice.randrange(3))
    assert bytes(flash.bytes) == store
    assert bytes(flash.slots[:SLOT_BYTES]) == running
    assert set(flash.erased) == {6}
    assert chip.board.mistakes == []


# The loader.


def start(slots, number):
    """A chip after its loader: it has started the image in slot `number`, or waits with None."""
    chip = Chip(slot=number or 0, slots=slots, checked=True)
    chip.board.flash.words_of_trailer = {20, 24, 28, 32}
    stack, entry = struct.unpack_from("<II", chip.code)
    chip.uc.reg_write(arm_const.UC_ARM_REG_SP, stack)
    begin = SLOTS[number or 0]
    (reset,) = struct.unpack_from("<I", chip.code, begin - FLASH + 4)
    if number is None:
        chip.steps_max = 8_000_000
        try:
            chip._run(entry, 0xFFFFFFFE)
        except Exception as error:
            assert "instructions" in str(error), error
        return chip
    chip._run(entry, reset & ~1)
    assert chip.uc.reg_read(arm_const.UC_ARM_REG_PC) & ~1 == reset & ~1
    assert chip.uc.reg_read(arm_const.UC_ARM_REG_SP) == chip.symbols["stack_top"]
    return chip


def test_the_loader_starts_the_newest_image_and_uses_one_try():
    """The incident and the data of a fault, which are in the RAM over a reset, are kept: the
    loader has only the stack of the image."""
    slots = slot(records()[0], 3) + slot(records()[1], 4, BLANK)
    before = bytearray(slots)
    chip = start(slots, 1)
    tries = SLOT_BYTES + SLOT_BYTES - 64 + 20
    before[tries : tries + 4] = bytes(4)
    assert bytes(chip.board.flash.slots) == before
    assert chip.board.mistakes == [] and chip.board.flash.erased == []
    assert chip.board.iwdg.started
    assert bytes(chip.uc.mem_read(0x20001000, 0x1F000)) == b"\xa5" * 0x1F000
    # Confirmed: nothing is programmed.
    slots = slot(records()[0], 3) + slot(records()[1], 4)
    assert bytes(start(slots, 1).board.flash.slots) == slots


@pytest.mark.parametrize("damage", ["tries", "crc", "magic"])
def test_the_loader_returns_to_the_image_before(damage):
    newer = bytearray(slot(records()[1], 4, BLANK, [0, 0, 0, 0] if damage == "tries" else []))
    if damage == "crc":
        newer[1000] ^= 4
    if damage == "magic":
        newer[SLOT_BYTES - 64] &= 0xF0
    slots = slot(records()[0], 3) + bytes(newer)
    assert bytes(start(slots, 0).board.flash.slots) == slots


def test_without_an_image_the_outputs_are_low_and_the_watchdog_is_off():
    chip = start(ERASED + ERASED, None)
    assert not chip.board.iwdg.started
    for port, pins in ((chip.board.gpioa, range(8, 12)), (chip.board.gpiob, (0, 1))):
        for pin in pins:
            assert port.mode(pin) == 1 and port.level(pin) == 0
    assert bytes(chip.board.flash.slots) == ERASED + ERASED


def test_the_image_in_slot_b_is_the_same_firmware():
    """Both links, in place: the one in slot B runs its ticks, and shows its slot."""
    chip = release(Chip(slot=1, slots=slot(records()[0], 3) + slot(records()[1], 4, BLANK, [0])))
    chip.tick(5)
    assert chip.read("fault") == 0
    shown = objects.BY_NAME["program_slot"].enum[chip.read("program_slot")]
    state = objects.BY_NAME["program_state"].enum[chip.read("program_state")]
    assert (shown, state) == ("b", "trial")
    assert chip.write("program_control", 128) != 0  # too early
    assert chip.board.mistakes == []
