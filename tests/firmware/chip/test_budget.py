"""The whole tick on an emulated Cortex-M4: its instructions stay within the interrupt's budget, and
docs/chip/instructions.md lists them.

The table and the fuzz behind it are those of tools/tick_profile, which also writes the table.
"""

import re

import pytest
from cortex_m4 import (
    LOCAL,
    NODE,
    ROOT,
    Chip,
    Host,
    Inputs,
)
from forceaxis.objects import BY_NAME
from pressing_fuzz import PressingFuzz
from tick_profile import (
    CAN_MAILBOXES,
    CYCLES_PER_INSTRUCTION,
    LIMITS,
    TICK_CYCLES,
    Port,
    Profile,
)

AXIS = 330  # axis_tick() and what it calls, with the laws of the thesis
BANKED = 550  # the same with a bank of the force law and bounds of the drive
# What follows it in most ticks, with the arming of the black box; resets and the store are apart.
BETWEEN = 3800
# The same in a cycle with sixteen elements that are all crossed at once, of two ticks: less than
# half of them.
EVALUATION = 40_000
COVERAGE = 0.95
SAME_TICKS = 15_000


@pytest.fixture(scope="module")
def profile():
    return Profile()


@pytest.mark.long
def test_the_interrupt_fits_into_its_budget(profile):
    path = ", ".join(f"{name} {count}" for count, name in profile.worst.shares)
    assert profile.interrupt <= LIMITS.interrupt_instructions, path
    assert profile.from_adc_to_dac <= LIMITS.adc_to_dac_instructions
    assert profile.axis.count <= AXIS, profile.axis.shares
    assert profile.banked.count <= BANKED, profile.banked.shares
    assert max(profile.between.count, profile.late.count) <= BETWEEN
    assert profile.evaluation.count <= EVALUATION
    for roots in (["axis_tick"], Port.CALLS):
        done, total, missed = profile.coverage(*roots)
        assert done >= COVERAGE * total, missed


@pytest.mark.long
def test_the_table_is_what_the_tool_writes(profile):
    path = ROOT / "docs/chip/instructions.md"
    assert path.read_text() == profile.table(), "stale: run tools/tick_profile"


def test_the_design_has_no_figures_of_its_own():
    """They would differ from the page that is compared."""
    pages = sorted((ROOT / "docs/design").glob("*.md"))
    text = " ".join(" ".join(page.read_text() for page in pages).split())
    assert not re.search(r"\d{3,} (of|instructions of) \d{3,}", text)
    assert not re.search(r"\d{3,} instructions", text)
    assert "../chip/instructions.md" in text


def test_the_limits_are_a_tenth_above_what_is_measured_or_less():
    """And in cycles the interrupt leaves nine tenths of a tick."""
    page = (ROOT / "docs/chip/instructions.md").read_text()
    measured, limit = map(int, re.search(r"longest tick \| (\d+) \| (\d+) \|", page).groups())
    assert measured <= limit <= 1.1 * measured
    amplifier = int(re.search(r"amplifier for \+-10 V \| (\d+) \|", page).group(1))
    assert amplifier <= 2800
    assert limit * CYCLES_PER_INSTRUCTION < 0.1 * TICK_CYCLES


class Pair:
    """The chip, whose tick has two parts, and the host, whose tick has one: every call is made on
    both, with equal results."""

    def __init__(self):
        self.chip, self.host = Chip(), Host()
        self.outputs = self.chip.outputs

    def __getattr__(self, name):
        def both(*arguments):
            answers = getattr(self.chip, name)(*arguments), getattr(self.host, name)(*arguments)
            assert answers[0] == answers[1], (name, arguments)
            return answers[0]

        return both

    def tick(self, inputs):
        self.outputs = self.host.tick(inputs)
        self.chip.interrupt(inputs)
        self.chip.between()
        assert self.chip.outputs == self.outputs


@pytest.mark.long
def test_the_chip_sends_what_the_host_sends():
    pair = Pair()
    fuzz, inputs = PressingFuzz(BY_NAME, 308), Inputs(0, (0, 0), 1, 1)
    frames = law = 0
    active, force = BY_NAME["active_mode"].number, BY_NAME["active_mode"].enum.index("force")
    for tick in range(SAME_TICKS):
        fuzz.step(pair, inputs)
        pair.tick(bytes(inputs))
        law += pair.host.read(active) == force
        # A bus that is busy at times fills the output queue.
        for _ in range(CAN_MAILBOXES if tick % 500 < 400 else 0):
            frames += pair.transmit() is not None
    assert frames > SAME_TICKS // 4
    assert law > SAME_TICKS * 3 // 10


def test_a_late_main_loop_loses_no_time():
    """A heartbeat every 10 ms, 15 ticks: held up by a late fw_between(), it comes with that, and
    the next one when it would have come anyway."""
    chip = Chip()
    chip.write(LOCAL, BY_NAME["producer_heartbeat_time"].number, 10)
    beats = []
    for tick in range(160):
        chip.interrupt(bytes(Inputs(0, (0, 0), 1, 1)))
        if 104 <= tick < 108:
            continue
        chip.between()
        while (frame := chip.transmit()) is not None:
            if int.from_bytes(frame[:2], "little") == 0x700 + NODE and tick > 0:
                beats.append(tick)
    assert beats == [15, 30, 45, 60, 75, 90, 108, 120, 135, 150]
