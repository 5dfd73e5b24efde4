"""Models of the STM32G474's peripherals, written from the reference manual RM0440 (chapters as
named at each model), with addresses and bits of their own: nothing here is taken from the port.
What is the same as in the STM32F446 is in peripherals.py. Violations of the manual are recorded in
`Board.mistakes`."""

import math
from typing import ClassVar

import peripherals
from peripherals import (
    CRC_UNIT,
    DBGMCU,
    HSI_HZ,
    IWDG,
    MPU,
    NEVER,
    NVIC,
    PWR,
    READS_UNTIL_READY,
    RTC,
    SCB,
    SUPPLY_V,
    TIM2,
    TIM4,
    TIM5,
    USART2,
    CrcUnit,
    Exti,
    Gpio,
    Iwdg,
    Mpu,
    Nvic,
    Peripheral,
    Scb,
    Syscfg,
    Tim2,
    Tim5,
    bits,
)

GPIOA, GPIOB, GPIOC = 0x48000000, 0x48000400, 0x48000800
RCC, FLASH = 0x40021000, 0x40022000
ADC1, ADC2, ADC_COMMON, DAC1 = 0x50000000, 0x50000100, 0x50000300, 0x50000800
SYSCFG, EXTI = 0x40010000, 0x40010400
FDCAN1, FDCAN2, FDCAN_MEMORY = 0x40006400, 0x40006800, 0x4000A400


