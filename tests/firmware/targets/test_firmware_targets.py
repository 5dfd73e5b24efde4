"""The firmware on its targets: it compiles and links without a libc, and an emulated Cortex-M4 and
RV32 compute the host's codes bit for bit, the Cortex-M4 within the instruction budget.

Run with `pytest -s` to see the sizes and instruction counts. A missing tool is a failure.
"""

import ctypes
import functools
import random
import struct
from pathlib import Path
from typing import NamedTuple

import cross
import pytest
import unicorn
from cross import run
from force_banks import random_bank
from forceaxis.objects import BY_NAME
from unicorn import arm_const, riscv_const

pytestmark = pytest.mark.beside

ROOT = Path(__file__).resolve().parents[3]
INSTRUCTIONS_MAX = 340
BANKED_MAX = 550  # with a bank of the force law
CORE_BYTES_MAX = 20 * 512  # 1 KiB of them is the table of the CRC-32
STATE_BYTES_MAX = 512
FUZZED_TICKS = 40_000
SEED = 1988

WARNINGS = [
    "-Wall",
    "-Wextra",
    "-Wpedantic",
    "-Werror",
    "-Wshadow",
    "-Wconversion",
    "-Wsign-conversion",
    "-Wstrict-prototypes",
    "-Wmissing-prototypes",
    "-Wcast-qual",
]
FREESTANDING = [
    "-std=c11",
    "-O2",
    "-ffreestanding",
    "-nostdlib",
    "-ffunction-sections",
    f"-I{ROOT}",
]


class Target(NamedTuple):
    """A processor: how the firmware is compiled for it, and how an emulator of it calls."""

    name: str
    compiler: list[str]
    prefix: str  # of its binutils
    processor: tuple[int, int, int]  # architecture, mode and model of the emulator
    arguments: list[int]  # registers; the first one also holds the result
    stack: int
    back: int  # where a function returns to
    thumb: int  # what an address of code is or-ed with
    long: int  # a first halfword of this or more, in `long_bits`, begins a 32-bit instruction
    long_bits: int
    instructions_max: int | None  # of axis_tick


CORTEX_M4 = Target(
    "Cortex-M4",
    ["arm-none-eabi-gcc", "-mcpu=cortex-m4", "-mthumb"],
    "arm-none-eabi-",
    (
        unicorn.UC_ARCH_ARM,
        unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS,
        arm_const.UC_CPU_ARM_CORTEX_M4,
    ),
    [getattr(arm_const, f"UC_ARM_REG_R{i}") for i in range(4)],
    arm_const.UC_ARM_REG_SP,
    arm_const.UC_ARM_REG_LR,
    thumb=1,
    long=0xE800,
    long_bits=0xFFFF,
    instructions_max=INSTRUCTIONS_MAX,
)
RV32 = Target(
    "RV32",
    ["riscv64-unknown-elf-gcc", "-march=rv32imac", "-mabi=ilp32"],
    "riscv64-unknown-elf-",
    (unicorn.UC_ARCH_RISCV, unicorn.UC_MODE_RISCV32, riscv_const.UC_CPU_RISCV32_ANY),
    [getattr(riscv_const, f"UC_RISCV_REG_A{i}") for i in range(8)],
    riscv_const.UC_RISCV_REG_SP,
    riscv_const.UC_RISCV_REG_RA,
    thumb=0,
    long=3,
    long_bits=3,
    instructions_max=None,
)
EMULATED = [CORTEX_M4, RV32]
AVR = ["avr-gcc", "-mmcu=atmega2560"]
LAWS_ROUNDS = 20_000

FOLDERS = (
    "fx", "objects", "core", "cycle", "guard", "drive", "canopen", "drive402", "modbus", "storage",
    "app",
)  # fmt: skip
SOURCES = [s for f in FOLDERS for s in sorted((ROOT / "firmware" / f).rglob("*.c"))]
LAWS = [ROOT / "tests/firmware/targets/laws_probe.c", ROOT / "firmware/fx/fx.c"]

