"""Models of the STM32F446's peripherals, written from the reference manual RM0390 (register maps at
the end of each chapter) and the ARMv7-M manual, with addresses and bits of their own: nothing here
is taken from the port. Violations of the manual are recorded in `Board.mistakes`.

Time is under a test's control: a conversion takes a number of reads of its status register, a PLL
locks after a number of reads, a CAN bus moves when Can.bits() is called, the core's clock when
Board.advance() is.
"""

import math
from collections import defaultdict
from typing import ClassVar

SUPPLY_V = 3.3
HSI_HZ = 16e6
READS_UNTIL_READY = 3
NEVER = 1 << 60

GPIOA, GPIOB, GPIOC = 0x40020000, 0x40020400, 0x40020800
CRC_UNIT, RTC, PWR, DBGMCU, MPU = 0x40023000, 0x40002800, 0x40007000, 0xE0042000, 0xE000ED90
RCC, FLASH = 0x40023800, 0x40023C00
TIM2, TIM4, TIM5, ADC, DAC = 0x40000000, 0x40000800, 0x40000C00, 0x40012000, 0x40007400
SYSCFG, EXTI = 0x40013800, 0x40013C00
CAN1, CAN2, USART2, IWDG = 0x40006400, 0x40006800, 0x40004400, 0x40003000
DMA1, SPI2 = 0x40026000, 0x40003800
NVIC, SCB = 0xE000E100, 0xE000ED00


def bits(value, at, width=1):
    return value >> at & (1 << width) - 1


class Peripheral:
    """Registers that hold what is written, unless a model overrides read() or write()."""

    size = 0x400
    reset: ClassVar[dict[int, int]] = {}  # offset: value

    def __init__(self, board):
        self.board = board
        self.registers = defaultdict(int, self.reset)

    def __getitem__(self, offset):
        return self.registers.get(offset, 0)

    def read(self, offset):
        return self[offset]

    def write(self, offset, value):
        self.registers[offset] = value


class Rcc(Peripheral):
    """7.3: PLLRDY follows PLLON after a while, SWS follows SW once that clock is ready, HSERDY
    follows HSEON where there is a clock at the pin and HSEBYP says that it is one."""

    reset: ClassVar = {0x00: 0x83, 0x04: 0x24003010, 0x30: 0}
    CAUSES = 0x74  # of the last reset: RCC_CSR
    lock_reads = READS_UNTIL_READY
    reads = 0
    switches = True
    hse_hz: float | None = 8e6  # at the pin OSC_IN: the ST-Link's output on a Nucleo
    hsi_hz = HSI_HZ
    nmi = False  # requested by the clock security system

    def source(self):
        """Input of the PLL in Hz."""
        return (self.hse_hz or 0.0) if bits(self[0x04], 22) else self.hsi_hz

    def has_hse(self):
        return self.hse_hz is not None and bits(self[0x00], 16) and bits(self[0x00], 18)

    def read(self, offset):
        if offset == 0x00:
            ready = (bits(self[0x00], 0) and 2) | (1 << 17 if self.has_hse() else 0)
            if bits(self[0x00], 24):
                self.reads += 1
                if self.reads >= self.lock_reads and (ready >> 17 or not bits(self[0x04], 22)):
                    ready |= 1 << 25
            self.registers[0x00] = self[0x00] & ~(1 << 25 | 1 << 17 | 2) | ready
        if offset == 0x08 and self.switches:
            wanted = bits(self[0x08], 0, 2)
            if wanted == 0 or (wanted == 2 and bits(self[0x00], 25)):
                self.registers[0x08] = self[0x08] & ~0xC | wanted << 2
        if offset == 0x74:
            return self[0x74] & ~2 | bits(self[0x74], 0) << 1
        return self[offset]

    def write(self, offset, value):
        if offset == 0x00:
            if (value ^ self[0x00]) >> 18 & 1 and bits(self[0x00], 16):
                self.board.mistakes.append("HSEBYP written while the HSE is on")
            if bits(self[0x08], 2, 2) == 2 and not bits(value, 24):
                self.board.mistakes.append("the PLL switched off while it is the core's clock")
            if not bits(value, 24):
                self.reads = min(self.reads, 0) if self.lock_reads != NEVER else self.reads
            value = value & ~(1 << 25) | (self[0x00] & 1 << 25 if bits(value, 24) else 0)
        if offset == 0x70:
            if not bits(self.board.pwr[0x00], 8):
                self.board.mistakes.append("the backup domain written without DBP")
                return
            if bits(value, 16):
                value = 1 << 16
                self.board.rtc.reset_domain()
            elif bits(self[0x70], 8, 2) and bits(value ^ self[0x70], 8, 2):
                self.board.mistakes.append("RTCSEL written twice")
        if offset == 0x74:  # RMVF clears the causes of the reset
            value = value & 1 if bits(value, 24) else self[0x74] & 0xFE000000 | value & 1
        if offset == 0x04 and bits(self[0x00], 24):
            self.board.mistakes.append("PLLCFGR written while the PLL is on")
        if offset == 0x08:
            value = value & ~0xC | self[0x08] & 0xC
            if bits(value, 0, 2) == 2:
                if not bits(self[0x00], 25):
                    self.board.mistakes.append("switched to a PLL that is not ready")
                if not self.board.pwr.is_ready():
                    self.board.mistakes.append("switched to a PLL before VOSRDY")
                if self.board.flash[0x00] & 7 < 5:
                    self.board.mistakes.append("168 MHz with too few wait states")
                if bits(value, 10, 3) < 5 or bits(value, 13, 3) < 4:
                    self.board.mistakes.append("APB1 above 45 MHz, or APB2 above 90 MHz")
            elif bits(value, 0, 2) == 3:
                self.board.mistakes.append("reserved clock selected")
        self.registers[offset] = value

    def hse_stops(self):
        """7.2.7: with CSSON, where the HSE is the core's clock by way of the PLL, the core goes on
        with the HSI, HSE and PLL are off, and an NMI is requested."""
        self.hse_hz = None
        if bits(self[0x00], 19) and bits(self[0x04], 22):
            self.registers[0x00] = self[0x00] & ~(1 << 16 | 1 << 17 | 1 << 24 | 1 << 25) | 3
            self.registers[0x08] = self[0x08] & ~0xF
            self.nmi = True

    def core_hz(self):
        self.read(0x08)
        if bits(self[0x08], 2, 2) == 0:
            return self.hsi_hz
        m, n = bits(self[0x04], 0, 6), bits(self[0x04], 6, 9)
        pll = self.source() / m * n / (2 * bits(self[0x04], 16, 2) + 2)
        prescaler = bits(self[0x08], 4, 4)
        return pll / (1 if prescaler < 8 else 2 ** (prescaler - 7))

    def is_within_bounds(self):
        m, n = bits(self[0x04], 0, 6), bits(self[0x04], 6, 9)
        vco_in = self.source() / m
        return 0.95e6 <= vco_in <= 2.1e6 and 100e6 <= vco_in * n <= 432e6

    def bus_hz(self, at):
        prescaler = bits(self[0x08], at, 3)
        return self.core_hz() / (1 if prescaler < 4 else 2 ** (prescaler - 3))

    def apb1_hz(self):
        return self.bus_hz(10)

    def apb2_hz(self):
        return self.bus_hz(13)

    def clocked(self, offset, bit):
        return bool(bits(self[offset], bit))