class Rcc(Peripheral):
    """7.4: PLLRDY follows PLLON after a while, SWS follows SW once that clock is ready, HSERDY
    follows HSEON after the start of the crystal, which HSEBYP prevents."""

    reset: ClassVar = {0x00: 0x500, 0x08: 0x5, 0x0C: 0x1000}
    CAUSES = 0x94  # of the last reset: RCC_CSR
    READ_CYCLES = 6
    lock_reads = READS_UNTIL_READY
    reads = 0
    switches = True
    hse_hz: float | None = 24e6  # the crystal; None: it does not start
    hse_start_s = 2e-3  # longest start of a crystal, data sheet
    hse_on_s = math.inf  # when HSEON was set
    hsi_hz = HSI_HZ
    nmi = False  # requested by the clock security system
    halved_at = None  # instructions when the PLL became the clock, with half its rate

    def source(self):
        """Input of the PLL in Hz."""
        return {2: self.hsi_hz, 3: self.hse_hz or 0.0}.get(bits(self[0x0C], 0, 2), 0.0)

    def has_hse(self):
        runs = self.board.time_s() >= self.hse_on_s + self.hse_start_s
        return self.hse_hz is not None and runs and not bits(self[0x00], 18)

    def read(self, offset):
        if offset == 0x00:
            self.board.advance(self.READ_CYCLES)
            ready = (bits(self[0x00], 8) and 1 << 10) | (1 << 17 if self.has_hse() else 0)
            if bits(self[0x00], 24):
                self.reads += 1
                if self.reads >= self.lock_reads and (ready >> 17 or bits(self[0x0C], 0, 2) == 2):
                    ready |= 1 << 25
            self.registers[0x00] = self[0x00] & ~(1 << 25 | 1 << 17 | 1 << 10) | ready
        if offset == 0x08 and self.switches:
            wanted = bits(self[0x08], 0, 2)
            if wanted == 1 or (wanted == 3 and bits(self[0x00], 25)):
                if wanted == 3 and bits(self[0x08], 2, 2) != 3:
                    self.halved_at = self.board.instructions()
                self.registers[0x08] = self[0x08] & ~0xC | wanted << 2
        if offset == 0x94:
            return self[0x94] & ~2 | bits(self[0x94], 0) << 1
        return self[offset]

    def write(self, offset, value):
        check = {0x00: self.control, 0x08: self.configuration, 0x90: self.backup}.get(offset)
        if check is not None:
            value = check(value)
            if value is None:
                return
        if offset == 0x94:  # RMVF clears the causes of the reset
            value = value & 1 if bits(value, 23) else self[0x94] & 0xFE000000 | value & 1
        if offset == 0x0C and bits(self[0x00], 24):
            self.board.mistakes.append("PLLCFGR written while the PLL is on")
        self.registers[offset] = value

    def control(self, value):
        if (value ^ self[0x00]) >> 18 & 1 and bits(self[0x00], 16):
            self.board.mistakes.append("HSEBYP written while the HSE is on")
        if bits(self[0x08], 2, 2) == 3 and not bits(value, 24):
            self.board.mistakes.append("the PLL switched off while it is the core's clock")
        if bits(value, 16) and not bits(self[0x00], 16):
            self.hse_on_s = self.board.time_s()
        elif not bits(value, 16):
            self.hse_on_s = math.inf
        if not bits(value, 24):
            self.reads = min(self.reads, 0) if self.lock_reads != NEVER else self.reads
        return value & ~(1 << 25) | (self[0x00] & 1 << 25 if bits(value, 24) else 0)

    def configuration(self, value):
        """6.1.5, 7.2: above 150 MHz range 1 boost; into it by way of half the rate for 1 us."""
        was_slow, board = bits(self[0x08], 2, 2) != 3, self.board
        if bits(value, 0, 2) == 3 and was_slow:
            if not bits(self[0x00], 25):
                board.mistakes.append("switched to a PLL that is not ready")
            if not board.pwr.is_boost():
                board.mistakes.append("more than 150 MHz without range 1 boost")
            if bits(value, 4, 4) != 8:
                board.mistakes.append("switched to the PLL without half the rate")
            if board.flash[0x00] & 15 < 4:
                board.mistakes.append("168 MHz with too few wait states")
        if bits(value, 0, 2) in (0, 2) and not (bits(value, 0, 2) == 2 and self.has_hse()):
            board.mistakes.append("a clock selected that is reserved or not ready")
        was_halved = not was_slow and bits(value, 0, 2) == 3 and bits(self[0x08], 4, 4) == 8
        if was_halved and board.instructions() - self.halved_at < 84:
            board.mistakes.append("half the rate for less than 1 us")
        return value & ~0xC | self[0x08] & 0xC

    def backup(self, value):
        if not bits(self.board.pwr[0x00], 8):
            self.board.mistakes.append("the backup domain written without DBP")
            return None
        if bits(value, 16):
            self.board.rtc.reset_domain()
            return 1 << 16
        if bits(self[0x90], 8, 2) and bits(value ^ self[0x90], 8, 2):
            self.board.mistakes.append("RTCSEL written twice")
        return value

    def hse_stops(self):
        """7.2.9: with CSSON, where the HSE is the core's clock by way of the PLL, the core goes on
        with the HSI, HSE and PLL are off, and an NMI is requested."""
        self.hse_hz = None
        if bits(self[0x00], 19) and bits(self[0x0C], 0, 2) == 3:
            self.registers[0x00] = self[0x00] & ~(1 << 16 | 1 << 17 | 1 << 24 | 1 << 25) | 0x500
            self.registers[0x08] = self[0x08] & ~0xF | 5
            self.nmi = True

    def pll_input(self):
        return self.source() / (bits(self[0x0C], 4, 4) + 1)

    def core_hz(self):
        if bits(self[0x08], 2, 2) != 3:
            return self.hsi_hz
        divider = 2 * bits(self[0x0C], 25, 2) + 2
        pll = self.pll_input() * bits(self[0x0C], 8, 7) / divider
        return pll / (2 if bits(self[0x08], 4, 4) == 8 else 1)

    def is_within_bounds(self):
        """Data sheet, table of the PLL: 2.66 to 16 MHz in, 96 to 344 MHz of its oscillator."""
        vco = self.pll_input() * bits(self[0x0C], 8, 7)
        return 2.66e6 <= self.pll_input() <= 16e6 and 96e6 <= vco <= 344e6

    def bus_hz(self, at):
        prescaler = bits(self[0x08], at, 3)
        return self.core_hz() / (1 if prescaler < 4 else 2 ** (prescaler - 3))

    def apb1_hz(self):
        return self.bus_hz(8)

    def apb2_hz(self):
        return self.bus_hz(11)

    def can_hz(self):
        """7.4.26, FDCANSEL."""
        return {0: self.hse_hz or 0.0, 2: self.apb1_hz()}.get(bits(self[0x88], 24, 2), 0.0)

    def clocked(self, offset, bit):
        return bool(bits(self[offset], bit))


class Pwr(Peripheral):
    """6.4: VOSF while the regulator changes its voltage; PVDO while the supply is below what PLS
    says (data sheet, VPVD0 to VPVD6, falling)."""

    LEVELS_V = (2.0, 2.2, 2.4, 2.5, 2.6, 2.8, 2.9)
    reset: ClassVar = {0x00: 0x200, 0x08: 0x8000, 0x80: 0x100}
    changing = 0  # reads until the regulator is ready

    def is_boost(self):
        return bits(self[0x00], 9, 2) == 1 and not bits(self[0x80], 8) and self.changing == 0

    def is_low(self):
        level = self.LEVELS_V[bits(self[0x04], 1, 3)]
        return bool(bits(self[0x04], 0)) and self.board.supply_v < level

    def write(self, offset, value):
        if offset == 0x04 and bits(self[0x04], 0) and bits(value ^ self[0x04], 1, 3):
            self.board.mistakes.append("PLS changed while the detector is on")
        if offset == 0x80 and bits(value ^ self[0x80], 8):
            self.changing = READS_UNTIL_READY
        self.registers[offset] = value

    def read(self, offset):
        if offset == 0x14:
            self.changing = max(self.changing - 1, 0) if self.changing < NEVER else NEVER
            return (1 << 10 if self.changing else 0) | (1 << 11 if self.is_low() else 0)
        return self[offset]


