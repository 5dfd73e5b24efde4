"""`forceaxis flash`: its output, its calls of openocd, and its refusals.

A program of the same name stands in for openocd: it records its arguments and fails as configured.
Its texts are those of openocd 0.12.
"""

import json
import os
import pty
import re
import shlex
import struct
import subprocess
import sys
from pathlib import Path

import pytest
from forceaxis import objects
from forceaxis.chip import board as boards
from forceaxis.chip import flash

ROOT = Path(__file__).resolve().parents[3]
FORCEAXIS = Path(sys.executable).parent / "forceaxis"
HASH = objects.OBJECTS_HASH[:8]

SOURCE = """
#include <stdint.h>
#include "firmware/port/identity.h"
IDENTITY_DEFINE("%(board)s", "ab12cd34ef56+");
extern uint32_t top_of_stack;
void reset(void);
void reset(void) { for (;;) {} }
typedef struct { const uint32_t *stack; void (*reset)(void); } vectors_t;
__attribute__((section(".vectors"), used)) static const vectors_t vectors = {&top_of_stack, reset};
__attribute__((section(".code"), used)) static const uint8_t table[3000] = {1};
__attribute__((section(".more"), used)) static const uint8_t more[4] = {1};
__attribute__((section(".trailer"), used)) static const uint32_t trailer[16] = {%(trailer)s};
"""
# Sectors 1 and 2 lie between the two segments, as in a port's image.
LINK = """
ENTRY(reset)
PHDRS { first PT_LOAD; second PT_LOAD; third PT_LOAD; }
top_of_stack = %(stack)#x;
SECTIONS {
  .vectors %(flash)#x : { KEEP(*(.vectors)) } :first
  .forceaxis_identity : { KEEP(*(%(kept)s)) } :first
  .text %(code)#x : { *(.text*) KEEP(*(.code)) } :second
  .more %(more)#x : { KEEP(*(.more)) } :second
  .trailer 0x0803FFC0 : { KEEP(*(.trailer)) } :third
  /DISCARD/ : { *(.comment) *(.ARM.attributes) *(.forceaxis_identity) }
}
"""
LAYOUT = {
    "board": "nucleo-f446re",
    "flash": 0x08000000,
    "code": 0x0800C000,
    "more": 0x0800D000,
    "stack": 0x20020000,
    "trailer": "0x31544146",
    "kept": ".forceaxis_identity",
}

FAKE = f"""#!{sys.executable}
import json, os, sys
with open(os.environ["FAKE_LOG"], "a") as log:
    log.write(json.dumps(sys.argv[1:]) + "\\n")
fails, words = os.environ.get("FAKE_FAILS", ""), " ".join(sys.argv)
def leave(text, status=1):
    print(text, file=sys.stderr)
    sys.exit(status)
print("Open On-Chip Debugger 0.12.0", file=sys.stderr)
if fails == "probe":
    leave("Info : clock speed 2000 kHz\\nError: open failed")
if fails == "access":
    leave("Error: libusb_open() failed with LIBUSB_ERROR_ACCESS\\nError: open failed")
print("Info : STLINK V2J37M26 (API v2) VID:PID 0483:374B\\nInfo : Target voltage: 3.246950",
      file=sys.stderr)
if fails == "chip":
    leave("Error: init mode failed (unable to connect to the target)")
if "mrw 0x40023c14" in words:
    print({{"brownout": "options 0ffeaaed", "open": "options 0fffaae1", "unread": ""}}
          .get(fails, "options 0ffeaae1"),
          file=sys.stderr)
if "mrw 0xe0042000" in words:
    leave({{"other": "device 10006413", "mute": "nothing"}}.get(fails, "device 10006421"), 0)
print("** Programming Started **", file=sys.stderr)
if fails == "program":
    leave("Error: stm32x device protected\\nError: failed erasing sectors 0 to 0\\n"
          "** Programming Failed **")
print("** Programming Finished **\\n** Verify Started **", file=sys.stderr)
if fails == "verify":
    leave("Error: checksum mismatch\\n** Verify Failed **")
if fails == "strange":
    leave("Error: the moon is full\\nshutdown command invoked", 3)
if fails == "silent":
    leave("shutdown command invoked", 0)
leave("** Verified OK **\\n** Resetting Target **\\nshutdown command invoked", 0)
"""