START = """
#include <stddef.h>
#include <stdint.h>
#include "firmware/app/fw.h"
void start(void);
const uint32_t probe_sizes[2] = {sizeof(axis_t), offsetof(fw_t, axis)};
static fw_t fw;
static uint8_t recorder_buffer[FW_RECORDER_BYTES];
void start(void) {
  axis_inputs_t inputs = {0};
  volatile axis_outputs_t sink;
  static const fw_config_t config = {.recorder_buffer = recorder_buffer,
                              .recorder_bytes = sizeof(recorder_buffer)};
  fw_init(&fw, &config);
  for (;;) {
    axis_outputs_t outputs;
    fw_tick(&fw, &inputs, &outputs);
    sink = outputs;
    (void)sink;
  }
}
"""
LOCAL = 3  # FW_SOURCE_LOCAL
CODE_BASE, RAM_BASE, STACK_TOP, EXIT = 0x08000000, 0x20000000, 0x20010000, 0x0F000000


def compile_all(target, sources, folder):
    objects = []
    for source in sources:
        objects.append(folder / (source.parent.name + "_" + source.stem + ".o"))
        run(*target.compiler, *FREESTANDING, *WARNINGS, "-c", source, "-o", objects[-1])
    return objects


def undefined_symbols(target, *files):
    """Names that the files together do not define."""
    needed, defined = set(), set()
    for line in run(target.prefix + "nm", *files).splitlines():
        words = line.split()
        if len(words) == 2 and words[0] == "U":
            needed.add(words[1])
        elif len(words) == 3:
            defined.add(words[2])
    return needed - defined


def link(target, objects, folder):
    start = folder / "start.c"
    start.write_text(START)
    (folder / "image.ld").write_text(
        f"ENTRY(start)\nSECTIONS {{ . = {CODE_BASE:#x}; .text : {{ *(.text*) *(.rodata*)"
        f" *(.srodata*) }} . = {RAM_BASE:#x}; .data : {{ *(.data*) *(.sdata*) }}"
        " .bss : { *(.bss*) *(.sbss*) *(COMMON) } }\n"
    )
    start_object = compile_all(target, [start], folder)
    image = folder / "image.elf"
    run(
        *target.compiler,
        "-nostdlib",
        "-nostartfiles",
        "-static",
        "-Wl,--no-undefined",
        f"-Wl,-T,{folder / 'image.ld'}",
        *start_object,
        *objects,
        "-o",
        image,
    )
    assert not undefined_symbols(target, image)
    return image


@pytest.fixture(scope="session")
def built(tmp_path_factory):
    """(objects, image) of the firmware for a target."""

    @functools.cache
    def build(name):
        target = next(t for t in EMULATED if t.name == name)
        folder = tmp_path_factory.mktemp(name)
        objects = cross.objects([*target.compiler, *FREESTANDING, *WARNINGS], SOURCES)
        return objects, link(target, objects, folder)

    return lambda target: build(target.name)


@pytest.fixture(scope="session")
def cortex_m4(built):
    return built(CORTEX_M4)


each_target = pytest.mark.parametrize("target", EMULATED, ids=lambda target: target.name)


@each_target
def test_firmware_links_without_any_library(built, target):
    objects, _ = built(target)
    assert undefined_symbols(target, *objects) == set(), "compiler helpers are needed"


def test_core_code_size(cortex_m4):
    objects, _ = cortex_m4
    rows = [line.split() for line in run("arm-none-eabi-size", *objects).splitlines()[1:]]
    size = {Path(row[-1]).name: int(row[0]) for row in rows}
    assert all(row[1] == row[2] == "0" for row in rows), "data or bss in the firmware"
    core = sum(n for name, n in size.items() if name.startswith(("core_", "fx_")))
    print(
        f"\nCortex-M4 -O2: core + fx {core} bytes, app {size['app_fw.o']}, "
        f"object table {size['generated_axis_objects.o']}"
    )
    assert core <= CORE_BYTES_MAX