class Rtc(peripherals.Rtc):
    """35.6"""

    CONTROL, COUNT, BACKUP, LSI = 0x18, 0x08, 0x90, 0x94


class Flash(Peripheral):
    """3.7, and the two sectors of the parameter store, 16 pages of 2 KiB each from the begin of
    bank 2. 3.3.7: 64 bits are programmed at a time, once after an erase. 3.3.2: one wrong bit of a
    double word is corrected and sets ECCC; two wrong bits, as a power cut can leave them, set ECCD,
    which requests an NMI. Address and bank of FLASH_ECCR are not updated while one of the two is
    set. ES0430 2.2.2: bank 2 is programmed and erased without the data cache, which is reset before
    it is on again."""

    BASE, SECTOR, PAGE = 0x08040000, 0x8000, 2048
    POLL_CYCLES = 20_000  # of an erase that takes its time
    # ST production value with what `forceaxis flash` sets: BOR_LEV 4, nSWBOOT0 0; WRP1A, all pages
    # of bank 1.
    reset: ClassVar = {0x00: 0x40600, 0x14: 0xC0000000, 0x20: 0xFBEFFCAA, 0x2C: 0x007F0000}
    ERRORS = 0xC3FA
    WRITABLE = 0xFF078BFF  # of FLASH_CR (3.7.5)
    busy_reads = READS_UNTIL_READY
    nmi = False

    def __init__(self, board):
        super().__init__(board)
        self.bytes = bytearray(b"\xff" * 2 * self.SECTOR)
        self.keys = []
        self.busy = 0
        self.erase_s = 0.0  # of a page
        self.erased_at = 0  # cycle
        self.fail = None  # error bit that the next operations end with
        self.protected = set()  # pages
        self.words = 0
        self.erased = []  # pages
        self.first = None  # offset and value of the first half of a double word
        self.damaged = set()  # offsets of double words with two wrong bits
        self.weak = set()  # offsets of double words with one wrong bit
        self.is_stale = False  # the data cache may hold what was changed
        self.polled_idle = False  # BSY was read as 0 since the last operation

    def error(self, bit):
        self.registers[0x10] = self[0x10] | 1 << bit

    def is_busy(self):
        return self.busy > 0 or self.board.cycles < self.erased_at

    def read_stored(self, offset, size):
        if self.is_busy():
            self.board.mistakes.append("bank 2 read while it is busy")
        if offset & ~7 in self.damaged:
            if bits(self[0x00], 10):
                self.board.mistakes.append("a double word read by way of the data cache")
            self.report(31, offset & ~7)
            self.nmi = True
        elif offset & ~7 in self.weak:
            self.report(30, offset & ~7)
        return int.from_bytes(self.bytes[offset : offset + size], "little")

    def report(self, bit, place, bank_2=True):
        """ECCC (30) or ECCD (31) of a double word."""
        held = self[0x18]
        if not held >> 30:
            held = held & 1 << 24 | bank_2 << 21 | place
        self.registers[0x18] = held | 1 << bit

    def changed(self):
        """Bank 2 is programmed or erased."""
        if bits(self[0x00], 10):
            self.board.mistakes.append("bank 2 changed with the data cache on")
        self.is_stale = True

    def access(self, value):
        """3.3.4, 3.7.1: the cache is reset while it is off, and then switched on."""
        if bits(value, 12) and bits(value, 10):
            self.board.mistakes.append("data cache reset while it is on")
            return
        if bits(value, 12) and not bits(self[0x00], 10):
            self.is_stale = False
        if bits(value, 10) and self.is_stale:
            self.board.mistakes.append("data cache on with what bank 2 held before")
        if (value & 15) < 4 and self.board.rcc.core_hz() > 150e6:
            self.board.mistakes.append("168 MHz with too few wait states")
        self.registers[0x00] = value

    def read(self, offset):
        if offset == 0x10:
            if self.board.cycles < self.erased_at:
                self.board.advance(self.POLL_CYCLES)
                return self[0x10] | 1 << 16
            if self.busy > 0:
                self.busy -= self.busy < NEVER
                return self[0x10] | 1 << 16
            self.polled_idle = True
        return self[offset]

    def write(self, offset, value):
        if offset == 0x08:
            self.keys = [*self.keys, value][-2:]
            if not bits(self[0x14], 31):
                self.board.mistakes.append("keys written to a flash that is not locked")
            if self.keys == [0x45670123, 0xCDEF89AB]:
                self.registers[0x14] = self[0x14] & ~(1 << 31)
        elif offset == 0x10:
            self.registers[0x10] = self[0x10] & ~value
        elif offset == 0x14:
            self.control(value)
        elif offset == 0x18:
            self.registers[0x18] = self[0x18] & ~(value & 0xC0000000)
        elif offset == 0x00:
            self.access(value)
        elif offset >= 0x20:
            self.board.mistakes.append("option bytes written while they are locked")
        else:
            self.registers[offset] = value

    def control(self, value):
        """3.3.5: a write while BSY is set stalls the bus. 3.3.6: PER, BKER, PNB, then STRT."""
        if value & ~self.WRITABLE:
            self.board.mistakes.append("reserved bits of FLASH_CR written")
        if self.is_busy():
            self.board.mistakes.append("FLASH_CR written while the flash is busy")
        if bits(self[0x14], 31):
            self.board.mistakes.append("FLASH_CR written while locked")
            return
        if bits(value, 16) and self[0x14] & 0xFFF != value & 0xFFF:
            self.board.mistakes.append("erase started together with its page")
        self.registers[0x14] = value & ~(1 << 16)
        if bits(value, 16):
            if not self.polled_idle:
                self.board.mistakes.append("erase started without a look at BSY")
            if bits(value, 0) or not bits(value, 1) or bits(value, 2) or bits(value, 15):
                self.board.mistakes.append("erase of something else than a page")
            self.erase(bits(value, 11), bits(value, 3, 7))

    def erase(self, bank_2, page):
        assert bank_2 and page < 32, "erased what is not the store"
        self.changed()
        self.busy, self.polled_idle = self.busy_reads, False
        self.erased_at = self.board.cycles + round(self.erase_s * self.board.rcc.core_hz())
        if page in self.protected:
            self.error(4)
        elif self[0x10] & self.ERRORS:
            self.error(7)
        elif self.fail is not None:
            self.error(self.fail)
        else:
            begin = page * self.PAGE
            self.bytes[begin : begin + self.PAGE] = b"\xff" * self.PAGE
            self.damaged -= set(range(begin, begin + self.PAGE, 8))
            self.erased.append(page)

    def program(self, at, size, value):
        control = self[0x14]
        if size != 4:
            self.error(6)  # SIZERR
        elif bits(control, 31) or control & 0x8807 != 1 or self.is_busy():
            self.error(7)  # PGSERR
        elif self.first is None:
            if at % 8:
                self.error(5)  # PGAERR
            else:
                self.first = at, value
        else:
            first, low = self.first
            self.first = None
            if at != first + 4:
                self.error(5)
            else:
                self.program_double(first, low | value << 32)

    def program_double(self, at, value):
        self.changed()
        self.busy, self.polled_idle = self.busy_reads, False
        held = int.from_bytes(self.bytes[at : at + 8], "little")
        if at // self.PAGE in self.protected:
            self.error(4)  # WRPERR
        elif self[0x10] & self.ERRORS:
            self.error(7)  # PGSERR, because of an earlier error
        elif held != (1 << 64) - 1 and value != 0:
            self.error(3)  # PROGERR
        elif self.fail is not None:
            self.error(self.fail)
        else:
            self.bytes[at : at + 8] = value.to_bytes(8, "little")
            self.words += 1


