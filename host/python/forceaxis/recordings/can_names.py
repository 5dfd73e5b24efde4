"""Names and scales of the frames of a CAN bus, from a DBC or from the PDOs of an EDS. With them, a
log of such frames is a source of recordings."""

import functools
import io
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from forceaxis import files, paths
from forceaxis._core import InputError
from forceaxis.errors import ParameterError, expect_package
from forceaxis.recordings.can_log import CanLog, FrameKey, Frames, expect_readers
from forceaxis.recordings.source import ArraySource, Head, Source
from forceaxis.words import counted

if TYPE_CHECKING:
    from canopen import ObjectDictionary
    from cantools.database import Message

TIME = "time_ns"
SHOWN = 6  # largest number of identifiers that are shown
NODE = re.compile(r"(?P<node>\d+)=(?P<file>.+)$")
# (name, first object with the identifier, first object with the mapping, first identifier)
PDOS = (("TPDO", 0x1800, 0x1A00, 0x180), ("RPDO", 0x1400, 0x1600, 0x200))
RECEIVED = ".RPDO"
# number of PDOs of a node, and number of PDOs with a predefined identifier
PDO_COUNT, PREDEFINED = 512, 4
PDO_STEP = 0x100  # difference between two predefined identifiers of PDOs
# Parts of the identifier of a PDO
OFF, EXTENDED, NUMBER_BITS = 1 << 31, 1 << 29, (1 << 29) - 1
FIRST_OBJECT = 0x20  # a mapping entry with a smaller index leaves its bits unused
SIGNED = (0x02, 0x03, 0x04, 0x10, 0x12, 0x13, 0x14, 0x15)  # data types of CiA 301
FLOATS = (0x08, 0x11)
NUMBERS = (0x01, *SIGNED, *FLOATS, *range(0x05, 0x08), 0x16, *range(0x18, 0x1C))
# Services whose identifiers tell the nodes of a bus
NODE_SERVICES = (0x180, 0x280, 0x380, 0x480, 0x700)


@dataclass(frozen=True)
class Names:
    """Files with names and scales of frames. `dbc`: DBC files. `eds`: EDS or DCF files, each as
    FILE or NODE=FILE."""

    dbc: Sequence[str] = ()
    eds: Sequence[str] = ()

    def __bool__(self) -> bool:
        return bool(self.dbc or self.eds)

    @property
    def parameter(self) -> str:
        """Name of the parameter that is given."""
        return "dbc" if self.dbc else "eds"


def source_of(log: CanLog, names: Names) -> Source:
    """Returns the signals in a log of CAN frames as a source, with the names MESSAGE/SIGNAL, and
    with the bus before them if several buses have the message. Raises InputError."""
    expect_readers(log.path)
    if not log.frames:
        raise InputError(
            f"{log.where}: expected frames with data, got none"
            f"{': ' + log.notes[0] if log.notes else ''}; record again"
        )
    if not names:
        raise ParameterError(
            "dbc", f"expected the file with names and scales of the frames in {log.where}, a "
            f"{log.kind} with {_identifiers(log.frames.items())}; give their DBC, or the EDS of a "
            "node by `eds`"
        )  # fmt: skip
    messages = [message for file in names.dbc for message in _of_dbc(Path(file))]
    for text in names.eds:
        messages += _of_eds(text, log)
    return _source(log, messages)


def _identifiers(frames: Iterable[tuple[FrameKey, Frames]]) -> str:
    """Returns the most frequent identifiers as text for messages."""
    known = sorted(frames, key=lambda one: -len(one[1].data))
    more = f" and {len(known) - SHOWN} more" if len(known) > SHOWN else ""
    return ", ".join(
        f"{key.text} ({counted(len(one.data), 'frame')})" for key, one in known[:SHOWN]
    ) + more  # fmt: skip


def _of_dbc(file: Path) -> list["Message"]:
    import cantools

    with files.parsing(file, "names and scales of frames (DBC)", "give another file"):
        database = cantools.database.load_file(str(file), strict=False)
        messages = getattr(database, "messages", None)
        if messages is None:
            raise ValueError("a database of diagnostics")
    return list(messages)


