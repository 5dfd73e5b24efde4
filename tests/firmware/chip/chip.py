"""The released image in an emulated Cortex-M4, in front of the modelled peripherals."""

import functools
import struct
import subprocess
from pathlib import Path
from typing import ClassVar

import unicorn
from forceaxis import objects
from forceaxis.chip import board
from peripherals import Board
from unicorn import arm_const

ROOT = Path(__file__).resolve().parents[3]
BOARD = board.read(ROOT / "firmware/port/stm32f4")
IMAGE = ROOT / f"build/image/{BOARD.image}.elf"
IMAGES = IMAGE, IMAGE.with_name(f"{IMAGE.stem}-b.elf")  # for both slots
EMULATED = IMAGE.with_name(f"{BOARD.image}-emulated.elf")
FLASH, FLASH_BYTES = 0x08000000, 512 * 1024
STORE, STORE_BYTES = 0x08004000, 2 * 16384
SLOTS, SLOT_BYTES = BOARD.slots.addresses, BOARD.slots.bytes
PAGE = 0x1000  # of the emulator; the trailer of the running slot has one of its own
RAM, RAM_BYTES = 0x20000000, 128 * 1024
EXIT = 0x00000F00  # where a handler returns to
UID, UID_WORDS = 0x1FFF7A10, (0x00350027, 0x33365110, 0x31323736)
# VREFINT_CAL: 1.21 V at 3.3 V.
REFERENCE_AT, REFERENCE_CODE = 0x1FFF7A2A, 1502
LOCAL = 3  # FW_SOURCE_LOCAL
PVD, INDEX, CAN_RX0, USART2, CAN2_TX, CAN2_RX0 = 1, 9, 20, 38, 63, 64
DMA1_STREAM3, EXTI15_10 = 14, 40
NMI, HARD_FAULT = 2, 3
TICK = 30  # TIM4
ENTRY_CYCLES = 12  # from the event to its handler
READ_ONLY = unicorn.UC_PROT_READ | unicorn.UC_PROT_EXEC
REGISTERS = [getattr(arm_const, f"UC_ARM_REG_R{i}") for i in range(13)]
STEPS_MAX = 40_000_000


class Stuck(Exception):
    """A called function did not return."""


@functools.cache
def segments(path):
    """[(address, bytes)] of what an ELF file is loaded with."""
    data = path.read_bytes()
    assert data[:6] == b"\x7fELF\x01\x01"
    (at,) = struct.unpack_from("<I", data, 28)
    size, count = struct.unpack_from("<HH", data, 42)
    found = []
    for i in range(count):
        kind, offset, _, address, length = struct.unpack_from("<5I", data, at + i * size)
        if kind == 1 and length > 0:
            found.append((address, data[offset : offset + length]))
    return found


@functools.cache
def symbols(path):
    done = subprocess.run(
        ["arm-none-eabi-nm", str(path)], capture_output=True, text=True, check=True
    )
    found = {}
    for line in done.stdout.splitlines():
        address, _, name = line.split()
        found[name] = int(address, 16)
    return found


