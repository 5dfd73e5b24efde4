"""tools/image_report: its stack against one that an emulator measures, and everything it refuses.

The programs are small and their frames are the compiler's; the firmware is linked with a start of
the test's own, so that no port is needed.
"""

import json
import random
import re
import struct
import subprocess
import sys
import tomllib

import pytest
import unicorn
from forceaxis.objects import BY_NAME
from pymodbus.framer import FramerRTU
from test_firmware_targets import CORTEX_M4, LOCAL, ROOT, SOURCES, run
from unicorn import arm_const

REPORT = ROOT / "tools/image_report"
FLAGS = ["-std=c11", "-O2", "-ffreestanding", "-ffunction-sections", "-fstack-usage", f"-I{ROOT}"]

SCRIPT = """
ENTRY(reset)
MEMORY { FLASH (rx) : ORIGIN = 0x08000000, LENGTH = 512K
         RAM (rwx) : ORIGIN = 0x20000000, LENGTH = 128K }
SECTIONS {
  .vectors : { KEEP(*(.vectors)) } > FLASH
  .text : { *(.text*) *(.rodata*) . = ALIGN(4); } > FLASH
  .stack (NOLOAD) : { . += 4K; stack_top = .; } > RAM
  .data : { *(.data*) } > RAM AT > FLASH
  .bss (NOLOAD) : { *(.bss*) *(COMMON) } > RAM
  /DISCARD/ : { *(.ARM*) *(.comment) }
}
"""
HEAD = """
#include <stdint.h>
extern uint32_t stack_top[];
void reset(void);
__attribute__((noinline)) void tick(void);
__attribute__((noinline)) void other(void);
void fault(void);
typedef struct { uint32_t *stack; void (*handlers[4])(void); } vectors_t;
__attribute__((section(".vectors"), used)) static const vectors_t vectors = {
    stack_top, {reset, tick, other, fault}};
static volatile uint8_t recorder_buffer[64];
static volatile uint32_t sink;
"""
# Frames that differ, a call through a pointer, a call at the end of a function, a table of jumps.
PROGRAM = (
    HEAD
    + """
#define APART __attribute__((noinline))
static APART void use(volatile uint8_t *bytes, uint32_t n) { sink += bytes[n]; }
static APART void leaf(uint32_t n) { volatile uint8_t a[40]; a[n & 31] = 1; use(a, n & 31); }
static APART void deep(uint32_t n) { volatile uint8_t a[400]; a[n & 255] = 1; use(a, n & 255); }
static APART void by_pointer(void (*f)(uint32_t), uint32_t n) { f(n); sink++; }
/* Cloned without its first argument, which nobody uses, under a name of its own. */
static APART uint32_t clone(uint32_t unused, uint32_t n) { leaf(n); return n + sink; }
static APART void at_the_end(uint32_t n) { sink = n; leaf(n); }
void reset(void) {
  for (uint32_t n = 0;; n++) {
    switch (n & 7) {
      case 0: leaf(n); break;
      case 1: by_pointer(n & 16 ? deep : leaf, n); break;
      case 2: sink *= 3; break;
      case 3: at_the_end(n); break;
      case 4: sink ^= clone(n, n); break;
      default: sink = 0;
    }
    recorder_buffer[n & 63] = 1;
  }
}
void tick(void) { leaf(1); sink++; }
void other(void) { sink = 2; }
void fault(void) { for (;;) {} }
"""
)
DECLARED = {
    "thread": '"reset"',
    "levels": '[["tick", "other"], ["fault"]]',
    "section": '".stack"',
    "flash_bytes": 98304,
    "ram_bytes": 24576,
    "recorder_bytes": 12288,
    "recorder": '"recorder_buffer"',
    "indirect": '"program.c" = ["leaf", "deep"]',
}
BOARD = """
name = "board"
image = "image"
[build]
tools = "arm-none-eabi-"
package = "gcc-arm-none-eabi"
flags = []
script = "image.ld"
sources = []
[released]
identity = "board"
sources = []
[memory]
flash = [0x08000000, 0x80000]
sectors = [0x80000]
parameters = [0x08000000, 0]
ram = [0x20000000, 0x20000]
[limits]
interrupt_instructions = 0
adc_to_dac_instructions = 0
flash_bytes = {flash_bytes}
ram_bytes = {ram_bytes}
recorder_bytes = {recorder_bytes}
[stack]
thread = {thread}
levels = {levels}
section = {section}
recorder = {recorder}
[stack.indirect]
{indirect}
"""


