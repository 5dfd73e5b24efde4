"""`forceaxis axis bringup` at the released image in the emulated chip: a board that is right, and
boards with a fault each, which the step that has to find the fault names."""

import contextlib

import pytest
from chip import Chip
from forceaxis.axis.axis import Axis
from forceaxis.axis.link import COMMAND_SOURCES, Link, Refused, unsigned
from forceaxis.commission import bringup
from forceaxis.commission.bringup import FAILED, PASSED, SKIPPED, BringupRequest, bring_up
from forceaxis.results import from_json, to_json

FORCE, CURRENT = 6, 7  # channels of the ADC
LINES = 500
WATCHDOG, POWER_UP = 1 << 29 | 1 << 26, 1 << 27 | 1 << 26 | 1 << 25  # RCC_CSR, RM0390 6.3.21
CLOSED = {0: 1, 1: 1, 2: 1}
PINS = {"PC0": 0, "PC1": 1, "PC2": 2}


class ChipLink(Link):
    """Objects of the chip, accessed as over Modbus."""

    source = COMMAND_SOURCES.index("modbus")
    where = "the emulated chip"
    FEED_TICKS = 100

    def __init__(self, chip):
        self.chip, self.is_owner = chip, False

    def read(self, names):
        return {name: unsigned(name, self.chip.read(name)) for name in names}

    def text(self, index):
        return self.chip.text(index)

    def write(self, values):
        for name, value in values.items():
            refusal = self.chip.write(name, value, self.source)
            if refusal:
                raise Refused(f"{name}: refused ({refusal})")
            self.chip.tick()

    def acquire(self):
        self.write({"command_source": self.source})
        self.is_owner = True

    def release(self):
        self.is_owner = False
        self.write({"command_source": 0})

    def wait(self, seconds):
        ticks = max(1, round(seconds * 1500))
        while ticks > 0:
            self.chip.tick(min(ticks, self.FEED_TICKS))
            ticks -= self.FEED_TICKS
            if self.is_owner:  # as the connection over Modbus does
                self.chip.write("watchdog", self.chip.read("watchdog"), self.source)

    def close(self):
        pass

    arm = fetch = recording = None  # not used by a bring-up


ChipLink.__abstractmethods__ = frozenset()


class Person:
    """Does at the models what the steps ask for."""

    def __init__(self, link, direction=1):
        self.link, self.direction, self.asked = link, direction, []

    @property
    def board(self):
        return self.link.chip.board

    def act(self, text):
        self.asked.append(text)
        wires = self.board.gpioc.wires
        if "both limit contacts" in text:
            wires.update(CLOSED)
        for pin, number in PINS.items():
            if pin in text:
                wires[number] = 0 if text.startswith("Open") else 1
        if text.startswith("Turn"):
            for _ in range(LINES):
                self.board.tim5.turn(int(4 * self.direction))
                self.link.chip.tick()
        if "PA6 and PA7" in text:
            self.board.adc.volts.update({FORCE: 1.65, CURRENT: 1.65})
        if text.startswith("Connect PA"):
            self.board.adc.volts[CURRENT if "PA7" in text else FORCE] = 3.3
        if "CAN_H and CAN_L again" in text:
            self.board.can.dominant = False
        if text.startswith("Short"):
            self.board.can.dominant = True
            self.board.can.errors(off=True)
        if text.startswith(("Take the supply", "Run in another")):
            self.restart(POWER_UP if "supply" in text else WATCHDOG)
        self.link.chip.tick()
        return True

    def restart(self, causes):
        before = self.link.chip
        self.link.chip = Chip(store=bytes(before.board.flash.bytes))
        self.board.rcc.registers[self.board.rcc.CAUSES] = causes
        self.link.chip.close_contacts()
        self.link.chip.boot()
        self.link.chip.tick(4)

    def number(self, text, unit):
        self.asked.append(text)
        if unit == "lines":
            return LINES
        if "stage" in text:
            return round(self.link.chip.terminals()[2], 3)
        mine, other = (FORCE, CURRENT) if "Connect PA6" in text else (CURRENT, FORCE)
        self.board.adc.volts.update({mine: 1.2, other: 0.0})
        self.link.chip.tick(2)
        return 1.2


def new_board(prepare=lambda board: None):
    """A chip with a drive's worth of nothing: contacts, a node id, and a partner on the CAN bus."""
    chip = Chip()
    chip.board.rcc.registers[chip.board.rcc.CAUSES] = POWER_UP
    prepare(chip.board)
    chip.close_contacts()
    chip.boot()
    chip.tick(40)
    return chip


@pytest.fixture(autouse=True)
def short_times(monkeypatch):
    monkeypatch.setattr(bringup, "RATE_TIME_S", 0.2)
    monkeypatch.setattr(bringup, "READINGS", 5)


def brought_up(chip, steps=(), direction=1, person=Person):
    link = ChipLink(chip)
    with contextlib.closing(Axis(link)) as axis:
        axis.acquire()
        done = list(
            bring_up(
                axis,
                person(link, direction),
                BringupRequest(steps),
                lambda: link.chip.board.time_s(),
            )
        )
    assert link.chip.board.gpiob.shorts or link.chip.terminals()[0] == 0  # the amplifier is off
    return done[-1]


