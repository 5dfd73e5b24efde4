"""Converts the fields of LCM messages to rows of tables. The names of the columns contain the
unit."""

from forceaxis.bus import state_names
from forceaxis.bus.capture_assembly import unit_of
from forceaxis.bus.lcm import NOT_AVAILABLE
from forceaxis.bus.messages import (
    axis_capture_t,
    axis_command_t,
    axis_event_t,
    axis_state_t,
    sim_clock_t,
    sim_truth_t,
)
from forceaxis.bus.wire import Message
from forceaxis.objects import BY_NAME

Row = dict[str, int | float | str | None]


def message_row(message: Message, wall_us: int) -> Row:
    """Returns the fields of a message as a row of a table.

    Names of columns contain the unit. After the fields, the row contains the further objects of the
    message with their names. The row also contains texts for fields that are numbers of states.
    """
    row: Row = {"received_wall_us": wall_us}
    for name, kind in zip(message.__slots__, message.__dimensions__, strict=True):
        value = getattr(message, name)
        if kind is None and not name.startswith("num_"):
            named = {"utime": "utime_us", "wall_utime": "wall_utime_us"}.get(name, name)
            value = int(value) if isinstance(value, bool) else value
            row[named] = None if value == NOT_AVAILABLE else value
    if isinstance(message, axis_state_t):
        row.update(state_words(message))
    if isinstance(message, axis_state_t | sim_clock_t):
        for name, raw in zip(message.more_name, message.more_value, strict=True):
            row[column_name(name)] = engineering(name, raw)
    if isinstance(message, axis_command_t | axis_event_t):
        pairs = zip(message.object, message.value, strict=True)
        row |= {"items_raw": "; ".join(f"{name}={raw}" for name, raw in pairs)}
    if isinstance(message, axis_command_t | axis_capture_t | sim_truth_t):
        row |= {"signals": "; ".join(message.signal)}
    if isinstance(message, axis_event_t):
        row |= {"kind_text": event_word(message.kind)}
    return row


def event_word(kind: int) -> str:
    """Returns the kind of an event as text, such as "heartbeat lost" for EVENT_HEARTBEAT_LOST."""
    for name, value in vars(axis_event_t).items():
        if name.startswith("EVENT_") and value == kind:
            return name.removeprefix("EVENT_").lower().replace("_", " ")
    return f"event {kind}"


def state_words(state: axis_state_t) -> dict[str, str]:
    """Returns state, modes of operation, fault and active limit of an axis as texts. The text is ""
    for a value that is not available."""
    texts = {
        "drive_state": (state.statusword, state_names.drive_state),
        "mode_text": (state.mode_display, state_names.mode),
        "native_mode_text": (state.native_mode, lambda n: state_names.enum("active_mode", n)),
        "fault_text": (state.fault, lambda n: state_names.enum("fault", n)),
        "limit_text": (state.limit_reason, lambda n: state_names.enum("limit_reason", n)),
    }
    return {k: "" if raw == NOT_AVAILABLE else words(raw) for k, (raw, words) in texts.items()}


def column_name(name: str) -> str:
    """Returns the name of an object with its unit, such as force_count or velocity_count_per_tick.

    The name does not change if the object has no unit or if the name already ends with the unit,
    such as dac_code.
    """
    return with_unit(name, unit_of(name))


def with_unit(name: str, unit: str) -> str:
    word = unit.replace("/", "_per_").replace("^", "").replace(" ", "_")
    if unit in ("", "1") or name.endswith(f"_{word}"):
        return name
    return f"{name}_{word}"


def engineering(name: str, raw: int) -> float | None:
    if raw == NOT_AVAILABLE:
        return None
    known = BY_NAME.get(name)
    return raw * known.scale if known and known.scale != 1 else raw
