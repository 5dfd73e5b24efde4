"""Boards: each is a folder with a board.toml, which describes it for building, measuring,
emulating and flashing its image. Sources and scripts are named from that folder.

    name            of `--link pil-NAME`
    image           of the files build/image/IMAGE.{elf,hex,bin}
    [build]         compiler: prefix of its tools, the system package it comes in, flags of the
                    processor; linker script; sources of every image
    [released]      identity (firmware/port/identity.h) and sources of the image that is flashed
    [memory]        [address, bytes] of flash, stored parameters and RAM; bytes of each sector
    [limits]        of the released image, and of one interrupt of the tick in instructions
    [stack]         for tools/image_report, which explains it
    [emulator]      optional. Identity and sources of the image for it; QEMU's program, the
                    system package it comes in, machine, options of its clock; what each of its
                    serial lines is: "", "modbus", or "can" (frames in records)
    [probe]         optional. openocd's configuration, name of the probe, pattern of its
                    version as openocd prints it; the chip, its 12-bit identifier and where that is.
                    [probe.options], optional: what a flashing also sets, and reads back: a register
                    whose bits `mask` become `value`, opened by `keys`, `start` and `lock` bits of
                    its own, ready when the bits `busy` of another one are 0
    [registers]     optional. For tools/check_svd: header, PyPI package and devices of the
                    vendor's files, peripherals that they lack, names that differ, fields that
                    the files lack though the manual has them

Programs of tools/ import this file without the package: only the standard library is used.
"""

import tomllib
from pathlib import Path
from types import SimpleNamespace

FILE = "board.toml"
_package = Path(__file__).resolve().parents[1]
_checkout = _package.parents[2] / "firmware/port"
PORTS = _checkout if _checkout.is_dir() else _package / "port"

TEXTS, NAMES, NUMBERS = [str], {str: str}, [int]
SCHEMA = {
    "name": str,
    "image": str,
    "build": {
        "tools": str,
        "package": str,
        "flags": TEXTS,
        "script": str,
        "sources": TEXTS,
    },
    "released": {"identity": str, "sources": TEXTS},
    "memory": {"flash": NUMBERS, "sectors": NUMBERS, "parameters": NUMBERS, "ram": NUMBERS},
    "limits": {
        "interrupt_instructions": int,
        "adc_to_dac_instructions": int,
        "flash_bytes": int,
        "ram_bytes": int,
        "recorder_bytes": int,
    },
    "stack": {
        "thread": str,
        "levels": [TEXTS],
        "section": str,
        "recorder": str,
        "indirect": {str: TEXTS},
    },
    "emulator": {
        "identity": str,
        "sources": TEXTS,
        "program": str,
        "package": str,
        "machine": str,
        "serial_lines": TEXTS,
        "clock": TEXTS,
    },
    "probe": {
        "title": str,
        "config": str,
        "version": str,
        "chip": str,
        "chip_id": int,
        "chip_id_address": int,
        "options": {
            "title": str,
            "address": int,
            "mask": int,
            "value": int,
            "keys_address": int,
            "keys": NUMBERS,
            "start": int,
            "lock": int,
            "busy_address": int,
            "busy": int,
        },
    },
    "registers": {
        "header": str,
        "package": str,
        "devices": TEXTS,
        "core": TEXTS,
        "peripherals": NAMES,
        "prefixes": NAMES,
        "split": NAMES,
        "lacking": TEXTS,
    },
}
OPTIONAL = {"emulator", "probe", "registers", "options", "lacking"}
WORDS = {str: "a text", int: "a number"}


class BoardError(ValueError):
    """A board.toml that is missing or wrong: one line."""


def _checked(where, value, schema):
    """The value, tables as namespaces. Raises BoardError unless it fits the schema."""
    if isinstance(schema, type):
        if type(value) is not schema:
            raise BoardError(f"{where}: expected {WORDS[schema]}")
        return value
    if isinstance(schema, list):
        if not isinstance(value, list):
            raise BoardError(f"{where}: expected a list")
        return [_checked(f"{where}[{i}]", v, schema[0]) for i, v in enumerate(value)]
    if not isinstance(value, dict):
        raise BoardError(f"{where}: expected a table")
    if str in schema:
        return {k: _checked(f"{where}.{k}", v, schema[str]) for k, v in value.items()}
    if unknown := sorted(value.keys() - schema.keys()):
        raise BoardError(f"{where}: {unknown[0]}: expected one of {', '.join(schema)}")
    if missing := [k for k in schema if k not in value and k not in OPTIONAL]:
        raise BoardError(f"{where}: expected {missing[0]}")
    return SimpleNamespace(
        **{
            k: _checked(f"{where}: {k}", value[k], kind) if k in value else None
            for k, kind in schema.items()
        }
    )


def read(folder):
    """The board of a folder. Raises BoardError."""
    path = Path(folder) / FILE
    try:
        board = _checked(path, tomllib.loads(path.read_text(encoding="utf-8")), SCHEMA)
    except OSError:
        raise BoardError(f"{path}: expected the description of a board, there is none") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BoardError(f"{path}: expected TOML; {error}") from None
    memory = board.memory
    for name in ("flash", "parameters", "ram"):
        span = getattr(memory, name)
        if len(span) != 2:
            raise BoardError(f"{path}: memory: {name}: expected an address and a number of bytes")
        setattr(memory, name, range(span[0], sum(span)))
    if sum(memory.sectors) != len(memory.flash):
        raise BoardError(f"{path}: memory: sectors: expected {len(memory.flash)} bytes in all")
    board.folder = path.parent
    return board


def folders():
    """The folders of all known boards."""
    return sorted(path.parent for path in PORTS.glob(f"*/{FILE}"))


def known():
    """All boards whose description can be read; tools/image reports the errors of others."""
    boards = []
    for folder in folders():
        try:
            boards.append(read(folder))
        except BoardError:
            continue
    return boards
