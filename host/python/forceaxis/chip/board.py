"""Reads the description of a board. The file board.toml in the folder of the board states how its
firmware image is built, measured, emulated and flashed.

Paths in board.toml are relative to its folder. A source file that does not exist there is searched
below firmware/port, where several boards have common source files.

    name            name of the board; the link to its emulator is called pil-NAME
    image           base name of the image files build/image/IMAGE.{elf,hex,bin}
    [build]         prefix of the names of the compiler's programs, the system package that contains
                    them, compiler flags of the processor, linker script, and the source files of
                    every image
    [released]      optional. The image that is flashed: its identity (firmware/port/identity.h) and
                    its additional source files. Without it, the board exists only in an emulator
    [memory]        [address, number of bytes] of flash memory, parameter store and RAM; number of
                    bytes of each flash sector
    [slots]         optional. The two slots of the flash memory for firmware images: addresses and
                    number of bytes. The loader, which selects a slot: its linker script, and the
                    source files of every loader, of the released one, and of the one for the
                    emulator
    [limits]        limits of the released image, and largest number of instructions in one tick
                    interrupt; missing if the board has no released image
    [stack]         values for tools/image_report, which explains them; missing if the board has no
                    released image
    [emulator]      optional. The image for the emulator QEMU: its identity and its source files.
                    QEMU: its program, the system package that contains it, the machine, options of
                    a run in lock-step, and the meaning of each serial line of the machine: "",
                    "modbus" or "can" (each CAN frame is a record)
    [probe]         optional. The debug probe: configuration of openocd, name of the probe, regular
                    expression for the version of the probe in the output of openocd. The chip: its
                    name, its 12-bit identifier, and the address of this identifier
    [probe.options] optional. Registers that flashing also sets and then reads back.
                    `settings`: items [address, mask, value]; the bits `mask` become `value`.
                    `writing`: item of the same form that ends the write protection before the image
                    is written. `keys`: values that unlock these registers. `start`, `lock`: bits of
                    the first register that start the change and lock the registers. `busy`: bits of
                    another register that are 0 when the change is complete. Optional: `flash_keys`,
                    which unlock the flash memory and are written first; another register with the
                    bits `start` and `lock`; the bit `load` of that register, which makes the new
                    values effective and resets the chip
    [registers]     optional. For tools/check_svd: header file; PyPI package or crate of register
                    files, and its devices; peripherals that these files lack; names that differ;
                    fields that the files lack although the manual has them; fields
                    that differ between the files and the manual

Programs in tools/ import this module without the package forceaxis. Therefore it uses only the
standard library.
"""

import dataclasses
import re
import tomllib
import types
import typing
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

if typing.TYPE_CHECKING:
    from _typeshed import DataclassInstance

    from forceaxis.toml import TomlValue

    # Kind: the declared type of a field. Field: union of all values that a field may have.
    Kind = type | types.GenericAlias | types.UnionType
    Field = str | int | range | list["Field"] | dict[str, "Field"] | DataclassInstance | Path | None

D = typing.TypeVar("D", bound="DataclassInstance")

BOARD_FILE = "board.toml"


@dataclass(frozen=True)
class Build:
    """The compiler for a board, its options, and the source files that every image of the board
    contains."""

    tools: str  # prefix of the names of the compiler programs, such as arm-none-eabi-
    package: str
    flags: list[str]
    script: str
    sources: list[str]


@dataclass(frozen=True)
class Released:
    """The image of the firmware that is released for a board: its name and its additional source
    files."""

    identity: str
    sources: list[str]


@dataclass(frozen=True)
class Memory:
    """The address ranges of the memories of a chip, and the size of each flash sector in bytes."""

    flash: range
    sectors: list[int]
    parameters: range  # address range of the parameter store in the flash memory
    ram: range


@dataclass(frozen=True)
class Slots:
    """The two slots of the flash memory for images of the firmware, and their loader."""

    addresses: list[int]
    bytes: int
    script: str
    sources: list[str]
    released: list[str]
    emulated: list[str]


@dataclass(frozen=True)
class Limits:
    """Limits for the released image: largest permitted instruction counts and memory sizes."""

    interrupt_instructions: int
    adc_to_dac_instructions: int
    flash_bytes: int
    ram_bytes: int
    recorder_bytes: int


@dataclass(frozen=True)
class Stack:
    """Values about the firmware image from which tools/image_report computes the largest stack
    depth."""

    thread: str
    levels: list[list[str]]
    section: str
    recorder: str
    indirect: dict[str, list[str]]


@dataclass(frozen=True)
class EmulatedImage:
    """The image of a board for the emulator QEMU, and the options with which QEMU is started."""

    identity: str
    sources: list[str]
    program: str
    package: str
    machine: str
    serial_lines: list[str]
    options: list[str]


@dataclass(frozen=True)
class ProbeOptions:
    """Bits of chip registers, such as option bytes, that flashing sets and then reads back. Each
    item of `settings` is a list [address, mask, value]. `writing` is one such item."""

    title: str
    settings: list[list[int]]
    writing: list[int]
    keys_address: int
    keys: list[int]
    start: int
    lock: int
    busy_address: int
    busy: int
    flash_keys_address: int | None
    flash_keys: list[int] | None
    control_address: int | None
    load: int | None