def run(*command, **options):
    return subprocess.run(
        [str(word) for word in command], capture_output=True, text=True, check=False, **options
    )


def linked(folder, name="image", source=SOURCE, **changes):
    """An ELF file of the layout, with changes."""
    layout = LAYOUT | changes
    code, script, image = (folder / f"{name}{end}" for end in (".c", ".ld", ".elf"))
    code.write_text(source % layout)
    script.write_text(LINK % layout)
    done = run(
        "arm-none-eabi-gcc", "-mcpu=cortex-m4", "-mthumb", "-std=c11", "-ffreestanding",
        "-nostdlib", "-Wall", "-Wextra", "-Wpedantic", "-Werror", f"-I{ROOT}",
        "-Wl,-n", "-T", script, code, "-o", image,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return image


def converted(elf, kind):
    path = elf.with_suffix("." + kind)
    form = {"hex": ["ihex"], "bin": ["binary", "--gap-fill", "0xff"]}[kind]
    done = run("arm-none-eabi-objcopy", "-O", *form, elf, path)
    assert done.returncode == 0, done.stderr
    return path


@pytest.fixture(scope="module")
def elf(tmp_path_factory):
    return linked(tmp_path_factory.mktemp("images"))


class Bench:
    """A PATH with an openocd that records its calls."""

    def __init__(self, folder):
        self.bin, self.log = folder / "bin", folder / "calls"
        self.bin.mkdir()
        fake = self.bin / "openocd"
        fake.write_text(FAKE)
        fake.chmod(0o755)
        self.folder = folder

    def environment(self, fails):
        return os.environ | {
            "PATH": f"{self.bin}:{os.environ['PATH']}",
            "FAKE_LOG": str(self.log),
            "FAKE_FAILS": fails,
        }

    def flash(self, *arguments, fails="", path=None):
        environment = self.environment(fails) | ({"PATH": str(path)} if path else {})
        return run(
            FORCEAXIS, "flash", *arguments,
            cwd=self.folder, env=environment, stdin=subprocess.DEVNULL,
        )  # fmt: skip

    def asked(self, answer, *arguments):
        """(status, what a terminal showed) with the answer typed at it."""
        ours, theirs = pty.openpty()
        os.write(ours, answer)
        done = subprocess.Popen(
            [FORCEAXIS, "flash", *map(str, arguments)],
            cwd=self.folder, env=self.environment(""), stdin=theirs,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        shown = done.communicate(timeout=60)[0]
        os.close(ours)
        os.close(theirs)
        return done.returncode, shown

    def calls(self):
        lines = self.log.read_text().splitlines() if self.log.exists() else []
        return [json.loads(line) for line in lines]


@pytest.fixture
def bench(tmp_path):
    return Bench(tmp_path)


def refused(done, status, text):
    assert done.returncode == status, done.stdout + done.stderr
    lines = done.stderr.splitlines()
    assert len(lines) == 1 and lines[0].startswith("forceaxis: "), done.stderr
    assert re.search(text, lines[0]), lines[0]


BOARD = ["-f", "board/st_nucleo_f4.cfg"]


def step(mask, value, ours):
    """RM0390 3.6.6, 3.8.2, 3.8.6: the keys of OPTKEYR, the bits, OPTSTRT 2, BSY, OPTLOCK 1."""
    return (
        f"if {{([mrw 0x40023c14] & {mask}) != {value}}} {{mww 0x40023c08 0x08192a3b; "
        "mww 0x40023c08 0x4c5d6e7f; "
        f"mww 0x40023c14 [expr {{([mrw 0x40023c14] & ~{ours}) | {value}}}]; "
        "mww 0x40023c14 [expr {[mrw 0x40023c14] | 0x2}]; "
        "while {[mrw 0x40023c0c] & 0x10000} {}; mww 0x40023c14 [expr {[mrw 0x40023c14] | 0x1}]}"
    )


# nWRP0 1, sector 0 may be written; then BOR_LEV 00, nWRP0 0 and SPRMOD 0.
OPEN = step("0x10000", "0x10000", "0x10003")
SET = step("0x8001000c", "0x0", "0x8001000f")
BEFORE = ["-c", "init", "-c", "reset init", "-c", OPEN]
AFTER = [
    *("-c", SET, "-c", "echo [format {options %08x} [mrw 0x40023c14]]"),
    *("-c", "reset run", "-c", "shutdown"),
]
# A newer image in the other slot would run instead of the one that is written.
OTHER_SLOT = ["-c", "flash erase_address 0x08040000 0x20000"]
PROBE = [*BOARD, "-c", "init", "-c", "echo [format {device %08x} [mrw 0xe0042000]]"]


def test_an_image_is_shown_written_and_verified(bench, elf):
    done = bench.flash(elf, "--yes")
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    shown = dict(line.split(None, 1) for line in done.stdout.splitlines())
    assert shown["file"] == str(elf)
    assert shown["sectors"] == "0 (0x08000000), 3 (0x0800c000), 5 (0x08020000), 6 (0x08040000)"
    assert shown["version"] == "0.1.0"
    assert shown["git"] == "ab12cd34ef56+"
    assert shown["objects"] == HASH
    assert shown["board"] == "nucleo-f446re"
    assert shown["parameters"] == "kept"
    assert shown["probe"] == "ST-Link V2J37M26, 3.2 V"
    assert shown["chip"] == "STM32F446, revision 0x1000"
    assert shown["written"].startswith("verified")
    # Vectors 8, identity 60, at 0x0800C000 the loop (2, filled up to 4) and 3000; 4 apart.
    size = int(shown["size"].split()[0])
    loaded = run("arm-none-eabi-readelf", "-lW", elf).stdout
    sizes = [int(m, 16) for m in re.findall(r"LOAD +\S+ \S+ \S+ (\S+)", loaded)]
    assert size == sum(sizes) and size >= 8 + 60 + 3000 + 4
    assert bench.calls() == [
        [*PROBE, "-c", "shutdown"],
        [*BOARD, *BEFORE, *OTHER_SLOT, "-c", f"program {{{elf}}} verify", *AFTER],
    ]
    assert shown["options"].startswith("brown-out reset at level 3")


# A chip that keeps its option register until it is opened as RM0390 3.6.6 says, in openocd's Tcl.
CHIP = """
set options %s; set keys {}; set trail {}
proc mrw {at} { return [expr {$at == 0x40023c14 ? $::options : 0}] }
proc mww {at value} {
  lappend ::trail [format "%%x=%%x" $at $value]
  if {$at == 0x40023c08} { lappend ::keys $value; return }
  if {$::keys eq [list 0x08192a3b 0x4c5d6e7f]} { set ::options $value }
}
"""


def by_openocd(before, what):
    """The register after a step, and whether it was written."""
    done = run(
        "openocd", "-c", CHIP % before, "-c", what,
        "-c", "echo [format {options %08x} $options]; echo $trail; shutdown",
    )  # fmt: skip
    text = done.stdout + done.stderr
    written = re.search(r"^options ([0-9a-f]{8})", text, re.M)
    return int(written.group(1), 16), "40023c14=" in text.split("options", 1)[1]


@pytest.mark.parametrize("before", ["0x0fffaaed", "0x0ffeaae9", "0x8fffaae1", "0x0ffeaae1"])
def test_the_option_bytes_are_set_by_openocd_s_own_tcl(before):
    """All other bits stay; where they are right nothing is written."""
    held = int(before, 16) | 1
    found, is_written = by_openocd(before, SET)
    assert found & ~2 == held & ~0x8001000C
    assert is_written == bool(held & 0x8001000C)


@pytest.mark.parametrize("before", ["0x0fffaaed", "0x0ffeaae1"])
def test_the_loader_may_be_written_before_the_image_is(before):
    held = int(before, 16)
    found, is_written = by_openocd(before, OPEN)
    assert found & ~2 == held | 0x10001
    assert is_written == (not held & 0x10000)


# RM0440 3.3.5, 3.4.2, 3.7: a flash that opens by KEYR, then its options by OPTKEYR; OPTSTRT writes
# OPTR, which is in force after OBL_LAUNCH, with a reset of the chip.
CHIP_G4 = """
set options %s; set pages %s; set held $options; set kept $pages; set keys {}; set trail {}
proc mrw {at} {
  if {$at == 0x40022020} { return $::options }
  if {$at == 0x4002202c} { return $::pages }
  return [expr {$at == 0x40022014 ? 0xc0000000 : 0}]
}
proc mww {at value} {
  lappend ::trail [format "%%x=%%x" $at $value]
  if {$at == 0x40022008 || $at == 0x4002200c} { lappend ::keys $value; return }
  if {$::keys ne [list 0x45670123 0xcdef89ab 0x08192a3b 0x4c5d6e7f]} { error locked }
  if {$at == 0x40022020} { set ::options $value }
  if {$at == 0x4002202c} { set ::pages $value }
  if {$at == 0x40022014 && $value & 0x20000} { set ::held $::options; set ::kept $::pages }
  if {$at == 0x40022014 && $value & 0x8000000} {
    set ::options $::held; set ::pages $::kept; error reset
  }
}
proc reset {how} { lappend ::trail reset; set ::keys {} }
proc sleep {ms} {}
"""


@pytest.mark.parametrize("pages", [0xFF00FFFF, 0xFF7FFF80, 0xFF03FF82])
@pytest.mark.parametrize("before", [0xFFEFF8AA, 0xFBEFF8AA, 0xFBEFFCAA, 0xFFFFFCAA, 0xFB8FFCAA])
def test_the_option_bytes_of_the_stm32g474_are_written_and_loaded(before, pages):
    """Brown-out reset at level 4, two banks, started from bank 1 by nBOOT0, RAM without parity,
    pages 0 to 127 of bank 1 protected; all other bits stay. RM0440 3.7.9: first page in bits 6:0 of
    FLASH_WRP1AR, last page in bits 22:16; none is protected if the first is above the last."""
    options = boards.read(ROOT / "firmware/port/stm32g4").probe.options
    steps = [
        *("-c", flash.options_step(options, [options.writing])),
        *("-c", "echo [format {open %08x} [mrw 0x4002202c]]; echo $trail; set trail {}"),
        *("-c", flash.options_step(options, options.settings)),
        *("-c", flash.read_back_step(options), "-c", "echo $trail; shutdown"),
    ]
    done = run("openocd", "-c", CHIP_G4 % (hex(before), hex(pages)), *steps)
    text = done.stdout + done.stderr
    opened = int(re.search(r"^open ([0-9a-f]{8})", text, re.M).group(1), 16)
    assert opened & 0x7F > opened >> 16 & 0x7F and opened & ~0x7F007F == pages & ~0x7F007F, text
    mask = 7 << 8 | 1 << 20 | 1 << 22 | 1 << 24 | 1 << 26 | 1 << 27
    wanted = before & ~mask | 4 << 8 | 1 << 22 | 1 << 24 | 1 << 27
    written = re.search(r"^options ([0-9a-f]{8}) ([0-9a-f]{8})", text, re.M)
    assert int(written.group(1), 16) == wanted, text
    assert int(written.group(2), 16) == pages & ~0x7F007F | 0x7F0000, text
    assert "reset" in text.split("options ", 1)[1], text
    assert ("reset" in text.split("open ", 1)[1].split("options")[0]) == (opened != pages)


def test_hex_and_json(bench, elf):
    path = converted(elf, "hex")
    done = bench.flash(path, "--yes", "--json")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["sectors"] == [0, 3, 5, 6] and report["table_hash"] == HASH
    assert report["warning"] is None
    assert report["command"] == ["openocd", *bench.calls()[-1]]
    program = ["-c", f"program {{{path}}} verify"]
    assert bench.calls()[-1] == [*BOARD, *BEFORE, *OTHER_SLOT, *program, *AFTER]


def test_bin_covers_the_parameters(bench, elf):
    path = converted(elf, "bin")
    refused(bench.flash(path, "--yes"), 2, "--erase-parameters: expected.*a .hex or .elf may")
    assert bench.calls() == []
    done = bench.flash(path, "--yes", "--erase-parameters")
    assert done.returncode == 0, done.stderr
    assert "parameters   erased" in done.stdout
    assert "1 (parameters, 0x08004000), 2 (parameters, 0x08008000), 3 (0x0800c000)" in done.stdout
    assert bench.calls()[-1] == [
        *BOARD, *BEFORE, "-c", "flash erase_address 0x08004000 0x8000", *OTHER_SLOT,
        "-c", f"program {{{path}}} verify 0x08000000", *AFTER,
    ]  # fmt: skip


def test_a_short_bin_is_no_image_that_the_loader_starts(bench, tmp_path):
    path = converted(linked(tmp_path, code=0x08000400, more=0x08001400), "bin")
    path.write_bytes(path.read_bytes()[:0x2000])
    refused(bench.flash(path, "--yes", "--address", "0x08000000"), 2, "at the address 0x0803ffc0")
    refused(
        bench.flash(path, "--yes", "--address", "0x0800c000"),
        2,
        "vector table.*without bytes at this address",
    )
    refused(
        bench.flash(path, "--yes", "--address", "0x20000000"), 2, "expected only addresses .*0x0800"
    )
    refused(bench.flash(path, "--yes", "--address", "here"), 2, "address of 32 bits")


def test_erasing_parameters_that_the_image_leaves_out(bench, elf):
    done = bench.flash(elf, "--dry-run", "--erase-parameters", "--json")
    assert json.loads(done.stdout)["sectors"] == [0, 1, 2, 3, 5, 6]


def test_dry_run_prints_the_command_quoted(bench, elf, tmp_path):
    path = tmp_path / "with a space $HOME.elf"
    path.write_bytes(elf.read_bytes())
    done = bench.flash(path.name, "--dry-run", "--serial", "066EFF")
    assert done.returncode == 0, done.stderr
    last = done.stdout.splitlines()[-1]
    assert bench.calls() == []
    words = [
        "openocd", *BOARD, "-c", "adapter serial 066EFF", *BEFORE, *OTHER_SLOT,
        "-c", f"program {{{path.name}}} verify", *AFTER,
    ]  # fmt: skip
    assert shlex.split(last) == words
    # A shell passes the same words.
    run("sh", "-c", last, env=bench.environment(""))
    assert bench.calls() == [words[1:]]


def test_it_asks(bench, elf):
    status, shown = bench.asked(b"n\n", elf)
    assert status == 1 and "Write it?" in shown and "nothing was written" in shown
    assert bench.calls() == [[*PROBE, "-c", "shutdown"]]
    status, shown = bench.asked(b"y\n", elf)
    assert status == 0 and "verified" in shown
    assert len(bench.calls()) == 3


def test_without_a_terminal_it_does_not_ask(bench, elf):
    refused(bench.flash(elf), 2, "expected the option --yes")
    refused(bench.flash(elf, "--json"), 2, "expected the option --yes")
    assert bench.calls() == []


def test_another_object_table_is_told(bench, elf, tmp_path):
    path = tmp_path / "old.elf"
    data = elf.read_bytes()
    at = data.index(b"FAXI") + 40
    assert data[at : at + 4] == struct.pack("<I", int(HASH, 16))
    path.write_bytes(data[:at] + struct.pack("<I", 0x00C0FFEE) + data[at + 4 :])
    done = bench.flash(path, "--yes")
    assert done.returncode == 0
    assert len(done.stderr.splitlines()) == 1
    assert re.search(f"warning: .*old.elf: its object table 00c0ffee is not.*{HASH}", done.stderr)


@pytest.mark.parametrize(
    ("fails", "text", "calls"),
    [
        ("probe", "expected an ST-Link on USB, there is none", 1),
        ("access", "expected to be allowed to use the ST-Link", 1),
        ("chip", "the chip does not answer", 1),
        ("other", r"expected the chip STM32F446 \(identifier 0x421\).*0x413", 1),
        ("mute", "expected the identifier of the chip; last output: nothing", 1),
        ("program", "the chip could not be written", 2),
        ("verify", "the chip does not hold what was written", 2),
        ("strange", "expected exit status 0, got 3; last output: Error: the moon is full", 2),
        ("silent", "expected `Verified OK`; last output: shutdown", 2),
        ("brownout", "expected brown-out reset at level 3.*got 0ffeaaed.*stays disabled", 2),
        ("open", "loader write-protected, got 0fffaae1.*stays disabled", 2),
        ("unread", "expected brown-out reset at level 3.*got nothing", 2),
    ],
)
def test_failures_are_one_line(bench, elf, fails, text, calls):
    done = bench.flash(elf, "--yes", fails=fails)
    refused(done, 1, text)
    assert "written" not in done.stdout
    assert len(bench.calls()) == calls


def test_openocd_is_missing(bench, elf, tmp_path):
    empty = tmp_path / "empty"
    empty.mkdir()
    refused(bench.flash(elf, "--yes", path=empty), 2, "openocd: .*apt install openocd")
    assert bench.flash(elf, "--dry-run", path=empty).returncode == 0


# Files that are no image for this chip.


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        (
            {"flash": 0x08010000},
            "vector table at 0x08000000, got a file without bytes",
        ),
        (
            {"more": 0x08080000, "code": 0x0807F000},
            "expected only addresses of the flash memory, 0x08000000.*0x0807f000..0x0808000",
        ),
        ({"trailer": "0"}, "the trailer of the image at the address 0x0803ffc0"),
        (
            {"more": 0x07FFFC00, "code": 0x07FFF000},
            "expected only addresses.*got bytes for 0x07fff000",
        ),
        (
            {"code": 0x20000000, "more": 0x20001000},
            "expected only addresses.*got bytes for 0x20000000",
        ),
        ({"code": 0x08007FFC, "more": 0x0800C000}, "--erase-parameters: expected"),
        ({"code": 0x08000100, "more": 0x0800BFFC}, "--erase-parameters: expected"),
        ({"stack": 0x20020004}, "with a stack pointer in 0x20000000..0x2001ffff"),
        ({"stack": 0x20000000}, "with a stack pointer in"),
        ({"stack": 0x2001FFFE}, "with a stack pointer in"),
        (
            {"board": "emulated"},
            "expected an image for the board nucleo-f446re, nucleo-g474re, got an image "
            "for the board emulated",
        ),
        (
            {"kept": ".none"},
            "expected one identity block .FAXI. of a forceaxis image, got 0 identity blocks",
        ),
    ],
)
def test_images_that_do_not_fit(bench, tmp_path, changes, text):
    refused(bench.flash(linked(tmp_path, **changes), "--yes"), 2, text)
    assert bench.calls() == []