class Pwr(Peripheral):
    """5.4: VOSRDY some time after the PLL is on; PVDO while the supply is below what PLS says."""

    LEVELS_V = (2.0, 2.1, 2.3, 2.5, 2.6, 2.7, 2.8, 2.9)
    reset: ClassVar = {0x00: 0xC000}
    reads = 0

    def is_ready(self):
        return bool(bits(self.board.rcc[0x00], 24)) and self.reads >= READS_UNTIL_READY

    def is_low(self):
        level = self.LEVELS_V[bits(self[0x00], 5, 3)]
        return bool(bits(self[0x00], 4)) and self.board.supply_v < level

    def read(self, offset):
        if offset == 0x04:
            self.reads += bool(bits(self.board.rcc[0x00], 24))
            return (1 << 14 if self.is_ready() else 0) | (4 if self.is_low() else 0)
        return self[offset]


class Rtc(Peripheral):
    """22: counts RTCCLK / (PREDIV_A + 1) down from PREDIV_S in SSR; its registers open by two keys,
    the prescalers in initialisation; SSR is read past its shadow with BYPSHAD alone."""

    reset: ClassVar = {0x0C: 0x07, 0x10: 0x007F00FF}
    CONTROL, COUNT, BACKUP, LSI = 0x08, 0x28, 0x70, 0x74  # CR, SSR; RCC_BDCR, RCC_CSR
    lsi_hz = 32e3
    # Erratum of several families (ES0430 and others: unstable LSI when it clocks RTC): after a
    # power-up the rate may wander until the backup domain is reset.
    wander = 0.0  # share by which the rate changes to and fro until that reset
    open = False
    keys: ClassVar[list[int]] = []

    def reset_domain(self):
        self.registers.clear()
        self.wander = 0.0

    def rate_hz(self):
        slow = int(self.board.seconds / 7e-3) % 2 == 0
        return self.lsi_hz * (1 - self.wander if slow else 1 + self.wander)

    def write(self, offset, value):
        if offset == 0x24:
            self.keys = [*self.keys, value][-2:]
            self.open = self.keys == [0xCA, 0x53]
            return
        if not self.open:
            self.board.mistakes.append("RTC written without its keys")
            return
        if offset == 0x10 and not bits(self[0x0C], 6):
            self.board.mistakes.append("RTC_PRER written outside initialisation")
            return
        if offset == 0x0C:
            value = value & ~0x40 | (0x40 if value & 0x80 else 0)
        self.registers[offset] = value

    def read(self, offset):
        if offset != self.COUNT:
            return self[offset]
        self.board.advance(6)
        rcc = self.board.rcc
        if not bits(rcc[self.BACKUP], 15) or bits(rcc[self.BACKUP], 8, 2) != 2:
            return 0
        if not bits(rcc[self.LSI], 0):
            return 0
        if not bits(self[self.CONTROL], 5) or bits(self[0x0C], 6):
            return 0
        divider = bits(self[0x10], 16, 7) + 1
        count = int(self.board.lsi_counts / divider)
        return bits(self[0x10], 0, 15) - count % (bits(self[0x10], 0, 15) + 1)


class CrcUnit(Peripheral):
    """4: CRC-32 of words, each from its highest bit on, from all ones."""

    def __init__(self, board):
        super().__init__(board)
        self.words = []

    def write(self, offset, value):
        if offset == 0x08 and value & 1:
            self.words = []
        elif offset == 0x00:
            self.words.append(value)

    def read(self, offset):
        if offset != 0x00:
            return self[offset]
        crc = 0xFFFFFFFF
        for word in self.words:
            crc ^= word
            for _ in range(4):
                crc = (crc << 8 ^ CRC_TABLE[crc >> 24]) & 0xFFFFFFFF
        return crc


def crc_step(byte):
    crc = byte << 24
    for _ in range(8):
        crc = (crc << 1 ^ (0x04C11DB7 if crc >> 31 else 0)) & 0xFFFFFFFF
    return crc


CRC_TABLE = [crc_step(byte) for byte in range(256)]


class Stalled(Exception):
    """The core waits on the bus for ever: nothing executes until the watchdog resets the chip."""


