"""Logs of messages as sources of recordings: LCM logs, and MCAP files with messages of forceaxis,
in JSON or in CDR of ROS 2. Each channel is a group of columns CHANNEL/field."""

import contextlib
import functools
import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from forceaxis import files, paths
from forceaxis._core import InputError
from forceaxis.bus import log_tables
from forceaxis.bus.message_rows import Row
from forceaxis.bus.recordings import MCAP_MAGIC, reader_of
from forceaxis.errors import expect_package
from forceaxis.recordings.clock import NS_PER_S
from forceaxis.recordings.signal_recording import Floats
from forceaxis.recordings.source import TIME_NAMES, Source, array_source, time_by_name
from forceaxis.recordings.times import FALL_PERIODS
from forceaxis.recordings.units import factor_of, split_name
from forceaxis.words import counted

if TYPE_CHECKING:
    from mcap.records import Channel, Schema

LOG_TIME = "log_time_ns"  # column with the time at which a message was recorded
# Names of the parts of a time that a message states as seconds and nanoseconds
STAMP_PARTS = (("sec", "nanosec"), ("sec", "nsec"), ("secs", "nsecs"), ("seconds", "nanos"))
# Columns with such a time that are usually the time of the sample
STAMPS = ("header.stamp_ns", "stamp_ns", "timestamp_ns", "header.timestamp_ns")
MOST_ITEMS = 64  # largest number of items of a list that become columns
LARGEST_INTEGER = 1 << 62
ASCENDING_SHARE = 0.9  # smallest share of the steps of a time that are not negative
NEAR_S = 86400.0  # largest difference between a time since 1970 and the time of the log
SPAN_SHARE = 0.2  # largest relative difference between the spans of stated and of logged times
Decoder = Callable[[bytes], object]


def read_messages(path: Path) -> Source:
    """Returns the messages in an LCM log or an MCAP file as a source of recordings. Of a damaged
    file, the messages that are complete are read, and a note says so. Raises InputError."""
    with path.open("rb") as file:
        is_mcap = file.read(len(MCAP_MAGIC)) == MCAP_MAGIC
    tables, others, damage = log_tables.tables_of(reader_of(path))
    notes: list[str] = []
    wrong: list[str] = []
    if not tables and is_mcap:
        tables, others, damage = _tables_of_others(path, notes, wrong)
    if not tables:
        raise InputError(damage or "; ".join(wrong) or (
            f"{paths.display(path)}: expected messages of forceaxis"
            f"{', in JSON or in CDR' * is_mcap}, got "
            + (f"only those of {', '.join(others)}" if others else "no message")
            + "; export the data as CSV or Parquet"
        ))  # fmt: skip
    found, times, units = {}, {}, {}
    for channel, columns in tables.items():
        time, unit = _time_of(channel, columns, notes)
        if LOG_TIME in columns:
            columns = _in_order(channel, columns, time, notes)
        for name, values in columns.items():
            if values.dtype.kind in "iufb":
                found[f"{channel}/{name}"] = values
                times[f"{channel}/{name}"] = f"{channel}/{time}"
        if unit:
            units[f"{channel}/{time}"] = unit
    source = array_source(path, "MCAP" if is_mcap else "LCM log", found, times, units)
    source.notes += [damage] if damage else []
    source.notes += notes
    source.notes += [f"messages not read: {', '.join(others)}"] if others and is_mcap else []
    source.notes += [f"messages not read: {error}" for error in wrong]
    source.unread = "; ".join(wrong)
    return source


def _time_of(channel: str, columns: log_tables.Table, notes: list[str]) -> tuple[str, str | None]:
    """Returns (column with the times of a channel, its unit if its name does not state it). A time
    that a message states is preferred to the time at which the message was recorded."""
    if LOG_TIME not in columns:
        known = (*TIME_NAMES, "utime_us", "received_wall_us")
        return next((name for name in known if name in columns), ""), None
    own = next((name for name in STAMPS if name in columns), None)
    place = time_by_name(list(columns))
    if own is None and place is not None and list(columns)[place] != LOG_TIME:
        own = list(columns)[place]
    if own is None:
        return LOG_TIME, None
    values = columns[own]
    unit = split_name(own)[1] or _unit_since_1970(values, columns[LOG_TIME])
    size_s = factor_of(unit, "s") if unit is not None else None
    if size_s is None:
        why = "have no known unit"
    elif values.dtype.kind not in "if" or not _is_clock(values.astype(np.float64)):
        why = "are no ascending times"
    else:
        span_s, log_s = size_s * float(np.ptp(values)), float(np.ptp(columns[LOG_TIME])) / NS_PER_S
        # A log that states one time for all messages says nothing.
        if not log_s or abs(span_s - log_s) <= SPAN_SHARE * log_s:
            return own, unit
        why = f"last {span_s:.3g} s and not {log_s:.3g} s as the log"
    notes.append(
        f"the times of {channel} are those of the log, as those of {own} {why}; `time` {own}:UNIT "
        "chooses them"
    )
    return LOG_TIME, None


def _is_clock(values: Floats) -> bool:
    """Returns True if values are ascending times. A fall to 0 is a time that nobody has set."""
    steps = np.diff(values)
    if not np.isfinite(values).all() or not len(steps) or (values[1:][steps < 0] == 0).any():
        return False
    return bool(values[-1] > values[0] and (steps >= 0).mean() >= ASCENDING_SHARE)