def test_laws_give_the_same_codes_with_a_16_bit_int(tmp_path):
    """The laws and fx on an ATmega2560, emulated: int has 16 bits there."""
    image = tmp_path / "laws.elf"
    main = ROOT / "tests/firmware/targets/avr_main.c"
    for source in [*LAWS, main]:
        run(
            *AVR,
            *FREESTANDING,
            *WARNINGS,
            f"-DROUNDS={LAWS_ROUNDS}",
            "-c",
            source,
            "-o",
            tmp_path / (source.stem + ".o"),
        )
    # libgcc holds the chip's products and quotients of more than 16 bits.
    run(
        *AVR,
        "-nostdlib",
        "-nostartfiles",
        tmp_path / "avr_main.o",
        tmp_path / "laws_probe.o",
        tmp_path / "fx.o",
        "-lgcc",
        "-o",
        image,
    )
    # simavr shows the serial port on standard error.
    printed = run("sh", "-c", f"timeout 60 simavr -m atmega2560 -f 16000000 '{image}' 2>&1")
    library = tmp_path / "laws.so"
    run("cc", "-std=c11", "-O2", "-shared", "-fPIC", f"-I{ROOT}", *LAWS, "-o", library)
    probe = ctypes.CDLL(str(library)).laws_probe
    probe.restype = ctypes.c_uint32
    expected = f"{probe(ctypes.c_uint32(LAWS_ROUNDS)):08x}"
    assert expected in printed


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


class Outputs(ctypes.Structure):
    _fields_ = [
        ("dac_code", ctypes.c_int16),
        ("amp_enable", ctypes.c_uint8),
        ("brake_release", ctypes.c_uint8),
        ("dac_fine", ctypes.c_int16),
        ("digital", ctypes.c_uint8),
    ]


class Host:
    """The firmware compiled for this machine."""

    def __init__(self, folder):
        library, probe = folder / "libfirmware.so", folder / "probe.c"
        probe.write_text(
            '#include <stddef.h>\n#include "firmware/app/fw.h"\n'
            "const uint32_t probe_axis = offsetof(fw_t, axis);\n"
            "const uint32_t probe_fw = sizeof(fw_t);\n"
            "const uint32_t probe_config = sizeof(fw_config_t);\n"
        )
        sources = [*SOURCES, probe]
        run("cc", "-std=c11", "-O2", "-shared", "-fPIC", f"-I{ROOT}", *sources, "-o", library)
        self.lib = ctypes.CDLL(str(library))
        self.axis = ctypes.c_uint32.in_dll(self.lib, "probe_axis").value
        sizes = (ctypes.c_uint32.in_dll(self.lib, f"probe_{name}") for name in ("fw", "config"))
        self.fw, config = (ctypes.create_string_buffer(size.value) for size in sizes)
        self.lib.fw_init(self.fw, config)  # all 0
        self.outputs = Outputs()

    def write(self, number, value):
        return self.lib.fw_object_write(
            self.fw, LOCAL, ctypes.c_uint16(number), ctypes.c_int32(value)
        )

    def read(self, number):
        value = ctypes.c_int32()
        assert self.lib.fw_object_read(self.fw, ctypes.c_uint16(number), ctypes.byref(value)) == 0
        return value.value

    def tick(self, inputs):
        axis = ctypes.byref(self.fw, self.axis)
        self.lib.axis_tick(axis, ctypes.byref(inputs), ctypes.byref(self.outputs))
        return bytes(self.outputs)

    def state(self, size):
        return self.fw.raw[self.axis : self.axis + size]


