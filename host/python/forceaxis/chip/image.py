"""Reads image files of the firmware (.elf, .hex, .bin). An image consists of the bytes for the
flash memory, and contains an identity with firmware version and name of the board.

The identity is a structure in the flash memory. firmware/port/identity.h defines this structure.
"""

import re
import struct
from pathlib import Path
from typing import NamedTuple

from forceaxis._core import InputError
from forceaxis.errors import ParameterError

IDENTITY_MAGIC = b"FAXI"
IDENTITY_STRUCT = struct.Struct("<4sI16s16sI16s")
# Expected values of the fields e_machine, e_type and p_type of an ELF file.
ARM_MACHINE, LINKED_TYPE, LOADED_SEGMENT = 40, 2, 1
# Largest size of an image file in bytes. A larger file is refused before it is read.
BYTES_MAX = 16 << 20


class Identity(NamedTuple):
    """The identity that a firmware image contains: firmware version, git revision, hash of the
    object table, name of the board."""

    version: str
    git: str
    table_hash: str  # hash of the object table, as the first eight digits of objects.OBJECTS_HASH
    board: str


class Segment(NamedTuple):
    """Consecutive bytes of the flash memory that begin at `address`."""

    address: int
    data: bytes

    @property
    def end(self) -> int:
        """Returns the address after the last byte of the segment."""
        return self.address + len(self.data)


class Image(NamedTuple):
    """The bytes for the flash memory that a firmware image file contains."""

    path: Path
    kind: str  # file format: "elf", "hex" or "bin"
    address: int | None  # start address of a .bin file; None for a file of another format
    # Segments in ascending order of their addresses.
    # For addresses between two segments, the image has no bytes.
    segments: tuple[Segment, ...]

    @property
    def size(self) -> int:
        """Returns the number of bytes in all segments."""
        return sum(len(s.data) for s in self.segments)

    def moved(self, address: int) -> "Image":
        """Returns the image of a .bin file with `address` as its start address."""
        by = address - (self.address or 0)
        segments = tuple(Segment(s.address + by, s.data) for s in self.segments)
        return self._replace(address=address, segments=segments)

    def word(self, address: int) -> int | None:
        """Returns the 32-bit word at `address`, or None if the image does not contain all bytes of
        the word."""
        for s in self.segments:
            if s.address <= address and address + 4 <= s.end:
                return int.from_bytes(s.data[address - s.address :][:4], "little")
        return None

    def has_byte(self, address: int) -> bool:
        """Returns True if the image contains a byte for `address`."""
        return any(s.address <= address < s.end for s in self.segments)


def load(path: Path | str, address: int | None = None) -> Image:
    """Reads an image file, whose suffix selects its format. `address` is the start address of a
    .bin file, by default 0. Raises InputError, OSError."""
    path = Path(path)
    kind = path.suffix.lower().lstrip(".")
    if kind not in READERS:
        raise InputError(f"{path}: expected a file ending in .elf, .hex or .bin")
    if address is not None and kind != "bin":
        raise ParameterError(
            "address",
            f"expected this option only with a .bin file, because {path} contains addresses; "
            "remove the option",
        )
    if path.stat().st_size > BYTES_MAX:
        raise InputError(
            f"{path}: expected an image of less than {BYTES_MAX} bytes, got a larger file"
        )
    data = path.read_bytes()
    if kind == "bin":
        address = address or 0
        # openocd would read a .bin file that begins with these bytes as an ELF file.
        if data.startswith(b"\x7fELF"):
            raise InputError(
                f"{path}: expected a binary image, got an ELF file; rename the file to .elf"
            )
    segments = READERS[kind](path, data, address)
    if not segments:
        raise InputError(
            f"{path}: expected a firmware image, got a file without bytes for the flash memory"
        )
    return Image(path, kind, address, joined(path, segments))


def joined(path: Path, segments: list[Segment]) -> tuple[Segment, ...]:
    """Joins adjacent segments, and returns the segments in ascending order of addresses. Raises
    InputError if two segments contain the same address."""
    runs: list[list[Segment]] = []
    for s in sorted(segments):
        end = runs[-1][-1].end if runs else -1
        if s.address < end:
            raise InputError(
                f"{path}: expected at most one byte per address, got two bytes for the address "
                f"{s.address:#010x}"
            )
        if s.address == end:
            runs[-1].append(s)
        else:
            runs.append([s])
    return tuple(Segment(run[0].address, b"".join(s.data for s in run)) for run in runs)


def read_bin(_path: Path, data: bytes, address: int | None) -> list[Segment]:
    """Returns the whole content of a .bin file as one segment that begins at `address`."""
    return [Segment(address or 0, data)] if data else []


