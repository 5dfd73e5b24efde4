"""firmware/port/blank is a board as it stands: a copy under another name builds, boots in QEMU and
ticks. What a linker script or a start-up leaves out of an image is refused in one line."""

import contextlib
import re
import shutil
import subprocess
import sys

import pytest
from chip import ROOT
from forceaxis.axis.axis import Axis
from forceaxis.axis.link import NoAnswer
from forceaxis.axis.modbus import ModbusLink

PORTS = ROOT / "firmware/port"
MACHINE = "netduinoplus2"
NODE = 1


def changed(path, *changes):
    text = path.read_text()
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path.write_text(text)


def image(board):
    """tools/image of a board, its images beside it."""
    return subprocess.run(
        [ROOT / "tools/image", "--out", board.parent / "out", board],
        capture_output=True, text=True, check=False,
    )  # fmt: skip


@pytest.fixture(scope="module")
def board(tmp_path_factory):
    """The board of the recipe in firmware/port/README.md, after its first step."""
    board = tmp_path_factory.mktemp("ports") / "lathe"
    shutil.copytree(PORTS / "blank", board)
    changed(
        board / "board.toml",
        ('name = "blank"', 'name = "lathe"'),
        ('image = "forceaxis-blank"', 'image = "forceaxis-lathe"'),
        ('identity = "blank"', 'identity = "lathe-controller"'),
    )
    done = image(board)
    assert done.returncode == 0, done.stdout + done.stderr
    return board


@pytest.mark.long
def test_the_image_is_whole_and_within_its_limits(board):
    elf = board.parent / "out/forceaxis-lathe.elf"
    binary = elf.with_suffix(".bin").read_bytes()
    assert binary.count(b"FAXI") == 1 and b"lathe-controller" in binary
    done = subprocess.run(
        [sys.executable, ROOT / "tools/image_report", "--board", board, elf],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


@pytest.mark.alone  # in real time
def test_it_boots_and_ticks_with_sensors_that_are_never_valid(board):
    process = subprocess.Popen(
        [
            *("qemu-system-arm", "-M", MACHINE, "-nographic", "-monitor", "none", "-serial", "pty"),
            *("-kernel", board.parent / "out/forceaxis-lathe.elf"),
        ],
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    try:
        tty = re.search(r"redirected to (\S+)", process.stdout.readline())[1]
        axis = Axis(ModbusLink(tty, NODE, timeout_s=2.0))
        for _ in range(3):  # the emulator opens its end within a second
            with contextlib.suppress(NoAnswer):
                axis.read("fault")
                break
        with axis:
            first = axis.get("tick_count", "fault", "active_mode")
            later = axis.get("tick_count", "fault", "active_mode")
        assert 0 < first["tick_count"] < later["tick_count"]
        for found in (first, later):
            assert found["fault"] == "sensor_invalid" and found["active_mode"] == "disabled"
    finally:
        process.kill()
        process.wait()


SECTIONS, START, SYSTICK = "sections.ld", "cortexm/start.c", "cortexm/systick.c"  # of PORTS
KEEP_VECTORS = (SECTIONS, "    KEEP(*(.vectors))\n", "    *(.vectors)\n")
KEEP_IDENTITY = (SECTIONS, "    KEEP(*(.forceaxis_identity))\n", "")
KEEP_VERSION = (SECTIONS, "    KEEP(*(.version))\n", "")
NOT_REPORTED = ("blank/blank.c", ".software = identity_software", ".software = NULL")
IN_RAM = (SECTIONS, "    KEEP(*(.vectors.interrupts))\n  } > FLASH",
          "    KEEP(*(.vectors.interrupts))\n  } > RAM")  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ([KEEP_VECTORS], "blank.ld: .vectors: expected the vectors in the flash"),
        ([IN_RAM], "blank.ld: .vectors: expected the vectors in the flash"),
        ([KEEP_IDENTITY], ".forceaxis_identity: expected the identity of the image in the flash"),
        ([KEEP_VERSION, NOT_REPORTED], ".version: expected the text of 100Ah in the flash"),
        ([(START, "(void)main();\n", "\n")], "main: expected this function in the image"),
        ([(SYSTICK, "  port_tick();\n", "")], "port_tick: expected this function in the image"),
    ],
    ids=["vectors", "vectors in the RAM", "identity", "version", "start", "tick"],
)
def test_an_image_that_lacks_a_part_is_refused_in_one_line(board, changes, named, tmp_path):
    """The board has a changed copy of a file that it shares with others."""
    folder = tmp_path / board.name
    shutil.copytree(board, folder)
    for name, old, new in changes:
        # A file of the board itself, or a source where tools/image finds it first.
        copy = folder / name.removeprefix("blank/")
        copy.parent.mkdir(exist_ok=True)
        shutil.copy(PORTS / name, copy)
        changed(copy, (old, new))
        if name == SECTIONS:
            changed(folder / "blank.ld", ("firmware/port/sections.ld", str(copy)))
    shutil.copytree(board.parent / "out", tmp_path / "out")
    images = {path: path.read_bytes() for path in (tmp_path / "out").glob("forceaxis-*.[ehb]*")}
    done = image(folder)
    assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
    assert named in done.stderr, done.stderr
    # What was built before stays as it was; nothing is left half-made.
    assert len(images) == 3 and images == {p: p.read_bytes() for p in images}
    assert not list((tmp_path / "out").glob("*.new"))