def described(folder, **changes):
    """The folder, with the description of a board in it."""
    (folder / "board.toml").write_text(BOARD.format(**DECLARED | changes))
    return folder


def build(folder, sources, options=()):
    """An ELF of the sources, its frames in objects/."""
    (folder / "image.ld").write_text(SCRIPT)
    frames = folder / "objects/board"
    frames.mkdir(parents=True, exist_ok=True)
    objects = []
    for source in sources:
        objects.append(frames / f"{source.parent.name}_{source.stem}.o")
        run(*CORTEX_M4.compiler, *FLAGS, "-c", source, "-o", objects[-1])
    image = folder / "image.elf"
    run(
        *CORTEX_M4.compiler, "-nostdlib", "-static", "-Wl,--gc-sections,--no-warn-rwx-segments",
        *options, "-T", folder / "image.ld", *objects, "-o", image,
    )  # fmt: skip
    return image


def built(folder, program=PROGRAM):
    source = folder / "program.c"
    source.write_text(program)
    return build(folder, [source])


def report(*arguments):
    return subprocess.run(
        [sys.executable, REPORT, *map(str, arguments)], capture_output=True, text=True, check=False
    )


def reported(folder, image, **changes):
    done = report("--board", described(folder, **changes), image)
    assert done.returncode == 0, done.stderr
    return done.stdout


def cell(text, name, column=1):
    """A number of the row that begins with a name."""
    (line,) = [line for line in text.splitlines() if line.startswith(f"| {name}")]
    return int(line.split("|")[1 + column])


class Chip:
    """Runs an image and keeps the lowest byte of the stack that was written; if exact, the lowest
    stack pointer."""

    TOP = 0x20001000

    def __init__(self, image, exact=False):
        self.symbols = {}
        for line in run("arm-none-eabi-nm", image).splitlines():
            words = line.split()
            self.symbols[words[-1]] = int(words[0], 16)
        binary = image.with_suffix(".bin")
        run("arm-none-eabi-objcopy", "-O", "binary", "-R", ".data", image, binary)
        self.uc = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
        self.uc.ctl_set_cpu_model(arm_const.UC_CPU_ARM_CORTEX_M4)
        self.uc.mem_map(0x08000000, 0x80000)
        self.uc.mem_write(0x08000000, binary.read_bytes())
        self.uc.mem_map(0x20000000, 0x20000)
        self.uc.mem_map(0x0F000000, 0x1000)
        self.low = self.TOP
        if exact:
            self.uc.hook_add(unicorn.UC_HOOK_CODE, self.on_instruction)
        else:
            self.uc.hook_add(unicorn.UC_HOOK_MEM_WRITE, self.on_write, None, 0x20000000, self.TOP)

    def on_instruction(self, uc, _address, _size, _data):
        self.low = min(self.low, uc.reg_read(arm_const.UC_ARM_REG_SP))

    def on_write(self, _uc, _access, address, _size, _value, _data):
        self.low = min(self.low, address)

    def call(self, name, *arguments, instructions=0):
        """The result of a function; with a number of instructions, as far as those lead."""
        for n, value in enumerate(arguments):
            self.uc.reg_write(arm_const.UC_ARM_REG_R0 + n, value & 0xFFFFFFFF)
        self.uc.reg_write(arm_const.UC_ARM_REG_SP, self.TOP)
        self.uc.reg_write(arm_const.UC_ARM_REG_LR, 0x0F000001)
        self.uc.emu_start(self.symbols[name] | 1, 0x0F000000, count=instructions)
        return self.uc.reg_read(arm_const.UC_ARM_REG_R0)


def test_the_stack_is_what_an_emulator_measures(tmp_path):
    image = built(tmp_path)
    text = reported(tmp_path, image)
    thread, tick = Chip(image, exact=True), Chip(image, exact=True)
    thread.call("reset", instructions=20_000)
    tick.call("tick")
    assert cell(text, "thread", 2) == Chip.TOP - thread.low > 400
    assert cell(text, "interrupt, level 1", 2) == Chip.TOP - tick.low > 40
    assert "`reset` > `by_pointer` > `deep` > `use`" in text
    assert "`tick` > `leaf` > `use`" in text
    rows = [cell(text, name, 2) for name in ("thread", "interrupt, level 1", "interrupt, level 2")]
    assert cell(text, "**stack needed**") == sum(rows) + 2 * 36