def test_a_board_that_is_right_passes_every_step():
    protocol = brought_up(new_board())
    assert [(s.name, s.verdict, s.text) for s in protocol.steps if s.verdict != PASSED] == []
    assert [step.name for step in protocol.steps] == list(bringup.STEPS)
    assert protocol.passed and protocol.device == "forceaxis"
    values = {key: value for step in protocol.steps for key, value in step.values.items()}
    assert values["rate_least_Hz"] <= 1500 * 1.0001 and values["rate_most_Hz"] >= 1500 * 0.9999
    assert values["counts"] == 4 * LINES
    assert from_json(bringup.BringupProtocol, to_json(protocol)) == protocol


def brown_out_off(board):
    board.flash.registers[0x14] = 0x0FFFAAE1 | 3 << 2


def weak_source(channel):
    def prepare(board):
        board.adc.source_ohm = {channel: 100e3}

    return prepare


def held(level):
    def prepare(board):
        board.gpiob.shorts[0] = level

    return prepare


def loaded_output(board):
    board.dac.stuck_v = 1.0


def alone(board):
    board.can.partner = False


def no_crystal(board):
    board.rcc.hse_hz = None


def broken_wire(board):
    board.gpioc.shorts[1] = 0


@pytest.mark.parametrize(
    "step, prepare, direction, words",
    [
        ("board", brown_out_off, 1, ["brown-out reset", "`write_image`"]),
        ("board", no_crystal, 1, ["8 MHz", "PH0"]),
        ("force", weak_source(FORCE), 1, ["PA6", "more than 10 kOhm", "follower"]),
        ("current", weak_source(CURRENT), 1, ["PA7", "more than 10 kOhm", "follower"]),
        ("encoder", None, -1, ["wrong direction", "exchange A and B"]),
        ("encoder", None, 0, ["0 counts", "line receiver"]),
        ("encoder", None, 0.5, ["expected 2000 counts"]),
        ("can", alone, 1, ["acknowledges", "second node"]),
        ("outputs", held(1), 1, ["PB0", "while the axis is disabled"]),
        ("outputs", held(0), 1, ["PB0", "at the DAC code 0"]),
        ("outputs", loaded_output, 1, ["PA4"]),
        ("contacts", broken_wire, 1, ["positive limit switch (PC1)", "check its wire"]),
    ],
)
def test_a_fault_is_named_by_its_step(step, prepare, direction, words):
    protocol = brought_up(new_board(*[prepare] if prepare else []), (step,), direction)
    (found,) = protocol.steps
    assert found.name == step and found.verdict == FAILED, found.text
    for word in words:
        assert word in found.text
    assert not protocol.passed


def test_a_source_of_ten_kilohms_is_right():
    def source(board):
        board.adc.source_ohm = {FORCE: 10e3, CURRENT: 10e3}

    protocol = brought_up(new_board(source), ("force", "current"))
    assert [step.verdict for step in protocol.steps] == [PASSED, PASSED]


class Absent(Person):
    def act(self, text):
        return False

    def number(self, text, unit):
        return None


def test_a_step_that_is_skipped_is_not_passed_and_the_others_are_done():
    protocol = brought_up(new_board(), ("identity", "encoder", "outputs", "can"), person=Absent)
    verdicts = [step.verdict for step in protocol.steps]
    assert verdicts == [PASSED, SKIPPED, SKIPPED, SKIPPED] and not protocol.passed


def test_a_reset_that_nothing_explains_is_named():
    chip = new_board(lambda board: board.rcc.registers.update({0x74: WATCHDOG & ~(1 << 26)}))
    (found,) = brought_up(chip, ("reset",)).steps
    assert found.verdict == FAILED and "watchdog" in found.text


class Idle(Person):
    """Does nothing of what is asked."""

    def act(self, text):
        return True


def test_a_motor_that_is_still_connected_ends_the_outputs_at_a_small_code():
    """The encoder follows the output, as with a motor without load. The firmware itself stops it,
    whatever the tool does."""
    chip = new_board()
    largest, act = [0], chip.board.look

    def look():
        act()
        amplifier, _, volts = chip.board.trail[-1]
        if amplifier:
            largest[0] = max(largest[0], abs(volts))
            chip.board.tim5.turn(round(volts * 100))

    chip.board.look = look
    (found,) = brought_up(chip, ("outputs",)).steps
    assert found.verdict == FAILED and "disconnect the motor" in found.text
    assert largest[0] < 0.3
    for name in ("first_motion_test", "speed_max"):
        assert chip.read(name) == new_board().read(name)


@pytest.mark.parametrize(
    "step, word", [("can-off", "no node has sent"), ("watchdog", "power-up"),
                   ("encoder", "0 counts"), ("contacts", "no contact")]
)  # fmt: skip
def test_what_was_not_done_is_not_passed(step, word):
    (found,) = brought_up(new_board(), (step,), person=Idle).steps
    assert found.verdict == FAILED and word in found.text