class Tim4(peripherals.Tim4):
    """Its trigger output is trigger 5 of the injected groups of ADC1 and ADC2 (21.4.18, table of
    the triggers), and internal trigger 3 of timer 5 (30.4, table of the internal triggers)."""

    JEXTSEL, TRIGGER = 5, 3


class Adc(Peripheral):
    """21.4: one of two converters. Its regulator needs 20 us, its calibration ends by itself, and
    ADRDY follows ADEN; sampling times and sequences are written while no conversion is started."""

    size = 0x100
    reset: ClassVar = {0x08: 1 << 29, 0x0C: 1 << 31}
    SAMPLE_CYCLES = (2.5, 6.5, 12.5, 24.5, 47.5, 92.5, 247.5, 640.5)
    REFERENCE_V = 1.212
    READ_CYCLES = 6
    regulator_s = math.inf  # when ADVREGEN was set
    ready_reads = READS_UNTIL_READY
    calibrating = 0  # reads
    is_calibrated = False
    single_at = NEVER  # cycle at which the regular conversion ends
    # ES0430 2.7.9: the result of a conversion that begins more than 1 ms after the calibration or
    # the conversion before may be wrong.
    IDLE_MAX_S, WRONG = 1e-3, 1.0
    rested_s = -math.inf  # when the last conversion was

    def __init__(self, board, sources):
        super().__init__(board)
        self.sources = sources  # {channel: pin of port A, "reference"}
        self.volts = {}  # pin of port A: input
        self.waiting = None  # reads until the injected group is done
        self.shares = []
        self.reads = 0
        self.conversions = 0

    def is_on(self):
        return bool(self[0x00] & 1 and self[0x08] & 1)

    def clock_hz(self):
        mode = bits(self.board.adc_common[0x08], 16, 2)
        assert mode in (2, 3), "a clock of the bus"
        clock = self.board.rcc.core_hz() / (2 if mode == 2 else 4)
        assert clock <= 60e6 or self.board.rcc.hse_hz != 24e6
        return clock

    def sample_s(self, channel):
        register, place = (0x18, channel - 10) if channel > 9 else (0x14, channel)
        return self.SAMPLE_CYCLES[bits(self[register], 3 * place, 3)] / self.clock_hz()

    def duration_s(self):
        return sum(self.sample_s(channel) + 12.5 / self.clock_hz() for channel in self.group())

    def group(self):
        jsqr = self[0x4C]
        return [bits(jsqr, 9 + 6 * i, 5) for i in range(bits(jsqr, 0, 2) + 1)]

    def is_rested(self):
        """Whether a conversion that begins now comes too late."""
        now_s = self.board.time_s()
        is_wrong = now_s - self.rested_s > self.IDLE_MAX_S
        self.rested_s = now_s
        return is_wrong

    def share(self, channel):
        board, source = self.board, self.sources.get(channel)
        if source == "reference":
            enabled = bits(board.adc_common[0x08], 22) and self.sample_s(channel) >= 4e-6
            return self.REFERENCE_V / board.supply_v if enabled else 0.0
        if source is None or board.gpioa.mode(source) != 3:
            return 0.0
        if source == 4:
            return board.dac.pin_v() / SUPPLY_V
        return self.volts.get(source, 0.0) / SUPPLY_V

    def read(self, offset):
        if offset in (0x00, 0x08):
            self.board.advance(self.READ_CYCLES)
        if offset == 0x08 and self.calibrating:
            self.calibrating -= self.calibrating < NEVER
            if not self.calibrating:
                self.registers[0x08] &= ~(1 << 31)
                self.is_calibrated = True
                self.rested_s = self.board.time_s()
        if offset == 0x40:
            self.registers[0x00] &= ~4  # EOC goes with the result
        self.settle()
        if offset == 0x00 and self.waiting is not None:
            self.reads += 1
            self.waiting -= 1
            if self.waiting <= 0:
                self.finish()
        return self[offset]

    def settle(self):
        """Ends a regular conversion whose time is over."""
        if self.board.cycles >= self.single_at:
            self.single_at = NEVER
            share = self.WRONG if self.is_single_wrong else self.share(self.single)
            self.registers[0x40] = min(max(int(share * 4096), 0), 4095)
            self.registers[0x00] |= 0xC
            self.registers[0x08] &= ~4

    def write(self, offset, value):
        self.settle()
        started = self[0x08] & 0xC
        if offset == 0x00:
            self.registers[0x00] = self[0x00] & ~value  # written 1 clears
        elif offset == 0x08:
            self.control(value)
        else:
            if offset in (0x0C, 0x14, 0x18) and started:
                self.board.mistakes.append(f"ADC {offset:#x} written while started")
            if offset in (0x30, 0x4C) and (started or not self.is_on()):
                self.board.mistakes.append(f"ADC {offset:#x} written while off or started")
            self.registers[offset] = value

    def control(self, value):
        """21.4.6, 21.4.8: bits of commands are set only, and go by themselves."""
        board, before = self.board, self[0x08]
        commands = 0x8000003F
        if not bits(before, 28) and bits(value, 28):
            if bits(before, 29):
                board.mistakes.append("regulator on in deep power-down")
            self.regulator_s = board.time_s()
        settled = board.time_s() - self.regulator_s >= 20e-6
        if value & commands and not (settled and bits(value, 28) and not bits(value, 29)):
            board.mistakes.append("ADC commanded before its regulator is ready")
        if bits(value, 31):
            if before & 1:
                board.mistakes.append("calibration of a converter that is on")
            self.calibrating = self.ready_reads
        if value & 1 and not before & 1:
            if not self.is_calibrated:
                board.mistakes.append("ADC on without a calibration")
            self.registers[0x00] |= 1
        if value & 0xC and not self.is_on():
            board.mistakes.append("ADC started while off")
        if value & 4 and self.is_on():
            assert bits(self[0x30], 0, 4) == 0 and bits(self[0x0C], 10, 2) == 0, "a group of one"
            if before & 4:
                board.mistakes.append("ADC started while it converts")
            self.single = bits(self[0x30], 6, 5)
            self.is_single_wrong = self.is_rested()
            took = self.sample_s(self.single) + 12.5 / self.clock_hz()
            self.single_at = board.cycles + took * board.rcc.core_hz()
        self.registers[0x08] = value & ~commands | (before | value) & commands

    def trigger(self, number):
        """With JADSTART and JEXTEN 1, the rising edge of JEXTSEL starts the injected group."""
        jsqr = self[0x4C]
        if self[0x08] & 8 and bits(jsqr, 7, 2) == 1 and bits(jsqr, 2, 5) == number:
            self.waiting = self.ready_reads
            self.conversions += 1
            self.shares = [self.share(channel) for channel in self.group()]
            if self.is_rested():
                self.shares[0] = self.WRONG

    def finish(self):
        self.waiting = None
        for i, share in enumerate(self.shares):
            self.registers[0x80 + 4 * i] = min(max(int(share * 4096), 0), 4095)
        self.registers[0x00] |= 3 << 5  # JEOC, JEOS


