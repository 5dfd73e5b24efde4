"""An emulated Cortex-M4 that counts the instructions of every call, by function, at the speed of C.

Every instruction of a block that is entered counts, also one that its condition skips.
"""

import atexit
import ctypes
import functools
import importlib.machinery
import importlib.util
import re
import shutil
import struct
import tempfile
from pathlib import Path

import cross
import unicorn
from cross import run
from forceaxis.chip import board
from unicorn import arm_const
from unicorn.unicorn_py3 import unicorn as binding

ROOT = Path(__file__).resolve().parents[3]
FOLDERS = (
    "fx",
    "objects",
    "core",
    "cycle",
    "guard",
    "drive",
    "canopen",
    "modbus",
    "storage",
    "app",
)
BOARD = board.read(ROOT / "firmware/port/stm32f4")
# As tools/image builds what is flashed.
LOADER = importlib.machinery.SourceFileLoader("image", str(ROOT / "tools/image"))
IMAGE = importlib.util.module_from_spec(importlib.util.spec_from_loader("image", LOADER))
LOADER.exec_module(IMAGE)
COMPILER = [BOARD.build.tools + "gcc", *BOARD.build.flags]
FLAGS = ["-std=c11", "-ffreestanding", "-ffp-contract=off", "-ffunction-sections"]
CODE, RAM, STACK_TOP, EXIT = 0x08000000, 0x20000000, 0x20010000, 0x0F000000
FW, RECORDER = RAM, RAM + 0x8000
CONFIG, INPUTS, OUTPUTS, FRAME, BYTES, BLACKBOX = (RAM + 0x4000 + 0x200 * i for i in range(6))
RECORDER_BYTES = 12288
CURVE, CURVE_BYTES = RAM + 0x5000, 12000
RESULTS, RESULT_BYTES = RAM + 0xD000, 32 * 192  # 32 of cycle_part_t
PROGRAMS = RAM + 0xB000, RAM + 0xC000  # room for two programs of a cycle
OUTPUT_BYTES = 8  # of axis_outputs_t: dac_code, amp_enable, brake_release, dac_fine, digital
LOCAL = 3  # FW_SOURCE_LOCAL
NODE = 5


class Inputs(ctypes.Structure):
    _fields_ = [
        ("encoder_cnt", ctypes.c_int32),
        ("adc_code", ctypes.c_uint16 * 2),
        ("din", ctypes.c_uint8),
        ("sensor_valid", ctypes.c_uint8),
        ("drive", ctypes.c_uint8),
        ("position_age", ctypes.c_uint8),
        ("force_age", ctypes.c_uint8),
    ]


def sources():
    return [s for f in FOLDERS for s in sorted((ROOT / "firmware" / f).rglob("*.c"))]


@functools.cache
def _folder():
    """The folder of what is built once for all tests of this process."""
    folder = Path(tempfile.mkdtemp(prefix="forceaxis."))
    atexit.register(shutil.rmtree, folder)
    return folder


@functools.cache
def build_image():
    """The firmware for the chip, linked without a library."""
    folder = _folder()
    script = folder / "image.ld"
    script.write_text(
        f"SECTIONS {{ . = {CODE:#x}; .text : {{ *(.text*) *(.rodata*) }} . = {RAM:#x};"
        " .data : { *(.data*) } .bss : { *(.bss*) *(COMMON) } }\n"
    )
    files, by_option, made = [*sources(), ROOT / "firmware/port/memory.c"], {}, {}
    for source in files:
        by_option.setdefault(IMAGE.optimisation(source), []).append(source)
    for option, some in by_option.items():
        command = [*COMPILER, option, *FLAGS, f"-I{ROOT}"]
        made |= zip(some, cross.objects(command, some), strict=True)
    objects = [made[source] for source in files]
    image = folder / "image.elf"
    options = ["-nostdlib", "-nostartfiles", "-static", "-Wl,--no-undefined", "-Wl,--no-warn-rwx"]
    run(*COMPILER, *options, f"-Wl,-T,{script},-e,0", *objects, "-o", image)
    return image