class Emulator:
    """The image linked for a target in an emulator; counts the instructions of each call.

    Every instruction of a block that is entered counts, also one that its condition skips.
    """

    FW, CONFIG, INPUTS, OUTPUTS = RAM_BASE, RAM_BASE + 0x4000, RAM_BASE + 0x5000, RAM_BASE + 0x5100

    def __init__(self, image, target=CORTEX_M4):
        self.target = target
        self.symbols = {}
        for line in run(target.prefix + "nm", image).splitlines():
            words = line.split()
            self.symbols[words[-1]] = int(words[0], 16)
        binary = image.with_suffix(".bin")
        run(target.prefix + "objcopy", "-O", "binary", "-j", ".text", image, binary)
        self.code = binary.read_bytes()
        architecture, mode, model = target.processor
        self.uc = unicorn.Uc(architecture, mode)
        self.uc.ctl_set_cpu_model(model)
        self.uc.mem_map(CODE_BASE, 0x40000)
        self.uc.mem_write(CODE_BASE, self.code)
        self.uc.mem_map(RAM_BASE, 0x10000)
        self.uc.mem_map(EXIT, 0x1000)
        self.blocks = {}
        self.count = 0
        self.visited = set()
        self.uc.hook_add(
            unicorn.UC_HOOK_BLOCK, self.on_block, begin=CODE_BASE, end=CODE_BASE + 0x3FFFF
        )
        at = self.symbols["probe_sizes"] - CODE_BASE
        self.state_bytes, self.axis = struct.unpack_from("<II", self.code, at)
        self.call("fw_init", self.FW, self.CONFIG)  # all 0

    def on_block(self, _uc, address, size, _data):
        key = (address, size)
        if key not in self.blocks:
            self.blocks[key] = self.instructions(address, size)
            self.visited.update(self.blocks[key])
        self.count += len(self.blocks[key])

    def instructions(self, address, size):
        """Addresses of the instructions of a block, of 16 or 32 bits each."""
        found, end = [], address + size
        while address < end:
            found.append(address)
            (first,) = struct.unpack_from("<H", self.code, address - CODE_BASE)
            address += 4 if first & self.target.long_bits >= self.target.long else 2
        return found

    def call(self, name, *arguments):
        target = self.target
        for register, value in zip(target.arguments, arguments, strict=False):
            self.uc.reg_write(register, value & 0xFFFFFFFF)
        self.uc.reg_write(target.stack, STACK_TOP)
        self.uc.reg_write(target.back, EXIT | target.thumb)
        self.count = 0
        self.uc.emu_start(self.symbols[name] | target.thumb, EXIT)
        result = self.uc.reg_read(target.arguments[0])
        return result - (1 << 32) if result >> 31 else result

    def write(self, number, value):
        return self.call("fw_object_write", self.FW, LOCAL, number, value)

    def tick(self, inputs):
        self.uc.mem_write(self.INPUTS, bytes(inputs))
        self.call("axis_tick", self.FW + self.axis, self.INPUTS, self.OUTPUTS)
        return bytes(self.uc.mem_read(self.OUTPUTS, ctypes.sizeof(Outputs)))

    def state(self, size):
        return bytes(self.uc.mem_read(self.FW + self.axis, size))


MODES = BY_NAME["mode"].enum
# Values that reach every branch: small and large, both rails, their neighbours, and off.
RANGES = {
    "drive_on_ticks_max": [1, 1, 5, 600],
    "position_age_max": [0, 1, 15, 254],
    "force_age_max": [0, 1, 15, 254],
    "mode": [0, 1, 1, 2, 2, 2, 2, 3, 3, 3, *range(4, len(MODES)), *range(4, len(MODES))],
    "open_loop_code": [-2048, -2047, -1, 0, 1, 700, 2047],
    "excitation_waveform": [0, 1],
    "excitation_amplitude": [0, 1, 300, 2048],
    "excitation_seed": [0, 1, 16384, 65535],
    "excitation_hold": [1, 1, 2, 65535],
    "excitation_frequency": [0, 1, 70000000, 2147483647],
    "excitation_sweep": [-2147483648, -30000, 0, 0, 30000, 2147483647],
    "excitation_period": [0, 1, 2, 10, 2147483647],
    "force_gain": [0, 1, 256, 1280, 2560, 65535],
    "force_setpoint": [-65536, 0, 128, 3840, 7680, 65536],
    "force_zero_code": [0, 0, 0, 128, 65535],
    "force_sign": [1, 1, -1, 0],
    "force_tare": [-65536, 0, 0, 0, 300, 65536],
    "adc_bits": [8, 8, 9, 12, 16],
    "dac_bits": [12, 12, 13, 16],
    "position_gain": [0, 10, 256, 65535],
    "velocity_gain": [0, 256, 2000, 65535],
    "profile_enable": [0, 1, 1, 1],
    "profile_velocity_max": [1, 65536, 1310720, 134217728],
    "profile_acceleration_max": [1, 6554, 65536, 3000000, 16777216],
    "position_min": [-2147483648, -2147483648, -1000, 0],
    "position_max": [2147483647, 2147483647, 1000, 100000],
    "output_limit": [0, 100, 2047, 2048, 2048, 2048],
    "latency_ticks": [0, 1],
    "output_bias": [0, 0, 0, 16384, -4806, 5],
    "brake_engage_ticks": [0, 0, 0, 3, 45],
    "bump_decay_shift": [0, 1, 3, 6, 12],
    "following_error_max": [0, 0, 0, 0, 0, 30, 2147483647],
    "speed_max": [0, 0, 0, 40, 2147483647],
    "force_max": [0, 0, 0, 0, 50000, 131072],
}


