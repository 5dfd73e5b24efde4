"""Checks that bytes are a complete message of an LCM type, before the generated code decodes the
bytes.

The generated code does not check the counts in a message. A short message that announces 2^31 empty
rows would fill the memory. A truncated string would be decoded as a shorter string.
"""

import functools
import math
from typing import ClassVar, Protocol, Self

_SIZES = {
    "int8_t": 1, "byte": 1, "boolean": 1, "int16_t": 2, "int32_t": 4, "int64_t": 8,
    "float": 4, "double": 8,
}  # fmt: skip


class Message(Protocol):
    """The functions and fields that all generated message types have."""

    __slots__: ClassVar[list[str]]
    __typenames__: list[str]
    __dimensions__: list[list[str] | None]
    wall_utime: int
    seq: int
    run_id: int

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Decodes a message."""

    @classmethod
    def _get_packed_fingerprint(cls) -> bytes:
        """Returns the first eight bytes of each message of this type."""

    def encode(self) -> bytes:
        """Encodes the message."""


# A Step is one step of reading a message, in one of three forms.
# First form of a Step: an integer is the size in bytes of fields without a count.
# Second form of a Step, for a count: (name of the count, size of the count in bytes).
# Third form of a Step, for an array: (names of the counts, size of an element in bytes).
# The size of an element is 0 for strings.
Step = int | tuple[str, int] | tuple[tuple[str, ...], int]


class Torn(ValueError):
    """Error: a count or length in a message does not match the size of the data."""


@functools.cache
def _plan(message_type: type[Message]) -> list[Step]:
    """Returns the steps for reading all bytes of a message after the fingerprint."""
    dimensions = message_type.__dimensions__
    counting = {name for each in dimensions if each for name in each}
    steps: list[Step] = []
    for name, kind, each in zip(
        message_type.__slots__, message_type.__typenames__, dimensions, strict=True
    ):
        size = _SIZES.get(kind, 0)
        if name in counting:
            steps.append((name, size))
        elif each is None and size and steps and isinstance(steps[-1], int):
            steps[-1] += size
        elif each is None and size:
            steps.append(size)
        else:
            steps.append((tuple(each or ()), size))
    return steps


class _Reader:
    """Reads the bytes of a message one after another. `at` is the present position. A method raises
    Torn if it would read beyond the last byte."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def skip(self, count: int) -> None:
        self.at += count
        if self.at > len(self.data):
            raise Torn("ends early")

    def number(self, size: int) -> int:
        self.skip(size)
        return int.from_bytes(self.data[self.at - size : self.at], "big", signed=True)

    def string(self) -> None:
        length = self.number(4)
        if length < 1:
            raise Torn("a string without its final zero")
        self.skip(length)
        if self.data[self.at - 1] != 0:
            raise Torn("a string without its final zero")


def expect_whole(message_type: type[Message], data: bytes) -> None:
    """Raises Torn unless all counts and lengths in a message match the size of the data exactly."""
    reader = _Reader(bytes(data))
    counts: dict[str, int] = {}
    reader.skip(8)
    if reader.data[:8] != message_type._get_packed_fingerprint():
        raise Torn("another type")
    for step in _plan(message_type):
        if isinstance(step, int):
            reader.skip(step)
            continue
        what, size = step
        if isinstance(what, str):
            counts[what] = reader.number(size)
            if not 0 <= counts[what] <= len(reader.data):
                raise Torn(f"{what}: {counts[what]}")
            continue
        elements = math.prod(counts[dimension] for dimension in what)
        if elements == 0 and any(counts[dimension] for dimension in what[:1]):
            # array rows without bytes are refused, because they would cost time and memory
            raise Torn("rows of nothing")
        if size:
            reader.skip(elements * size)
            continue
        for _ in range(elements):
            reader.string()
    if reader.at != len(reader.data):
        raise Torn("bytes are left over")
