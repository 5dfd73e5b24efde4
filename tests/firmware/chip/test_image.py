"""tools/image, the blank port on other compilers, both images in an emulator of the STM32F405."""

import re
import struct
import subprocess
import time

import pytest
from chip import BOARD, EMULATED, IMAGE, ROOT, SLOT_BYTES, SLOTS, segments
from forceaxis.chip import emulator, update_file

# What QEMU has no model of.
REPLACED = {
    "tick_timer_start",
    "tick_timer_take",
    "tick_timer_is_due",
    *("io_init", "io_make_safe", "io_node_id", "io_serial_number", "io_clock_is_right"),
    *(
        "port_sample",
        "port_sense",
        "port_act",
        "port_idle",
        "flash_memory",
        "flash_archive",
        "flash_slots",
        *("read_bytes", "program_bytes", "erase_sector"),
        "watchdog_arm",
        "supply_interrupt",
        "can_interrupt",
        "drive_bus_interrupt",
        "drive_bus_sent_interrupt",
        "io_start",
        "spi_force_read_interrupt",
        "spi_force_ready_interrupt",
    ),
    *("port_can_receive", "port_can_transmit", "port_can_bus", "port_can_lost", "port_can_rate"),
    *("port_feed_watchdog", "reset_cause", "clock_count"),
}
WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Werror", "-Wshadow", "-Wconversion"]


def run(*command, **options):
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT, **options)


@pytest.mark.parametrize("compiler", [["cc"], ["arm-none-eabi-gcc", "-mcpu=cortex-m4", "-mthumb"]])
def test_the_blank_port_compiles_freestanding(compiler, tmp_path):
    for source in ("firmware/port/main.c", "firmware/port/blank/blank.c"):
        done = run(
            *compiler, "-std=c11", "-O2", "-ffreestanding", *WARNINGS, "-I.", "-c", source,
            "-o", str(tmp_path / "object.o"),
        )  # fmt: skip
        assert done.returncode == 0, done.stderr


def test_an_image_that_is_up_to_date_stays():
    before = IMAGE.stat().st_mtime_ns, EMULATED.stat().st_mtime_ns
    assert run("tools/image", "--emulated", str(BOARD.folder)).returncode == 0
    assert (IMAGE.stat().st_mtime_ns, EMULATED.stat().st_mtime_ns) == before


def test_a_wrong_option_is_refused_in_one_line():
    done = run("tools/image", "--emulate")
    assert done.returncode == 2 and done.stderr.count("\n") == 1


def test_the_formats_hold_the_same():
    binary = IMAGE.with_suffix(".bin").read_bytes()
    memory = {}
    base = 0
    for line in IMAGE.with_suffix(".hex").read_text().split():
        record = bytes.fromhex(line[1:])
        assert sum(record) % 256 == 0
        count, address, kind = record[0], int.from_bytes(record[1:3], "big"), record[3]
        data = record[4 : 4 + count]
        if kind == 4:
            base = int.from_bytes(data, "big") << 16
        elif kind == 2:
            base = int.from_bytes(data, "big") << 4
        elif kind == 0:
            memory.update({base + address + i: b for i, b in enumerate(data)})
    for address, data in segments(IMAGE):
        assert bytes(memory.pop(address + i) for i in range(len(data))) == data
        at = address - 0x08000000
        assert binary[at : at + len(data)] == data
    assert memory == {}


def test_both_images_are_of_the_same_objects_but_those_of_the_emulator(tmp_path):
    """Every function of core, fx, proto and app has the same code in both."""

    def code(image):
        text = run("arm-none-eabi-nm", "-S", str(image)).stdout
        return {m[3]: int(m[2], 16) for m in re.finditer(r"^(\w+) (\w+) [Tt] (\w+)$", text, re.M)}

    released, emulated = code(IMAGE), code(EMULATED)
    differ = {n for n in released.keys() & emulated.keys() if released[n] != emulated[n]}
    assert differ <= REPLACED, differ - REPLACED
    both = {
        "fw_prepare",
        "fw_control",
        "fw_report",
        "fw_between",
        "axis_tick",
        "port_tick",
        "tick_interrupt",
        "main",
    }
    assert both | {"main"} <= released.keys() & emulated.keys()


# In QEMU: clocks, converters, CAN and pins read 0 there.


def qemu(image, *options):
    return subprocess.Popen(
        emulator.command(BOARD, image, *options),
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip


def until(condition, what):
    for _ in range(1200):
        if condition():
            return
        time.sleep(0.05)
    raise AssertionError(what)


@pytest.mark.parametrize(
    "image, exception", [(IMAGE, 46), (EMULATED, 15)], ids=["released", "emulated"]
)
def test_it_boots_and_ticks_without_its_peripherals(image, exception, tmp_path):
    """The tick is the interrupt of TIM4, which the emulator has, or of SysTick."""
    tick = f"pending nonsecure exception {exception}".encode()
    log = tmp_path / "log"
    process = qemu(
        image, "-icount", "shift=3,sleep=off", "-d", "int,guest_errors", "-D", str(log),
    )  # fmt: skip
    try:
        until(
            lambda: log.exists() and log.read_bytes().count(tick) > 20,
            "no tick",
        )
    finally:
        process.kill()
        process.wait()
    text = log.read_text(errors="replace")
    assert text.count("Loaded reset SP 0x2000") == 1, "it was reset"
    assert "exception 3" not in text and "Invalid" not in text


def test_a_stack_that_overflows_resets_the_core_and_does_not_lock_it_up(tmp_path):
    """The image with 16 bytes of stack: the first pushes fall below the RAM, the push of the fault
    itself too. A handler that pushes as well is QEMU's "Lockup: can't escalate 3 to HardFault"."""
    image, log = tmp_path / "image.elf", tmp_path / "log"
    parts = dict(segments(EMULATED))
    before, trailer = parts[SLOTS[0]], parts[SLOTS[0] + SLOT_BYTES - 64]
    after = struct.pack("<I", 0x20000010) + before[4:]
    content = EMULATED.read_bytes().replace(before, after)
    image.write_bytes(content.replace(trailer, update_file.trailer(after)))
    process = qemu(image, "-icount", "shift=3,sleep=off", "-d", "int", "-D", str(log))
    try:
        until(
            lambda: (
                process.poll() is not None
                or (log.exists() and log.read_bytes().count(b"Loaded reset SP 0x20001000") > 3)
            ),
            "no reset",
        )
        assert process.poll() is None, "locked up"
    finally:
        process.kill()
        process.wait()
    text = log.read_text(errors="replace")
    assert "pending nonsecure exception 3" in text or "exception 3" in text