def test_the_sizes_are_those_of_binutils(tmp_path):
    image = built(tmp_path)
    text = reported(tmp_path, image)
    code, data, bss = map(int, run("arm-none-eabi-size", image).splitlines()[1].split()[:3])
    assert cell(text, "flash: code and constants") == code
    assert cell(text, "**flash**") == code + data
    assert cell(text, "RAM: data") == data
    assert cell(text, "RAM: recorder") == 64
    assert cell(text, "RAM: stack reserved") == 4096
    assert cell(text, "RAM: bss without recorder") == bss - 64 - 4096
    assert cell(text, "**RAM**") == data + bss


def test_the_table_is_compared_exactly(tmp_path):
    image, board, table = built(tmp_path), described(tmp_path), tmp_path / "docs/size.md"
    assert report("--board", board, "--out", table, image).returncode == 0
    assert report("--board", board, "--check", table, image).returncode == 0
    table.write_text(table.read_text().replace("4096", "4097", 1))
    done = report("--board", board, "--check", table, image)
    assert done.returncode == 1 and "expected the table above" in done.stderr
    table.unlink()
    assert report("--board", board, "--check", table, image).returncode == 1


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"flash_bytes": 200}, r"expected at most 200 bytes of flash, it takes \d+"),
        ({"ram_bytes": 4100}, r"expected at most 4100 bytes of RAM, it takes \d+"),
        ({"recorder_bytes": 63}, r"expected at most 63 bytes of RAM for the recorder, it takes 64"),
    ],
)
def test_a_broken_budget_fails(tmp_path, changes, text):
    done = report("--board", described(tmp_path, **changes), built(tmp_path))
    assert done.returncode == 1
    assert re.search(text, done.stderr), done.stderr


def test_a_budget_holds_up_to_its_last_byte(tmp_path):
    image = built(tmp_path)
    text = reported(tmp_path, image)
    exact = {
        "flash_bytes": cell(text, "**flash**"),
        "ram_bytes": cell(text, "**RAM**"),
    }
    reported(tmp_path, image, **exact)
    for key in exact:
        done = report("--board", described(tmp_path, **exact | {key: exact[key] - 1}), image)
        assert done.returncode == 1 and len(done.stderr.splitlines()) == 1


def test_a_stack_that_is_too_small_fails(tmp_path):
    done = report("--board", described(tmp_path), built(tmp_path, PROGRAM.replace("400]", "4000]")))
    assert done.returncode == 1
    assert re.search(r"at most 4096 bytes of stack, it takes 4\d\d\d", done.stderr)


def changed(old, new):
    assert old in PROGRAM
    return PROGRAM.replace(old, new)


@pytest.mark.parametrize(
    ("program", "changes", "text"),
    [
        (
            PROGRAM,
            {"indirect": ""},
            r"by_pointer .*program.c.* expected its file under .stack.indirect",
        ),
        (PROGRAM, {"indirect": '"program.c" = ["leaf"]'}, "who calls deep under"),
        (PROGRAM, {"indirect": '"program.c" = ["leaf", "gone"]'}, "may call gone; expected it in"),
        (
            PROGRAM,
            {"indirect": DECLARED["indirect"] + '\n"gone.c" = ["leaf"]'},
            "gone.c: expected a file that calls so",
        ),
        # by_pointer may reach what reaches it: recursion through a pointer.
        (
            PROGRAM,
            {"indirect": '"program.c" = ["leaf", "deep", "by_pointer"]'},
            "expected no recursion: by_pointer > by_pointer",
        ),
        (
            changed("leaf(1); sink++;", "leaf(1); sink++; if (sink & 1) { other(); }").replace(
                "sink = 2;", "tick(); sink = 2;"
            ),
            {},
            "expected no recursion: tick > other > tick",
        ),
        (PROGRAM, {"levels": '[["tick"], ["fault"]]'}, "functions of .vectors; in one only: other"),
        (PROGRAM, {"levels": '[["tick", "other", "leaf"], ["fault"]]'}, "in one only: leaf"),
        (PROGRAM, {"thread": '"tick"'}, "in one only: reset"),
        (PROGRAM, {"section": '".heap"'}, "expected a section .heap"),
        (PROGRAM, {"recorder": '"tape"'}, "expected one symbol tape, there are 0"),
        (PROGRAM, {"thread": ""}, "board.toml: expected TOML"),
        (
            changed("volatile uint8_t a[400]; a[n & 255]", "volatile uint8_t a[n + 8]; a[n]"),
            {},
            "deep: expected a fixed frame",
        ),
    ],
)
def test_what_cannot_be_known_is_refused(tmp_path, program, changes, text):
    done = report("--board", described(tmp_path, **changes), built(tmp_path, program))
    assert done.returncode == 2, done.stdout
    assert len(done.stderr.splitlines()) == 1
    assert re.search(text, done.stderr), done.stderr


