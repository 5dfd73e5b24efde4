"""What the numbers of a drive say in words: CiA 402 state, mode, EMCY code, enums of the table."""

from forceaxis import objects

BY_NAME = {o.name: o for o in objects.OBJECTS}

# CiA 402: (mask, value, state of the drive); exactly one matches where the firmware is right.
STATES = (
    (0x4F, 0x00, "not ready to switch on"),
    (0x4F, 0x40, "switch on disabled"),
    (0x6F, 0x21, "ready to switch on"),
    (0x6F, 0x23, "switched on"),
    (0x6F, 0x27, "operation enabled"),
    (0x6F, 0x07, "quick stop active"),
    (0x4F, 0x0F, "fault reaction active"),
    (0x4F, 0x08, "fault"),
)

# Where the object table names no value (`values` of the object), or the number is not an object's.
MODES = {
    0: "none",
    1: "profile position",
    3: "profile velocity",
    4: "force",
    6: "homing",
    8: "cyclic position",
    9: "cyclic velocity",
    10: "cyclic force",
    -1: "force counts",
    -2: "open loop",
    -3: "excitation",
    -4: "native position",
    -5: "guarded move",
    -6: "stiffness",
    -7: "damping",
    -8: "impedance",
}
NODE_STATES = {
    0: "booting",
    4: "stopped",
    5: "operational",
    127: "pre-operational",
    -1: "silent",
}
EMERGENCIES = {
    0x0000: "error reset",
    0x2310: "current",
    0x5530: "store",
    0x6010: "watchdog",
    0x6320: "parameter",
    0x7305: "encoder",
    0x7310: "speed",
    0x8110: "CAN overrun",
    0x8120: "CAN passive",
    0x8130: "heartbeat lost",
    0x8140: "CAN off",
    0x8210: "PDO length",
    0x8240: "SYNC length",
    0x8611: "following error",
    0x8612: "limit",
    0xFF01: "contact lost",
    0xFF02: "force sensor saturated",
    0xFF03: "limit cycle",
    0xFF04: "loop overrun",
}

# Statusword bits that mean the same in every mode.
BITS = (
    (7, "warning"),
    (10, "target reached"),
    (11, "internal limit"),
)
# Bits 12 and 13 mean what the mode says.
BIT_12 = {
    1: "set-point acknowledged",
    3: "speed zero",
    6: "homing attained",
    8: "follows command",
    9: "follows command",
    10: "follows command",
}
BIT_13 = {1: "following error", 6: "homing error", 8: "following error"}


def drive_state(statusword):
    """The CiA 402 state, or the word itself where no state has that pattern."""
    for mask, value, text in STATES:
        if statusword & mask == value:
            return text
    return f"statusword {statusword:04X}h"


def status_bits(statusword, mode=None):
    """What further bits of the statusword say in this mode, as a list of texts."""
    said = [text for bit, text in BITS if statusword >> bit & 1]
    for bit, texts in ((12, BIT_12), (13, BIT_13)):
        if statusword >> bit & 1 and mode in texts:
            said.append(texts[mode])
    return said


def mode(number):
    """The mode of operation (6061h) in words."""
    said = _named("modes_of_operation_display", number) or MODES.get(number)
    return said.replace("_", " ") if said else f"mode {number}"


def node_state(number):
    return NODE_STATES.get(number, f"NMT {number}")


def emergency(code):
    """An EMCY code in words, with its number."""
    text = EMERGENCIES.get(code) if code == 0 else _named("error_code", code)
    text = text or EMERGENCIES.get(code)
    return f"EMCY {code:04X}h {text.replace('_', ' ')}" if text else f"EMCY {code:04X}h"


def enum(name, raw):
    """Text of an object's raw value; the number where the table has no text for it."""
    return _named(name, raw) or str(raw)


def texts(known):
    """{text: raw value} of an object whose values have names, else empty."""
    return {t: i for i, t in enumerate(known.enum)} | {
        text: value for value, text in getattr(known, "values", ())
    }


def _named(name, raw):
    known = BY_NAME.get(name)
    if known is None:
        return None
    return next((text for text, value in texts(known).items() if value == raw), None)