class Flash(Peripheral):
    """3.8, and the sectors that the firmware may write: 1 and 2 with the parameters, 16 KiB each
    from 0x08004000, and of the slots, sectors 5 and 6, the one that does not run."""

    BASE, SECTOR = 0x08004000, 0x4000
    SLOTS, SLOT = 0x08020000, 0x20000
    POLL_CYCLES = 20_000  # of an erase that takes its time
    # BOR_LEV 0 and nWRP0 0: as `forceaxis flash` sets them.
    reset: ClassVar = {0x10: 0x80000000, 0x14: 0x0FFEAAE1}
    WRITABLE = 0x8301037F  # of FLASH_CR (3.8.5)
    busy_reads = READS_UNTIL_READY
    prepared = None  # CR as it stood when STRT was written
    nmi = False  # never requested by this flash

    def __init__(self, board):
        super().__init__(board)
        self.bytes = bytearray(b"\xff" * 2 * self.SECTOR)
        self.slots = bytearray(b"\xff" * 2 * self.SLOT)
        self.other = 6  # sector of the slot that does not run
        # Words of the trailer of the running slot that may be programmed: `confirmed`; by the
        # loader, the tries.
        self.words_of_trailer = {16}
        self.keys = []
        self.busy = 0
        self.erase_s = 0.0
        self.erased_at = 0  # cycle
        self.fail = None  # error bit that the next operations end with
        self.protected = set()  # sectors
        self.words = 0
        self.erased = []
        self.cut_after = None  # words or erases until the power fails
        self.polled_idle = False  # BSY was read as 0 since the last operation

    def error(self, bit):
        self.registers[0x0C] = self[0x0C] | 1 << bit

    def read_stored(self, offset, size):
        return int.from_bytes(self.bytes[offset : offset + size], "little")

    def read(self, offset):
        if offset == 0x0C:
            if self.board.cycles < self.erased_at:
                self.board.advance(self.POLL_CYCLES)
                return self[0x0C] | 1 << 16
            if self.busy > 0:
                self.busy -= self.busy < NEVER
                return self[0x0C] | 1 << 16
            self.polled_idle = True
            return self[0x0C]
        return self[offset]

    def write(self, offset, value):
        if offset == 0x04:
            # 3.5.1: keys in another order lock the register until the next reset.
            if not bits(self[0x10], 31):
                self.board.mistakes.append("keys written to a flash that is not locked")
            self.keys = [*self.keys, value][-2:]
            if self.keys == [0x45670123, 0xCDEF89AB]:
                self.registers[0x10] = self[0x10] & ~(1 << 31)
        elif offset == 0x0C:
            self.registers[0x0C] = self[0x0C] & ~value
        elif offset == 0x14:
            self.board.mistakes.append("option bytes written while they are locked")
        elif offset == 0x10:
            if value & ~self.WRITABLE:
                self.board.mistakes.append("reserved bits of FLASH_CR written")
            # 3.8.5: a write of CR while BSY is set stalls the bus until it is not.
            if self.busy >= NEVER:
                raise Stalled("FLASH_CR written while the flash is busy for ever")
            if self.busy > 0 or self.board.cycles < self.erased_at:
                self.board.mistakes.append("FLASH_CR written while the flash is busy")
            if bits(self[0x10], 31):
                self.board.mistakes.append("FLASH_CR written while locked")
                return
            # 3.6.3: BSY is looked at, then SER and SNB are set, then STRT.
            if bits(value, 16) and self[0x10] & 0x37E != value & 0x37E:
                self.board.mistakes.append("erase started together with its sector")
            self.registers[0x10] = value & ~(1 << 16)
            if bits(value, 16):
                if self.polled_idle is False:
                    self.board.mistakes.append("erase started without a look at BSY")
                self.erase(bits(value, 1), bits(value, 2), bits(value, 3, 4))
        elif offset == 0x00 and bits(value, 12) and bits(value, 10):
            self.board.mistakes.append("data cache reset while it is on")
        else:
            self.registers[offset] = value

    def erase(self, sector_erase, mass_erase, number):
        assert sector_erase and not mass_erase, "erased everything"
        assert number in (1, 2, self.other), "erased what is neither the store nor the other slot"
        self.busy, self.polled_idle = self.busy_reads, False
        self.erased_at = self.board.cycles + round(self.erase_s * self.board.rcc.core_hz())
        if number in self.protected:
            self.error(4)
        elif self.fail is not None:
            self.error(self.fail)
        else:
            is_slot = number == self.other
            memory, size = (self.slots, self.SLOT) if is_slot else (self.bytes, self.SECTOR)
            at = (number - (5 if is_slot else 1)) * size
            memory[at : at + size] = b"\xff" * size
            self.erased.append(number)

    def program_slot(self, at, size, value):
        """Programs bytes of the slots: of the one that does not run, or the word that confirms the
        image that runs."""
        trailer = (0 if self.other == 6 else self.SLOT) + self.SLOT - 64
        is_other = at // self.SLOT == self.other - 5
        assert is_other or at - trailer in self.words_of_trailer, (
            f"programmed {self.SLOTS + at:#x} of the running slot"
        )
        self.program(at, size, value, self.slots, 5 + at // self.SLOT)

    def program(self, at, size, value, memory=None, sector=None):
        control = self[0x10]
        if bits(control, 31) or not bits(control, 0) or self.busy > 0:
            self.error(7)  # PGSERR
            return
        if size != 1 << bits(control, 8, 2):
            self.error(6)  # PGPERR
            return
        self.busy, self.polled_idle = self.busy_reads, False
        memory, sector = memory or self.bytes, sector or 1 + at // self.SECTOR
        if sector in self.protected:
            self.error(4)  # WRPERR
        elif self.fail is not None:
            self.error(self.fail)
        else:
            for i, byte in enumerate(value.to_bytes(size, "little")):
                memory[at + i] &= byte
            self.words += 1


class Gpio(Peripheral):
    """8.4: the mode decides what a pin does; an input reads its wire, or else its pull."""

    def __init__(self, board, name, moder):
        super().__init__(board)
        self.name = name
        self.registers[0x00] = moder
        self.wires = {}  # pin: level driven from outside
        self.shorts = {}  # pin: level that something stronger than the pin holds

    def mode(self, pin):
        return bits(self[0x00], 2 * pin, 2)

    def function(self, pin):
        return bits(self[0x20 if pin < 8 else 0x24], 4 * (pin % 8), 4)

    def level(self, pin):
        if self.name == "C" and pin == 12 and self.board.converter is not None:
            if not self.board.exti[0x00] >> 12 & 1:  # else Chip.convert() makes its edges
                self.board.converter.run(self.board.time_s())
            return 0 if self.board.converter.ready else 1
        if pin in self.shorts:
            return self.shorts[pin]
        if self.mode(pin) == 1:
            return bits(self[0x14], pin)
        if pin in self.wires:
            return self.wires[pin]
        return 1 if bits(self[0x0C], 2 * pin, 2) == 1 else 0

    def read(self, offset):
        if offset == 0x10:
            return sum(self.level(pin) << pin for pin in range(16))
        return self[offset]

    def write(self, offset, value):
        if offset == 0x18:
            odr = self[0x14] & ~(value >> 16)
            self.registers[0x14] = (odr | value & 0xFFFF) & 0xFFFF
        else:
            self.registers[offset] = value
        self.board.look()


class Syscfg(Peripheral):
    """8.2: EXTICR1 to 4 select the port of each line, four bits a line."""

    def port(self, line):
        return bits(self[0x08 + line // 4 * 4], 4 * (line % 4), 4)


class Exti(Peripheral):
    """10.2, 10.3: a selected edge sets the pending bit of a line that is not masked. The mask is
    between the edge detector and that bit, so an edge on a masked line is lost, as others measured
    on this chip. Writing 1 clears the bit. A software trigger, written 1 where it is 0, acts as an
    edge if the line is not masked, and stays until the pending bit is cleared (10.3.5). Line 16 is
    the supply's detector."""

    LINES = 0x7FFFFF

    def pend(self, lines):
        self.registers[0x14] = self[0x14] | lines & self[0x00]

    def supply_edge(self, rising):
        self.pend(self[0x08 if rising else 0x0C] & 1 << 16)

    def interrupt(self, line):
        """Returns True while the line requests its interrupt."""
        return bool(bits(self[0x14] & self[0x00], line))

    def edge(self, pin, rising):
        if self.board.syscfg.port(pin) == 2:
            self.pend(self[0x08 if rising else 0x0C] & 1 << pin)

    def write(self, offset, value):
        if value & ~self.LINES:
            self.board.mistakes.append("reserved line of EXTI written")
        if offset == 0x10:
            triggered = value & ~self[0x10]
            self.registers[0x10] = self[0x10] | value
            self.pend(triggered)
        elif offset == 0x14:
            self.registers[0x14] = self[0x14] & ~value
            self.registers[0x10] = self[0x10] & ~value
        else:
            self.registers[offset] = value


class Tim5(Peripheral):
    """17.3.12: in encoder mode 3 the counter follows both edges of TI1 and TI2, up to ARR. 17.3.5,
    17.4.8: a channel that is an input with IC3 mapped on TRC captures the counter at the internal
    trigger that TS selects, 2 for timer 4 (table 97). 17.4.3: TS is changed only while SMS is 0."""

    reset: ClassVar = {0x2C: 0xFFFFFFFF}
    TRC, CC3IF, CC3OF = 3, 1 << 3, 1 << 11

    def write(self, offset, value):
        if offset == 0x08 and bits(self[0x08], 0, 3) and bits(value ^ self[0x08], 4, 3):
            self.board.mistakes.append("TS changed while the slave mode is on")
        for place, at, channel in ((0x18, 0, 0), (0x18, 8, 4), (0x1C, 0, 8)):  # CC1S, CC2S, CC3S
            changed = offset == place and bits(value ^ self[place], at, 2)
            if changed and bits(self[0x20], channel):
                self.board.mistakes.append("CCxS changed while the channel is on")
        self.registers[offset] = self[0x10] & value if offset == 0x10 else value

    def read(self, offset):
        if offset == 0x3C:
            self.registers[0x10] = self[0x10] & ~self.CC3IF
        return self[offset]

    def trigger(self, number):
        """The rising edge of an internal trigger."""
        captures = bits(self[0x20], 8) and bits(self[0x1C], 0, 2) == self.TRC
        if captures and bits(self[0x08], 4, 3) == number:
            over = self.CC3OF if self[0x10] & self.CC3IF else 0
            self.registers[0x10] = self[0x10] | self.CC3IF | over
            self.registers[0x3C] = self[0x24]

    def turn(self, counts):
        port = self.board.gpioa
        connected = all(port.mode(p) == 2 and port.function(p) == 2 for p in (0, 1))
        selected = bits(self[0x18], 0, 2) == 1 and bits(self[0x18], 8, 2) == 1
        if connected and selected and bits(self[0x00], 0) and bits(self[0x08], 0, 3) == 3:
            self.registers[0x24] = (self[0x24] + counts) % (self[0x2C] + 1)


class Tim2(Peripheral):
    """17.3: counts its clock, twice that of APB1 where that is divided (6.2), up to ARR."""

    reset: ClassVar = {0x2C: 0xFFFFFFFF}
    started = None  # cycle

    def write(self, offset, value):
        self.registers[offset] = value
        if offset == 0x00 and value & 1 and self.started is None:
            self.started = self.board.cycles

    def read(self, offset):
        if offset != 0x24 or self.started is None:
            return self[offset]
        self.board.advance(4)
        rcc = self.board.rcc
        clock = rcc.apb1_hz() * (1 if rcc.apb1_hz() == rcc.core_hz() else 2)
        count = (self.board.cycles - self.started) * clock / rcc.core_hz()
        return int(count) % (self[0x2C] + 1)


class Tim4(Peripheral):
    """17.3: counts its clock, as timer 2, from 0 to ARR and again from 0. The overflow is the
    update event: it sets UIF, requests an interrupt with UIE, and is the trigger output with MMS 2.
    """

    reset: ClassVar = {0x2C: 0xFFFF}
    IRQ, JEXTSEL = 30, 9
    TRIGGER = 2  # internal trigger of timer 5
    next = NEVER  # cycle of the next overflow

    def period(self):
        """Cycles of the core between two overflows."""
        rcc = self.board.rcc
        clock = rcc.apb1_hz() * (1 if rcc.apb1_hz() == rcc.core_hz() else 2)
        return (self[0x2C] + 1) * (self[0x28] + 1) * rcc.core_hz() / clock

    def read(self, offset):
        if offset == 0x24 and self.next != NEVER:
            self.board.advance(4)
            left = (self.next - self.board.cycles) / self.period()
            return int((self[0x2C] + 1) * (1 - left))
        return self[offset]

    def write(self, offset, value):
        if offset == 0x00 and value & 1 and not self[0x00] & 1:
            self.next = self.board.cycles + self.period()
        self.registers[offset] = self[0x10] & value if offset == 0x10 else value

    def pending(self):
        """True while the interrupt is requested."""
        return bool(self[0x10] & self[0x0C] & 1)

    def wrap(self):
        """Time goes on to the next overflow."""
        self.board.advance(self.next - self.board.cycles)

    def reached(self, cycles):
        while self.next <= cycles:
            self.next += self.period()
            self.registers[0x10] = self[0x10] | 1
            if bits(self[0x04], 4, 3) == 2:
                self.board.tim5.trigger(self.TRIGGER)
                self.board.adc.trigger(self.JEXTSEL)


class Adc(Peripheral):
    """13: an injected group of JL + 1 conversions, the last places of JSQR, in scan mode. The
    registers common to all converters lie at 0x300. The sampling capacitor keeps the voltage of the
    conversion before, and the source of a channel charges it through its resistance and that of the
    switch during the sampling time (data sheet: at most 7 pF and 6 kOhm)."""

    CAPACITANCE_F, SWITCH_OHM = 7e-12, 6e3

    SAMPLE_CYCLES = (3, 15, 28, 56, 84, 112, 144, 480)
    REFERENCE_V = 1.21
    READ_CYCLES = 6  # of the core, over a bus half as fast
    ready_reads = READS_UNTIL_READY
    single = None  # regular conversion under way, of that channel
    single_at = 0  # cycle at which it ends
    on_s = math.inf  # when ADON was set

    def __init__(self, board):
        super().__init__(board)
        self.volts = {}  # channel: input
        self.source_ohm = {}  # channel: resistance of its source
        self.held = 0.0  # share of the supply at the sampling capacitor
        self.shares = []  # shares of the injected group that is converted
        self.waiting = None  # reads until the conversion is done
        self.reads = 0
        self.conversions = 0

    def group(self):
        count = bits(self[0x38], 20, 2) + 1
        if count > 1 and not bits(self[0x04], 8):
            count = 1  # without SCAN only the first one
        first = 4 - (bits(self[0x38], 20, 2) + 1)
        return [bits(self[0x38], 5 * (first + i), 5) for i in range(count)]

    def duration_s(self):
        divider = 2 * bits(self[0x304], 16, 2) + 2
        clock = self.board.rcc.apb2_hz() / divider
        assert clock <= 36e6 or not self.board.rcc.is_within_bounds()
        width = 12 - 2 * bits(self[0x04], 24, 2)
        cycles = sum(
            self.SAMPLE_CYCLES[bits(self[0x10], 3 * channel, 3)] + width for channel in self.group()
        )
        return cycles / clock

    def sample_s(self, channel):
        register, place = (0x0C, channel - 10) if channel > 9 else (0x10, channel)
        cycles = self.SAMPLE_CYCLES[bits(self[register], 3 * place, 3)]
        return cycles * (2 * bits(self[0x304], 16, 2) + 2) / self.board.rcc.apb2_hz()

    def source_max_ohm(self, channel):
        """Of what may drive that channel, for a quarter of a code: data sheet, (k - 0.5) / (f C
        ln(2^14)) - R_ADC, with at most 7 pF and 6 kOhm."""
        half = 0.5 * (2 * bits(self[0x304], 16, 2) + 2) / self.board.rcc.apb2_hz()
        return (self.sample_s(channel) - half) / (7e-12 * math.log(2**14)) - 6e3

    def of_channel(self, channel):
        if channel == 17:
            volts = (
                self.REFERENCE_V if bits(self[0x304], 23) and self.sample_s(17) >= 10e-6 else 0.0
            )
            return volts / self.board.supply_v
        if channel == 4 and self.board.gpioa.mode(4) == 3:
            return self.board.dac.pin_v() / SUPPLY_V
        return (
            self.volts.get(channel, 0.0) / SUPPLY_V if self.board.gpioa.mode(channel) == 3 else 0.0
        )

    def sampled(self, channel):
        """The share of the supply at the end of the sampling time of a channel."""
        wanted = self.of_channel(channel)
        time_constant_s = (self.source_ohm.get(channel, 0.0) + self.SWITCH_OHM) * self.CAPACITANCE_F
        rest = math.exp(-self.sample_s(channel) / time_constant_s)
        self.held = wanted + (self.held - wanted) * (rest if self.source_ohm else 0.0)
        return self.held

    def read(self, offset):
        if offset in (0x00, 0x04):
            self.board.advance(self.READ_CYCLES)
        if offset == 0x4C:
            self.registers[0x00] = self[0x00] & ~2  # EOC goes with the result
        if offset == 0x00 and self.single is not None and self.board.cycles >= self.single_at:
            share, self.single = self.sampled(self.single), None
            self.registers[0x4C] = min(max(int(share * 4096), 0), 4095)
            self.registers[0x00] = self[0x00] | 2
        if offset == 0x00 and self.waiting is not None:
            self.reads += 1
            self.waiting -= 1
            if self.waiting <= 0:
                self.finish()
        return self[offset]

    def check(self, offset, value):
        """13.3.6: 3 us from ADON to a start. ES0298 2.6.1: a sequence that is written while a
        conversion runs resets that conversion. 13.13: sampling times likewise."""
        if offset in (0x0C, 0x10, 0x2C, 0x34, 0x38):
            waits = self.waiting is not None and self.ready_reads < NEVER and offset != 0x34
            if waits or (self.single is not None and self.board.cycles < self.single_at):
                self.board.mistakes.append(f"ADC {offset:#x} written during a conversion")
        if offset == 0x08:
            if bits(value, 0) and not bits(self[0x08], 0):
                self.on_s = self.board.time_s()
            if bits(value, 30) and not self.board.time_s() - self.on_s >= 3e-6:
                self.board.mistakes.append("ADC started before it is stable")

    def write(self, offset, value):
        if offset == 0x00:
            self.registers[0x00] = self[0x00] & value  # written 0 clears
            return
        self.check(offset, value)
        if offset == 0x08 and bits(value, 30):
            value &= ~(1 << 30)
            assert bits(self[0x2C], 20, 4) == 0, "a group of one"
            self.single = bits(self[0x34], 0, 5)
            took = self.sample_s(self.single) + 12 / 21e6 + self.duration_s()
            self.single_at = self.board.cycles + took * self.board.rcc.core_hz()
        self.registers[offset] = value

    def trigger(self, number):
        """13.3.10, table 70: with JEXTEN 1, the rising edge of the trigger JEXTSEL starts the
        injected group. The inputs are sampled then."""
        cr2 = self[0x08]
        if bits(cr2, 0) and bits(cr2, 20, 2) == 1 and bits(cr2, 16, 4) == number:
            self.waiting = self.ready_reads
            self.conversions += 1
            self.shares = [self.sampled(channel) for channel in self.group()]

    def finish(self):
        self.waiting = None
        width = 12 - 2 * bits(self[0x04], 24, 2)
        for i, share in enumerate(self.shares):
            code = min(max(int(share * (1 << width)), 0), (1 << width) - 1)
            self.registers[0x3C + 4 * i] = code
        self.registers[0x00] = self[0x00] | 1 << 2  # JEOC


class Dac(Peripheral):
    """14: without a trigger DHR goes to DOR; a channel that is off leaves its pin alone."""

    stuck_v = None  # the pin, held by something stronger

    def write(self, offset, value):
        self.registers[offset] = value
        if offset == 0x08:
            self.registers[0x2C] = value & 0xFFF
        if bits(self[0x00], 2):
            self.board.mistakes.append("DAC waits for a trigger")
        self.board.look()

    def pin_v(self):
        """The bias of the board makes half the supply of a pin that nothing drives."""
        if self.stuck_v is not None:
            return self.stuck_v
        if bits(self[0x00], 0) and self.board.gpioa.mode(4) == 3:
            volts = SUPPLY_V * self[0x2C] / 4096
            # With its output buffer the converter reaches no closer to the rails than 0.2 V.
            buffered = not bits(self[0x00], 1)
            return min(max(volts, 0.2), SUPPLY_V - 0.2) if buffered else volts
        return SUPPLY_V / 2

    def stage_v(self):
        return (self.pin_v() - SUPPLY_V / 2) * 20 / SUPPLY_V


class Can(Peripheral):
    """30: bxCAN. Frames are (id, data, extended, remote). `pins` are those of port B, in and out.
    The filters of both controllers lie in the registers of the first one, `filters`; those from
    CAN2SB on belong to the second one (30.7.4, 30.9.5)."""

    reset: ClassVar = {
        0x00: 0x00010002,
        0x04: 0x00000C02,
        0x08: 0x1C000000,
        0x1C: 0x01230000,
        0x200: 0x2A1C0E01,
    }
    SEQUENCES = 128  # of 11 recessive bits, until a controller that was bus off is back
    FRAME_BITS = 135  # longest standard frame with its pause: the time between two sequences

    def __init__(self, board, pins=(8, 9), filters=None):
        super().__init__(board)
        self.pins, self.filters = pins, filters or self
        self.fifo = []
        self.requests = []  # mailboxes in order of their request
        self.sent = []
        self.recovering = False  # asked by software to leave bus off
        self.sequences = 0  # seen while recovering
        self.rest_bits = 0.0
        self.dominant = False  # the bus is stuck
        self.busy = False  # others send without a gap
        self.partner = True  # another node acknowledges
        self.answers_init = True
        self.aborted = 0  # frames

    # The controller's own state.

    def initialising(self):
        return bool(self[0x04] & 1)

    def write(self, offset, value):
        if offset == 0x00:
            self.registers[0x00] = value
            if not value & 2:
                self.registers[0x04] &= ~2  # SLAK
            if value & 1 and self.answers_init:
                # Nothing is monitored in initialisation: what was counted is lost.
                self.registers[0x04] |= 1
                self.recovering, self.sequences = bool(self[0x18] & 4), 0
        elif offset == 0x08:
            for box in range(3):
                if value >> 8 * box & 1:  # RQCP, TXOK, ALST and TERR go together
                    self.registers[0x08] &= ~(0xF << 8 * box)
                self.aborted += bool(value >> (8 * box + 7) & 1 and box in self.requests)
                if value >> (8 * box + 7) & 1 and box in self.requests:
                    self.requests.remove(box)
                    self.empty(box)
        elif offset == 0x0C:
            self.registers[0x0C] = self[0x0C] & ~(value & 0x18)
            if value & 0x20 and self.fifo:
                self.fifo.pop(0)
        elif offset == 0x1C and not self.initialising():
            self.board.mistakes.append("bit timing written outside initialisation")
        elif offset >= 0x200 and self.filters is not self:
            self.board.mistakes.append("filters of the first controller written at the second one")
        elif (
            0x240 <= offset < 0x320
            and not self[0x200] & 1
            and self.is_active((offset - 0x240) // 8)
        ):
            self.board.mistakes.append("active filter written")
        elif offset in (0x204, 0x20C, 0x214) and not self[0x200] & 1:
            self.board.mistakes.append("filters set outside their initialisation")
        elif 0x180 <= offset < 0x1B0:
            box = (offset - 0x180) // 16
            if box in self.requests:  # 30.7.1: a mailbox that is not empty is write protected
                self.board.mistakes.append("mailbox written while its frame waits")
                return
            self.registers[offset] = value
            if offset % 16 == 0 and value & 1:
                self.requests.append(box)
                self.registers[0x08] &= ~(1 << 26 + box | 0xF << 8 * box)
        else:
            self.registers[offset] = value

    def read(self, offset):
        if offset == 0x0C:
            return self[0x0C] & 0x18 | len(self.fifo)
        if 0x1B0 <= offset < 0x1C0:
            return self.head()[(offset - 0x1B0) // 4] if self.fifo else 0
        return self[offset]

    def empty(self, box):
        self.registers[0x08] |= 1 << 26 + box | 1 << 8 * box  # TME, RQCP
        self.registers[0x180 + 16 * box] &= ~1

    def head(self):
        can_id, data, extended, remote = self.fifo[0]
        word = can_id << 3 | 4 if extended else can_id << 21
        full = data.ljust(8, b"\0")
        low, high = (int.from_bytes(full[i : i + 4], "little") for i in (0, 4))
        return [word | (2 if remote else 0), len(data), low, high]

    # The bus.

    def bit_rate(self):
        btr = self[0x1C]
        quanta = 1 + bits(btr, 16, 4) + 1 + bits(btr, 20, 3) + 1
        return self.board.rcc.apb1_hz() / (bits(btr, 0, 10) + 1) / quanta

    def sample_point(self):
        before = 1 + bits(self[0x1C], 16, 4) + 1
        return before / (before + bits(self[0x1C], 20, 3) + 1)

    def connected(self):
        port = self.board.gpiob
        pins = all(port.mode(p) == 2 and port.function(p) == 9 for p in self.pins)
        return pins and not self.initialising() and not self[0x04] & 2

    def tick(self):
        """What the bus carries in a tick."""
        self.bits(self.bit_rate() / 1500)

    def bits(self, count):
        """So many bits of a bus that is idle, busy or stuck."""
        if self.dominant:
            return
        length = self.FRAME_BITS if self.busy else 11
        self.rest_bits += count
        while self.rest_bits >= length:
            self.rest_bits -= length
            self.sequence()

    def sequence(self):
        """11 recessive bits. 30.4.1, 30.7.8 (INAK): initialisation is left with the first of them
        after INRQ is cleared. 30.7.6: out of bus off after 128, counted in normal mode alone, and
        without ABOM only where software went into initialisation and out of it."""
        if self.initialising():
            if not self[0x00] & 1:
                self.registers[0x04] &= ~1
        elif self[0x18] & 4 and self.recovering:
            self.sequences += 1
            if self.sequences >= self.SEQUENCES:
                self.recovering = False
                self.registers[0x18] = 0

    def is_active(self, bank):
        return bool(self[0x21C] >> bank & 1)

    def accepts(self, can_id, extended):
        """By the filters of this controller for FIFO 0, of 32 bits in mask mode."""
        filters = self.filters
        if filters[0x200] & 1:
            return False
        first = bits(filters[0x200], 8, 6)
        word = can_id << 3 | 4 if extended else can_id << 21
        for bank in range(first) if filters is self else range(first, 28):
            if not filters.is_active(bank) or filters[0x214] >> bank & 1:
                continue
            assert not filters[0x204] >> bank & 1 and filters[0x20C] >> bank & 1, "mask, 32 bits"
            wanted, mask = filters[0x240 + 8 * bank], filters[0x244 + 8 * bank]
            if (wanted ^ word) & mask == 0:
                return True
        return False

    def receive(self, can_id, data=b"", extended=False, remote=False):
        if not self.connected() or self[0x18] & 4 or not self.accepts(can_id, extended):
            return
        if len(self.fifo) == 3:
            self.registers[0x0C] |= 0x10
            if not self[0x00] & 8:  # RFLM
                self.fifo[-1] = (can_id, data, extended, remote)
            return
        self.fifo.append((can_id, data, extended, remote))
        if len(self.fifo) == 3:
            self.registers[0x0C] |= 8

    def transmit(self):
        """Transmits all pending mailboxes. Without a partner a frame is repeated, and each attempt
        adds 8 to the transmit error counter, which ends at 128: error passive (ISO 11898-1)."""
        if not self.partner:
            if self.requests and self.connected() and not self[0x18] & 4:
                count = min(bits(self[0x18], 16, 8) + 8, 128)
                self.registers[0x18] = count << 16 | (2 if count >= 128 else 0)
            return
        while self.requests and self.connected() and not self[0x18] & 4:
            box = self.requests[0]
            if not self[0x00] & 4:  # without TXFP the lowest identifier first
                box = min(self.requests, key=lambda b: self[0x180 + 16 * b])
            self.requests.remove(box)
            head, length, low, high = (self[0x180 + 16 * box + 4 * i] for i in range(4))
            assert not head & 4, "sent an extended frame"
            data = (low | high << 32).to_bytes(8, "little")[: length & 15]
            self.sent.append((head >> 21, data, bool(head & 2)))
            self.empty(box)

    def errors(self, passive=False, off=False):
        self.registers[0x18] = (2 if passive else 0) | (7 if off else 0)
        self.recovering, self.sequences = False, 0

    def interrupt(self):
        return bool(self[0x14] & 2 and self.fifo)

    def sent_interrupt(self):
        return bool(self[0x14] & 1 and self[0x08] & 0x10101)


class Dma(Peripheral):
    """9: streams 3 and 4 of DMA1, channel 0, are SPI2 in and out (table 28). Both together move the
    bytes of a transfer to the device at SPI2 and back."""

    IN, OUT = 0x58, 0x70
    done_s = None  # end of a transfer under way

    def write(self, offset, value):
        if offset in (0x08, 0x0C):
            self.registers[offset - 8] = self[offset - 8] & ~value
            return
        for base, status, flags in ((self.IN, 0x00, 0x3D << 22), (self.OUT, 0x04, 0x3D)):
            if base < offset < base + 0x14 and self[base] & 1:
                self.board.mistakes.append("stream written while it is on")
            if offset == base and value & 1 and self[status] & flags:
                self.board.mistakes.append("stream on with flags of the last transfer")
        self.registers[offset] = value
        if self[self.IN] & 1 and self[self.OUT] & 1 and self.done_s is None:
            self.begin()

    def begin(self):
        spi, board = self.board.spi, self.board
        count = self[self.OUT + 4]
        assert self[self.IN + 4] == count
        assert self[self.IN + 8] == self[self.OUT + 8] == SPI2 + 0x0C
        assert bits(self[self.IN], 6, 2) == 0 and bits(self[self.OUT], 6, 2) == 1
        assert self[self.IN] >> 10 & self[self.OUT] >> 10 & 1 and not self[self.IN] >> 25
        sent = board.read_memory(self[self.OUT + 12], count)
        received = spi.exchange(sent)
        board.write_memory(self[self.IN + 12], received)
        self.done_s = board.time_s() + count * 8 * spi.bit_s()

    def finish(self):
        self.done_s = None
        self.registers[0x00] |= 1 << 27
        self.registers[0x04] |= 1 << 5
        for base in (self.IN, self.OUT):
            self.registers[base] &= ~1

    def read(self, offset):
        self.board.advance(6)
        if offset < 8 and self.done_s is not None and self.board.time_s() >= self.done_s:
            self.finish()
        return self[offset]

    def interrupt(self):
        """A transfer that is under way ends before its interrupt."""
        if self[self.IN] & 0x10 and self.done_s is not None:
            self.finish()
        return bool(self[self.IN] & 0x10 and self[0x00] >> 27 & 1)


class Spi(Peripheral):
    """26: master with software slave management; both directions by DMA. 26.7.1: clock, rate and
    format are not changed while SPE is set."""

    def write(self, offset, value):
        if offset == 0x00 and self[0x00] & 0x40 and (value ^ self[0x00]) & 0x893F & value:
            self.board.mistakes.append("SPI_CR1 changed while the SPI is on")
        self.registers[offset] = value

    def bit_s(self):
        return (2 << bits(self[0x00], 3, 3)) / self.board.rcc.apb1_hz()

    def exchange(self, sent):
        control, device, board = self[0x00], self.board.converter, self.board
        assert control & 0x344 == 0x344 and not control & 0x80, "master, MSB first, on"
        assert self[0x04] & 3 == 3
        pins = all(board.gpiob.mode(p) == 2 and board.gpiob.function(p) == 5 for p in (13, 14, 15))
        selected = board.gpioc.mode(11) == 1 and not board.gpioc[0x14] >> 11 & 1
        if device is None or not pins or not selected:
            return b"\xff" * len(sent)
        if control & 3 != ((device.spi_mode & 1) | (device.spi_mode & 2)):
            board.mistakes.append("SPI mode of another device")
        return device.exchange(sent, board.time_s(), self.bit_s())


class Usart(Peripheral):
    """25.6"""

    reset: ClassVar = {0x00: 0xC0}

    def __init__(self, board):
        super().__init__(board)
        self.incoming = []
        self.sent = bytearray()
        self.drive = []  # driver enable during each byte

    def read(self, offset):
        if offset == 0x00:
            return self[0x00] | (0x20 if self.incoming else 0)
        if offset == 0x04:
            self.registers[0x00] &= ~8  # ORE
            return self.incoming.pop(0) if self.incoming else 0
        return self[offset]

    def write(self, offset, value):
        if offset == 0x04:
            assert self[0x0C] >> 3 & 1 and self[0x0C] >> 13 & 1, "sent while off"
            self.sent.append(value & 0xFF)
            self.drive.append(self.board.gpiob.level(12))
        else:
            self.check(0x0C, offset, value)
            if offset == 0x08 and self[0x0C] >> 13 & 1:
                self.board.mistakes.append("baud rate written while the line is on")
            self.registers[offset] = value

    FORMAT, ENABLE = 0x1600, 13  # of CR1: M, PCE, PS; UE

    def check(self, control, offset, value):
        """25.6.4: the format is not changed while the line is on."""
        is_on = self[control] >> self.ENABLE & 1
        if offset == control and is_on and (value ^ self[control]) & self.FORMAT:
            self.board.mistakes.append("format written while the line is on")

    def overrun(self):
        self.registers[0x00] |= 8

    def baud(self):
        return self.board.rcc.apb1_hz() / self[0x08]

    def interrupt(self):
        control, status = self[0x0C], self.read(0x00)
        return bool(
            (control & 0x20 and status & 0x28)
            or (control & 0x80 and status & 0x80)
            or (control & 0x40 and status & 0x40)
        )


class Iwdg(Peripheral):
    """21.4"""

    reset: ClassVar = {0x08: 0xFFF}

    def __init__(self, board):
        super().__init__(board)
        self.started = False
        self.feeds = 0
        self.open = False
        self.updating = 0  # reads until the registers have what was written
        self.written = set()  # these registers
        self.force = 0xFFF, 0  # what it counts from and by: loaded by a feeding

    def read(self, offset):
        if offset == 0x0C and self.updating > 0:
            self.updating -= 1
            return 3  # PVU, RVU
        return self[offset]

    def write(self, offset, value):
        if offset == 0x00:
            self.open = value == 0x5555
            self.started |= value == 0xCCCC
            self.feeds += value == 0xAAAA
            if value == 0xAAAA and not self.updating:
                self.force = self[0x08], self[0x04]
        elif self.open:
            # 21.3.2: PR and RLR are written only while PVU and RVU are 0.
            if self.updating and offset in self.written:
                self.board.mistakes.append("watchdog written while its register is updated")
            self.written = {*(self.written if self.updating else ()), offset}
            self.registers[offset] = value
            self.updating = 50
        else:
            self.board.mistakes.append("watchdog written without its key")

    def timeout_s(self, lsi_hz):
        reload, prescaler = self.force
        return (reload + 1) * (4 << prescaler) / lsi_hz


class Nvic(Peripheral):
    """ARMv7-M B3.4: registers that enable (ISER, 000h), disable (ICER, 080h), request (ISPR, 100h)
    and forget (ICPR, 180h) by writing 1. Writing 0 does nothing."""

    size = 0x400
    SET, CLEAR = (0x000, 0x100), (0x080, 0x180)

    def write(self, offset, value):
        group = offset & ~0x1F
        if group in self.SET:
            self.registers[offset] = self[offset] | value
        elif group in self.CLEAR:
            self.registers[offset - 0x80] = self[offset - 0x80] & ~value
        else:
            self.registers[offset] = value

    def take(self, irq):
        """Returns True if software has requested the interrupt `irq`, and clears the request."""
        at, bit = 0x100 + 4 * (irq // 32), 1 << irq % 32
        pending = bool(self[at] & bit) and self.enabled(irq)
        if pending:
            self.registers[at] &= ~bit
        return pending

    def enabled(self, irq):
        return bool(bits(self[4 * (irq // 32)], irq % 32))

    def priority(self, irq):
        return bits(self[0x300 + irq // 4 * 4], 8 * (irq % 4), 8)


class Scb(Peripheral):
    size = 0x100
    reset_asked = False

    def write(self, offset, value):
        if offset == 0x0C:
            self.reset_asked |= value >> 16 == 0x05FA and bool(value & 4)
        self.registers[offset] = value


class Mpu(Peripheral):
    """ARMv7-M B3.5: the region with the highest number that holds an address decides."""

    size = 0x14

    def __init__(self, board):
        super().__init__(board)
        self.regions = {}

    def write(self, offset, value):
        self.registers[offset] = value
        if offset == 0x10:
            self.regions[self[0x08]] = self[0x0C], value

    def rights(self, address):
        """(may be read, may be written, may be executed) by privileged code."""
        if not self[0x04] & 1:
            return True, True, True
        for number in sorted(self.regions, reverse=True):
            base, attributes = self.regions[number]
            size = 2 << bits(attributes, 1, 5)
            inside = base <= address < base + size
            eighth = 8 * (address - base) // size
            if attributes & 1 and inside and not (size >= 256 and bits(attributes, 8 + eighth)):
                assert base % size == 0, "a region lies at a multiple of its size"
                access = bits(attributes, 24, 3)
                may_read = access != 0
                return may_read, access in (1, 2, 3), may_read and not bits(attributes, 28)
        return (True, True, True) if self[0x04] & 4 else (False, False, False)


class Board:
    """All peripherals on their buses. One without its clock ignores writes and reads as 0."""

    converter = None

    def __init__(self):
        self.mistakes = []
        self.seconds = 0.0
        self.cycles = 0  # of the core
        self.supply_v = SUPPLY_V
        self.lsi_counts = 0.0
        self.trail = []  # (amplifier, brake, volts) whenever one of them changes
        self.rcc, self.flash = Rcc(self), Flash(self)
        self.gpioa = Gpio(self, "A", 0xA8000000)
        self.gpiob = Gpio(self, "B", 0x00000280)
        self.gpioc = Gpio(self, "C", 0)
        self.syscfg, self.exti = Syscfg(self), Exti(self)
        self.tim2, self.tim4, self.tim5 = Tim2(self), Tim4(self), Tim5(self)
        self.adc, self.dac = Adc(self), Dac(self)
        self.can, self.usart, self.iwdg = Can(self), Usart(self), Iwdg(self)
        self.can2 = Can(self, (5, 6), self.can)
        self.converter = None  # at SPI2: converters.py
        self.dma, self.spi = Dma(self), Spi(self)
        self.nvic, self.scb = Nvic(self), Scb(self)
        self.pwr, self.rtc, self.crc = Pwr(self), Rtc(self), CrcUnit(self)
        self.dbgmcu, self.mpu = Peripheral(self), Mpu(self)
        self.places = [
            (GPIOA, self.gpioa, (0x30, 0)),
            (GPIOB, self.gpiob, (0x30, 1)),
            (GPIOC, self.gpioc, (0x30, 2)),
            (SYSCFG, self.syscfg, (0x44, 14)),
            (EXTI, self.exti, None),
            (RCC, self.rcc, None),
            (FLASH, self.flash, None),
            (TIM2, self.tim2, (0x40, 0)),
            (TIM4, self.tim4, (0x40, 2)),
            (TIM5, self.tim5, (0x40, 3)),
            (DAC, self.dac, (0x40, 29)),
            (CAN1, self.can, (0x40, 25)),
            (CAN2, self.can2, (0x40, 26)),
            (USART2, self.usart, (0x40, 17)),
            (SPI2, self.spi, (0x40, 14)),
            (DMA1, self.dma, (0x30, 21)),
            (ADC, self.adc, (0x44, 8)),
            (IWDG, self.iwdg, None),
            (NVIC, self.nvic, None),
            (MPU, self.mpu, None),
            (CRC_UNIT, self.crc, (0x30, 12)),
            (RTC, self.rtc, None),
            (PWR, self.pwr, (0x40, 28)),
            (DBGMCU, self.dbgmcu, None),
            (SCB, self.scb, None),
        ]
        self.look()

    def advance(self, cycles):
        self.cycles += cycles
        self.seconds += cycles / self.rcc.core_hz()
        self.lsi_counts += cycles / self.rcc.core_hz() * self.rtc.rate_hz()
        self.tim4.reached(self.cycles)

    def time_s(self):
        return self.seconds

    def pulse(self, pin, during=lambda: None):
        """A pulse on an input of port C that no tick sees; what happens while it stands."""
        before = self.gpioc.wires.get(pin)
        self.gpioc.wires[pin] = 1
        self.exti.edge(pin, True)
        during()
        self.gpioc.wires[pin] = before or 0
        self.exti.edge(pin, False)

    def supply(self, volts):
        """A supply that changes; the detector tells its edges."""
        before = self.pwr.is_low()
        self.supply_v = volts
        if self.pwr.is_low() != before:
            self.exti.supply_edge(not before)

    def look(self):
        """The levels at the terminals: an output that is not driven is pulled down."""
        port = getattr(self, "gpiob", None)
        if port is None or not hasattr(self, "dac"):
            return
        now = (port.level(0), port.level(1), self.dac.stage_v())
        if not self.trail or self.trail[-1] != now:
            self.trail.append(now)

    def place(self, address):
        for base, peripheral, clock in self.places:
            if base <= address < base + peripheral.size:
                if clock is not None and not self.rcc.clocked(*clock):
                    self.mistakes.append(f"{address:#x}: without its clock")
                    return None, 0
                return peripheral, address - base
        self.mistakes.append(f"{address:#x}: nothing lies there")
        return None, 0

    def read(self, address, size):
        peripheral, offset = self.place(address)
        return 0 if peripheral is None else peripheral.read(offset) & (1 << 8 * size) - 1

    def write(self, address, size, value):
        if size != 4:
            self.mistakes.append(f"{address:#x}: written by {size} bytes")
        peripheral, offset = self.place(address)
        if peripheral is not None:
            peripheral.write(offset, value)
