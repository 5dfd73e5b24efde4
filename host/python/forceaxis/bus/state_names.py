"""Converts numbers that a drive sends to texts: CiA 402 state, mode of operation, EMCY code and
enumerations."""

from forceaxis.objects import BY_NAME, STATUS_STATES, AxisObject, bits_in

# CiA 402 states of the drive in which the amplifier is switched on.
POWERED = ("operation enabled", "quick stop active", "fault reaction active")

# {number of a mode of operation: its name in the object table}
MODES = {
    value: text.replace("_", " ") for value, text in BY_NAME["modes_of_operation_display"].values
}
# {NMT state of a node by CiA 301: text}. The gateway uses -1 for a node that sends no messages.
NODE_STATES = {
    0: "booting",
    4: "stopped",
    5: "operational",
    127: "pre-operational",
    -1: "silent",
}

# an axis is regarded as silent if the values of its drive are older than this time in s
STALE_AFTER_S = 1.0

# Numbers of the modes of operation that control a force, a position, or a position along a profile.
FORCE_MODES = {-8, -7, -6, -1, 4, 10}
TARGET_MODES = {-5, 1, 8}
PROFILE_MODES = {-9, -4, 3, 6, 9}


def drive_state(statusword: int) -> str:
    """Returns the CiA 402 state of a statusword as text, or the number if no state matches."""
    for state in STATUS_STATES:
        if statusword & state.mask == state.value:
            return state.text
    return f"statusword {statusword:04X}h"


def condition(statusword: int, fault: str) -> str:
    """Returns state and fault of a drive as a sentence, such as "the axis is operation enabled
    without a fault" or "the axis has the fault no_contact".

    `fault` is the text of the object `fault`. It is "none" if the axis has no fault.
    """
    state = drive_state(statusword)
    if fault == "none":
        return f"the axis is {state} without a fault"
    if state == "fault":
        return f"the axis has the fault {fault}"
    return f"the axis is {state} with the fault {fault}"


def status_bits(statusword: int, mode: int | None = None) -> list[str]:
    """Returns names of bits of a statusword: of all bits among 7 and 10 to 14 that are 1. The
    meaning of some bits depends on the mode of operation."""
    bits = bits_in("statusword", statusword, mode)
    return [bit.text for bit in bits if bit.bit == 7 or bit.bit >= 10]


def mode(number: int) -> str:
    """Returns the mode of operation (object 6061h) as text."""
    return MODES.get(number, f"mode {number}")


def node_state(number: int) -> str:
    return NODE_STATES.get(number, f"NMT {number}")


def is_silent(nmt_state: int, age_s: float) -> bool:
    """Returns True if an axis no longer sends new values. This is so if its node is silent, if NMT
    has stopped the node, or if the values of the drive are older than STALE_AFTER_S. The gateway
    goes on publishing the last values of such an axis."""
    return node_state(nmt_state) in ("silent", "stopped") or age_s > STALE_AFTER_S


def emergency(code: int) -> str:
    """Returns the text of an EMCY code, with its number."""
    text = _named("error_code", code) if code else "error reset"
    return f"EMCY {code:04X}h {text.replace('_', ' ')}" if text else f"EMCY {code:04X}h"


def enum(name: str, raw: int) -> str:
    """Returns the text for the raw value of an object, or the number if the object has no text for
    this value."""
    return _named(name, raw) or str(raw)


def texts(known: AxisObject) -> dict[str, int]:
    """Returns {text: raw value} for an object whose values have names, otherwise an empty
    dictionary."""
    return {t: i for i, t in enumerate(known.enum)} | {text: value for value, text in known.values}


def _named(name: str, raw: int) -> str | None:
    known = BY_NAME.get(name)
    if known is None:
        return None
    return next((text for text, value in texts(known).items() if value == raw), None)
