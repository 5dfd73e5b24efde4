"""Converts messages of an LCM bus to topics. Topics are the form of messages in MCAP files and in
viewers such as Foxglove.

Each LCM channel becomes two topics:

    /lcm/AXIS_1_STATE   the bytes of the messages, with the type in the language of LCM
    /axis_1/state       the same as JSON, with a JSON schema that names the unit of each number

Each sample in a block of samples (SIM_TRUTH, AXIS_n_CAPTURE) becomes one JSON message, with the
tick and the time of the sample. The names of fields contain the unit, as in exported tables. A
point in the name of a signal separates nested objects: "sensor.force_N" becomes {"sensor":
{"force_N": 1}}. A number that is not available has no field. In the JSON schema, each number has
the key "unit" in addition to "type".
"""

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from forceaxis._core import TICKS_PER_SECOND
from forceaxis.bus.capture_assembly import fits, unit_of
from forceaxis.bus.lcm import NOT_AVAILABLE, Gaps, Undecodable, channel_of, decode, type_of
from forceaxis.bus.message_rows import column_name, engineering, message_row, with_unit
from forceaxis.bus.messages import axis_capture_t, axis_state_t, sim_truth_t
from forceaxis.bus.monitor_state import AxisWatch
from forceaxis.bus.wire import Message

RAW = "/lcm/"  # prefix of the names of topics with the bytes of LCM messages
LCM, JSON, JSON_SCHEMA = "lcm", "json", "jsonschema"  # encodings, named as in the MCAP registry
NS_PER_US = 1000
NS_PER_S = 1_000_000_000
# {end of the name of a field: unit of the field}
UNIT_ENDINGS = {
    "_mm_per_s": "mm/s",
    "_deg_per_s": "deg/s",
    "_mm": "mm",
    "_deg": "deg",
    "_cnt_per_s": "count/s",
    "_cnt_q8": "1/256 count",
    "_scale_uN": "uN/count",
    "_permille": "permille",
    "_tick": "tick",
    "_code": "DAC code",
    "_raw": "ADC code",
    "_cnt": "count",
    "_mN": "mN",
    "_us": "us",
    "_N": "N",
    "_V": "V",
    "_s": "s",
}
FIELD_UNITS = {
    "tick": "tick",
    "decimation": "tick",
    "first_sample": "sample",
    "encoder": "count",
    "adc0": "ADC code",
    "adc1": "ADC code",
    "dac": "DAC code",
    "position_age": "tick",
    "force_age": "tick",
}
CHANNEL = re.compile(r"AXIS_([0-9]+)_(\w+)|SIM_(\w+)")
Fields = dict[str, Any]


class Topic(NamedTuple):
    """A topic, and the schema of its messages. The schema is empty for messages of another
    program."""

    name: str
    encoding: str  # encoding of the messages: LCM or JSON
    schema_name: str = ""
    schema_encoding: str = ""
    schema: bytes = b""


class TopicMessage(NamedTuple):
    """One message of a topic, with its time in ns since 1970."""

    topic: Topic
    time_ns: int
    data: bytes


def topic_name(channel: str) -> str:
    """Returns the name of the JSON topic for an LCM channel, such as "/axis_1/state" for
    "AXIS_1_STATE"."""
    match = CHANNEL.fullmatch(channel)
    if not match:
        return f"/{channel}"
    return f"/sim/{match[3].lower()}" if match[3] else f"/axis_{match[1]}/{match[2].lower()}"


def raw_topic(channel: str, data: bytes) -> Topic:
    """Returns the topic that contains the messages of an LCM channel as bytes."""
    carried = type_of(channel, data)
    if carried is None:
        return Topic(RAW + channel, LCM)
    name = f"forceaxis.{carried.__name__}"
    return Topic(RAW + channel, LCM, name, LCM, lcm_text(carried).encode())


def lcm_text(carried: type[Message]) -> str:
    """Returns the definition of a message type in the type language of LCM. The names of its fields
    contain the units."""
    lines = []
    for name, kind, size in zip(
        carried.__slots__, carried.__typenames__, carried.__dimensions__, strict=True
    ):
        lines.append(f"  {kind} {name}{''.join(f'[{one}]' for one in size or ())};")
    return "\n".join(["package forceaxis;", f"struct {carried.__name__} {{", *lines, "}", ""])


def unit_of_field(name: str) -> str:
    """Returns the unit that the name of a message field contains at its end, or "1" if the name
    contains no unit."""
    if name in FIELD_UNITS:
        return FIELD_UNITS[name]
    return next((unit for end, unit in UNIT_ENDINGS.items() if name.endswith(end)), "1")


