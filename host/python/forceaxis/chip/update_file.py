"""Reads and writes the update file of a board. It contains two firmware images, one for each slot.
Before each image is its head (update_head_t in firmware/app/update_state.h).

The file begins with 64 bytes: {"FAXF", version 1, offset and size of both records, SHA-256 of all
bytes after these 64 bytes}. Two records follow. A record consists of a head and an image. An axis
receives the record for the slot whose image does not run.

Programs in tools/ import this module without the package forceaxis. Therefore it uses only the
standard library.
"""

import hashlib
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

FILE_MAGIC, FILE_VERSION = b"FAXF", 1
FILE_HEAD = struct.Struct("<4sI4I32s8x")
HEAD = struct.Struct("<4s5I16s16sII")
HEAD_MAGIC = b"FAXU"
HEAD_CRC_OFFSET = HEAD.size - 4
# layout of the trailer of a firmware image, as in firmware/storage/slots.h
TRAILER = struct.Struct("<16I")
TRAILER_MAGIC, BLANK = 0x31544146, 0xFFFFFFFF


class UpdateFileError(ValueError):
    """Error: a file is not an update file. The text of the error has one line."""


@dataclass(frozen=True)
class UpdateRecord:
    """One firmware image of an update file, and the values of its head. `table`: hash of the object
    table. `address`: first address of the slot for which the image is linked."""

    address: int
    crc: int
    table: int
    board: str
    version: str
    image: bytes

    def download(self, replaced_table: int) -> bytes:
        """Returns the bytes that an axis receives in an update: head and firmware image.
        `replaced_table`: hash of the object table of the firmware that the axis has now."""
        head = HEAD.pack(
            HEAD_MAGIC, self.address, len(self.image), self.crc, self.table, replaced_table,
            self.board.encode(), self.version.encode(), BLANK, 0,
        )  # fmt: skip
        return head[:HEAD_CRC_OFFSET] + _word(zlib.crc32(head[:HEAD_CRC_OFFSET])) + self.image


def record(address: int, image: bytes, table: int, board: str, version: str) -> UpdateRecord:
    """Returns the update record of a firmware image that is linked for the slot at `address`."""
    return UpdateRecord(address, zlib.crc32(image), table, board, version, image)


def trailer(image: bytes) -> bytes:
    """Returns the trailer for an image that a debug probe writes to the flash memory. The trailer
    marks the image as confirmed, and gives it the sequence number 1, as for the first image of a
    chip."""
    words = [TRAILER_MAGIC, len(image), zlib.crc32(image), 1, 0]
    return TRAILER.pack(*words, *[BLANK] * (16 - len(words)))


def write(records: Sequence[UpdateRecord]) -> bytes:
    """Returns the bytes of an update file that contains two records."""
    parts = [one.download(one.table) for one in records]
    body = b"".join(parts)
    first, second = (len(part) for part in parts)
    places = FILE_HEAD.size, first, FILE_HEAD.size + first, second
    return FILE_HEAD.pack(FILE_MAGIC, FILE_VERSION, *places, hashlib.sha256(body).digest()) + body


def read(path: Path) -> list[UpdateRecord]:
    """Returns both records of an update file. Raises UpdateFileError if the file has another format
    or is damaged."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise UpdateFileError(f"{path}: expected an update file, got: {error.strerror}") from None
    if len(data) < FILE_HEAD.size or data[:4] != FILE_MAGIC:
        raise UpdateFileError(
            f"{path}: expected an update file, such as build/image/forceaxis-stm32f446.update; "
            "tools/image writes it"
        )
    _, version, *places, digest = FILE_HEAD.unpack_from(data)
    if version != FILE_VERSION:
        raise UpdateFileError(
            f"{path}: expected an update file of version {FILE_VERSION}, got version {version}; "
            "use the package of this file"
        )
    end = max(places[0] + places[1], places[2] + places[3])
    if len(data) < end:
        raise UpdateFileError(
            f"{path}: expected {end} bytes, got {len(data)} bytes; the file is not complete"
        )
    if hashlib.sha256(data[FILE_HEAD.size :]).digest() != digest:
        raise UpdateFileError(
            f"{path}: expected the SHA-256 that the file states, got another one; the file is "
            "damaged"
        )
    return [_record(path, data[at : at + size]) for at, size in (places[:2], places[2:])]


def _word(value: int) -> bytes:
    return value.to_bytes(4, "little")


def _record(path: Path, data: bytes) -> UpdateRecord:
    if len(data) < HEAD.size or data[:4] != HEAD_MAGIC:
        raise UpdateFileError(f"{path}: expected the head of an image, got other bytes")
    _, address, length, crc, table, _, board, version, _, _ = HEAD.unpack_from(data)
    image = data[HEAD.size :]
    if length != len(image) or zlib.crc32(image) != crc:
        raise UpdateFileError(f"{path}: expected an image of {length} bytes with a right CRC")
    return UpdateRecord(address, crc, table, _text(board), _text(version), image)


def _text(field: bytes) -> str:
    return field.split(b"\0")[0].decode("ascii", errors="replace")