@functools.cache
def build_counter():
    library, source = _folder() / "block_counter.so", Path(__file__).with_name("block_counter.c")
    run("cc", "-O2", "-shared", "-fPIC", source, "-o", library)
    return ctypes.CDLL(str(library))


class Code:
    """The image's functions, their instructions and calls."""

    def __init__(self, image):
        self.symbols, self.instructions, self.calls = {}, {}, {}
        name, owner, pending = None, {}, []
        for line in run("arm-none-eabi-objdump", "-d", "--no-show-raw-insn", image).splitlines():
            head = re.match(r"([0-9a-f]{8}) <(.+)>:$", line)
            if head:
                name = head[2]
                self.symbols[name] = int(head[1], 16)
                self.instructions[name], self.calls[name] = [], set()
                continue
            words = line.split("\t")
            # Constants that follow the code, and padding, are no instructions.
            if name is None or len(words) < 2 or words[1].strip() in (".word", ".short", "nop"):
                continue
            if words[1].startswith("."):
                continue
            address = int(words[0].strip().rstrip(":"), 16)
            self.instructions[name].append(address)
            owner[address] = name
            called = re.search(r"<([^>+]+)>", line)
            if called and words[1].strip().startswith("b"):
                pending.append((name, called[1]))
        for caller, called in pending:
            if called in self.instructions:
                self.calls[caller].add(called)
        self.names = [n for n in self.instructions if self.instructions[n]]
        self.owner = owner

    def reachable(self, *roots):
        """Functions reachable from these; calls through pointers are not followed."""
        found, left = set(), list(roots)
        while left:
            name = left.pop()
            if name not in found:
                found.add(name)
                left += self.calls[name]
        return found


class Counter(ctypes.Structure):
    _fields_ = [
        ("base", ctypes.c_uint64),
        ("before", ctypes.c_void_p),
        ("owner", ctypes.c_void_p),
        ("longest", ctypes.c_void_p),
        ("shares", ctypes.c_void_p),
        ("total", ctypes.c_uint64),
    ]