def test_frames_of_another_compilation_are_refused(tmp_path):
    image, board = built(tmp_path), described(tmp_path)
    (frames,) = (tmp_path / "objects/board").glob("*.su")
    text = frames.read_text()
    frames.write_text(re.sub(r"(:deep\t)\d+", r"\g<1>8", text))
    done = report("--board", board, image)
    assert done.returncode == 2 and "deep: expected a frame of 8 bytes" in done.stderr
    frames.write_text("".join(line for line in text.splitlines(True) if ":deep\t" not in line))
    done = report("--board", board, image)
    assert done.returncode == 2 and "deep: expected its frame in the *.su" in done.stderr
    frames.unlink()
    done = report("--board", board, image)
    assert done.returncode == 2 and "expected *.su of gcc" in done.stderr


def test_files_that_are_missing(tmp_path):
    board = described(tmp_path)
    done = report("--board", board, tmp_path / "no.elf")
    assert done.returncode == 2 and "expected an image, there is none" in done.stderr
    done = report("--board", tmp_path / "none", tmp_path / "no.elf")
    assert done.returncode == 2 and "expected a file with the description of a board" in done.stderr


# The firmware, with a start of the test's own.

START = (
    HEAD.replace("[64]", "[FW_RECORDER_BYTES]").replace(
        "#include <stdint.h>", '#include "firmware/app/fw.h"'
    )
    + """
void *memcpy(void *to, const void *from, __SIZE_TYPE__ count);
void *memset(void *to, int value, __SIZE_TYPE__ count);
fw_t firmware;
can_frame_t frame;
uint8_t bytes[256];
axis_inputs_t inputs;
axis_outputs_t outputs;
static uint8_t flash[2][4096];
static void flash_read(void *context, uint32_t address, uint8_t *to, uint32_t count) {
  (void)context;
  for (uint32_t i = 0; i < count; i++) { to[i] = flash[0][address + i]; }
}
static bool flash_program(void *context, uint32_t at, const uint8_t *from, uint32_t count) {
  (void)context;
  for (uint32_t i = 0; i < count; i++) { flash[0][at + i] = from[i]; }
  return true;
}
static bool flash_erase(void *context, uint8_t sector) {
  (void)context;
  for (uint32_t i = 0; i < sizeof(flash[0]); i++) { flash[sector][i] = 0xFF; }
  return true;
}
static const store_memory_t memory = {0, sizeof(flash[0]), flash_read, flash_program, flash_erase};
static const fw_config_t config = {
  .recorder_buffer = (void *)recorder_buffer, .recorder_bytes = sizeof(recorder_buffer),
  .memory = &memory, .node_id = 5, .buses = 1};
__attribute__((noinline)) void begin(void);
void begin(void) { fw_init(&firmware, &config); }
void reset(void) {
  begin();
  for (;;) {
    fw_modbus_receive(&firmware, bytes, sizeof(bytes));
    fw_modbus_transmit(&firmware, bytes, sizeof(bytes));
    (void)fw_object_write(&firmware, FW_SOURCE_LOCAL, 1, 0);
    int32_t value;
    (void)fw_object_read(&firmware, 1, &value);
  }
}
void tick(void) {
  fw_can_receive(&firmware, &frame);
  fw_can_bus(&firmware, 0);
  fw_can_lost(&firmware, 1);
  fw_overrun(&firmware, 0);
  fw_tick(&firmware, &inputs, &outputs);
  (void)fw_can_transmit(&firmware, &frame);
}
void other(void) { sink = 1; }
void fault(void) { for (;;) {} }
"""
)


