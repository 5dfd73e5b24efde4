"""Reads the results of pressed parts from an axis, records them, and acknowledges them.

A result waits in the memory of the axis until it is acknowledged. Collector.collect() acknowledges
a result only after its record is on the disk. Therefore no result is lost if the program is killed,
the disk is full or the connection fails. Another master may select results at the same time. If the
selection has changed during a read, the read is repeated.
"""

import contextlib
import datetime
import struct
import time
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from forceaxis import paths
from forceaxis._core import TICKS_PER_SECOND, InputError
from forceaxis.axis.axis import Axis
from forceaxis.axis.drive import Drive
from forceaxis.axis.link import Link, NoAnswer, Refused
from forceaxis.axis.parameter_file import PARAMETERS
from forceaxis.axis.values import R
from forceaxis.cycles import curve as curves
from forceaxis.cycles import live
from forceaxis.cycles.live import LiveProgram
from forceaxis.cycles.outcome import GOOD
from forceaxis.cycles.part import ElementFigure, figure_of
from forceaxis.cycles.record import CALIBRATION_DUE, LOST, MASTER_DUE, PartRecord
from forceaxis.cycles.records import RecordFolder
from forceaxis.errors import ParameterError
from forceaxis.experiments.points import tidy

SERIAL_WORDS = tuple(f"cycle_serial_{i}" for i in range(1, 5))
SERIAL_BYTES = 4 * len(SERIAL_WORDS)
WAITING_MOST = 255  # largest number of part results that an axis stores (firmware/cycle/results.h)
# largest number of evaluation elements in a cycle program (firmware/cycle/program.h)
ELEMENTS_MOST = 16
# largest number of attempts to read a result; another master may select other results meanwhile
READ_TRIES = 20
POLL_S = 0.2  # time in s between two reads of the number of results that wait to be acknowledged
RECONNECT_S = 1.0
# If the CRC of the parameters is older than this time in s, it is computed again for the next part.
# The CRC is not computed for each part, because this needs the values of some hundred objects.
CRC_KEPT_S = 60.0


@dataclass(frozen=True)
class WaitingObjects:
    """Objects that show which results of parts wait to be acknowledged, and which results were lost
    in a power cut."""

    cycle_results_waiting: int
    cycle_number: int
    cycle_power_up: int
    cycle_lost_first: int
    cycle_lost_last: int


@dataclass(frozen=True)
class ResultObjects:
    """Objects with the result of the part that the object cycle_result_number selects."""

    cycle_result_number: int
    cycle_result_part: int
    cycle_result_power_up: int
    cycle_result_program_crc: int
    cycle_result_bank_crc: int
    cycle_result_state: str
    cycle_result_outcome: str
    cycle_result_phase: int
    cycle_result_invalid: int
    cycle_result_begin: int
    cycle_result_duration: int
    cycle_result_serial_1: int
    cycle_result_serial_2: int
    cycle_result_serial_3: int
    cycle_result_serial_4: int


@dataclass(frozen=True)
class ElementObjects:
    """Objects with the result of the evaluation element that the object cycle_result_element
    selects."""

    cycle_result_value: int
    cycle_result_verdict: str


@dataclass(frozen=True)
class Circumstances:
    """Data about the axis that the record of a part contains in addition to the result of the
    part."""

    axis: str = ""
    device: str = ""
    parameters_crc: str = ""
    calibration_expired: bool = False


# Parameters from which the CRC in a record is computed. Every connection can read them.
# Parameters that a connection changes for its own use are not among them.
COUNTED = tuple(
    o.name
    # The objects are sorted by Modbus register, because one request reads adjacent registers.
    for o in sorted(PARAMETERS, key=lambda one: one.modbus)
    if o.part != "canopen" and o.modbus >= 0
)


def circumstances(axis: Drive) -> Circumstances:
    """Reads the data about the axis that the record of a part contains. Raises Refused,
    NoAnswer."""
    names = [n for n in COUNTED if axis.link.reaches(n) and not axis.link.manages(n)]
    raw = axis.link.read(names)
    text = "".join(f"{name}={raw[name]}\n" for name in sorted(names))
    serial = axis.link.read_one("serial_number") if axis.link.reaches("serial_number") else None
    return Circumstances(
        axis=axis.link.where,
        device="" if serial is None else f"0x{serial:08x}",
        parameters_crc=f"{zlib.crc32(text.encode()):08X}",
        calibration_expired=axis.integer("calibration_expired") != 0,
    )


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")


