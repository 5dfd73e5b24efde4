"""The instructions of a tick by function: a fuzzed run on the emulated Cortex-M4, and its table."""

import math
from collections import Counter, defaultdict

import chip as released
from converters import Ads1256
from cortex_m4 import Chip, Code, Inputs, run
from drive_bench import FORCE, LAW, SETTINGS, bench, frames_of, stored
from forceaxis.objects import BY_NAME
from tick_fuzz import CYCLE, CycleFuzz, Fuzz, GuidedFuzz
from unicorn import UC_HOOK_CODE

SEED = 1
TICKS, TICKS_GUIDED = 80_000, 40_000
# Besides, with cycles alone: of ten seeds the seed with the longest tick.
TICKS_OF_CYCLES, SEED_OF_CYCLES = 40_000, 4
CAN_MAILBOXES = 3  # of a bxCAN: frames that can be sent in one tick
LATE = 0.002  # share of the ticks after which fw_between() is late
ENABLED = 4  # AXIS_DRIVE_STATE_
MODE_NAMES = {
    1: "pp",
    3: "pv",
    4: "tq",
    6: "hm",
    8: "csp",
    9: "csv",
    10: "cst",
    0: "none, holds",
    -1: "force, counts",
    -2: "open loop",
    -3: "excitation",
    -4: "native position",
    -5: "guarded move",
    -6: "stiffness",
    -7: "damping",
    -8: "impedance",
    CYCLE: "cycle",
}
OFF = "not enabled, stopping"
RESET = ("power_up", "canopen_init")
# The timer starts the conversions of both channels, which take 3.81 us, 640 cycles of the core. The
# entry of the interrupt takes 12 cycles, and each instruction before the first poll takes a cycle
# at least. A poll has eight reads of 6 cycles at least, four other instructions, and a branch that
# is taken, of 2 cycles at least.
CONVERSION_CYCLES, ENTRY_CYCLES, POLL_CYCLES = 640, 12, 54
# Instructions from the reading of the flag of the ADC to that of CR1, which only a poll reads.
FLAG_TO_CR1 = 4
LIMITS = released.BOARD.limits
# By a model of core, flash accelerator and buses over 40,000 fuzzed ticks; only a board shows it.
CYCLES_PER_INSTRUCTION = 2.6
TICK_CYCLES = 112_000


def cycles(instructions):
    """The cycles of the core, by the model."""
    return round(instructions * CYCLES_PER_INSTRUCTION)


