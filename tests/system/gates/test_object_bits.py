"""Bits of values are named in the object table alone: no source compares an object with a literal
mask, and no meaning describes bits in words."""

import re
from pathlib import Path

import pytest
from forceaxis.bus import state_names
from forceaxis.objects import BY_NAME, OBJECTS, REFUSALS, STATUS_STATES, mask, sentence

ROOT = Path(__file__).resolve().parents[3]
pytestmark = [pytest.mark.quick, pytest.mark.beside]
OF_BITS = sorted({re.sub(r"_\d+$", "", o.name) for o in OBJECTS if o.bits})
# Members with the value of such an object that have another name.
ALIASES = (r"inputs(?:\.|->)(?:din|drive)",)
OBJECT = rf"(?<![a-z_])(?:{'|'.join([*OF_BITS, *ALIASES])})(?:_\d+)?\b(?:\[\w+\])?"
NUMBER = r"~?\(?(?:\(?u?int\d+_t\)?\s*\(?)?(?:U?INT\d+_C\()?(?:0[xX]?[\da-fA-F]*|\d+)\b"
OPERATOR = r"\s*(?:&|\||\^)(?![&|])=?\s*"
# An object, as a name, a member or the text of a read, beside an operator of bits and a number.
LITERAL = re.compile(
    rf"{OBJECT}[\"'\])]*(?:{OPERATOR}{NUMBER}|\s*(?:>>|<<))"
    rf"|(?<![\w.]){NUMBER}\)*{OPERATOR}\(?(?:\w+(?:\.|->))*{OBJECT}"
)


def sources():
    for folder in ("firmware", "host", "tools", "sim"):
        for path in (ROOT / folder).rglob("*"):
            if path.suffix in (".c", ".h", ".cpp", ".hpp", ".py") and not (
                {"generated", "messages"} & set(path.parts)
            ):
                yield path


def literals(text):
    return [line.strip() for line in text.splitlines() if LITERAL.search(line)]


def test_no_source_has_a_literal_mask_of_an_object():
    assert {
        p.relative_to(ROOT): found for p in sources() if (found := literals(p.read_text()))
    } == {}


@pytest.mark.parametrize(
    "line",
    [
        "if ((signals->statusword & 0x4F) == 8) {",
        "enabled = word.statusword & 0x6F == 0x27",
        'if axis.read("board_state") & 1 << 6:',
        "drive->params.controlword |= UINT16_C(0x100);",
        "return inputs->digital_inputs >> 3 & 1;",
        "fw->signals.rpdo_cob_id[2] & ~0x80000000",
        "if (inputs.din & 4) {",
        "if (axis->inputs.drive & 0x04) {",
        "if ((0x8 & signals->statusword) != 0) {",
        "if ((statusword & (uint16_t)8) != 0) {",
    ],
)
def test_a_literal_mask_is_found(line):
    assert literals(line)


@pytest.mark.parametrize(
    "line",
    [
        "if ((signals->statusword & AXIS_STATUSWORD_FAULT) != 0) {",
        'if axis.read("board_state") & mask("board_state", "dac"):',
        "if (polarity && 1) {",
        "if (count == 8 && signals->statusword == wanted) {",
        "mask = AXIS_STATUSWORD_FAULT & signals->statusword;",
    ],
)
def test_a_name_is_no_literal_mask(line):
    assert not literals(line)


def test_a_meaning_names_bits_by_the_table_alone():
    """A sum of numbers, or "bit 3 is", in a meaning is a bit without a key."""
    for o in OBJECTS:
        assert not re.search(r"as bits|as a sum|sum of bits|bit \d+ is", o.meaning), o.name


def test_bits_12_and_13_depend_on_the_mode():
    """CiA 402, and for the modes of the manufacturer the design page of the drive."""
    bits = {
        1: (["set-point acknowledged"], ["following error"]),
        3: (["speed zero"], []),
        6: (["homing attained"], ["homing error"]),
        8: (["follows command"], ["following error"]),
        10: (["follows command"], []),
        -5: (["set-point acknowledged"], ["following error"]),
        -6: (["follows command"], []),
        -7: (["follows command"], []),
        -8: (["follows command"], []),
        -9: (["cycle done"], ["part not good or no cycle started"]),
        0: ([], []),
        None: ([], []),
    }
    for mode, (twelve, thirteen) in bits.items():
        assert state_names.status_bits(1 << 12, mode) == twelve
        assert state_names.status_bits(1 << 13, mode) == thirteen
    assert state_names.status_bits(0x4C80, 1) == [
        "warning", "target reached", "internal limit", "stopped by another source",
    ]  # fmt: skip


def test_a_statusword_shows_one_state():
    """The table "state coding" of CiA 402: x is any value."""
    coding = {
        "not ready to switch on": "x0xx0000", "switch on disabled": "x1xx0000",
        "ready to switch on": "x01x0001", "switched on": "x01x0011",
        "operation enabled": "x01x0111", "quick stop active": "x00x0111",
        "fault reaction active": "x0xx1111", "fault": "x0xx1000",
    }  # fmt: skip
    assert [state.text for state in STATUS_STATES] == list(coding)
    for word in range(256):
        shown = [
            text
            for text, bits in coding.items()
            if all(want in ("x", is_) for want, is_ in zip(bits, f"{word:08b}", strict=True))
        ]
        assert state_names.drive_state(word) == (shown or [f"statusword {word:04X}h"])[0]


def test_each_fault_has_a_sentence_and_an_error_code():
    codes = dict((text, code) for code, text in BY_NAME["error_code"].values)
    for fault in BY_NAME["fault"].enum[1:]:
        assert codes[fault] and sentence(fault), fault
    assert sentence("none") is None and sentence("invented") is None
    assert sentence("can_off") == "the CAN controller went bus off"


def test_refusals_have_the_codes_of_cia_301():
    assert [refusal.error for refusal in REFUSALS.values()] == [-n for n in range(1, 11)]
    first = {name: refusal.aborts[:1] for name, refusal in REFUSALS.items()}
    assert first == {
        "no_object": (0x06020000,), "read_only": (0x06010002,), "write_only": (0x06010001,),
        "range": (0x06090030,), "state": (0x08000022,), "no_data": (0x08000024,),
        "locked": (0x08000021,), "busy": (), "mapping": (0x06040041,), "no_memory": (0x06060000,),
    }  # fmt: skip


def test_masks_are_those_of_the_standards():
    assert mask("controlword", "switch_on", "enable_voltage", "no_quick_stop") == 7
    assert mask("controlword", "halt") == 0x100 and mask("rpdo_cob_id_1", "off") == 0x80000000
    assert mask("inputs_fitted", "limit_positive", "limit_negative", "index", "home") == 30
    with pytest.raises(KeyError):
        mask("statusword", "invented")