@dataclass(frozen=True)
class Probe:
    """The debug probe that writes the flash memory, and the type of chip that must be connected to
    the probe."""

    title: str
    config: str
    version: str  # regular expression for the version in the output of openocd
    chip: str
    chip_id: int
    chip_id_address: int
    options: ProbeOptions | None


@dataclass(frozen=True)
class Registers:
    """The register descriptions of the chip vendor. Also the registers whose names differ between
    these descriptions and the firmware."""

    header: str
    package: str
    devices: list[str]
    core: list[str]
    peripherals: dict[str, str]
    prefixes: dict[str, str]
    split: dict[str, str]
    lacking: list[str] | None
    disputed: list[str] | None


@dataclass(frozen=True)
class Board:
    """The content of the file board.toml in `folder`."""

    name: str
    image: str
    build: Build
    released: Released | None
    memory: Memory
    slots: Slots | None
    limits: Limits | None
    stack: Stack | None
    emulator: EmulatedImage | None
    probe: Probe | None
    registers: Registers | None
    folder: Path


class BoardError(ValueError):
    """Error: a file board.toml is missing or has a wrong entry. The text of the error has one
    line."""


def _read_value(where: str, value: "TomlValue", kind: "Kind") -> "Field":
    """Returns a value of board.toml as the type `kind`. Raises BoardError for a value of a
    different type."""
    # An optional table or list has a type such as `Table | None`.
    # If the file contains this table or list, the first type of the union applies.
    if isinstance(kind, types.UnionType):
        kind = typing.get_args(kind)[0]
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        return _read_table(where, value, kind, {})
    if kind is range:
        return _read_range(where, value)
    if typing.get_origin(kind) is list:
        if not isinstance(value, list):
            raise BoardError(f"{where}: expected a list")
        (item,) = typing.get_args(kind)
        return [_read_value(f"{where}[{i}]", v, item) for i, v in enumerate(value)]
    if typing.get_origin(kind) is dict:
        item = typing.get_args(kind)[1]
        return {k: _read_value(f"{where}.{k}", v, item) for k, v in _table(where, value).items()}
    if isinstance(value, str | int) and type(value) is kind:
        return value
    raise BoardError(f"{where}: expected {'a text' if kind is str else 'a number'}")


def _read_range(where: str, value: "TomlValue") -> range:
    match value:
        case [int(address), int(length)]:
            return range(address, address + length)
    raise BoardError(f"{where}: expected two values, an address and a number of bytes")


def _table(where: str, value: "TomlValue") -> dict[str, "TomlValue"]:
    if not isinstance(value, dict):
        raise BoardError(f"{where}: expected a table")
    return value


def _read_table(where: str, value: "TomlValue", kind: type[D], given: Mapping[str, "Field"]) -> D:
    """Returns a table of board.toml as an object of the dataclass `kind`. `given`: {name: value} of
    those fields of the object that are not in the file."""
    table = _table(where, value)
    fields = dict(given)
    kinds: dict[str, Kind] = {
        k: v for k, v in typing.get_type_hints(kind).items() if k not in given
    }
    if unknown := sorted(table.keys() - kinds.keys()):
        raise BoardError(f"{where}: {unknown[0]}: expected one of {', '.join(kinds)}")
    for key, expected in kinds.items():
        if key in table:
            fields[key] = _read_value(f"{where}: {key}", table[key], expected)
        elif isinstance(expected, types.UnionType):
            fields[key] = None
        else:
            raise BoardError(f"{where}: expected {key}")
    return kind(**fields)


def read(folder: Path | str) -> Board:
    """Returns the board that a folder describes. Raises BoardError."""
    path = Path(folder) / BOARD_FILE
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError:
        raise BoardError(
            f"{path}: expected a file with the description of a board, got no such file"
        ) from None
    except (ValueError, RecursionError) as error:
        raise BoardError(f"{path}: expected TOML; {error}") from None
    board = _read_table(str(path), table, Board, {"folder": path.parent})
    if sum(board.memory.sectors) != len(board.memory.flash):
        raise BoardError(
            f"{path}: memory: sectors: expected sectors with a total size of "
            f"{len(board.memory.flash)} bytes, the size of the flash memory"
        )
    return board


def source(ports: Path, folder: Path, name: str) -> Path:
    """Returns the path of a source file that board.toml in `folder` names. `ports`: folder with the
    source files that several boards use."""
    path = folder / name
    return path if path.is_file() else ports / name


def shared_objects(out: Path, build: Build) -> Path:
    """Returns the folder for object files that are the same for all boards with the same compiler
    and processor. It is below `out`, the folder of the images."""
    return out / "objects" / re.sub(r"[^\w+.=-]+", "_", "_".join([build.tools, *build.flags]))


def folders(ports: Path) -> list[Path]:
    """Returns the folders that describe boards. They are subfolders of `ports`."""
    return sorted(path.parent for path in ports.glob(f"*/{BOARD_FILE}"))


def known(ports: Path) -> list[Board]:
    """Returns all boards in the folder `ports` with a correct board.toml. The program tools/image
    reports the errors of the other boards."""
    boards = []
    for folder in folders(ports):
        try:
            boards.append(read(folder))
        except BoardError:
            continue
    return boards