def nested(names: Sequence[str]) -> list[tuple[str, ...]]:
    """Splits the name of each signal into the keys of nested JSON objects. For example,
    "sensor.force_N" becomes ("sensor", "force_N"). A name is not split if it begins with another
    name and a dot."""
    known = set(names)
    places = []
    for name in names:
        parts = tuple(name.split("."))
        above = {".".join(parts[:i]) for i in range(1, len(parts))}
        places.append((name,) if above & known or "" in parts else parts)
    return places


def put(table: Fields, place: Sequence[str], value: object) -> None:
    """Writes a value into nested JSON objects. `place` has the keys of the objects, from the outer
    to the inner one."""
    for part in place[:-1]:
        table = table.setdefault(part, {})
    table[place[-1]] = value


def json_schema(title: str, units: Mapping[str, str | None]) -> bytes:
    """Returns the JSON schema of an object. `units`: {name of a field: unit of its number, or None
    for a text}. Names with dots become nested objects, as in the messages."""
    properties: Fields = {}
    for place, unit in zip(nested(list(units)), units.values(), strict=True):
        at = properties
        for part in place[:-1]:
            at = at.setdefault(part, {"type": "object", "properties": {}})["properties"]
        number = {"type": "number", "unit": unit, "description": f"unit: {unit}"}
        at[place[-1]] = {"type": "string"} if unit is None else number
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": title,
        "type": "object",
        "properties": properties,
    }
    return json.dumps(schema).encode()


def engineering_row(axis: AxisWatch, state: axis_state_t, wall_us: int) -> dict[str, float | None]:
    """Returns values of a state of an axis: forces in N, lengths in the unit that the monitor
    shows, and voltages in V."""
    axis.take_state(state, wall_us)
    shown = axis.words(wall_us)
    assert shown is not None  # `shown` is not None, because take_state() has set a state
    found = {
        "force_N": shown.force_N,
        "target_force_N": shown.target_force_N,
        "output_V": shown.output_V,
        "command_V": shown.command_V,
    }
    if shown.position_unit != "count":
        unit = shown.position_unit
        found |= {
            with_unit("position", unit): shown.position,
            with_unit("target_position", unit): shown.target_position,
            with_unit("velocity", f"{unit}/s"): shown.velocity_per_s,
        }
    return found