class AdcCommon(Peripheral):
    """21.6: clock and internal channels are selected while both converters are off."""

    size = 0x100

    def write(self, offset, value):
        if (self.board.adc1[0x08] | self.board.adc[0x08]) & 1:
            self.board.mistakes.append("ADC_CCR written while a converter is on")
        self.registers[offset] = value


class Dac(peripherals.Dac):
    """22.4: MODE1 is written while the channel is off; 0 is the output buffer at the pin, which
    does not reach the outer 0.2 V (data sheet); HFSEL is for the rate of the bus."""

    def write(self, offset, value):
        if offset == 0x3C and bits(self[0x00], 0):
            self.board.mistakes.append("DAC_MCR written while the DAC is on")
        if offset == 0x00 and bits(value, 0):
            assert bits(self[0x3C], 0, 3) == 0 and bits(self[0x3C], 14, 2) == 2
            assert not bits(value, 1), "no trigger"
        self.registers[offset] = value
        if offset == 0x08:
            self.registers[0x2C] = value & 0xFFF
        self.board.look()

    def pin_v(self):
        if self.stuck_v is not None:
            return self.stuck_v
        if bits(self[0x00], 0) and self.board.gpioa.mode(4) == 3:
            return min(max(SUPPLY_V * self[0x2C] / 4096, 0.2), SUPPLY_V - 0.2)
        return SUPPLY_V / 2