def test_up_to_the_parameters_and_across_them(bench, tmp_path):
    path = linked(tmp_path, code=0x08000100, more=0x08003FFC)
    assert "sectors      0 (0x08000000), 5 (0x08020000)" in bench.flash(path, "--yes").stdout
    # One segment around a gap: a linker fills it.
    path = linked(tmp_path, code=0x08000100, more=0x0800C000)
    refused(bench.flash(path, "--yes"), 2, "--erase-parameters: expected")


def test_a_start_outside_the_image(bench, tmp_path, elf):
    data = bytearray(elf.read_bytes())
    at = data.index(struct.pack("<I", 0x20020000))
    for reset in (0x0800C000, 0x0800F001):  # not Thumb; nothing there
        data[at + 4 : at + 8] = struct.pack("<I", reset)
        path = tmp_path / "start.elf"
        path.write_bytes(data)
        refused(bench.flash(path, "--yes"), 2, f"a reset address within the image.*{reset:#010x}")


def test_two_identities(bench, tmp_path):
    again = SOURCE.replace('section(".code")', 'section(".code"), aligned(4)').replace(
        "[3000] = {1}", '[3000] = "FAXI\\x3c"'
    )
    refused(bench.flash(linked(tmp_path, source=again), "--yes"), 2, "FAXI.*got 2 identity blocks")
    # The magic alone is none.
    other = again.replace("\\x3c", "\\x01")
    assert bench.flash(linked(tmp_path, source=other), "--yes").returncode == 0