def _source(log: CanLog, messages: Sequence["Message"]) -> Source:
    known: dict[tuple[int, bool], Message] = {}
    logged = {(key.number, key.is_extended) for key in log.frames}
    for message in sorted(messages, key=lambda one: RECEIVED in one.name):
        number = (message.frame_id, message.is_extended_frame)
        if number not in logged:
            continue
        same = known.setdefault(number, message)
        is_received = RECEIVED in message.name  # what another node sends has its names
        if not is_received and _meaning(same) != _meaning(message):
            raise InputError(
                f"{log.where}: expected one meaning of 0x{message.frame_id:03X}, got {same.name} "
                f"and {message.name}; give one of these files alone"
            )
    heads: list[Head] = []
    arrays: list[Callable[[], NDArray[np.generic]]] = []
    nameless: dict[FrameKey, Frames] = {}
    keys = [key for key in log.frames if (key.number, key.is_extended) in known]
    buses = {key: [k.bus for k in keys if k[1:] == key[1:]] for key in keys}
    for key, frames in log.frames.items():
        if key not in buses:
            nameless[key] = frames
            continue
        message = known[key.number, key.is_extended]
        decoded = _Decoded(log, message, frames)
        if not decoded.is_fit:
            continue
        group = f"{key.bus}/{message.name}" if len(buses[key]) > 1 else message.name
        time = len(heads) if log.has_times else None
        if log.has_times:
            heads.append(Head(f"{group}/{TIME}", "ns"))
            arrays.append(decoded.times_ns)
        for signal in message.signals:
            labels = (signal.name, f"{message.name}.{signal.name}")
            heads.append(Head(f"{group}/{signal.name}", signal.unit or None, labels, time))
            arrays.append(partial(decoded.values, signal.name))
    if not heads:
        raise InputError(
            f"{log.where}: expected frames of the given names, got only "
            f"{_identifiers(log.frames.items())}; " + ("; ".join(log.notes) or "give another file")
        )
    source = ArraySource(log.path, log.kind, heads, arrays)
    source.notes = log.notes  # those of values come when these are read
    if nameless:
        source.notes.append(f"frames without a name: {_identifiers(nameless.items())}")
    return source


def _meaning(message: "Message") -> list[object]:
    """Returns what a message says about the data of its frames."""
    signals = [
        (one.name, one.start, one.length, one.byte_order, one.is_signed, one.is_float, one.scale,
         one.offset, one.unit, one.multiplexer_ids, one.multiplexer_signal)
        for one in message.signals
    ]  # fmt: skip
    return [message.name, message.length, *signals]


class _Decoded:
    """The values in the frames of one message. `is_fit`: whether any frame has the length of the
    message. Others are left out, and a note of the log says so."""

    def __init__(self, log: CanLog, message: "Message", frames: Frames) -> None:
        self._message, self._path, self._notes = message, log.path, log.notes
        fit = [k for k, data in enumerate(frames.data) if len(data) == message.length]
        self._times_ns = np.array(frames.times_ns, dtype=np.int64)[fit]
        self._data = [frames.data[k] for k in fit]
        self.is_fit = bool(fit)
        wrong = len(frames.data) - len(fit)
        if wrong:
            sizes = ", ".join(map(str, sorted({len(d) for d in frames.data} - {message.length})))
            log.notes.append(
                f"{message.name} (0x{message.frame_id:03X}): {counted(wrong, 'frame')} with "
                f"{sizes} bytes left out, as the message has {message.length}"
            )

    def times_ns(self) -> NDArray[np.generic]:
        """Returns the times of the frames in ns."""
        return self._times_ns

    def values(self, name: str) -> NDArray[np.generic]:
        """Returns the values of a signal, NaN in frames without it. Raises InputError."""
        return self._all[name]

    @functools.cached_property
    def _all(self) -> dict[str, NDArray[np.float64]]:
        found = {one.name: np.full(len(self._data), np.nan) for one in self._message.signals}
        others = 0
        with files.parsing(self._path, f"frames of {self._message.name}", "give another DBC"):
            for k, data in enumerate(self._data):
                values, is_known = _decode(self._message, data)
                others += not is_known
                for name, value in values.items():
                    found[name][k] = value
        if others:
            self._notes.append(
                f"{self._message.name}: {counted(others, 'frame')} with a multiplexer that the DBC "
                "does not have, left out for the signals behind it"
            )
        return found


def _decode(message: "Message", data: bytes) -> tuple[dict[str, Any], bool]:
    """Returns (values in a frame, whether the message has its multiplexers). Without, the values
    are those of the signals that depend on none."""
    from cantools.database import DecodeError
    from cantools.database.utils import create_encode_decode_formats, decode_data

    try:
        values = message.decode(data, decode_choices=False, allow_truncated=False)
    except DecodeError:
        plain = [one for one in message.signals if not one.multiplexer_ids]
        if len(plain) == len(message.signals):
            raise
        formats = create_encode_decode_formats(plain, message.length)
        how = {"decode_choices": False, "scaling": True, "allow_truncated": False}
        return dict(
            decode_data(data, message.length, plain, formats, **how, allow_excess=True)
        ), False
    if not isinstance(values, dict):
        raise ValueError("a container of several messages")
    return values, True