class Chip:
    """The firmware in the emulator; count() and shares() refer to the last call."""

    def __init__(self):
        image, library = build_image(), build_counter()
        self.code = Code(image)
        binary = image.with_suffix(".bin")
        run("arm-none-eabi-objcopy", "-O", "binary", "-j", ".text", image, binary)
        text = binary.read_bytes()
        self.halfwords = len(text) // 2 + 1
        self.uc = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
        self.uc.ctl_set_cpu_model(arm_const.UC_CPU_ARM_CORTEX_M4)
        self.uc.mem_map(CODE, 0x20000)
        self.uc.mem_write(CODE, text)
        self.uc.mem_map(RAM, 0x10000)
        self.uc.mem_map(EXIT, 0x1000)
        self._count_blocks(library)
        self.outputs = bytes(OUTPUT_BYTES)
        self.places, self.programs = {}, list(PROGRAMS)
        self.compiler = run(COMPILER[0], "--version").splitlines()[0]
        buses = struct.pack(
            "<IIIIIIIIBB22xIIII", RECORDER, RECORDER_BYTES, BLACKBOX, 0, 0, 0, 0, 0, NODE, 1,
            RESULTS, RESULT_BYTES, CURVE, CURVE_BYTES,
        )  # fmt: skip
        self.uc.mem_write(CONFIG, buses)
        self.call("fw_init", FW, CONFIG)

    def _count_blocks(self, library):
        code, n = self.code, self.halfwords + 1
        self.before = (ctypes.c_uint32 * n)()
        self.owner = (ctypes.c_uint16 * n)()
        self.longest = (ctypes.c_uint16 * n)()
        self.shares_of = (ctypes.c_uint32 * (len(code.names) + 1))()
        number = {name: i + 1 for i, name in enumerate(code.names)}
        passed, owner = 0, 0
        for i in range(n):
            self.before[i] = passed
            at = CODE + 2 * i
            if at in code.owner:
                passed += 1
                owner = number[code.owner[at]]
            self.owner[i] = owner
        address = ctypes.addressof
        self.counter = Counter(
            CODE,
            address(self.before),
            address(self.owner),
            address(self.longest),
            address(self.shares_of),
            0,
        )
        hook = ctypes.c_size_t()
        status = binding.uclib.uc_hook_add(
            self.uc._uch,
            ctypes.byref(hook),
            unicorn.UC_HOOK_BLOCK,
            ctypes.cast(library.count_block, ctypes.c_void_p),
            ctypes.byref(self.counter),
            ctypes.c_uint64(CODE),
            ctypes.c_uint64(CODE + 0x1FFFF),
        )
        assert status == unicorn.UC_ERR_OK

    def call(self, name, *arguments, goes_on=False):
        """The signed result of a function; `goes_on`: added to the counts of the last call."""
        write = self.uc.reg_write
        for i, value in enumerate(arguments):
            write(arm_const.UC_ARM_REG_R0 + i, value & 0xFFFFFFFF)
        write(arm_const.UC_ARM_REG_SP, STACK_TOP)
        write(arm_const.UC_ARM_REG_LR, EXIT | 1)
        if not goes_on:
            ctypes.memset(self.shares_of, 0, ctypes.sizeof(self.shares_of))
            self.counter.total = 0
        self.uc.emu_start(self.code.symbols[name] | 1, EXIT)
        result = self.uc.reg_read(arm_const.UC_ARM_REG_R0)
        return result - (1 << 32) if result >> 31 else result

    @property
    def count(self):
        return self.counter.total

    def shares(self, numbers=None):
        """Instructions of the last call by function, largest first; `numbers`: of some of them."""
        names = self.code.names
        found = [(self.shares_of[i + 1], names[i]) for i in numbers or range(len(names))]
        return sorted(((c, n) for c, n in found if c), reverse=True)

    def executed(self):
        """Addresses of all instructions that were executed so far."""
        found = set()
        for i in range(self.halfwords):
            if self.longest[i]:
                begin = CODE + 2 * i
                found.update(range(begin, begin + self.longest[i], 2))
        return found

    # What a port does.

    def interrupt(self, inputs):
        """A tick, counted as one; `prepare_count` and `control_count` are before the ADC codes are
        read, and from inputs to outputs."""
        self.uc.mem_write(INPUTS, inputs)
        self.call("fw_prepare", FW)
        self.prepare_count = self.count
        self.call("fw_control", FW, INPUTS, OUTPUTS, goes_on=True)
        self.control_count = self.count - self.prepare_count
        self.call("fw_report", FW, goes_on=True)
        self.outputs = bytes(self.uc.mem_read(OUTPUTS, OUTPUT_BYTES))
        return self.outputs

    def between(self):
        self.call("fw_between", FW)

    def write(self, source, number, value):
        return self.call("fw_object_write", FW, source, number, value)

    def byte(self, number):
        """The value of an object of 8 bits."""
        if number not in self.places:
            self.places[number] = FW + self.call("dictionary_place", FW, number)
        return self.uc.mem_read(self.places[number], 1)[0]

    def receive(self, can_id, data):
        frame = struct.pack("<HBB", can_id, len(data), 0) + data.ljust(8, b"\0")
        self.uc.mem_write(FRAME, frame)
        self.call("fw_can_receive", FW, FRAME)

    def transmit(self):
        """The next frame's 12 bytes, or none."""
        if self.call("fw_can_transmit", FW, FRAME) & 0xFF:
            return bytes(self.uc.mem_read(FRAME, 12))
        return None

    def lost(self, frames):
        self.call("fw_can_lost", FW, frames)

    def bus(self, state):
        self.call("fw_can_bus", FW, state)

    def select_program(self, record):
        """Selects the program of a cycle and returns the reason and the part of fw_select_program()
        in one number. The program that runs stays in memory until another one is accepted."""
        self.uc.mem_write(self.programs[0], record)
        answer = self.call("fw_select_program", FW, self.programs[0], len(record)) & 0xFFFF
        if answer == 0:
            self.programs.reverse()
        return answer

    def overrun(self):
        self.call("fw_overrun", FW, 0)

    def modbus(self, data):
        self.uc.mem_write(BYTES, data)
        self.call("fw_modbus_receive", FW, BYTES, len(data))
        count = self.count
        answer = self.call("fw_modbus_transmit", FW, BYTES, 256)
        self.counter.total = count
        return answer