class CanMemory(Peripheral):
    """44.3.3: 212 words for each controller. A frame that waits is not changed."""

    size = 3 * 0x350

    def write(self, offset, value):
        for can in (self.board.can, self.board.can2):
            box = (offset - can.memory[1] - can.TX) // can.FRAME
            if box in can.requests and offset >= can.memory[1] + can.TX:
                self.board.mistakes.append("a frame that waits was changed")
        self.registers[offset] = value


class Can(Peripheral):
    """44: FDCAN with classic frames. Frames are (id, data, extended, remote). `pins`: port, in and
    out. 44.4.11: bus off sets INIT; after software has cleared it, 129 sequences of 11 recessive
    bits end bus off. 44.4.7: configuration registers are written with CCE, which also clears what
    waits."""

    reset: ClassVar = {0x18: 1, 0x1C: 0x06000A03}
    SEQUENCES, FRAME_BITS = 129, 135
    RX, TX, FRAME = 0xB0, 0x278, 72  # offsets and size in bytes in the memory
    CONFIGURATION = (0x1C, 0x80, 0xC0)

    def __init__(self, board, port, pins, memory):
        super().__init__(board)
        self.port, self.pins, self.memory = port, pins, memory
        self.fifo = 0  # frames in FIFO 0
        self.get = 0
        self.requests = []  # buffers in order of their request
        self.put = 0
        self.sent = []
        self.sequences = 0  # seen after bus off
        self.joining = 0  # 1: no 11 recessive bits since INIT was cleared
        self.rest_bits = 0.0
        self.dominant = False  # the bus is stuck
        self.busy = False  # others send without a gap
        self.partner = True  # another node acknowledges
        self.answers_init = True
        self.aborted = 0  # frames

    def initialising(self):
        return bool(self[0x18] & 1)

    def write(self, offset, value):
        if offset == 0x18:
            self.control(value)
        elif offset == 0x50:
            self.registers[0x50] = self[0x50] & ~value
        elif offset == 0x94:
            assert self.fifo and value == self.get, "acknowledged what is not the oldest frame"
            self.fifo, self.get = self.fifo - 1, (self.get + 1) % 3
        elif offset == 0xCC:
            for box in range(3):
                if value >> box & 1:
                    assert len(self.requests) < 3 and box == self.put, "not the put index"
                    self.requests.append(box)
                    self.put = (self.put + 1) % 3
        elif offset == 0xD0:
            # 44.4.31: cancellation is for the queue; for the FIFO it is not meant.
            if not self[0xC0] >> 24 & 1:
                self.board.mistakes.append("FDCAN: a frame of the FIFO cancelled")
            self.aborted += sum(value >> box & 1 for box in self.requests)
            self.requests = [box for box in self.requests if not value >> box & 1]
        elif offset in self.CONFIGURATION and self[0x18] & 3 != 3:
            self.board.mistakes.append(f"FDCAN {offset:#x} written without CCE")
        else:
            self.registers[offset] = value

    def control(self, value):
        """44.4.7: INIT may be read back late; CCE can be set only while INIT reads 1, and goes with
        it. Setting CCE clears the requests and the FIFOs."""
        before = self[0x18]
        if value & 2 and not before & 1:
            self.board.mistakes.append("CCE without INIT")
            value &= ~2
        if value & 1 and not self.answers_init:
            value = value & ~1 | before & 1
        if not value & 1:
            value &= ~2
        if value & 2 and not before & 2:
            self.aborted += len(self.requests)
            self.requests, self.put, self.fifo, self.get = [], 0, 0, 0
        if before & 1 and not value & 1:
            self.joining, self.sequences = 1, 0
        self.registers[0x18] = value

    def read(self, offset):
        if offset == 0x90:
            return self.fifo | self.get << 8
        if offset == 0xC4:
            full = len(self.requests) == 3
            return 3 - len(self.requests) | self.put << 16 | full << 21
        if offset == 0xC8:
            return sum(1 << box for box in self.requests)
        if offset == 0x44:
            synchronising = self.joining or self.initialising()
            return self[0x44] & ~0x18 | (0 if synchronising else 1 << 3)
        return self[offset]

    # The bus.

    def bit_rate(self):
        nbtp = self[0x1C]
        quanta = 1 + bits(nbtp, 8, 8) + 1 + bits(nbtp, 0, 7) + 1
        return self.board.rcc.can_hz() / (bits(nbtp, 16, 9) + 1) / quanta

    def sample_point(self):
        before = 1 + bits(self[0x1C], 8, 8) + 1
        return before / (before + bits(self[0x1C], 0, 7) + 1)

    def connected(self):
        pins = all(self.port.mode(p) == 2 and self.port.function(p) == 9 for p in self.pins)
        assert self[0x18] & 0xFFFC == 0, "classic frames, repeated"
        return pins and not self.initialising() and not self.joining and not self[0x44] & 0x80

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
            if not self.initialising():
                self.sequence()

    def sequence(self):
        """11 recessive bits, in operation."""
        self.joining = 0
        if self[0x44] & 0x80:
            self.sequences += 1
            if self.sequences >= self.SEQUENCES:
                self.registers[0x44] = 0

    def accepts(self, extended, remote):
        """44.4.19, RXGFC: frames that match no filter; there is none."""
        global_filter = self[0x80]
        assert bits(global_filter, 16, 5) == bits(global_filter, 24, 4) == 0, "no filters"
        if remote and global_filter >> (0 if extended else 1) & 1:
            return False
        return bits(global_filter, 2 if extended else 4, 2) == 0

    def receive(self, can_id, data=b"", extended=False, remote=False):
        if not self.connected() or not self.accepts(extended, remote):
            return
        if self.fifo == 3:
            self.registers[0x50] |= 4  # RF0L
            assert not self[0x80] >> 9 & 1, "a FIFO that overwrites"
            return
        at = self.RX + self.FRAME * ((self.get + self.fifo) % 3)
        head = (can_id | 1 << 30 if extended else can_id << 18) | remote << 29
        length, full = len(data) if len(data) <= 8 else 15, data.ljust(8, b"\0")
        words = [head, length << 16, *(int.from_bytes(full[i : i + 4], "little") for i in (0, 4))]
        for i, word in enumerate(words):
            self.memory[0].registers[self.memory[1] + at + 4 * i] = word
        self.fifo += 1
        self.registers[0x50] |= 1

    def transmit(self):
        """Transmits all requests. Without a partner a frame is repeated, and the transmit error
        counter ends at 128: error passive (ISO 11898-1)."""
        if not self.connected():
            return
        if not self.partner:
            if self.requests:
                count = min(bits(self[0x40], 0, 8) + 8, 128)
                self.registers[0x40] = count
                self.registers[0x44] = self[0x44] & ~0x20 | (0x20 if count >= 128 else 0)
            return
        assert not self[0xC0] >> 24 & 1, "in the order of the requests"
        while self.requests:
            box = self.requests.pop(0)
            memory, base = self.memory
            at = base + self.TX + self.FRAME * box
            head, length, low, high = (memory[at + 4 * i] for i in range(4))
            assert not head >> 30 & 1 and not length >> 20 & 3, "sent an extended or a long frame"
            data = (low | high << 32).to_bytes(8, "little")[: bits(length, 16, 4)]
            self.sent.append((bits(head, 18, 11), data, bool(head >> 29 & 1)))
            if self[0xDC] >> box & 1:
                self.registers[0x50] |= 1 << 7  # TC

    def errors(self, passive=False, off=False):
        self.registers[0x44] = (0x20 if passive else 0) | (0xA0 if off else 0)
        if off:
            self.registers[0x18] |= 1
            self.sequences = 0

    def requested(self, line):
        """44.4.15, ILS: groups of interrupts and their lines."""
        groups = {0: 0x7, 2: 0x180}
        active = self[0x50] & self[0x54]
        of_line = [m for bit, m in groups.items() if bits(self[0x58], bit) == line]
        return bool(self[0x5C] >> line & 1) and any(active & mask for mask in of_line)

    def interrupt(self):
        return self.requested(0)

    def sent_interrupt(self):
        return self.requested(1)