class Chip:
    """A chip out of reset. `store`: the bytes of the stored sectors of its flash. `steps` counts
    instructions, without `ram_counts` only those in the flash. Unless `checked`, the CRC of the
    image is taken for right, to save its 22,000 words of every boot. `slot`: number of the slot
    that the loader has started; `slots`: the bytes of both slots, by default those of an image that
    a debug probe has written to slot A."""

    models: ClassVar = Board
    images: ClassVar = IMAGES
    store: ClassVar = (STORE, STORE_BYTES)
    slots_of_board: ClassVar = SLOTS
    uid, reference = UID, (REFERENCE_AT, REFERENCE_CODE)
    buses: ClassVar = ((0x40000000, 0x30000), (0xE000E000, 0x1000), (0xE0042000, 0x1000))
    vector_count = 81

    def __init__(self, store=None, ram_counts=True, checked=False, slot=0, slots=None):
        self.board = self.models()
        self.board.instructions = lambda: self.steps
        self.board.read_memory = lambda at, count: bytes(self.uc.mem_read(at, count))
        self.board.write_memory = lambda at, data: self.uc.mem_write(at, data)
        self.board.gpioc.wires = {4: 0}  # the strap of node id 1
        self.symbols = symbols(self.images[slot])
        if store is not None:
            self.board.flash.bytes[:] = store
        self.uc = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
        self.uc.ctl_set_cpu_model(arm_const.UC_CPU_ARM_CORTEX_M4)
        self.code = bytearray(b"\xff" * FLASH_BYTES)
        for address, data in segments(self.images[slot]):
            self.code[address - FLASH : address - FLASH + len(data)] = data
        self._map_flash(slot, slots)
        self.uc.mem_map(RAM, RAM_BYTES)
        self.uc.mem_write(RAM, b"\xa5" * RAM_BYTES)
        self.uc.mem_map(self.uid & ~0xFFF, 0x1000, unicorn.UC_PROT_READ)
        self.uc.mem_write(self.uid, struct.pack("<3I", *UID_WORDS))
        self.uc.mem_write(self.reference[0], struct.pack("<H", self.reference[1]))
        self.uc.mem_map(EXIT & ~0xFFF, 0x1000, READ_ONLY)
        self.steps, self.steps_max = 0, STEPS_MAX
        self.watch = None  # called with address and bytes of each block that is executed
        self.problem = None
        counted = (1, 0) if ram_counts else (FLASH, FLASH + FLASH_BYTES)
        self.uc.hook_add(unicorn.UC_HOOK_BLOCK, self._on_block, None, *counted)
        if not checked:
            self.uc.mem_write(self.symbols["image_is_whole"], b"\x01\x20\x70\x47")  # true
        for base, size in self.buses:
            self.uc.mmio_map(base, size, self._read, base, self._write, base)
        stack, self.entry = struct.unpack_from("<II", self.code, self.vectors_at - FLASH)
        self.vectors = struct.unpack_from(
            f"<{self.vector_count}I", self.code, self.vectors_at - FLASH
        )
        self.uc.reg_write(arm_const.UC_ARM_REG_SP, stack)
        self.idle = self.symbols["port_idle"]
        # The loader's copy of the data, so that every boot starts as at power-up.
        self.boot_steps = None

    def _map_flash(self, slot, slots):
        """Maps the flash: what may be programmed is a model, the rest is read only."""
        stored, stored_bytes = self.store
        self.uc.mmio_map(stored, stored_bytes, self._read_store, None, self._write_store, None)
        self.vectors_at = self.slots_of_board[slot] if self.slots_of_board else FLASH
        programmable = [range(stored, stored + stored_bytes)]
        if self.slots_of_board:
            programmable += self._map_slots(slot, slots)
        at = FLASH
        for part in sorted(programmable, key=lambda part: part.start):
            self._map_read_only(at, part.start)
            at = part.stop
        self._map_read_only(at, FLASH + FLASH_BYTES)

    def _map_read_only(self, begin, end):
        if end > begin:
            self.uc.mem_map(begin, end - begin, READ_ONLY)
            self.uc.mem_write(begin, bytes(self.code[begin - FLASH : end - FLASH]))

    def _map_slots(self, slot, slots):
        """Maps the slot that does not run and the last page of the other one; returns both."""
        flash, first = self.board.flash, SLOTS[0] - FLASH
        flash.other = 6 - slot
        if slots is not None:
            self.code[first : first + 2 * SLOT_BYTES] = slots
        flash.slots[:] = self.code[first : first + 2 * SLOT_BYTES]
        end, other = SLOTS[slot] + SLOT_BYTES, SLOTS[1 - slot]
        parts = [range(end - PAGE, end), range(other, other + SLOT_BYTES)]
        for begin in (part.start for part in parts):
            size = PAGE if begin == end - PAGE else SLOT_BYTES
            self.uc.mmio_map(begin, size, self._read_slots, begin, self._write_slots, begin)
        return parts

    # Peripherals: an exception in a callback must not be lost in C code.

    def _guard(self, call, *arguments):
        try:
            return call(*arguments) or 0
        except Exception as error:
            self.problem = self.problem or error
            self.uc.emu_stop()
            return 0

    def _read(self, _uc, offset, size, base):
        return self._guard(self.board.read, base + offset, size)

    def _write(self, _uc, offset, size, value, base):
        self._guard(self.board.write, base + offset, size, value)

    def _read_store(self, _uc, offset, size, _data):
        return self._guard(self.board.flash.read_stored, offset, size)

    def _write_store(self, _uc, offset, size, value, _data):
        self._guard(self.board.flash.program, offset, size, value)

    def _read_slots(self, _uc, offset, size, begin):
        at = begin + offset - SLOTS[0]
        return int.from_bytes(self.board.flash.slots[at : at + size], "little")

    def _write_slots(self, _uc, offset, size, value, begin):
        self._guard(self.board.flash.program_slot, begin + offset - SLOTS[0], size, value)

    def _on_block(self, _uc, address, size, _data):
        # At most that many: an instruction has two bytes or four.
        self.steps += size // 2
        if self.watch is not None:
            self.watch(address, size)
        if address == self.idle or self.steps > self.limit or self.board.flash.nmi:
            self.uc.emu_stop()

    # Running.

    def _run(self, address, until):
        self.steps, self.limit, self.problem = 0, self.steps_max, None
        self.uc.emu_start(address | 1, until)
        while self.board.flash.nmi and self.problem is None:
            self.board.flash.nmi = False
            at, steps = self.uc.reg_read(arm_const.UC_ARM_REG_PC), self.steps
            self._call(self.vectors[NMI])
            self.steps += steps
            self.uc.emu_start(at | 1, until)
        if self.problem is not None:
            raise self.problem
        if self.steps > self.limit:
            raise Stuck(f"after {self.steps} instructions")

    def boot(self):
        """Runs from reset to the first idle point."""
        self._run(self.entry, 0xFFFFFFFE)
        assert self.uc.reg_read(arm_const.UC_ARM_REG_PC) & ~1 == self.idle
        self.boot_steps = self.steps
        return self

    def call(self, name, *arguments):
        """A function, called as by an interrupt; returns its signed result."""
        return self._call(self.symbols[name], *arguments)

    def _call(self, address, *arguments):
        context = self.uc.context_save()
        for register, value in zip(REGISTERS, arguments, strict=False):
            self.uc.reg_write(register, value & 0xFFFFFFFF)
        self.uc.reg_write(
            arm_const.UC_ARM_REG_SP, self.uc.reg_read(arm_const.UC_ARM_REG_SP) - 0x20 & ~7
        )
        self.uc.reg_write(arm_const.UC_ARM_REG_LR, EXIT | 1)
        self._run(address, EXIT)
        result = self.uc.reg_read(arm_const.UC_ARM_REG_R0)
        self.uc.context_restore(context)
        return result - (1 << 32) if result >> 31 else result

    def call_interrupted(self, name, after, irq, *arguments):
        """The same, with an interrupt after so many of its instructions."""
        seen = [0]

        def count(uc, address, _size, _data):
            seen[0] += 1
            if seen[0] == after + 1:
                self.stopped_at = address
                uc.emu_stop()

        self.stopped_at = None
        begin = self.symbols[name]
        hook = self.uc.hook_add(unicorn.UC_HOOK_CODE, count)
        self.uc.ctl_flush_tb()  # what was translated before would not be counted
        context = self.uc.context_save()
        for register, value in zip(REGISTERS, arguments, strict=False):
            self.uc.reg_write(register, value & 0xFFFFFFFF)
        self.uc.reg_write(
            arm_const.UC_ARM_REG_SP, self.uc.reg_read(arm_const.UC_ARM_REG_SP) - 0x40 & ~7
        )
        self.uc.reg_write(arm_const.UC_ARM_REG_LR, EXIT | 1)
        self._run(begin, EXIT)
        self.uc.hook_del(hook)
        if self.stopped_at is not None:
            self.interrupt(irq)
            self._run(self.stopped_at, EXIT)
        self.call_result = self.uc.reg_read(arm_const.UC_ARM_REG_R0)
        self.uc.context_restore(context)

    def interrupt(self, irq):
        assert self.board.nvic.enabled(irq)
        self._call(self.vectors[16 + irq])

    def requested(self):
        """The interrupt of the highest priority that a peripheral requests, or None."""
        board = self.board
        requests = (
            (PVD, lambda: board.exti.interrupt(16)),
            (INDEX, lambda: board.exti.interrupt(3)),
            (CAN_RX0, board.can.interrupt),
            (USART2, board.usart.interrupt),
            (EXTI15_10, lambda: board.exti.interrupt(12)),
            (DMA1_STREAM3, board.dma.interrupt),
            (CAN2_RX0, board.can2.interrupt),
            (CAN2_TX, lambda: board.nvic.take(CAN2_TX) or board.can2.sent_interrupt()),
        )
        return self.first(requests)

    def first(self, requests):
        """The first interrupt of [(number, whether it is requested)] that is enabled, or None."""
        nvic = self.board.nvic
        return next((irq for irq, requested in requests if nvic.enabled(irq) and requested()), None)

    def interrupts(self):
        """Serves the interrupts that peripherals request, until none is pending."""
        for _ in range(2000):
            irq = self.requested()
            if irq is None:
                return
            self.interrupt(irq)
        raise Stuck("an interrupt that does not end")

    def tick(self, count=1, hung=False, late_cycles=0):
        """Interrupts of the timer, with the other pending interrupts before each, so many cycles
        late; after each the main loop, unless it is hung; then what the bus carries in a tick."""
        for _ in range(count):
            self.interrupts()
            timer = self.board.tim4
            self.convert(self.board.time_s() + (timer.next - self.board.cycles) / 168e6)
            assert timer[0x00] & 1 and timer[0x0C] & 1, "the timer is off"
            if not timer.pending():
                timer.wrap()
            self.board.advance(ENTRY_CYCLES + late_cycles)
            self.interrupt(TICK)
            self.tick_steps = self.steps
            if not hung:
                self.main()
            self.board.can.transmit()
            self.board.can.tick()
            self.board.can2.tick()

    def convert(self, until_s):
        """The conversions of the converter at SPI2 up to a time; each one interrupts."""
        converter = self.board.converter
        while converter is not None and converter.next_s <= until_s:
            converter.run(converter.next_s)
            if converter.ready:
                self.board.exti.edge(12, False)
            self.interrupts()

    def main(self, rounds=1):
        """The main loop from idle to idle."""
        for _ in range(rounds):
            self.interrupts()
            self._run(self.uc.reg_read(arm_const.UC_ARM_REG_LR), 0xFFFFFFFE)
            self.main_steps = self.steps
            assert self.uc.reg_read(arm_const.UC_ARM_REG_PC) & ~1 == self.idle
            self.interrupts()

    # The firmware's objects.

    def write(self, name, value, source=LOCAL):
        """Writes an object as `source` does. Returns the firmware's error code, 0 for none."""
        number = objects.BY_NAME[name].number
        return self.call("dictionary_write", self.symbols["firmware"], source, number, value)

    def read(self, name):
        at = RAM + RAM_BYTES - 16
        number = objects.BY_NAME[name].number
        assert self.call("dictionary_read", self.symbols["firmware"], number, at) == 0
        return struct.unpack("<i", self.uc.mem_read(at, 4))[0]

    def text(self, index):
        at = self.call("dictionary_text", self.symbols["firmware"], index) & 0xFFFFFFFF
        return bytes(self.uc.mem_read(at, 64)).split(b"\0")[0].decode()

    # The board.

    def close_contacts(self):
        """Enable chain closed, neither limit switch reached."""
        self.board.gpioc.wires |= {0: 1, 1: 1, 2: 1}

    def terminals(self):
        """(amplifier, brake, volts)"""
        self.board.look()
        return self.board.trail[-1]


def release(chip):
    """A booted chip with closed contacts, ticking."""
    chip.close_contacts()
    chip.boot()
    chip.tick(4)
    return chip