def _in_order(
    channel: str, columns: log_tables.Table, time: str, notes: list[str]
) -> log_tables.Table:
    """Returns the messages of a channel in the order of their times, if they only overtook each
    other. Times that begin again remain so."""
    steps = np.diff(columns[time])
    falls = steps[steps < 0]
    if not len(falls) or -falls.min() >= FALL_PERIODS * np.median(np.abs(steps)):
        return columns
    notes.append(f"{channel}: {counted(len(falls), 'message')} not in the order of the times")
    order = np.argsort(columns[time], kind="stable")
    return {name: values[order] for name, values in columns.items()}


def _unit_since_1970(values: Any, log_ns: Any) -> str | None:
    """Returns the unit in which numbers are times since 1970, as the times of the log show it, or
    None."""
    if values.dtype.kind not in "if" or not len(values):
        return None
    first, log_s = float(values[0]), float(log_ns[0]) / NS_PER_S
    units = (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9))
    if log_s < 100 * NEAR_S:
        return None
    return next((unit for unit, size in units if abs(first * size - log_s) < NEAR_S), None)


def _tables_of_others(
    path: Path, notes: list[str], wrong: list[str]
) -> tuple[dict[str, log_tables.Table], list[str], str | None]:
    """Reads the messages of another program in an MCAP file. Returns (tables, topics, damage).
    `tables`: {topic: {field: values}} with all numbers. `topics`: topics with messages of kinds
    that are not read. `damage`: one text line about damage of the file, or None. `wrong`: receives
    an error for each channel with a message that cannot be decoded; none of its messages is in the
    tables."""
    from forceaxis.bus.mcap_file import McapReader

    reader = McapReader(path)
    decoders: dict[int, Decoder | None] = {}
    names: dict[int, str] = {}
    rows: dict[int, list[Row]] = {}
    others: dict[str, None] = {}
    long: dict[str, None] = {}
    for channel, message in reader.messages():
        if channel.id not in decoders:
            decoders[channel.id] = _decoder(path, channel, reader.schema_of(channel))
            names[channel.id] = _name_of(channel.topic, names, notes)
            if decoders[channel.id] is None:
                others[f"{channel.topic} ({channel.message_encoding or 'no encoding'})"] = None
        if (decode := decoders[channel.id]) is None:
            continue
        kind = f"messages in {channel.message_encoding} on {channel.topic}"
        try:
            with files.parsing(path, kind, "export the data as CSV"):
                row: Row = dict(_numbers("", decode(message.data), long))
        except InputError as error:
            wrong.append(str(error))
            decoders[channel.id] = None
            rows.pop(channel.id, None)
            continue
        row[LOG_TIME] = message.log_time
        rows.setdefault(channel.id, []).append(row)
    if long:
        notes.append(f"lists of more than {MOST_ITEMS} items left out: {', '.join(long)}")
    tables: dict[str, log_tables.Table] = {}
    for number, own in rows.items():
        columns = log_tables.Columns()
        for row in own:
            columns.add(row)
        tables[names[number]] = columns.arrays()
    return tables, list(others), reader.damage


def _name_of(topic: str, names: Mapping[int, str], notes: list[str]) -> str:
    """Returns the name of a channel. Several channels of a topic are several senders, whose values
    are not mixed."""
    before = sum(name == topic or name.startswith(f"{topic} #") for name in names.values())
    if not before:
        return topic
    notes.append(f"{topic} has another channel, {topic} #{before + 1}")
    return f"{topic} #{before + 1}"


def _decoder(path: Path, channel: "Channel", schema: "Schema | None") -> Decoder | None:
    """Returns the function that decodes the messages of a channel, or None for an encoding that is
    not read."""
    if channel.message_encoding == "json":
        return lambda data: files.json_of(data, has_constants=True)
    if channel.message_encoding != "cdr" or schema is None or schema.encoding != "ros2msg":
        return None
    expect_package(paths.display(path), "mcap_ros2", "mcap-ros2-support", "mcap")
    from mcap_ros2.decoder import DecoderFactory

    @functools.cache
    def decoder() -> Decoder | None:  # a damaged schema is an error of the first message
        with contextlib.redirect_stderr(io.StringIO()):  # the library prints what is wrong
            return DecoderFactory().decoder_for(channel.message_encoding, schema)

    return lambda data: (found := decoder()) and found(data)


def _numbers(prefix: str, value: object, long: dict[str, None]) -> Iterator[tuple[str, float]]:
    """Yields the numbers in a value of JSON or CDR as (name, number), such as ("wrench.force.z",
    1.5). A time in two parts is one number. `long`: receives the names of long lists."""
    if isinstance(value, bool | int | float):
        is_exact = isinstance(value, int) and abs(value) < LARGEST_INTEGER
        yield prefix or "value", int(value) if is_exact else float(value)
        return
    items: Sequence[tuple[object, object]] = []
    if isinstance(value, Mapping):
        items = list(value.items())
    elif hasattr(value, "__slots__"):  # a message of ROS 2
        items = [(name, getattr(value, name)) for name in value.__slots__]
    elif isinstance(value, Sequence) and not isinstance(value, str | bytes):
        if len(value) > MOST_ITEMS:
            long[prefix] = None
            return
        items = list(enumerate(value))
    if (stamp := _stamp_ns(dict(items))) is not None:
        yield f"{prefix or 'time'}_ns", stamp
        return
    for key, inner in items:
        yield from _numbers(f"{prefix}.{key}" if prefix else str(key), inner, long)


def _stamp_ns(parts: Mapping[object, object]) -> int | None:
    """Returns a time in ns that consists of seconds and nanoseconds, or None."""
    for names in STAMP_PARTS:
        if len(parts) == 2 and set(names) == set(parts):
            seconds, ns = (parts[name] for name in names)
            if isinstance(seconds, int) and isinstance(ns, int):
                return seconds * NS_PER_S + ns
    return None
