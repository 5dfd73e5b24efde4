"""Files of other programs that are no text tables, as bytes, made from known samples with the
libraries of the formats: workbooks, TDMS, MDF, logs of a CAN bus, messages of ROS 2."""

import contextlib
import functools
import io
import random
import struct
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import can
import numpy as np
import openpyxl
from asammdf import MDF, Signal
from forceaxis.recordings import signal_recording
from mcap_ros2.writer import Writer as RosWriter
from nptdms import ChannelObject, RootObject, TdmsWriter
from verbs import forceaxis

DBC = """\
VERSION ""
NS_ :
BS_:
BU_: Press
BO_ 385 Press: 8 Press
 SG_ Force : 0|32@1- (0.001,0) [0|0] "N" Press
 SG_ Travel : 32|32@1- (0.0001,0) [0|0] "mm" Press
"""
EDS = """\
[FileInfo]
FileName=press.eds
[DeviceInfo]
VendorName=press
"""
BEGIN_S = 1_778_767_384
VALUE = "builtin_interfaces/Time stamp\nfloat64 force\nfloat64 travel\n"


def entry(index: str, name: str, data_type: int, default: str = "", kind: int = 7) -> str:
    text = f"[{index}]\nParameterName={name}\nObjectType={kind}\n"
    if kind != 7:
        return f"{text}SubNumber=3\n"
    return f"{text}DataType={data_type}\nAccessType=rw\nDefaultValue={default}\n"


def eds() -> str:
    """An EDS whose first TPDO has force and travel as 32 bits each."""
    parts = [
        entry("1800", "TPDO1", 0, kind=9), entry("1800sub0", "n", 5, "1"),
        entry("1800sub1", "COB-ID", 7, "$NODEID+0x180"),
        entry("1A00", "mapping", 0, kind=9), entry("1A00sub0", "n", 5, "2"),
        entry("1A00sub1", "1", 7, "0x20000020"), entry("1A00sub2", "2", 7, "0x20010020"),
        entry("2000", "Force", 4, "0"), entry("2001", "Travel", 4, "0"),
    ]  # fmt: skip
    return EDS + "".join(parts)


@dataclass
class Samples:
    """Samples before they become a file. `lost`: what an import must say if some are missing."""

    time_s: np.ndarray
    force_N: np.ndarray
    travel_mm: np.ndarray

    def without(self, places: list[int]) -> "Samples":
        return Samples(*(np.delete(one, places) for one in vars(self).values()))


@dataclass
class Made:
    """A file as bytes. `maps`: what a user writes. `more`: files beside it with the words that name
    them, {name: (content, words)}. `named`: whether samples are missing from it."""

    data: bytes
    maps: list[str]
    more: dict[str, str] = field(default_factory=dict)