def crc(frame):
    """The frame and its CRC."""
    return frame + FramerRTU.compute_CRC(frame).to_bytes(2, "big")


@pytest.mark.long
def test_the_firmware_needs_no_more_stack_than_reported(tmp_path):
    """Random objects over CANopen and Modbus, every mode of the drive: the lowest stack pointer of
    thread and tick stays above what the report says."""
    (tmp_path / "start.c").write_text(START)
    image = build(tmp_path, [*SOURCES, tmp_path / "start.c"])
    # With flash in RAM and without slots; the rest is as on the chip.
    indirect = tomllib.loads((ROOT / "firmware/port/stm32f4/board.toml").read_text())["stack"][
        "indirect"
    ] | {
        "firmware/app/update.c": [],
        "firmware/storage/archive.c": ["flash_read", "flash_program", "flash_erase"],
        "firmware/storage/entries.c": ["flash_read"],
        "firmware/storage/record.c": ["flash_read"],
        "firmware/storage/store.c": ["flash_read", "flash_program", "flash_erase"],
    }
    del indirect["firmware/port/stm32f4/flash.c"]
    lines = "\n".join(f'"{file}" = {json.dumps(names)}' for file, names in indirect.items())
    sizes = {"flash_bytes": 131072, "ram_bytes": 65536, "recorder_bytes": 32768}
    text = reported(tmp_path, image, indirect=lines, **sizes)
    deepest = {"thread": 0, "interrupt, level 1": 0}
    rng = random.Random(3)
    chip = Chip(image)

    def measured(row, name, *arguments):
        chip.low = chip.TOP
        result = chip.call(name, *arguments)
        deepest[row] = max(deepest[row], chip.TOP - chip.low)
        return result

    def at(name):
        return chip.symbols[name]

    measured("thread", "begin")
    registers = [o.modbus for o in BY_NAME.values() if o.modbus >= 0]
    for _ in range(3000):
        o = rng.choice(list(BY_NAME.values()))
        kind = rng.randint(0, 3)
        data = bytes(8)
        if kind == 0:  # SDO, download or upload
            head = rng.choice([0x22, 0x23, 0x27, 0x2B, 0x2F, 0x40])
            data = struct.pack(
                "<BHBi", head, o.index, o.sub, rng.randint(-(1 << 31), (1 << 31) - 1)
            )
            frame = struct.pack("<HBB", 0x605, 8, 0) + data
        elif kind == 1:
            frame = struct.pack("<HBB", 0, 2, 0) + bytes([rng.choice([1, 2, 128]), 5]) + bytes(6)
        else:
            frame = struct.pack("<HBB", rng.choice([0x80, 0x205, 0x305, 0x405]), 8, 0)
            frame += bytes(rng.randint(0, 255) for _ in range(8))
        chip.uc.mem_write(at("frame"), frame)
        if kind == 3:
            address = rng.choice(registers)
            request = rng.choice(
                [
                    struct.pack(">BBHHH", 5, 0x16, address, rng.randint(0, 65535), 0xFF),
                    struct.pack(">BBHHBHH", 5, 0x10, address, 2, 4, 0, rng.randint(0, 65535)),
                    struct.pack(">BBHH", 5, rng.randint(1, 4), address, 2),
                ]
            )
            request = crc(request)
            chip.uc.mem_write(at("bytes"), request)
            row = "thread"
            measured(row, "fw_modbus_receive", at("firmware"), at("bytes"), len(request))
            measured(row, "fw_modbus_transmit", at("firmware"), at("bytes"), 256)
        if rng.random() < 0.2:
            number = BY_NAME["controlword"].number
            word = rng.choice([0x06, 0x07, 0x0F, 0x1F])
            measured("thread", "fw_object_write", at("firmware"), LOCAL, number, word)
        for _ in range(rng.choice([1, 1, 8])):
            measured("interrupt, level 1", "tick")
    for name, count in deepest.items():
        limit = cell(text, name, 2)
        print(f"\n{name}: {count} bytes in 3000 rounds, at most {limit} by the report", end="")
        assert limit // 3 <= count <= limit
    print()
