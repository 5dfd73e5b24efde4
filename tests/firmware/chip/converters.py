"""Models of converters of 24 bits, written from their data sheets: AD7193 (Analog Devices, Rev. E)
and ADS1256 (Texas Instruments, SBAS288K). A byte in is a byte out; time in seconds is the caller's.
What a data sheet forbids is recorded in `mistakes`."""

from typing import ClassVar

NOISE = (3, -5, 1, 7, -2, -8, 4, 0, -3, 6, 2, -6)  # codes


class Converter:
    bits_per_s_max = 1e12

    def __init__(self):
        self.mistakes = []
        self.volts = 0.0  # between its first two inputs
        self.reference_v = 2.5
        self.conversions = 0
        self.next_s = float("inf")  # of the next conversion
        self.ready = False
        self.stuck = None  # level of the data line, if it stands still
        self.silent = False  # no conversion becomes ready
        self.data = 0
        self.reset(0.0)

    def run(self, until_s):
        """Conversions up to a time; returns their number."""
        count = 0
        while self.next_s <= until_s:
            self.next_s += 1 / self.rate()
            count += 1
            self.convert()
            self.ready = not self.silent
        return count

    def start(self, now_s, settling_s):
        self.ready, self.next_s = False, now_s + settling_s

    def noisy(self, code):
        self.conversions += 1
        return code + NOISE[self.conversions % len(NOISE)]

    def exchange(self, sent, now_s, bit_s):
        if 1 / bit_s > self.bits_per_s_max:
            self.mistakes.append("SCLK too fast")
        received = []
        for byte in sent:
            self.run(now_s)
            received.append(self.byte(byte, now_s) & 0xFF)
            now_s += 8 * bit_s
        self.ended_s = now_s
        if self.stuck is not None:
            return bytes([0xFF * self.stuck] * len(sent))
        return bytes(received)


class Ad7193(Converter):
    """Registers by RS2..RS0: {number: bytes}; the status is made when it is read."""

    spi_mode = 3
    bits_per_s_max = 5e6  # t3, t4: 100 ns each
    BYTES = (1, 3, 3, 3, 1, 1, 3, 3)
    ID = 0xA2

    def reset(self, now_s):
        self.registers = {1: 0x080060, 2: 0x000117, 4: self.ID, 5: 0, 6: 0x800000, 7: 0x555550}
        self.busy_s, self.ones = now_s + 500e-6, 0
        self.reading, self.writing, self.continuous, self.at = [], None, False, 0
        self.status = 0x80
        self.start(now_s, 4 / self.rate())

    def rate(self):
        return 4.92e6 / 1024 / (self.registers[1] & 0x3FF)

    def convert(self):
        gain = {0: 1, 3: 8, 4: 16, 5: 32, 6: 64, 7: 128}[self.registers[2] & 7]
        assert not self.registers[2] & 8, "unipolar"
        assert self.registers[2] >> 8 & 0xFF == 1, "AIN1 - AIN2 alone"
        missing = self.reference_v < 0.3
        share = self.volts * gain / self.reference_v if not missing else 0.0
        code = self.noisy(round(share * 2**23)) + 2**23
        clamped = not 0 <= code < 2**24 or missing
        self.data = 0xFFFFFF if missing else min(max(code, 0), 2**24 - 1)
        detected = missing and self.registers[2] & 0x40
        odd = bin(self.data).count("1") % 2 and self.registers[1] >> 13 & 1
        self.status = (0x40 if clamped else 0) | (0x20 if detected else 0) | (0x10 if odd else 0)

    def result(self):
        appended = [self.status] if self.registers[1] >> 20 & 1 else []
        return [*self.data.to_bytes(3, "big"), *appended]

    def byte(self, sent, now_s):
        self.ones = self.ones + 8 if sent == 0xFF else 0
        if self.ones >= 40:
            self.reset(now_s)
            self.ones = 40
            return 0xFF
        if self.reading:
            return self.reading.pop(0)
        if self.writing is not None:
            number, left, value = self.writing
            value = value << 8 | sent
            self.writing = (number, left - 1, value) if left > 1 else None
            if left == 1:
                self.registers[number] = value
                if number in (1, 2):
                    order = 3 if self.registers[1] >> 15 & 1 else 4
                    self.start(now_s, order / self.rate())
            return 0xFF
        if self.continuous:
            if not self.ready:
                return 0xFF
            if sent == 0x58:
                self.continuous = False
                return 0xFF
            self.ready = False
            first, *self.reading = self.result()
            return first
        self.command(sent, now_s)
        return 0xFF

    def command(self, sent, now_s):
        if sent == 0xFF or sent & 0x80:  # WEN: the bits that follow are not taken
            return
        if now_s < self.busy_s:
            self.mistakes.append("accessed within 500 us of a reset")
        number = sent >> 3 & 7
        if sent & 0x04:
            self.continuous = sent == 0x5C
        elif sent & 0x40:
            value = (
                self.status if number == 0 else self.data if number == 3 else self.registers[number]
            )
            self.reading = list(value.to_bytes(self.BYTES[number], "big"))
        else:
            self.writing = (number, self.BYTES[number], 0)


