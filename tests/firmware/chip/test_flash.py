"""The parameter store in two sectors of the chip's flash, as the released image does it."""

import draws
import pytest
from chip import Chip, release
from forceaxis import objects
from peripherals import NEVER, Stalled

SAVE = 0x65766173  # "save"
RDERR, PGSERR, PGPERR, PGAERR, WRPERR, OPERR = 8, 7, 6, 5, 4, 1
STATES = objects.BY_NAME["store_state"].enum


def save(chip, gain):
    assert chip.write("force_gain", gain) == 0
    assert chip.write("store_all", SAVE) == 0
    for _ in range(2000):
        chip.tick()
        if STATES[chip.read("store_state")] != "saving":
            return STATES[chip.read("store_state")]
    return "never"


def restarted(chip):
    """The same flash after a power cut."""
    return release(Chip(bytes(chip.board.flash.bytes)))


def reported(chip):
    """Whether there was an emergency 5530h."""
    return any(i == 0x081 and d[:2] == b"\x30\x55" for i, d, _ in chip.board.can.sent)


def test_a_blank_flash_is_an_empty_store(chip):
    assert STATES[chip.read("store_state")] == "empty"


def test_what_was_saved_is_there_after_a_power_cut(chip):
    assert save(chip, 777) == "saved"
    flash = chip.board.flash
    assert flash[0x10] >> 31, "still unlocked"
    assert flash.erased == [1]  # the first sector of the store is sector 1 of the chip
    assert flash.words > 0
    again = restarted(chip)
    assert STATES[again.read("store_state")] == "loaded"
    assert again.read("force_gain") == 777
    assert chip.board.mistakes == [] and again.board.mistakes == []


@pytest.mark.long
def test_the_second_sector_is_used_when_the_first_is_full(chip):
    for gain in range(300, 300 + 1300):
        assert save(chip, gain) == "saved"
        if len(chip.board.flash.erased) > 2:
            break
    assert chip.board.flash.erased == [1, 2, 1]
    assert restarted(chip).read("force_gain") == gain


@pytest.mark.parametrize(
    "bit",
    [
        RDERR, WRPERR,
        *(pytest.param(bit, marks=pytest.mark.long) for bit in (PGSERR, PGPERR, PGAERR, OPERR)),
    ],
)  # fmt: skip
def test_a_write_error_is_reported_and_the_old_set_stays(chip, bit):
    assert save(chip, 500) == "saved"
    chip.board.flash.fail = bit
    assert save(chip, 600) == "failed"
    assert chip.board.flash[0x10] >> 31
    chip.tick(3)
    assert reported(chip)
    chip.board.flash.fail = None
    assert restarted(chip).read("force_gain") == 500
    # The error is no longer in the way.
    assert save(chip, 700) == "saved"
    assert not chip.board.flash[0x0C] >> bit & 1, "its flag is still there"
    assert restarted(chip).read("force_gain") == 700


def test_protected_sectors_are_a_failure(chip):
    chip.board.flash.protected = {1, 2}
    assert save(chip, 600) == "failed"
    assert bytes(chip.board.flash.bytes) == b"\xff" * 32768


def test_a_flash_that_is_busy_for_ever_ends_by_the_watchdog():
    """RM0390 3.5, 3.8.5: fetches from a busy flash and writes of its CR stall the bus. An erase is
    fed for no longer than its polls, 2 s; then the core stands, with the outputs off."""
    chip = release(Chip(ram_counts=False))  # the wait is in the RAM, 140 million instructions
    chip.board.flash.busy_reads = NEVER
    before = chip.board.iwdg.feeds
    with pytest.raises(Stalled):
        save(chip, 600)
    assert chip.terminals() == (0, 0, 0.0)
    assert 100_000 < chip.board.iwdg.feeds - before < 1_000_000
    assert chip.board.iwdg.timeout_s(17e3) < 40e-3
    assert chip.board.mistakes == []


def test_an_erase_and_a_write_follow_the_order_of_the_manual(chip):
    """RM0390 3.6.3: BSY, then SER with SNB, then STRT by itself; 3.6.4: BSY, PG, the word, BSY. The
    model notes what is not."""
    assert save(chip, 700) == "saved" and chip.board.flash.words > 0
    assert chip.board.flash.erased == [1]
    assert chip.board.mistakes == []


def test_an_erase_runs_from_ram_without_interrupts_and_the_watchdog_lives(chip):
    """250 ms in which nothing can be fetched from the flash, and a watchdog of 14 to 38 ms."""
    flash, iwdg = chip.board.flash, chip.board.iwdg
    fetched = []
    reads = flash.read

    def read(offset):
        if offset == 0x0C and flash.busy > 0:
            from unicorn import arm_const

            fetched.append(
                (
                    chip.uc.reg_read(arm_const.UC_ARM_REG_PC),
                    chip.uc.reg_read(arm_const.UC_ARM_REG_PRIMASK),
                    flash[0x10] & 2,
                )
            )
        return reads(offset)

    flash.read = read
    flash.busy_reads = 5000
    before = iwdg.feeds
    assert chip.write("store_all", SAVE) == 0
    chip.tick()
    erases = [f for f in fetched if f[2]]
    assert len(erases) > 4000
    assert all(0x20000000 <= pc < 0x20020000 for pc, _, _ in erases)
    assert all(mask == 1 for _, mask, _ in erases)
    assert iwdg.feeds - before > 4000
    # Between two feedings: at most so many instructions of some cycles each, far from 14 ms.
    assert 100 < chip.main_steps / (iwdg.feeds - before) < 14e-3 * 168e6 / 100
    assert chip.read("overruns") == 0  # the model's time stood still