def read_elf(path: Path, data: bytes, _address: int | None) -> list[Segment]:
    """Returns a segment for each PT_LOAD entry of an ELF file. The address of the segment is the
    physical address of the entry."""
    if not data.startswith(b"\x7fELF"):
        raise InputError(f"{path}: expected an ELF file")
    try:
        bits, order = data[4], data[5]
        kind, machine = struct.unpack_from("<HH", data, 16)
        if (bits, order, machine) != (1, 1, ARM_MACHINE):
            raise InputError(
                f"{path}: expected an image for 32-bit little-endian ARM (machine {ARM_MACHINE}), "
                f"got an image for {32 * bits} bits, machine {machine}"
            )
        if kind != LINKED_TYPE:
            raise InputError(f"{path}: expected a linked image (ELF type 2), got ELF type {kind}")
        (table,) = struct.unpack_from("<I", data, 28)
        entry_bytes, entries = struct.unpack_from("<HH", data, 42)
        segments = []
        for n in range(entries):
            what, offset, _, physical, count = struct.unpack_from(
                "<5I", data, table + n * entry_bytes
            )
            if what != LOADED_SEGMENT or not count:
                continue
            if offset + count > len(data):
                raise InputError(
                    f"{path}: expected a file of at least {offset + count} bytes, got {len(data)} "
                    "bytes; the file is damaged"
                )
            segments.append(Segment(physical, data[offset : offset + count]))
    except (struct.error, IndexError):
        raise InputError(
            f"{path}: expected a complete ELF file, but this file ends too early"
        ) from None
    return segments


class HexRecord(NamedTuple):
    """One record of a file in the format Intel HEX."""

    address: int  # lower 16 bits of the address of the first byte in the record
    kind: int
    data: bytes


DATA_RECORD, END_RECORD, SEGMENT_RECORD, LINEAR_RECORD = 0, 1, 2, 4
# Types of the records in an Intel HEX file that state a start address.
# A start address in a record is ignored, because the vector table of the chip contains it too.
START_RECORDS = (3, 5)


def hex_record(where: str, line: bytes) -> HexRecord:
    """Decodes a text line of an Intel HEX file. The line is a record of the form :nnaaaattdd..cc.
    Raises InputError for a wrong line, with a text that begins with `where`."""
    try:
        record = bytes.fromhex(line.decode("ascii").removeprefix(":"))
    except ValueError:
        record = b""
    if not line.startswith(b":") or len(record) < 5 or len(record) != record[0] + 5:
        raise InputError(f"{where}: expected a record of Intel HEX, such as :00000001FF")
    if sum(record) % 256:
        raise InputError(
            f"{where}: expected an Intel HEX record with a correct checksum, got another "
            "checksum; the file is damaged"
        )
    return HexRecord(int.from_bytes(record[1:3], "big"), record[3], record[4:-1])


def read_hex(path: Path, data: bytes, _address: int | None) -> list[Segment]:
    """Returns the data records of an Intel HEX file. Records of the types 2 and 4 define the upper
    bits of the addresses of the records that follow."""
    segments: list[Segment] = []
    base, ended = 0, False
    for number, line in enumerate(map(bytes.strip, data.split(b"\n")), 1):
        if not line:
            continue
        where = f"{path}:{number}"
        if ended:
            raise InputError(
                f"{where}: expected the end record as the last record of the Intel HEX file, got "
                "a further record"
            )
        at, kind, content = hex_record(where, line)
        if kind == DATA_RECORD:
            segments += [Segment(base + at, content)] if content else []
        elif kind == END_RECORD:
            ended = True
        elif kind in (SEGMENT_RECORD, LINEAR_RECORD) and len(content) == 2:
            base = int.from_bytes(content, "big") << (4 if kind == SEGMENT_RECORD else 16)
        elif kind not in START_RECORDS:
            raise InputError(
                f"{where}: expected an Intel HEX record of type 0 to 5, got a record of type {kind}"
            )
    if not ended:
        raise InputError(
            f"{path}: expected an Intel HEX file with an end record, got a file that "
            "ends without an end record"
        )
    return segments


READERS = {"elf": read_elf, "hex": read_hex, "bin": read_bin}


def identity(image: Image) -> Identity:
    """Returns the identity that an image contains. Raises InputError if the image contains no
    identity or several identities."""
    found: list[Identity] = []
    for s in image.segments:
        for match in re.finditer(IDENTITY_MAGIC, s.data):
            head = s.data[match.start() :][: IDENTITY_STRUCT.size]
            if (s.address + match.start()) % 4 or len(head) < IDENTITY_STRUCT.size:
                continue
            _, size, version, git, table_hash, board = IDENTITY_STRUCT.unpack(head)
            # The identity in newer firmware may be longer, because fields were appended to it.
            # The magic number of an identity may also occur by chance in machine code.
            # Machine code has no valid size of an identity after the magic number.
            if IDENTITY_STRUCT.size <= size <= 256:
                found.append(Identity(text(version), text(git), f"{table_hash:08x}", text(board)))
    if len(found) != 1:
        raise InputError(
            f"{image.path}: expected one identity block (FAXI) of a forceaxis image, got "
            f"{len(found)} identity blocks"
        )
    return found[0]


def text(field: bytes) -> str:
    """Returns the text of a field of the identity, with "?" for each control character."""
    return "".join(chr(b) if 32 <= b < 127 else "?" for b in field.split(b"\0")[0])