class Ads1256(Converter):
    spi_mode = 1
    CLOCK_HZ = 7.68e6
    bits_per_s_max = CLOCK_HZ / 4  # t1
    ID = 3
    RATES: ClassVar = {0xF0: (30000, 210e-6), 0xD0: (7500, 310e-6)}  # with settling, table 13
    CALIBRATION_S: ClassVar = {0xF0: 600e-6, 0xD0: 900e-6}

    def reset(self, now_s):
        self.registers = [self.ID << 4 | 1, 0x01, 0x20, 0xF0, 0xE0, *[0] * 6]
        self.pending, self.reading, self.continuous = [], [], False
        self.ended_s = now_s
        self.calibrate(now_s)

    def rate(self):
        return self.RATES[self.registers[3]][0]

    def calibrate(self, now_s):
        self.busy_s = now_s + self.CALIBRATION_S[self.registers[3]]
        self.start(now_s, self.busy_s - now_s)

    def convert(self):
        gain = 1 << min(self.registers[2] & 7, 6)
        assert self.registers[1] == 0x01, "AIN0 - AIN1"
        code = self.noisy(round(self.volts * gain / (2 * self.reference_v) * 2**23))
        self.data = min(max(code, -(2**23)), 2**23 - 1)

    def byte(self, sent, now_s):
        if self.reading:
            if self.answers and now_s - self.asked_s < 50 / self.CLOCK_HZ:
                self.mistakes.append("t6: data before 50 cycles")
            self.answers = False
            return self.reading.pop(0)
        if self.continuous:
            if sent in (0x0F, 0xFE):
                self.continuous = False
            elif self.ready:
                self.ready = False
                first, *self.reading = (self.data & 0xFFFFFF).to_bytes(3, "big")
                return first
            if sent != 0xFE:
                return 0
        self.pending.append(sent)
        self.command(now_s)
        return 0xFF

    def check_time(self, command, now_s):
        if now_s < self.busy_s and command != 0xFE:
            self.mistakes.append("command during a calibration")
        if now_s - self.ended_s < 4 / self.CLOCK_HZ:
            self.mistakes.append("t11: command before 4 cycles")

    def command(self, now_s):
        first, *rest = self.pending
        if not rest:
            self.check_time(first, now_s)
        if first >> 4 == 5:
            if len(rest) < 1 or len(rest) < 2 + rest[0]:
                return
            for i, value in enumerate(rest[1:]):
                at = (first & 15) + i
                self.registers[at] = self.registers[at] & 0xF1 | value & 0x0E if at == 0 else value
            self.start(now_s, self.RATES[self.registers[3]][1])
        elif first >> 4 == 1:
            if not rest:
                return
            at = first & 15
            self.registers[0] = self.registers[0] & 0xFE | (not self.ready)
            self.reading = self.registers[at : at + 1 + rest[0]]
            self.answers, self.asked_s = True, now_s + 8 / 1.3125e6
        elif first == 0xF0:
            self.calibrate(now_s)
        elif first == 0xFE:
            self.reset(now_s)
        elif first == 0x03:
            if not self.ready:
                self.mistakes.append("RDATAC while no conversion is ready")
            self.continuous = True
        self.pending = []