def serial_words(text: str) -> dict[str, int]:
    """Converts the serial number of a part to the raw values of objects. Raises ParameterError."""
    data = text.encode()
    if not text.isprintable() or len(data) > SERIAL_BYTES:
        raise ParameterError(
            "serial", f"expected at most {SERIAL_BYTES} bytes of printable text, got {text!r}"
        )
    words = struct.unpack(f"<{len(SERIAL_WORDS)}I", data.ljust(SERIAL_BYTES, b"\0"))
    return dict(zip(SERIAL_WORDS, words, strict=True))


def serial_text(found: ResultObjects) -> str:
    """Returns the serial number of a part as text."""
    words = [getattr(found, f"cycle_result_serial_{i}") for i in range(1, 5)]
    data = struct.pack(f"<{len(words)}I", *words)
    return data.rstrip(b"\0").decode("utf-8", "backslashreplace")


@dataclass(frozen=True)
class Selection:
    """Objects that show which result of a part is selected, and whether this result exists."""

    cycle_result_number: int
    cycle_result_element: int
    cycle_result_part: int


@contextlib.contextmanager
def _selecting(axis: Drive) -> Iterator[None]:
    """Context manager within which other results of parts may be selected. At its end, it selects
    the result again that was selected at its beginning."""
    before = axis.record(Selection)
    yield
    axis.link.write(
        {
            "cycle_result_number": before.cycle_result_number,
            "cycle_result_element": before.cycle_result_element,
        }
    )


def _selected(axis: Drive, number: int, element: int, kind: type[R]) -> R:
    """Selects the result of a part and one of its evaluation elements, and reads the objects that
    are the fields of `kind`. Raises Refused. Raises NoAnswer if another master changes the
    selection again and again."""
    for _ in range(READ_TRIES):
        axis.link.write({"cycle_result_number": number, "cycle_result_element": element})
        found = axis.record(kind)
        now = axis.record(Selection)
        if (now.cycle_result_number, now.cycle_result_element) == (number, element):
            return found
    raise NoAnswer(
        f"{axis.link.where}: expected a result that can be read, but another master selects "
        "results all the time; use one of the two"
    )


def waiting_numbers(axis: Drive) -> list[int]:
    """Returns the numbers of the parts whose results wait to be acknowledged. The oldest part is
    the first one. The search begins at the last part. Raises Refused, NoAnswer."""
    now = axis.record(WaitingObjects)
    found: list[int] = []
    if now.cycle_results_waiting:
        with _selecting(axis):
            for number in range(now.cycle_number, 0, -1):
                if _selected(axis, number, 0, Selection).cycle_result_part == number:
                    found.insert(0, number)
                if len(found) >= now.cycle_results_waiting:
                    break
    return found


def read(axis: Drive, number: int, wanted: LiveProgram) -> PartRecord | None:
    """Reads the result of a part as a record, without data about the axis and without notes.
    `number`: number of the part; 0 means the last part. Returns None if its result does not wait to
    be acknowledged. The evaluation elements of a part that was pressed with another cycle program
    than `wanted` have raw values and no names. Raises Refused, NoAnswer."""
    with _selecting(axis):
        found = _selected(axis, number, 0, ResultObjects)
        if found.cycle_result_part == 0:
            return None
        is_known = found.cycle_result_program_crc == wanted.program.crc
        count = len(wanted.program.elements) if is_known else ELEMENTS_MOST
        elements = [_selected(axis, number, i, ElementObjects) for i in range(count)]
    record = PartRecord(
        number=found.cycle_result_part,
        power_up=found.cycle_result_power_up,
        serial=serial_text(found),
        recorded=_now(),
        program_crc=f"{found.cycle_result_program_crc:08X}",
        law="bank" if found.cycle_result_bank_crc else "P",
        law_crc=f"{found.cycle_result_bank_crc:08X}" if found.cycle_result_bank_crc else "",
        begin_tick=found.cycle_result_begin,
        duration_s=found.cycle_result_duration / TICKS_PER_SECOND,
        state=found.cycle_result_state,
        outcome=found.cycle_result_outcome,
        phase=f"{found.cycle_result_phase}",
        invalid_ticks=found.cycle_result_invalid,
    )
    verdicts = [one.cycle_result_verdict.replace("_", " ") for one in elements]
    values = [float(one.cycle_result_value) for one in elements]
    if not is_known:
        return replace(
            record,
            elements=[
                ElementFigure(f"element_{i}", "", verdict, value, "", None, None)
                for i, (verdict, value) in enumerate(zip(verdicts, values, strict=True))
                if verdict != "none"
            ],
        )
    program = wanted.program
    return replace(
        record,
        program=paths.display(program.file),
        title=program.title,
        program_number=program.number,
        phase=program.phases[found.cycle_result_phase].name,
        elements=[
            figure_of(element, verdict, tidy(value * element.per_value))
            for element, verdict, value in zip(program.elements, verdicts, values, strict=True)
        ],
    )