@dataclass
class SampleTimes:
    """Computes times, in ns since 1970, for the samples of one channel. The last sample of a block
    has the time at which the block was received. The first sample of a block is later than the
    previous block. The times therefore increase at any speed of a simulation."""

    last_tick: int | None = None
    last_ns: int = 0

    def of(self, ticks: range, received_ns: int) -> list[int]:
        """Returns the time of each sample of a block. `ticks` has the tick of each sample."""
        # the block belongs to another run or to another capture
        if self.last_tick is None or ticks[0] <= self.last_tick:
            span_ns = (ticks[-1] - ticks[0] + ticks.step) * NS_PER_S // TICKS_PER_SECOND
            self.last_ns = max(self.last_ns, received_ns - span_ns)
            self.last_tick = ticks[0] - ticks.step
        start, first = self.last_ns, self.last_tick
        span_ns, span = max(0, received_ns - start), ticks[-1] - first
        self.last_ns, self.last_tick = start + span_ns, ticks[-1]
        return [start + span_ns * (tick - first) // span for tick in ticks]


class Topics:
    """Converts the messages of an LCM bus or log, in their order, to messages of topics."""

    def __init__(self, mm_per_count: float | None = None) -> None:
        self._mm_per_count = mm_per_count
        self._axes: dict[int, AxisWatch] = {}
        self._gaps: dict[str, Gaps] = {}
        self._raw: dict[tuple[str, bytes], Topic] = {}
        self._samples: dict[str, tuple[list[str], Topic, list[tuple[str, ...]]]] = {}
        self._times: dict[str, SampleTimes] = {}
        self._rows: dict[str, tuple[dict[str, str | None], Topic]] = {}

    def of(self, channel: str, data: bytes, wall_us: int) -> Iterator[TopicMessage]:
        """Yields the topic messages for one LCM message: one message with its bytes, and messages
        with its values in JSON. There is no JSON if the LCM message is damaged, unknown or a
        duplicate."""
        time_ns = wall_us * NS_PER_US
        raw = self._raw.setdefault((channel, data[:8]), raw_topic(channel, data))
        yield TopicMessage(raw, time_ns, data)
        if not raw.schema_name:
            return
        try:
            message = decode(channel, data)
        except Undecodable:
            return
        if not self._gaps.setdefault(channel, Gaps()).take(message.run_id, message.seq):
            return
        if isinstance(message, sim_truth_t | axis_capture_t):
            yield from self._sampled(channel, message, time_ns)
        else:
            row = message_row(message, wall_us)
            if isinstance(message, axis_state_t):
                number = channel_of(channel)[0] or 0
                axis = self._axes.setdefault(number, AxisWatch(number, self._mm_per_count))
                row |= engineering_row(axis, message, wall_us)
            yield TopicMessage(self._row_topic(channel, message, row), time_ns, _json(row))

    def _row_topic(self, channel: str, message: Message, row: Mapping[str, object]) -> Topic:
        """Returns the JSON topic of a message. If the message has a field that earlier messages of
        the channel did not have, a new topic is made."""
        units, topic = self._rows.get(channel, ({}, None))
        if topic is None or not row.keys() <= units.keys():
            texts = {name for name, value in row.items() if isinstance(value, str)}
            objects = {column_name(n): unit_of(n) or "1" for n in getattr(message, "more_name", ())}
            units = units | {
                n: None if n in texts else objects.get(n) or unit_of_field(n) for n in row
            }
            title = f"forceaxis.{type(message).__name__.removesuffix('_t')}"
            topic = Topic(topic_name(channel), JSON, title, JSON_SCHEMA, json_schema(title, units))
            self._rows[channel] = units, topic
        return topic

    def _sampled(
        self, channel: str, block: sim_truth_t | axis_capture_t, time_ns: int
    ) -> Iterator[TopicMessage]:
        """Yields a topic message in JSON for each sample of a block."""
        if not block.num_samples or not fits(*_ticks_of(block)):
            return
        first, count, decimation = _ticks_of(block)
        ticks = range(first, first + count * decimation, decimation)
        topic, places = self._sample_topic(channel, block)
        times = self._times.setdefault(channel, SampleTimes()).of(ticks, time_ns)
        for tick, at_ns, raw in zip(ticks, times, block.value, strict=True):
            row: Fields = {"tick": tick, "time_s": tick / TICKS_PER_SECOND}
            for signal, place, value in zip(block.signal, places, raw, strict=True):
                truth = isinstance(block, sim_truth_t)
                put(row, place, value if truth else engineering(signal, value))
            yield TopicMessage(topic, at_ns, _json(row))

    def _sample_topic(
        self, channel: str, block: sim_truth_t | axis_capture_t
    ) -> tuple[Topic, list[tuple[str, ...]]]:
        """Returns the JSON topic of the samples of a block, and for each signal the keys of its
        nested JSON objects."""
        signals = list(block.signal)
        known = self._samples.get(channel)
        if known is None or known[0] != signals:
            is_truth = isinstance(block, sim_truth_t)
            units = [unit_of(name) or "1" for name in signals]
            if isinstance(block, sim_truth_t):
                units = list(block.unit)
            names = [with_unit(n, u) for n, u in zip(signals, units, strict=True)]
            title = f"forceaxis.{'truth' if is_truth else 'capture'}_sample"
            schema = json_schema(
                title, {"tick": "tick", "time_s": "s", **dict(zip(names, units, strict=True))}
            )
            topic = Topic(topic_name(channel), JSON, title, JSON_SCHEMA, schema)
            places = nested(["tick", "time_s", *names])[2:]
            known = self._samples[channel] = signals, topic, places
        return known[1:]


def _ticks_of(block: sim_truth_t | axis_capture_t) -> tuple[int, int, int]:
    """Returns three numbers of a block: its first tick, its number of samples, and the number of
    ticks between two samples. If a capture states no tick, the sample at the trigger has tick 0."""
    decimation = max(1, block.decimation)
    if isinstance(block, axis_capture_t) and block.first_tick == NOT_AVAILABLE:
        first = (block.first_sample - block.trigger_sample) * decimation
        return first, block.num_samples, decimation
    return block.first_tick, block.num_samples, decimation


def _json(row: Mapping[str, object]) -> bytes:
    """Returns a JSON object as bytes. Fields whose values JSON cannot express are left out."""
    try:
        if None not in row.values():
            return json.dumps(row, allow_nan=False).encode()
    except ValueError:
        pass
    return json.dumps(_finite(row)).encode()


def _finite(row: Mapping[str, Any]) -> Fields:
    """Returns a JSON object without the fields that are None, nan or infinite."""
    found: Fields = {}
    for name, value in row.items():
        if isinstance(value, dict):
            found[name] = _finite(value)
        elif value is not None and not (isinstance(value, float) and not math.isfinite(value)):
            found[name] = value
    return found