class Usart(peripherals.Usart):
    """37.8"""

    reset: ClassVar = {0x1C: 0xC0}
    FORMAT, ENABLE = 0x10009600, 0  # of CR1: M1, OVER8, M0, PCE, PS; UE

    def read(self, offset):
        if offset == 0x1C:
            return self[0x1C] | (0x20 if self.incoming else 0)
        if offset == 0x24:
            return self.incoming.pop(0) | 0x100 if self.incoming else 0  # with its parity bit
        return self[offset]

    def write(self, offset, value):
        if offset == 0x28:
            assert self[0x00] & 1 and self[0x00] >> 3 & 1, "sent while off"
            self.sent.append(value & 0xFF)
            self.drive.append(self.board.gpiob.level(10))
        elif offset == 0x20:
            self.registers[0x1C] &= ~(value & 8)  # ORECF
        else:
            self.check(0x00, offset, value)
            if offset == 0x0C and self[0x00] & 1:
                self.board.mistakes.append("baud rate written while the line is on")
            self.registers[offset] = value

    def overrun(self):
        self.registers[0x1C] |= 8

    def baud(self):
        return self.board.rcc.apb1_hz() / self[0x0C]

    def interrupt(self):
        control, status = self[0x00], self.read(0x1C)
        return bool(
            (control & 0x20 and status & 0x28)
            or (control & 0x80 and status & 0x80)
            or (control & 0x40 and status & 0x40)
        )