def with_curve(axis: Drive, record: PartRecord, wanted: LiveProgram) -> PartRecord:
    """Adds the curve to the record of a part. This is possible only for the last part of the axis,
    and only if the axis permits to read the curve. Otherwise the record does not change. Raises
    NoAnswer."""
    try:
        if axis.integer("cycle_number") != record.number or not record.title:
            return record
        points = curves.read(axis, wanted)
        is_same = axis.integer("cycle_number") == record.number
    except Refused:
        return record
    return replace(record, curve=points.rows()) if is_same else record


def acknowledge(axis: Drive, number: int) -> None:
    """Acknowledges the result of a part to the axis, which then need not store it any longer.
    Raises Refused, NoAnswer."""
    axis.link.write({"cycle_acknowledge": number})


@dataclass
class Reminders:
    """Adds notes to records of parts. The notes remind of work that is necessary, such as pressing
    a master part."""

    # time in hours after which a master part must be pressed again; None: no note about it
    master_every_h: float | None = None
    master_serial: str = ""
    calibration_due: datetime.date | None = None
    # time at which a master part was last pressed with the verdict good
    master_pressed: datetime.datetime | None = None

    def resume(self, folder: RecordFolder) -> None:
        """Finds in the records of a folder when a master part was last pressed with the verdict
        good."""
        if self.master_every_h is not None:
            for record in folder.records():
                self.press(record)

    def press(self, record: PartRecord) -> None:
        """Stores the time of a record if the record belongs to a good master part."""
        if record.serial == self.master_serial and record.state == GOOD:
            self.master_pressed = datetime.datetime.fromisoformat(record.recorded)

    def notes(self, record: PartRecord, is_expired: bool) -> list[str]:
        """Returns the notes for the record of a part. `is_expired`: True if the axis reports that
        its calibration has expired."""
        self.press(record)
        now = datetime.datetime.fromisoformat(record.recorded)
        found = []
        if self.master_every_h is not None:
            last = self.master_pressed
            age_h = None if last is None else (now - last).total_seconds() / 3600
            if age_h is None or age_h > self.master_every_h:
                found.append(MASTER_DUE)
        is_due = self.calibration_due is not None and now.date() > self.calibration_due
        return [*found, CALIBRATION_DUE] if is_due or is_expired else found