def test_a_longer_identity_is_read(bench, tmp_path, elf):
    """Fields of a later version lie behind the known ones."""
    data = elf.read_bytes()
    at = data.index(b"FAXI") + 4
    path = tmp_path / "later.elf"
    path.write_bytes(data[:at] + struct.pack("<I", 64) + data[at + 4 :])
    assert bench.flash(path, "--yes").returncode == 0
    path.write_bytes(data[:at] + struct.pack("<I", 56) + data[at + 4 :])
    refused(bench.flash(path, "--yes"), 2, "got 0 identity blocks")


def test_other_machines(bench, tmp_path):
    source = tmp_path / "a.c"
    source.write_text("int start(void); int start(void) { return 0; }\n")
    for compiler, text in (
        (["riscv64-unknown-elf-gcc", "-march=rv32imac", "-mabi=ilp32"], "32 bits, machine 243"),
        (["cc"], "64 bits, machine"),
    ):
        image = tmp_path / "other.elf"
        done = run(*compiler, "-nostdlib", "-static", "-Wl,-e,start", source, "-o", image)
        assert done.returncode == 0, done.stderr
        refused(bench.flash(image, "--yes"), 2, text)
    image = tmp_path / "object.elf"
    run("arm-none-eabi-gcc", "-mcpu=cortex-m4", "-mthumb", "-c", source, "-o", image)
    refused(bench.flash(image, "--yes"), 2, "expected a linked image")