class Board(peripherals.Board):
    """All peripherals on their buses. One without its clock ignores writes and reads as 0."""

    def __init__(self):
        self.mistakes = []
        self.seconds = 0.0
        self.cycles = 0  # of the core
        self.supply_v = SUPPLY_V
        self.lsi_counts = 0.0
        self.trail = []  # (amplifier, brake, volts) whenever one of them changes
        self.instructions = lambda: 0
        self.rcc, self.flash = Rcc(self), Flash(self)
        self.gpioa = Gpio(self, "A", 0xABFFFFFF)
        self.gpiob = Gpio(self, "B", 0xFFFFFEBF)
        self.gpioc = Gpio(self, "C", 0xFFFFFFFF)
        self.syscfg, self.exti = Syscfg(self), Exti(self)
        self.tim2, self.tim4, self.tim5 = Tim2(self), Tim4(self), Tim5(self)
        self.adc1 = Adc(self, {18: "reference"})
        self.adc = Adc(self, {3: 6, 4: 7, 17: 4})  # ADC2
        self.adc_common = AdcCommon(self)
        self.dac = Dac(self)
        self.usart, self.iwdg = Usart(self), Iwdg(self)
        self.can_memory = CanMemory(self)
        self.can = Can(self, self.gpioa, (11, 12), (self.can_memory, 0))
        self.can2 = Can(self, self.gpiob, (5, 6), (self.can_memory, 0x350))
        self.nvic, self.scb = Nvic(self), Scb(self)
        self.pwr, self.rtc, self.crc = Pwr(self), Rtc(self), CrcUnit(self)
        self.dbgmcu, self.mpu = Peripheral(self), Mpu(self)
        self.places = [
            (GPIOA, self.gpioa, (0x4C, 0)),
            (GPIOB, self.gpiob, (0x4C, 1)),
            (GPIOC, self.gpioc, (0x4C, 2)),
            (ADC1, self.adc1, (0x4C, 13)),
            (ADC2, self.adc, (0x4C, 13)),
            (ADC_COMMON, self.adc_common, (0x4C, 13)),
            (DAC1, self.dac, (0x4C, 16)),
            (SYSCFG, self.syscfg, (0x60, 0)),
            (EXTI, self.exti, None),
            (RCC, self.rcc, None),
            (FLASH, self.flash, None),
            (TIM2, self.tim2, (0x58, 0)),
            (TIM4, self.tim4, (0x58, 2)),
            (TIM5, self.tim5, (0x58, 3)),
            (FDCAN1, self.can, (0x58, 25)),
            (FDCAN2, self.can2, (0x58, 25)),
            (FDCAN_MEMORY, self.can_memory, (0x58, 25)),
            (USART2, self.usart, (0x58, 17)),
            (IWDG, self.iwdg, None),
            (NVIC, self.nvic, None),
            (MPU, self.mpu, None),
            (CRC_UNIT, self.crc, (0x48, 12)),
            (RTC, self.rtc, (0x58, 10)),
            (PWR, self.pwr, (0x58, 28)),
            (DBGMCU, self.dbgmcu, None),
            (SCB, self.scb, None),
        ]
        self.look()