class Collector:
    """Reads the results of parts from one axis. If `folder` is given, writes their records to it
    and then acknowledges them. If `folder` is None, changes nothing on the axis. Raises InputError
    if the folder has another part with the same number, and Refused, NoAnswer."""

    def __init__(
        self,
        axis: Drive,
        wanted: LiveProgram,
        folder: RecordFolder | None,
        reminders: Reminders | None = None,
    ) -> None:
        self.axis, self.wanted, self.folder = axis, wanted, folder
        self.reminders = reminders or Reminders()
        self._circumstances = circumstances(axis)
        self._since = time.monotonic()

    def collect(self) -> Iterator[PartRecord]:
        """Yields the records of the results that wait to be acknowledged. The oldest record is the
        first one. If there is a folder, writes each record to it and acknowledges the result.
        Records that the folder already contains are not yielded."""
        for number in waiting_numbers(self.axis):
            record = self.record(number)
            # The result no longer waits, because another master has acknowledged it.
            if record is None:
                continue
            is_new = True
            if self.folder is not None:
                if record.key not in self.folder:
                    record = with_curve(self.axis, record, self.wanted)
                is_new = self.folder.add(record)
                acknowledge(self.axis, number)
            if is_new:
                yield record

    def lost(self) -> list[PartRecord]:
        """Returns records of the results that were lost in a power cut of the axis. If there is a
        folder, writes these records to it and acknowledges the results. Records that the folder
        already contains are not returned. Call collect() before this function."""
        now = self.axis.record(WaitingObjects)
        last = now.cycle_lost_last
        if now.cycle_lost_first == 0:
            return []
        # number of the power-up in which the lost parts were pressed
        before = now.cycle_power_up - 1
        found = []
        for number in range(max(now.cycle_lost_first, last + 1 - WAITING_MOST), last + 1):
            record = self._completed(PartRecord(number, before, recorded=_now(), state=LOST))
            if not self._is_known(record):
                found.append(record)
        if self.folder is not None:
            for record in found:
                self.folder.add(record)
            acknowledge(self.axis, last)
        return found

    def _is_known(self, lost: PartRecord) -> bool:
        """Returns True if the folder already has the record of a lost part. The axis reports a lost
        part twice if a power cut occurs before it has stored the acknowledgement. It never reports
        another part with the same number."""
        if self.folder is None:
            return False
        same = [key for key in self.folder.keys if key[1] == lost.number]
        return lost.key in same or any(self.folder.record(key).state == LOST for key in same)

    def record(self, number: int) -> PartRecord | None:
        """Returns the complete record of a part, or None if the result of the part does not wait to
        be acknowledged."""
        record = read(self.axis, number, self.wanted)
        return None if record is None else self._completed(record)

    def _completed(self, record: PartRecord) -> PartRecord:
        if time.monotonic() - self._since > CRC_KEPT_S:
            self._circumstances = circumstances(self.axis)
            self._since = time.monotonic()
        now = self._circumstances
        return replace(
            record,
            axis=now.axis,
            device=now.device,
            parameters_crc=now.parameters_crc,
            notes=self.reminders.notes(record, now.calibration_expired),
        )


@dataclass(frozen=True)
class Silence:
    """Event: the axis no longer answers, for the stated reason. An empty reason means that the axis
    answers again."""

    reason: str


def watch(
    connect: Callable[[], Link],
    wanted: LiveProgram,
    folder: RecordFolder,
    reminders: Reminders,
) -> Iterator[PartRecord | Silence]:
    """Records the parts of an axis that another master commands. Yields their records without end.
    If the axis no longer answers, connects to it again. Raises InputError. Raises Refused if the
    axis refuses an acknowledgement, and NoAnswer if the axis does not answer at the beginning."""
    collector: Collector | None = Collector(Axis(connect()), wanted, folder, reminders)
    while True:
        try:
            while collector is not None:
                yield from collector.collect()
                yield from collector.lost()
                collector.axis.link.wait(POLL_S)
            time.sleep(RECONNECT_S)
            collector = _reconnected(connect, wanted, folder, reminders)
            yield Silence("")
        except NoAnswer as error:
            if collector is not None:
                collector.axis.link.close()
                yield Silence(str(error))
            collector = None


def _reconnected(
    connect: Callable[[], Link],
    wanted: LiveProgram,
    folder: RecordFolder,
    reminders: Reminders,
) -> Collector:
    """Connects to an axis again. Raises NoAnswer if the axis does not answer or if the interface of
    the connection is missing."""
    try:
        axis = Axis(connect())
    except InputError as error:
        raise NoAnswer(str(error)) from None
    try:
        return Collector(axis, wanted, folder, reminders)
    except NoAnswer:
        axis.link.close()
        raise


def press(axis: Drive, wanted: LiveProgram, serial: str = "") -> PartRecord:
    """Presses one part on an axis that this client owns, and returns its record. The result is not
    acknowledged here, so the axis still stores it. Raises ParameterError, Refused, NoAnswer."""
    words = serial_words(serial)
    now = circumstances(axis)
    if serial:
        axis.link.write(words)
    try:
        fault = live.start(axis, wanted)
    except BaseException:
        # After a failed start, the serial number is deleted, so that the next part does not get it.
        with contextlib.suppress(Refused, NoAnswer):
            axis.link.write(dict.fromkeys(words, 0) if serial else {})
        raise
    record = read(axis, 0, wanted)
    assert record is not None  # the cycle has ended, so there is a record
    return replace(
        record,
        axis=now.axis,
        device=now.device,
        parameters_crc=now.parameters_crc,
        notes=[
            *Reminders().notes(record, now.calibration_expired),
            *([f"fault {fault}: reset it before the next part"] if fault else []),
        ],
    )