PROFILE = ("profile_enable", "profile_velocity_max", "profile_acceleration_max")


# Without force_control_step(), whose cap only the drive sets.
AXIS_TICK = ("axis_tick", "excitation_step", "limits_block", "profile_step", "force_law_step")


def tick_instructions(image, target=CORTEX_M4):
    """Addresses of the instructions of axis_tick and what it calls."""
    found = set()
    for function in AXIS_TICK:
        listing = run(target.prefix + "objdump", "-d", f"--disassemble={function}", image)
        for line in listing.splitlines():
            words = line.split("\t")
            # Constants that follow the code, and padding, are no instructions.
            if len(words) > 2 and words[2].strip() not in (".word", "nop"):
                found.add(int(words[0].strip().rstrip(":"), 16))
    return found


def random_write(rng, position):
    """A plausible write: (number, value)."""
    if rng.random() < 0.15:
        near = rng.choice([0, 1, 3, 100, 5000, 40000, 30000000, 0x7FFFFFFF])
        value = position + rng.randint(-near, near)
        return BY_NAME["position_setpoint"].number, (value + (1 << 31)) % (1 << 32) - (1 << 31)
    name = rng.choice(PROFILE if rng.random() < 0.3 else list(RANGES))
    o = BY_NAME[name]
    value = rng.choice(RANGES[name])
    if rng.random() < 0.2:
        value = rng.randint(o.min, o.max)
    return o.number, value


FAULTS_OF_A_TICK = (
    *("none", "sensor_invalid", "enable_lost", "adc_range", "limit_switches", "overspeed"),
    *("force_max", "following_error"),
    *("drive_not_ready", "drive_lost", "drive_fault", "position_old", "force_old"),
)


def report_drive(rng, tick, inputs):
    """In one of four spans of 500 ticks a drive is fitted, and off for 25 of 100 ticks. Values
    are of any age."""
    inputs.drive = inputs.position_age = inputs.force_age = 0
    if tick // 500 % 4 == 3:
        on = rng.choice([3] * 60 + [11] * 12 + [1, 1, 5, 7])
        inputs.drive = 1 if tick % 100 < 25 else on
        if rng.random() < 0.02:
            inputs.position_age, inputs.force_age = rng.choice([(1, 0), (0, 1), (16, 0), (0, 255)])