def _of_eds(text: str, log: CanLog) -> list["Message"]:
    """Returns the PDOs of a node as messages. `text`: FILE or NODE=FILE."""
    named = NODE.match(text)
    file = Path(named["file"] if named else text)
    expect_package(paths.display(file), "canopen", "canopen", "can")
    from canopen.objectdictionary.eds import import_eds

    wrong = files.parsing(file, "the objects of a node (EDS or DCF)", "give another file")
    with wrong, files.remarks("canopen"):
        content = file.read_bytes()
        try:
            lines = content.decode("utf-8-sig")
        except UnicodeDecodeError:
            lines = content.decode("cp1252")
        own = import_eds(io.StringIO(lines), None).node_id
        node = int(named["node"]) if named else own or _only_node(log, text)
        if not 1 <= node <= 127:
            raise ValueError(f"the node {node}")
        messages = []
        for message, is_on in _pdos(import_eds(io.StringIO(lines), node), node):
            messages.append(message)
            if not is_on and any(key.number == message.frame_id for key in log.frames):
                log.notes.append(
                    f"{message.name} is off in {paths.display(file)}; its mapping there was used"
                )
    if not messages:
        raise InputError(
            f"{paths.display(file)}: expected objects that are mapped to PDOs, got none"
        )
    if not named:
        log.notes.append(f"{paths.display(file)}: the PDOs are those of node {node}")
    return messages


def _only_node(log: CanLog, text: str) -> int:
    """Returns the node that sends on the bus, if it is the only one. Raises ParameterError."""
    nodes = sorted({
        key.number & 0x7F for key in log.frames
        if not key.is_extended and key.number & 0x780 in NODE_SERVICES and key.number & 0x7F
    })  # fmt: skip
    if len(nodes) != 1:
        several = ", ".join(map(str, nodes)) or "none"
        raise ParameterError(
            "eds", f"expected NODE={text} with the number of the node, such as "
            f"{(nodes or [1])[0]}={text}; {log.where} has frames of the nodes {several}"
        )  # fmt: skip
    return nodes[0]


def _pdos(objects: "ObjectDictionary", node: int) -> Iterator[tuple["Message", bool]]:
    """Yields (PDO, True if it is switched on) for each numbered PDO of a node."""
    from cantools.database import Message

    for kind, first, mapping, begin in PDOS:
        for number in range(PDO_COUNT):
            if first + number not in objects or mapping + number not in objects:
                continue
            base = begin + number * PDO_STEP if number < PREDEFINED else 0
            identifier = _number(objects[first + number], 1)
            if identifier is None or identifier == base:  # without the number of the node
                identifier = base + node if base else 0
            signals, bits = _signals(objects, objects[mapping + number])
            if not identifier & NUMBER_BITS or not signals:
                continue
            message = Message(
                identifier & NUMBER_BITS, f"node{node}.{kind}{number + 1}", (bits + 7) // 8,
                signals, is_extended_frame=bool(identifier & EXTENDED), strict=False,
            )  # fmt: skip
            yield message, not identifier & OFF


def _number(record: Any, sub: int) -> int | None:
    """Returns the number that an EDS or a DCF gives for an entry of a record, or None."""
    if sub not in record:
        return None
    entry = record[sub]
    value = entry.value if getattr(entry, "value", None) is not None else entry.default
    return value if isinstance(value, int) else None


def _signals(objects: "ObjectDictionary", mapping: Any) -> tuple[list[Any], int]:
    """Returns the signals of a PDO, and its number of bits."""
    from cantools.database import Signal
    from cantools.database.conversion import BaseConversion

    signals: list[Any] = []
    bits = 0
    for sub in range(1, (_number(mapping, 0) or 0) + 1):
        entry = _number(mapping, sub)
        if entry is None:
            return [], 0
        index, place, length = entry >> 16, entry >> 8 & 0xFF, entry & 0xFF
        start, bits = bits, bits + length
        variable = objects.get_variable(index, place) if index >= FIRST_OBJECT else None
        if variable is None or variable.data_type not in NUMBERS or not length:
            continue
        conversion = BaseConversion.factory(
            scale=getattr(variable, "factor", 1) or 1, is_float=variable.data_type in FLOATS
        )
        name = variable.name
        if any(one.name == name for one in signals):
            name = f"{name} ({index:04X}h:{place})"
        signals.append(
            Signal(
                name, start, length, is_signed=variable.data_type in SIGNED, conversion=conversion,
                unit=getattr(variable, "unit", "") or None,
            )
        )  # fmt: skip
    return signals, bits