class Worst:
    """The longest call of one kind, and its instructions by function."""

    def __init__(self):
        self.count, self.shares, self.counts = 0, [], []

    def take(self, chip, names=None):
        """Records a call; with `names` only the instructions of these functions."""
        shares = chip.shares(names) if names else None
        count = sum(c for c, _ in shares) if names else chip.count
        self.counts.append(count)
        if count > self.count:
            self.count, self.shares = count, shares or chip.shares()

    def percentile(self, n):
        return sorted(self.counts)[(len(self.counts) - 1) * n // 100]


class Watched:
    """The chip, with the calls between two ticks counted by kind."""

    def __init__(self, chip, frames):
        self.chip, self.frames = chip, frames

    @property
    def outputs(self):
        return self.chip.outputs

    def __getattr__(self, name):
        return getattr(self.chip, name)

    def receive(self, can_id, data):
        self.chip.receive(can_id, data)
        self.count(self.kind(can_id, data))

    def modbus(self, data):
        self.chip.modbus(data)
        self.count("Modbus request of at most 14 registers")

    def count(self, kind):
        self.frames[kind] = max(self.frames[kind], self.chip.count)

    @staticmethod
    def kind(can_id, data):
        if can_id < 0x80:
            return "NMT"
        if can_id == 0x80:
            return "SYNC, up to 4 TPDOs and 4 RPDOs"
        if can_id >= 0x700:
            return "heartbeat"
        if can_id >= 0x600:
            command = data[0] >> 5
            return {2: "SDO upload", 1: "SDO download"}.get(command, "SDO segment, abort")
        return "RPDO, up to 8 objects"


class Port:
    """What the port adds in the tick's interrupt of the released image to the firmware's calls:
    at most, of ticks that are off, go on, are on and go off."""

    CALLS = ("fw_prepare", "fw_control", "fw_report")
    # CR1 and JDR2 of the ADC, DHR12R1 of the DAC
    POLLED, LAST_INPUT, OUTPUT = 0x04, 0x40, 0x08

    def __init__(self, flash=None, polls=1):
        """`flash`: the stored parameters; `polls`: of the ADC in each tick."""
        run(released.ROOT / "tools/image")
        self.owner = Code(released.IMAGE).owner
        self.board = released.Chip(flash)
        self.board.board.adc.ready_reads = 1 + polls  # monitor_look() reads the flags too
        self.starts = {self.board.symbols[name] & ~1 for name in self.CALLS}
        self.total = self.from_adc_to_dac = 0
        self.before_polls = math.inf  # fewest instructions before a poll that finds no result
        self.notice(self.board.board.adc, "read", self.POLLED, self.polled)
        self.notice(self.board.board.adc, "read", self.LAST_INPUT, self.sample_taken)
        self.notice(self.board.board.dac, "write", self.OUTPUT, self.output_written)
        self.count, self.inside, self.sampled = 0, False, None
        # From the start: blocks translated before would not be counted.
        self.board.uc.hook_add(UC_HOOK_CODE, self.executed)
        self.run()

    def notice(self, peripheral, access, register, what):
        original = getattr(peripheral, access)

        def noticed(offset, *value):
            if offset == register:
                what()
            return original(offset, *value)

        setattr(peripheral, access, noticed)

    def polled(self):
        self.before_polls = min(self.before_polls, self.count - FLAG_TO_CR1)

    def sample_taken(self):
        self.sampled = self.count

    def output_written(self):
        if self.sampled is not None:
            self.from_adc_to_dac = max(self.from_adc_to_dac, self.count - self.sampled)
        self.sampled = None

    def executed(self, _uc, address, _size, _data):
        name = self.owner.get(address)
        self.inside = address in self.starts or (self.inside and name != "port_tick")
        self.count += name is not None and not self.inside

    def tick(self):
        self.count, self.inside, self.sampled = 0, False, None
        self.board.tick(hung=True)
        self.total = max(self.total, self.count)
        self.board.main()

    def run(self):
        released.release(self.board)
        assert self.board.write("open_loop_code", 100) == 0
        open_loop = BY_NAME["mode"].enum.index("open_loop")
        for mode in (0, open_loop, 0):
            assert self.board.write("mode", mode) == 0
            for _ in range(3):
                self.tick()
            assert self.board.terminals()[0] == (mode == open_loop)


class DrivePort(Port):
    """The same with a drive at the second CAN and a converter of the force at SPI2: the drive is
    enabled, presses and is switched off; frames, conversions and their interrupts are between the
    ticks."""

    def __init__(self):
        self.frame = 0  # instructions of the longest interrupt of a frame
        converter = BY_NAME["force_converter"].enum.index("ads1256")
        super().__init__(stored(SETTINGS | {"force_converter": converter}))

    def receive(self, can_id, data):
        self.board.board.can2.receive(can_id, data)
        self.interrupts()

    def interrupts(self):
        self.count, self.inside = 0, False
        self.board.interrupts()
        self.frame = max(self.frame, self.count)

    def take(self, force_code):
        """A tick, and the frames that it sends."""
        board = self.board.board
        board.converter.volts = (force_code - 2048) / 2048 * 5.0
        self.board.convert(board.time_s() + (board.tim4.next - board.cycles) / 168e6)
        self.tick()
        return frames_of(self.board, self.interrupts)

    def run(self):
        self.board.board.converter = Ads1256()
        released.release(self.board)
        for name, value in LAW.items():
            assert self.board.write(name, value) == 0
        with bench(self, "the port with a drive") as made:
            made.tick(300)
            for mode, ticks in ((FORCE, 300), (0, 30)):
                assert self.board.write("mode", mode) == 0
                made.tick(ticks)
                assert self.board.terminals()[0] == (mode == FORCE)


class Profile:
    def __init__(self, ticks=TICKS, seed=SEED):
        self.chip = Chip()
        self.ticks, self.seed = ticks, seed
        self.modes = defaultdict(Worst)
        self.between, self.late, self.evaluation = Worst(), Worst(), Worst()
        self.port, self.drive = Port(), DrivePort()
        waiting = Port(polls=2)
        self.poll, self.before_polls = waiting.total - self.port.total, waiting.before_polls
        self.waited = self.longest = 0
        self.resets, self.axis, self.banked = Worst(), Worst(), Worst()
        self.control = 0
        self.frames = Counter()
        self.run(self.chip, Fuzz(BY_NAME, self.seed), self.ticks)
        # Kept, because the emulator still calls their counters.
        self.busy_chip, self.guided_chip = Chip(), Chip()
        self.run(self.busy_chip, CycleFuzz(BY_NAME, SEED_OF_CYCLES), TICKS_OF_CYCLES)
        self.run(self.guided_chip, GuidedFuzz(BY_NAME, self.seed), TICKS_GUIDED)
        self.executed = self.chip.executed() | self.busy_chip.executed()
        self.executed |= self.guided_chip.executed()

    def polled(self, prepare):
        """Instructions of the polls of the ADC that find no result, in a tick in which fw_prepare()
        has `prepare` instructions."""
        left = CONVERSION_CYCLES - ENTRY_CYCLES - self.before_polls - prepare
        return self.poll * max(0, math.ceil(left / POLL_CYCLES))

    def run(self, chip, fuzz, ticks):
        state = BY_NAME["drive_state"].number
        display = BY_NAME["modes_of_operation_display"].number
        side = Watched(chip, self.frames)
        inputs = Inputs(0, (0, 0), 1, 1)
        resets = [chip.code.names.index(name) for name in RESET]
        waiting = False
        axis = sorted(chip.code.names.index(n) for n in chip.code.reachable("axis_tick"))
        # In a force mode the drive makes the waveform, not axis_tick().
        drive = chip.code.names.index("contact_excitation_prepare")
        waveform = chip.code.names.index("excitation_step")
        excited = [n for n in axis if n != waveform]
        law = chip.code.names.index("force_law_step")
        evaluates = chip.code.names.index("cycle_element_take")
        for _ in range(ticks):
            fuzz.step(side, inputs)
            chip.interrupt(bytes(inputs))
            worst = self.banked if chip.shares_of[law + 1] else self.axis
            worst.take(chip, excited if chip.shares_of[drive + 1] else axis)
            self.control = max(self.control, chip.control_count)
            waited = self.polled(chip.prepare_count)
            self.waited = max(self.waited, waited)
            self.longest = max(self.longest, chip.count + waited)
            mode = chip.byte(display)
            mode = mode - 256 if mode > 127 else mode
            enabled = chip.byte(state) == ENABLED
            self.modes[mode if enabled else OFF].take(chip)
            if fuzz.rng.random() < LATE:
                waiting = True
                continue
            chip.between()
            if any(chip.shares_of[i + 1] for i in resets):
                self.resets.take(chip)
            elif chip.shares_of[evaluates + 1]:
                self.evaluation.take(chip)
            else:
                (self.late if waiting else self.between).take(chip)
            waiting = False
            for _ in range(CAN_MAILBOXES):
                if chip.transmit() is None:
                    break

    @property
    def worst(self):
        return max(self.modes.values(), key=lambda w: w.count)

    @property
    def interrupt(self):
        return self.longest + max(self.port.total, self.drive.total)

    @property
    def from_adc_to_dac(self):
        return self.control + max(self.port.from_adc_to_dac, self.drive.from_adc_to_dac)

    def coverage(self, *roots):
        """(executed, all) instructions of what functions can come to, and those missed by name."""
        code, executed = self.chip.code, self.executed
        missed, total = {}, 0
        for name in sorted(code.reachable(*roots)):
            addresses = code.instructions[name]
            total += len(addresses)
            left = sum(a not in executed for a in addresses)
            if left:
                missed[name] = left
        return total - sum(missed.values()), total, missed

    def in_cycles(self):
        """Lines of text: the interrupt as a time."""
        words = []
        for count in (self.interrupt, LIMITS.interrupt_instructions):
            share = 100 * cycles(count) / TICK_CYCLES
            words.append(
                f"{cycles(count)} cycles, {cycles(count) / 168:.0f} us, {share:.1f} % of a tick"
            )
        return [
            f"At {CYCLES_PER_INSTRUCTION} cycles an instruction, wait states and buses included,",
            f"at most {words[0]}; the limit is {words[1]}.",
        ]

    def table(self):
        done, total, missed = self.coverage(*Port.CALLS)
        axis_done, axis_total, _ = self.coverage("axis_tick")
        lines = [
            "# Instructions of a tick",
            "",
            "Made by `tools/tick_profile`, compared by `tests/firmware/chip/test_budget.py`; "
            "do not edit.",
            "",
            f"Cortex-M4, {self.chip.compiler}, -O2,",
            f"{self.ticks:,} fuzzed ticks (seed {self.seed}), {TICKS_GUIDED:,} with first motions",
            f"and cycles, and {TICKS_OF_CYCLES:,} with cycles of short phases (seed "
            f"{SEED_OF_CYCLES}): random modes, parameters, mappings,",
            "PDO, SYNC, NMT, SDO and Modbus traffic, eight recorder channels, broken sensors and",
            "masters. Instructions that a condition skips count. The cycles are those of a model",
            f"of core, flash accelerator and buses, {CYCLES_PER_INSTRUCTION} for an instruction.",
            "On a board, `tick_time_max` has the time of a tick.",
            "",
            "## fw_prepare(), fw_control() and fw_report()",
            "",
            "| mode of operation | ticks | median | 99 % | at most | cycles |",
            "| --- | ---: | ---: | ---: | ---: | ---: |",
        ]
        order = [*MODE_NAMES, OFF]
        for mode in sorted(self.modes, key=order.index):
            w = self.modes[mode]
            name = OFF if mode == OFF else f"{mode} ({MODE_NAMES[mode]})"
            figures = [len(w.counts), w.percentile(50), w.percentile(99), w.count, cycles(w.count)]
            lines.append(f"| {name} | " + " | ".join(map(str, figures)) + " |")
        lines += [
            "",
            f"At most {self.worst.count}. {done} of the {total} instructions it can come to were",
            f"executed ({100 * done / total:.1f} %).",
            "",
            "The longest one by function:",
            "",
            "| function | instructions |",
            "| --- | ---: |",
            *(f"| {name} | {count} |" for count, name in self.worst.shares),
            "",
            "Not executed: " + ", ".join(f"{n} {c}" for n, c in missed.items()) + ".",
            "",
            f"axis_tick() and what it calls: at most {self.axis.count}, with a bank of the force"
            f" law {self.banked.count}; {axis_done} of {axis_total} executed.",
            "",
            "## The whole interrupt",
            "",
            "| what | at most | limit | cycles |",
            "| --- | ---: | ---: | ---: |",
            *(
                f"| {what} | {count} | {limit} | {cycles(count)} |"
                for what, count, limit in self.interrupt_rows()
            ),
            "",
            *self.in_cycles(),
            "",
            "## After it, before the next one",
            "",
            "| what | at most | cycles |",
            "| --- | ---: | ---: |",
            *(f"| {what} | {count} | {cycles(count)} |" for what, count in self.between_rows()),
            "",
        ]
        return "\n".join(lines)

    def interrupt_rows(self):
        """What, its instructions, and their limit, for the table of the interrupt."""
        adc_to_dac = max(self.port.from_adc_to_dac, self.drive.from_adc_to_dac)
        return [
            ("fw_prepare(), fw_control() and fw_report()", self.worst.count, ""),
            (
                "polls of the ADC until the conversions end, the fewer the longer fw_prepare() is",
                self.waited,
                "",
            ),
            (
                "the port: entry, inputs, last poll of the ADC, outputs, watchdog, exit",
                self.port.total,
                "",
            ),
            (
                "the same with a drive at the second CAN and a converter at SPI2, without their "
                "interrupts",
                self.drive.total,
                "",
            ),
            (
                "the longest tick, with an amplifier for +-10 V",
                self.longest + self.port.total,
                "",
            ),
            ("the longest tick", self.interrupt, LIMITS.interrupt_instructions),
            ("fw_control()", self.control, ""),
            ("the port from the last reading of the ADC to the DAC", adc_to_dac, ""),
            ("ADC read to DAC write", self.from_adc_to_dac, LIMITS.adc_to_dac_instructions),
        ]

    def between_rows(self):
        """What, and its instructions, for the table of the time between two ticks."""
        return [
            ("fw_between()", self.between.count),
            ("fw_between() with elements of a cycle, 16 at most", self.evaluation.count),
            ("fw_between() that makes up for a tick", self.late.count),
            ("fw_between() with a reset, no memory", self.resets.count),
            *sorted(self.frames.items()),
            ("interrupt of a frame from or to a drive", self.drive.frame),
        ]