@each_target
def test_targets_compute_the_host_codes_within_the_budget(built, target, tmp_path):
    _, image = built(target)
    host, chip = Host(tmp_path), Emulator(image, target)
    state_bytes = chip.state_bytes
    assert state_bytes <= STATE_BYTES_MAX
    rng = random.Random(SEED)
    names = BY_NAME["mode"].enum
    worst = dict.fromkeys(names, 0)
    ticks = dict.fromkeys(names, 0)
    faults, reasons, banked = set(), set(), 0
    inputs = Inputs(0, (0, 0), 1, 1)
    drive_rng = random.Random(SEED + 1)
    position, speed = 0.0, 0.0
    for tick in range(FUZZED_TICKS):
        writes = []
        fault = host.read(BY_NAME["fault"].number)
        if fault and rng.random() < 0.5:
            writes.append((BY_NAME["fault_reset"].number, 1))
        elif not host.read(BY_NAME["active_mode"].number) and rng.random() < 0.3:
            for _ in range(6):
                writes.append(random_write(rng, inputs.encoder_cnt))
            if rng.random() < 0.3:
                bank = random_bank(rng) if rng.random() < 0.6 else [("force_bank", 0)]
                writes.extend((BY_NAME[name].number, value) for name, value in bank)
            writes.append((BY_NAME["mode"].number, rng.choice(RANGES["mode"])))
        elif rng.random() < 0.08:
            writes.append(random_write(rng, inputs.encoder_cnt))
        for number, value in writes:
            expected = host.write(number, value)
            assert chip.write(number, value) == expected, (SEED, tick, number, value)

        # A crude plant: the code drives the speed, a wall presses back, rare jumps and failures.
        code = struct.unpack("<h", bytes(host.outputs)[:2])[0]
        speed += 0.2 * (code / 50.0 - speed)
        position += speed
        if rng.random() < 0.002:
            position = rng.choice([0, 2**31 - 20, -(2**31) + 5, rng.randint(-(2**31), 2**31 - 1)])
        count = int(position)
        inputs.encoder_cnt = (count + (1 << 31)) % (1 << 32) - (1 << 31)
        top = (1 << host.read(BY_NAME["adc_bits"].number)) - 1
        inputs.adc_code[0] = max(0, min(top, int(abs(speed) * 4) + rng.randint(0, 3)))
        if rng.random() < 0.1:
            inputs.adc_code[0] = rng.choice([0, top, rng.randint(0, top)])
        if rng.random() < 0.003:
            inputs.adc_code[rng.randint(0, 1)] = min(65535, top + 1)
        else:
            inputs.adc_code[1] = rng.randint(0, top)
        inputs.din = 1
        if rng.random() < 0.02:
            inputs.din = rng.choice([0, 3, 5, 7, 9])
        inputs.sensor_valid = int(rng.random() >= 0.004)
        report_drive(drive_rng, tick, inputs)

        expected = host.tick(inputs)
        got = chip.tick(inputs)
        replay = f"seed {SEED}, tick {tick}"
        assert got == expected, replay
        assert chip.state(state_bytes) == host.state(state_bytes), replay
        mode = names[host.read(BY_NAME["active_mode"].number)]
        if mode == "force" and host.read(BY_NAME["force_bank"].number):
            banked = max(banked, chip.count)
        else:
            worst[mode] = max(worst[mode], chip.count)
        ticks[mode] += 1
        faults.add(host.read(BY_NAME["fault"].number))
        reasons.add(host.read(BY_NAME["limit_reason"].number))

    code = tick_instructions(image, target)
    missed = sorted(code - chip.visited)
    print(
        f"\naxis_tick on {target.name}, {FUZZED_TICKS} fuzzed ticks, state {state_bytes} bytes, "
        f"{len(code) - len(missed)} of its {len(code)} instructions executed"
        + "".join(f" (not {a:#x})" for a in missed)
    )
    for name in names:
        print(f"  {name:10} {ticks[name]:6} ticks, at most {worst[name]} instructions")
    print(f"  with a bank of the force law at most {banked} instructions")
    assert target.instructions_max is None or max(worst.values()) <= target.instructions_max
    assert target.instructions_max is None or target.instructions_max < banked <= BANKED_MAX
    # What the drive sets for a tick is not reached without it: tests/firmware/chip/test_budget.py
    # reaches it.
    assert len(missed) <= len(code) // 25
    assert min(ticks.values()) > FUZZED_TICKS // 50
    texts = BY_NAME["fault"].enum
    found = {texts[fault] for fault in faults}
    assert found == set(FAULTS_OF_A_TICK), "all that the tick finds"
    assert reasons == set(range(len(BY_NAME["limit_reason"].enum)))