def test_the_ticks_that_an_erase_costs_are_counted_and_made_up_for(chip):
    """300 ms are 450 ticks, of which the interrupt that is pending does one. A heartbeat that was
    due meanwhile comes at once, the next ones at their interval; a master counts as lost only its
    full time after the erase."""
    board, tick_cycles = chip.board, 168e6 / 1500
    assert chip.write("producer_heartbeat_time", 100) == 0  # 150 ticks
    assert chip.write("consumer_heartbeat_1", 2 << 16 | 200) == 0  # node 2, 300 ticks
    chip.tick(149)
    board.can.sent.clear()
    begin, ticks = board.cycles, chip.read("tick_count")
    beats, lost = [], []

    def tick():
        chip.tick()
        now = round((board.cycles - begin) / tick_cycles)
        sent = [(i, d[:2]) for i, d, _ in board.can.sent]
        board.can.sent.clear()
        beats.extend(now for i, _ in sent if i == 0x701)
        lost.extend(now for i, code in sent if i == 0x081 and code == b"\x30\x81")  # 8130h

    board.can.receive(0x702, b"\x05")
    for _ in range(5):
        tick()
    board.flash.erase_s = 0.3
    assert chip.write("store_all", SAVE) == 0
    while STATES[chip.read("store_state")] != "saved":
        tick()
    erased_by = round((board.cycles - begin) / tick_cycles)
    for _ in range(400):
        tick()
    assert chip.read("overruns") == pytest.approx(449, abs=1)
    assert chip.read("tick_count") - ticks == round((board.cycles - begin) / tick_cycles)
    after = [b for b in beats if b >= 450]
    assert after[0] <= 460 and len(after) > 2
    assert all(after[n] == after[0] + 150 * n for n in range(len(after)))
    assert len([b for b in beats if b < 450]) == 1
    assert len(lost) == 1 and lost[0] == pytest.approx(300 + 450, abs=2)
    assert erased_by > 450


def test_the_cache_is_emptied_after_an_erase(chip):
    flash = chip.board.flash
    written = []
    write = flash.write

    def note(offset, value):
        if offset == 0x00:
            written.append(value)
        write(offset, value)

    flash.write = note
    assert save(chip, 800) == "saved"
    assert any(v & 1 << 12 and not v & 1 << 10 for v in written)
    assert written[-1] & 0x707 == 0x705


def test_saving_is_refused_while_the_drive_is_enabled(chip):
    assert chip.write("mode", objects.BY_NAME["mode"].enum.index("open_loop")) == 0
    chip.tick(3)
    assert chip.write("store_all", SAVE) != 0
    words, erased = chip.board.flash.words, list(chip.board.flash.erased)
    chip.tick(50)
    assert (chip.board.flash.words, chip.board.flash.erased) == (words, erased)


def test_enabling_is_refused_while_the_store_is_at_work(chip):
    assert chip.write("store_all", SAVE) == 0
    chip.tick()
    assert chip.write("mode", 1) != 0
    chip.tick(3)
    assert chip.terminals() == (0, 0, 0.0)


# With --all three more, drawn by the commit, or with FORCEAXIS_WHOLE=1 ten.
MORE = draws.some("power cuts", range(2, 12), 3)


@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.long) for seed in MORE)]
)
def test_a_power_cut_anywhere_leaves_the_old_set_or_the_new_one(chip, seed):
    assert save(chip, 500) == "saved"
    for gain in range(501, 501 + seed % 3):
        assert save(chip, gain) == "saved"
    old = chip.read("force_gain")
    assert chip.write("force_gain", 900) == 0
    assert chip.write("store_all", SAVE) == 0
    chip.tick(1 + seed)
    again = restarted(chip)
    assert again.read("force_gain") in (old, 900)
    # What remains of a set that was cut off is reported.
    cut = again.read("force_gain") == old
    state = STATES[again.read("store_state")]
    assert state == "loaded" or (cut and state == "loaded_older")
    assert (state == "loaded_older") == reported(again)


@pytest.mark.long
def test_a_corrupted_sector_falls_back_to_the_other_then_to_defaults_with_an_emcy(chip):
    flash = chip.board.flash
    gain = 300
    while flash.erased != [1, 2]:
        gain += 1
        assert save(chip, gain) == "saved"
    newest = gain
    assert restarted(chip).read("force_gain") == newest
    # The new set in sector 2 is damaged: the last one of sector 1 counts.
    second = bytearray(flash.bytes)
    for i in range(16384, 32768):
        second[i] &= 0x5A
    again = release(Chip(bytes(second)))
    assert again.read("force_gain") == newest - 1
    assert STATES[again.read("store_state")] == "loaded_older" and reported(again)
    assert not reported(restarted(chip))
    # Both are: nothing remains to load.
    again = release(Chip(bytes(b & 0x5A for b in flash.bytes)))
    assert again.read("force_gain") == objects.BY_NAME["force_gain"].default
    assert STATES[again.read("store_state")] == "failed"
    assert reported(again)
    # What is saved next counts again, and a blank flash is no failure.
    assert save(again, 321) == "saved"
    assert restarted(again).read("force_gain") == 321