@pytest.mark.parametrize(
    ("name", "content", "text"),
    [
        ("none.elf", b"", "expected a(n| complete) ELF file"),
        ("none.hex", b"", "expected an Intel HEX file with an end record"),
        ("none.bin", b"", "without bytes for the flash"),
        ("empty.hex", b":00000001FF\n", "without bytes for the flash"),
        ("text.elf", b"hello", "expected a(n| complete) ELF file"),
        ("text.hex", b"hello", "hex:1: expected a record of Intel HEX"),
        ("text.bin", b"hello", "expected one identity"),
        ("cut.elf", b"\x7fELF\x01\x01", "this file ends too early"),
        ("elf.bin", b"\x7fELF\x01\x01", "got an ELF file"),
        ("sum.hex", b":0100000001FF\n", "hex:1: expected an Intel HEX record with a correct"),
        (
            "kind.hex",
            b":00000007F9\n",
            "expected an Intel HEX record of type 0 to 5, got a record of type 7",
        ),
        ("cut.hex", b":0100000001FE\n", "file with an end record"),
        (
            "more.hex",
            b":00000001FF\n:00000001FF\n",
            "hex:2: expected the end record as the last record",
        ),
        (
            "twice.hex",
            b":0100000001FE\n:0100000001FE\n:00000001FF\n",
            "got two bytes for the address 0x00000000",
        ),
        ("a.txt", b"hello", "expected a file ending in .elf, .hex or .bin"),
    ],
)
def test_files_that_are_no_image(bench, tmp_path, name, content, text):
    path = tmp_path / name
    path.write_bytes(content)
    refused(bench.flash(path, "--yes"), 2, text)


