"""The boards of firmware/port: the table of docs/chip/boards.md, and what a fault does in QEMU.

`BOARDS=docs/chip/boards.md pytest tests/firmware/chip/test_boards.py` writes the table.
"""

import os
import re
import struct
import subprocess

import pytest
from chip import ROOT
from forceaxis.chip import board, emulator

TABLE = ROOT / "docs/chip/boards.md"
PORTS = ROOT / "firmware/port"
HEAD = """<!-- Written by tests/firmware/chip/test_boards.py; do not edit. -->
# Boards

A board is a folder of `firmware/port` ([porting](../guide/porting.md)). All boards run the same
sources, and all with an emulator have the trace hash of the run in process for every recorded
experiment (`tests/firmware/chip/test_lockstep.py`). Flash and RAM are those of the chip in bytes.
The next four columns are the bytes that the board gives to recorder, programs of cycles, curve and
results; with 0 the board lacks the function. Lines include comments.

| board | processor | image | flash | RAM | recorder | programs | curve | results | files | lines |
| --- | --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |
"""
SHARED = """
| shared part | for | files | lines |
| --- | --- | ---: | ---: |
"""
SIZES = ("recorder_buffer", "program", "curve", "result")  # of NAME_bytes in the linker script
SUFFIXES = (".c", ".h", ".ld", ".toml")
UNITS = {"": 1, "K": 1024, "M": 1024 * 1024}


def files_of(folder, pattern="**/*"):
    return [path for path in sorted(folder.glob(pattern)) if path.suffix in SUFFIXES]


def count(files):
    return f"{len(files)} | {sum(len(path.read_text().splitlines()) for path in files)} |"


def size_of(script, name):
    """The value of NAME_bytes in a linker script."""
    text = re.search(rf"^{name}_bytes = ([^;]*);", script, re.M)[1]
    factors = [re.fullmatch(r"(\d+)([KM]?)", factor) for factor in text.split(" * ")]
    value = 1
    for factor in factors:
        value *= int(factor[1]) * UNITS[factor[2]]
    return value


def row(described):
    files = files_of(described.folder)
    script = (described.folder / described.build.script).read_text()
    sizes = {name: size_of(script, name) for name in SIZES}
    shared = [board.source(PORTS, described.folder, name) for name in described.build.sources]
    if any("recorder_buffer[FW_RECORDER_BYTES]" in path.read_text() for path in shared):
        header = (ROOT / "firmware/app/fw.h").read_text()
        sizes["recorder_buffer"] = int(re.search(r"FW_RECORDER_BYTES (\d+)", header)[1])
    processor = re.search(r"-m(?:cpu|arch)=([\w-]+)", " ".join(described.build.flags))[1]
    places = [described.released.identity] if described.released else []
    places += [f"QEMU {described.emulator.machine}"] if described.emulator else []
    memory = described.memory
    return (
        f"| `{described.folder.name}` | {processor} | {', '.join(places)} | {len(memory.flash)} "
        f"| {len(memory.ram)} | {' | '.join(map(str, sizes.values()))} | {count(files)}\n"
    )


def table():
    boards = sorted(
        board.known(PORTS), key=lambda b: (b.released is None, len(b.memory.ram), b.name)
    )
    shared = {
        "`port`, its own files": ("every board", files_of(PORTS, "*")),
        "`port/cortexm`": ("a Cortex-M", files_of(PORTS / "cortexm")),
        "`port/stm32`": ("a board with an STM32", files_of(PORTS / "stm32")),
        "`port/emulated`": ("a board of an emulator", files_of(PORTS / "emulated")),
    }
    rows = [f"| {name} | {use} | {count(files)}\n" for name, (use, files) in shared.items()]
    return HEAD + "".join(map(row, boards)) + SHARED + "".join(rows)


def test_the_table_of_the_boards_is_fresh():
    if path := os.environ.get("BOARDS"):
        (ROOT / path).write_text(table())
    assert TABLE.read_text() == table()


def test_every_folder_with_a_description_is_a_board_that_can_be_read():
    """known() leaves out a board with an error, which would also leave it out of the tests."""
    assert [described.folder for described in board.known(PORTS)] == board.folders(PORTS)
    names = [described.name for described in board.known(PORTS)]
    assert len(set(names)) == len(names) == len({b.image for b in board.known(PORTS)})


CORTEX_M = [
    described
    for described in board.known(PORTS)
    if described.emulator and "cortexm/start.c" in described.build.sources
]


@pytest.mark.parametrize(
    "emulated",
    [
        pytest.param(b, id=b.name, marks=() if b.name == "microbit" else pytest.mark.long)
        for b in CORTEX_M
    ],
    indirect=True,
)
def test_a_stack_that_overflows_ends_the_program_and_does_not_lock_the_core_up(emulated, tmp_path):
    """The image with 16 bytes of stack: the push of the fault itself may fall below the RAM, so the
    handler begins a new stack. QEMU ends with the status of the program, and reports no lock-up."""
    content = bytearray((ROOT / f"build/image/{emulated.image}-emulated.elf").read_bytes())
    (headers,) = struct.unpack_from("<I", content, 28)
    (at,) = struct.unpack_from("<I", content, headers + 4)  # the vectors are the first segment
    top, reset = struct.unpack_from("<II", content, at)
    assert top in emulated.memory.ram and reset - 1 in emulated.memory.flash
    struct.pack_into("<I", content, at, emulated.memory.ram.start + 16)
    image = tmp_path / "image.elf"
    image.write_bytes(content)
    line = emulator.command(emulated, image, *emulated.emulator.options, arguments=["forceaxis"])
    done = subprocess.run(line, stdin=subprocess.DEVNULL, capture_output=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (1, b"", b"")


@pytest.mark.parametrize(
    ("command", "missing"),
    [
        (["tools/image", "firmware/port/microbit"], "[released]"),
        (
            ["tools/image_report", "--board", "firmware/port/microbit", "x.elf"],
            "[limits] and [stack]",
        ),
    ],
)
def test_what_a_board_of_an_emulator_lacks_is_named_in_one_line(command, missing):
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
    assert f"microbit/board.toml: expected {missing}" in done.stderr
    assert "only in an emulator" in done.stderr