@functools.cache
def build_library(name, *more):
    """The firmware, and more sources, as a library for this machine."""
    library = _folder() / f"lib{name}.so"
    options = ["-std=c11", "-O2", "-shared", "-fPIC", f"-I{ROOT}"]
    run("cc", *options, *sources(), *more, "-o", library)
    return ctypes.CDLL(str(library))


class Host:
    """The same calls into a library compiled for this machine."""

    def __init__(self):
        self.lib = build_library("firmware")
        self.fw = ctypes.create_string_buffer(16384)
        self.recorder = ctypes.create_string_buffer(RECORDER_BYTES)
        self.blackbox = ctypes.create_string_buffer(0x200)
        places = [ctypes.addressof(self.recorder), RECORDER_BYTES, ctypes.addressof(self.blackbox)]
        self.curve = ctypes.create_string_buffer(CURVE_BYTES)
        self.results = ctypes.create_string_buffer(RESULT_BYTES)
        memories = (ctypes.addressof(self.results), RESULT_BYTES)
        memories += (ctypes.addressof(self.curve), CURVE_BYTES)
        config = struct.pack("<QI4xQQQQIIBB46xQI4xQI4x", *places, 0, 0, 0, 0, 0, NODE, 1, *memories)
        # What the configuration does not name is 0, as behind CONFIG of the chip.
        self.config = ctypes.create_string_buffer(config, 0x200)
        self.lib.fw_init(self.fw, self.config)
        self.outputs = ctypes.create_string_buffer(OUTPUT_BYTES)
        self.value = ctypes.c_int32()
        self.frame = ctypes.create_string_buffer(12)
        self.bytes = ctypes.create_string_buffer(256)
        self.count = 0

    def tick(self, inputs):
        self.lib.fw_tick(self.fw, inputs, self.outputs)
        return self.outputs.raw

    def write(self, source, number, value):
        return self.lib.fw_object_write(
            self.fw, source, ctypes.c_uint16(number), ctypes.c_int32(value)
        )

    def read(self, number):
        self.lib.fw_object_read(self.fw, ctypes.c_uint16(number), ctypes.byref(self.value))
        return self.value.value

    def receive(self, can_id, data):
        frame = struct.pack("<HBB", can_id, len(data), 0) + data.ljust(8, b"\0")
        self.lib.fw_can_receive(self.fw, frame)

    def transmit(self):
        return self.frame.raw if self.lib.fw_can_transmit(self.fw, self.frame) & 0xFF else None

    def lost(self, frames):
        self.lib.fw_can_lost(self.fw, frames)

    def bus(self, state):
        self.lib.fw_can_bus(self.fw, state)

    def select_program(self, record):
        """As Chip.select_program()."""
        memory = ctypes.create_string_buffer(record, len(record))
        answer = self.lib.fw_select_program(self.fw, memory, len(record)) & 0xFFFF
        if answer == 0:
            self.program = memory
        return answer

    def overrun(self):
        self.lib.fw_overrun(self.fw, 0)

    def modbus(self, data):
        self.lib.fw_modbus_receive(self.fw, data, len(data))
        return self.lib.fw_modbus_transmit(self.fw, self.bytes, 256)