def _file_of(write: Callable[[Path], object], suffix: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"file{suffix}"
        write(path)
        return path.read_bytes()


def workbook(s: Samples, rng: random.Random) -> Made:
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.title = rng.choice(["Data", "Messung 1", "Sheet1"])
    for _ in range(rng.choice([0, 3])):
        sheet.append(["Report", "of", "press", 7])
    left = [None] * rng.choice([0, 2])
    sheet.append([*left, "Time", "Force", "Travel", "State"])
    sheet.append([*left, "s", "N", "mm"])
    for row in zip(*vars(s).values(), strict=True):
        sheet.append([*left, *map(float, row), rng.choice(["RUN", "STOP", None])])
    for k in range(rng.choice([0, 2])):
        book.create_sheet(f"Notes {k}").append(["nothing", "here"])
    if rng.random() < 0.3:
        book.create_sheet("Setup").append(["Program", 7])
    stream = io.BytesIO()
    book.save(stream)
    return Made(stream.getvalue(), ["force=Force", "position=Travel"])


def tdms(s: Samples, rng: random.Random) -> Made:
    stream = io.BytesIO()
    step_s = float(np.median(np.diff(s.time_s)))
    is_wave = bool(np.ptp(np.diff(s.time_s)) < 1e-9) and rng.random() < 0.6
    start = np.datetime64("2026-05-14T12:00:00")
    wave = {"wf_increment": step_s, "wf_start_offset": float(s.time_s[0]), "wf_start_time": start}
    scale = rng.choice([1, 1000])
    force = {"unit_string": "kN" if scale == 1000 else "N", **(wave if is_wave else {})}
    travel = {"unit_string": "mm", **(wave if is_wave else {})}
    objects = [
        ChannelObject("A", "Force", s.force_N / scale, force),
        ChannelObject("A", "Travel", s.travel_mm.astype(rng.choice(["f4", "f8"])), travel),
        ChannelObject("B", "Force raw", np.arange(5, dtype=np.int16), {}),
    ]
    if not is_wave:
        objects.insert(0, ChannelObject("A", "Time", s.time_s, {"unit_string": "s"}))
    parts = rng.choice([1, 2])
    with TdmsWriter(stream) as writer:
        for k in range(parts):  # a channel continues in the next segment
            writer.write_segment([RootObject({}), *(
                ChannelObject(o.group, o.channel, np.array_split(o.data, parts)[k], o.properties)
                for o in objects
            )])  # fmt: skip
    return Made(stream.getvalue(), ["force=A/Force", "position=Travel"])


def mdf(s: Samples, rng: random.Random) -> Made:
    codes = np.round(1e3 * s.force_N).astype(np.int32)
    force = Signal(codes, s.time_s, "N", "Force", conversion={"a": 1e-3, "b": 0.0})
    travel = Signal(s.travel_mm, s.time_s, "mm", "Travel")
    version, is_one = rng.choice(["3.30", "4.10", "4.20"]), rng.random() < 0.5

    def write(path: Path) -> None:
        file = MDF(version=version)
        for group in [[force, travel]] if is_one else [[travel], [force]]:
            file.append(group)
        file.save(path, overwrite=True, compression=rng.choice([0, 1, 2]) if version > "4" else 0)
        file.close()

    suffix = ".mf4" if version > "4" else ".mdf"
    return Made(_file_of(write, suffix), ["force=Force", "position=Travel"])


def packed(s: Samples) -> list[bytes]:
    return [
        struct.pack("<ii", round(1e3 * f), round(1e4 * x))
        for f, x in zip(s.force_N, s.travel_mm, strict=True)
    ]


def can_log(s: Samples, rng: random.Random, kind: str) -> Made:
    other = rng.random() < 0.5
    lines = list(zip(s.time_s - s.time_s[0], packed(s), strict=True))

    def write(path: Path) -> None:
        with can.Logger(str(path)) as log:
            for k, (at, data) in enumerate(lines):
                for number, content in [(385, data)] + [(0x701, b"\5")] * (other and k % 5 == 0):
                    log.on_message_received(can.Message(
                        timestamp=BEGIN_S + at, arbitration_id=number, data=content,
                        is_extended_id=False, channel=0,
                    ))  # fmt: skip

    if kind == "screen":
        text = "".join(
            f" ({BEGIN_S + at:.6f})  can0  181   [8]  {data.hex(' ').upper()}\n"
            for at, data in lines
        )
        data = text.encode()
    else:
        data = _file_of(write, f".{kind}")
    if rng.random() < 0.5:
        return Made(data, ["force=Force", "position=Travel"], {"dbc": DBC})
    return Made(data, ["force=Force:0.001N", "position=Travel:0.1um"], {"eds": eds()})


def ros(s: Samples, rng: random.Random) -> Made:
    stream = io.BytesIO()
    writer = RosWriter(stream, chunk_size=rng.choice([500, 1 << 20]))
    schema = writer.register_msgdef("press_msgs/msg/Value", VALUE)
    for time_s, force, travel in zip(*vars(s).values(), strict=True):
        ns = BEGIN_S * 10**9 + round(1e9 * time_s)
        message = {
            "stamp": {"sec": ns // 10**9, "nanosec": ns % 10**9}, "force": force, "travel": travel,
        }  # fmt: skip
        writer.write_message("/press", schema, message, log_time=ns + rng.randrange(10**5))
    writer.finish()
    return Made(stream.getvalue(), ["force=force:N", "position=/press/travel:mm"])


MAKERS: dict[str, Callable[[Samples, random.Random], Made]] = {
    "press.xlsx": workbook,
    "press.tdms": tdms,
    "press.mf4": mdf,
    **{
        f"log.{kind}": functools.partial(can_log, kind=kind)
        for kind in ("log", "screen", "asc", "blf", "trc")
    },
    "ros.mcap": ros,
}


def parts_of(archive: bytes) -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(archive)) as file:
        return {name: file.read(name) for name in file.namelist()}


def archive_of(parts: dict[str, bytes]) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in parts.items():
            with contextlib.suppress(UserWarning):
                file.writestr(name, content)
    return stream.getvalue()


def damaged(name: str, data: bytes, rng: random.Random, change: Callable) -> bytes:
    """Returns a file with small errors: of the sheet inside of a workbook, or of any byte."""
    if not name.endswith("xlsx") or rng.random() < 0.2:
        return change(data, rng)
    parts = parts_of(data)
    inner = rng.choice([n for n in parts if n.endswith("xml")])
    return archive_of(parts | {inner: change(parts[inner], rng)})


def drawn(seed: int) -> tuple[str, Made, Samples, list[str]]:
    """Returns (name, file, samples, changes), drawn by a seed. Some samples may be missing in the
    middle or have no value."""
    rng = random.Random(seed)
    count = rng.choice([40, 60, 200])
    step_s = rng.choice([1e-3, 5e-4, 1e-2])
    noise = np.array([rng.uniform(-1, 1) for _ in range(2 * count)])
    ramp = np.arange(count)
    known = Samples(
        np.round((rng.choice([0, 500]) + ramp) * step_s, 6),
        np.round(3 + 2 * ramp + noise[:count], 3),
        np.round(-7 + 0.11 * ramp + 0.05 * noise[count:], 4),
    )
    changes = []
    given = known
    if rng.random() < 0.3:
        at = rng.randrange(10, count - 12)
        given = known.without(list(range(at, at + rng.randint(1, 5))))
        changes.append("gap")
    name = rng.choice(list(MAKERS))
    return name, MAKERS[name](given, rng), known, changes


def run(file, *words):
    """`forceaxis recording import` of a file, into the folder of the file."""
    return forceaxis("recording", "import", file, *words, "--out", file.parent / "made")


def imported(file, *words):
    """Imports a file; returns (recording, what the command has printed)."""
    done = run(file, *words)
    assert done.returncode == 0, done.stderr
    return signal_recording.read(file.parent / "made.npz"), done.stdout
