"""The models of the registers refuse what the manuals rule out: each row writes in a forbidden way,
and the model notes it. Without these notes a test of the image would pass whatever it does."""

import peripherals
import peripherals_g4
import pytest

F4, G4 = peripherals, peripherals_g4


def on_168_mhz(board):
    """As after clock.c: no test of the clocks themselves."""
    board.rcc.core_hz = lambda: 168e6


def started_adc(board):
    board.adc.write(0x08, 1)
    board.advance(16 * 100)
    board.adc.write(0x08, 1 | 1 << 30)


def waiting_mailbox(board):
    board.can.write(0x180, 1)


def open_flash(board):
    for key in (0x45670123, 0xCDEF89AB):
        board.flash.write(0x04 if isinstance(board.flash, F4.Flash) else 0x08, key)


def queued_frame(board):
    board.can.registers[0x18] = 0
    board.can.write(0xCC, 1)


ROWS = {
    # (models, what is done before, peripheral, offset, value, what the model notes)
    "bus rates": (F4, None, "rcc", 0x08, 2 | 4 << 10 | 4 << 13, "APB1 above 45 MHz"),
    "reserved clock": (F4, None, "rcc", 0x08, 3, "reserved clock"),
    "reserved clock of the G4": (G4, None, "rcc", 0x08, 0, "reserved or not ready"),
    "keys twice": (F4, open_flash, "flash", 0x04, 0x45670123, "not locked"),
    "keys twice of the G4": (G4, open_flash, "flash", 0x08, 0x45670123, "not locked"),
    "options": (F4, None, "flash", 0x14, 0, "option bytes written"),
    "options of the G4": (G4, None, "flash", 0x20, 0, "option bytes written"),
    "protection of the G4": (G4, None, "flash", 0x2C, 0, "option bytes written"),
    "control": (F4, open_flash, "flash", 0x10, 1 << 20, "reserved bits"),
    "control of the G4": (G4, open_flash, "flash", 0x14, 1 << 12, "reserved bits"),
    "cache reset": (G4, None, "flash", 0x00, 0x1604, "reset while it is on"),
    "wait states": (G4, on_168_mhz, "flash", 0x00, 0x703, "wait states"),
    "line": (F4, None, "exti", 0x00, 1 << 23, "reserved line"),
    "channel": (F4, lambda b: b.tim5.write(0x20, 1), "tim5", 0x18, 1, "CCxS changed"),
    "unstable": (F4, lambda b: b.adc.write(0x08, 1), "adc", 0x08, 1 | 1 << 30, "before it is st"),
    "sequence": (F4, started_adc, "adc", 0x34, 4, "written during a conversion"),
    "common": (G4, lambda b: b.adc.registers.update({0x08: 1}), "adc_common", 0x08, 0, "ADC_CCR"),
    "mailbox": (F4, waiting_mailbox, "can", 0x184, 8, "mailbox written while its frame waits"),
    "cancellation": (G4, queued_frame, "can", 0xD0, 1, "a frame of the FIFO cancelled"),
    "frame": (G4, queued_frame, "can_memory", 0x278, 0, "a frame that waits was changed"),
    "SPI": (F4, lambda b: b.spi.write(0x00, 0x40), "spi", 0x00, 0x41, "SPI_CR1 changed"),
    "format": (F4, lambda b: b.usart.write(0x0C, 1 << 13), "usart", 0x0C, 0x3000, "format written"),
    "format of the G4": (G4, lambda b: b.usart.write(0x00, 1), "usart", 0x00, 0x1001, "format"),
    "rate": (F4, lambda b: b.usart.write(0x0C, 1 << 13), "usart", 0x08, 7, "baud rate written"),
}  # fmt: skip


@pytest.mark.quick
@pytest.mark.parametrize("name", ROWS)
def test_a_model_notes_what_its_manual_rules_out(name):
    models, before, peripheral, offset, value, words = ROWS[name]
    board = models.Board()
    if before is not None:
        before(board)
    assert board.mistakes == []
    getattr(board, peripheral).write(offset, value)
    assert any(words in mistake for mistake in board.mistakes), board.mistakes


def program_double_word(board):
    open_flash(board)
    board.flash.write(0x14, 1)  # PG
    for at in (0, 4):
        board.flash.program(at, 4, 0)


@pytest.mark.quick
def test_bank_2_changed_with_the_cache_on_or_read_by_an_old_cache_is_noted():
    board = G4.Board()
    program_double_word(board)
    assert board.mistakes == ["bank 2 changed with the data cache on"]
    board = G4.Board()
    board.flash.write(0x00, 0x204)
    program_double_word(board)
    board.flash.write(0x00, 0x604)
    assert board.mistakes == ["data cache on with what bank 2 held before"]
    board = G4.Board()
    for access in (0x204, 0x1204, 0x204, 0x604):
        board.flash.write(0x00, access)
    assert board.mistakes == []


@pytest.mark.quick
def test_the_watchdog_s_registers_are_not_written_again_while_they_are_taken_over():
    board = F4.Board()
    board.iwdg.write(0x00, 0x5555)
    for offset in (0x04, 0x08):
        board.iwdg.write(offset, 2)
    assert board.mistakes == []
    board.iwdg.write(0x08, 3)
    assert board.mistakes == ["watchdog written while its register is updated"]


@pytest.mark.quick
def test_an_edge_on_a_masked_line_is_lost_and_a_software_trigger_acts_once():
    """RM0390 10.3.5 and figure 30."""
    board = F4.Board()
    board.syscfg.registers[0x08] = 2 << 12
    board.exti.write(0x08, 1 << 3)
    board.exti.edge(3, True)
    board.exti.write(0x00, 1 << 3)
    assert not board.exti.interrupt(3)
    for wanted in (True, False, True):
        board.exti.write(0x10, 1 << 3)
        assert board.exti.interrupt(3) == wanted
        board.exti.registers[0x14] = 0  # taken by nobody: SWIER still stands
        if not wanted:
            board.exti.write(0x14, 1 << 3)


@pytest.mark.quick
def test_address_and_bank_of_an_error_stay_those_of_the_first_one():
    """RM0440 3.3.2."""
    flash = G4.Board().flash
    flash.weak, flash.damaged = {0x1230}, {0x40}
    for at in (0x1230, 0x40):
        flash.read_stored(at, 4)
    assert flash[0x18] == 3 << 30 | 1 << 21 | 0x1230
    flash.write(0x18, 3 << 30)
    flash.read_stored(0x40, 4)
    assert flash[0x18] == 1 << 31 | 1 << 21 | 0x40