def test_any_cut_of_an_elf_file_is_refused_or_read(bench, elf):
    """In process, for speed: it raises nothing but InputError, however the file is damaged."""
    from forceaxis import InputError
    from forceaxis.chip import flash, image

    data = elf.read_bytes()
    path = bench.folder / "cut.elf"
    ends = [*range(0, 400, 7), len(data) - 1]
    for changed in [data[:end] for end in ends] + [
        data[:at] + b"\xff" + data[at + 1 :] for at in range(52 + 2 * 32)
    ]:
        path.write_bytes(changed)
        try:
            flash.plan(path)
        except InputError as error:
            assert "\n" not in str(error)
    assert image.load(elf).segments


def test_names_and_options(bench, elf, tmp_path):
    odd = tmp_path / "a{b.elf"
    odd.write_bytes(elf.read_bytes())
    refused(bench.flash(odd, "--yes"), 2, "expected a file name without")
    refused(bench.flash(tmp_path / "no.elf", "--yes"), 2, "does not exist")
    refused(
        bench.flash(elf, "--yes", "--address", "0x08000000"),
        2,
        "--address: expected this option only with a .bin file",
    )
    refused(
        bench.flash(elf, "--yes", "--serial", "a b"),
        2,
        "--serial: expected a serial number of letters",
    )
    assert bench.calls() == []
