"""Brings a board into operation without a motor. Each step asks a person for an action at the
board, reads objects of the axis, and checks their values. The README.md of the board describes
these steps, in firmware/port/stm32f4 and firmware/port/stm32g4.

    protocol = bring_up(axis, Person(), BringupRequest())
    protocol.passed                     # True if every step passed
"""

import datetime
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

from forceaxis._core import InputError
from forceaxis.axis import parameter_set
from forceaxis.axis.axis import Axis
from forceaxis.axis.link import (
    COMMAND_SOURCES,
    DEVICE_NAME_INDEX,
    HARDWARE_INDEX,
    TICKS_PER_S,
    VERSION_INDEX,
    NoAnswer,
    Refused,
)
from forceaxis.bus.lcm import TABLE_HASH
from forceaxis.objects import bits_in, mask

PASSED, FAILED, SKIPPED = "passed", "failed", "skipped"
# Longest computing time of a tick in us that is permitted: 15 % of the tick period.
# A model of core and flash memory gives 55 us for a tick (docs/chip/instructions.md).
TICK_TIME_MAX_US = 100
# Longest permitted delay of a tick in us.
# The main loop disables the tick interrupt for at most 40 us (port/main.c).
TICK_LATE_MAX_US = 60
# largest relative difference between the tick rate and the clock of this computer
RATE_TOLERANCE = 0.01
RATE_TIME_S = 4.0
# largest relative difference between the tick length and the second clock of the board
DEVIATION_MAX = 0.06
SETTLE_S = 2.0  # longest time in s until a board has compared its clocks and joined a CAN bus
SUPPLY_V, FULL_CODES = 3.3, 4096
READINGS = 20
# The voltage that the ADC measures may differ from the voltmeter by 2 % of the voltage plus 20 mV.
VOLTAGE_SHARE, VOLTAGE_MAX_V = 0.02, 0.02
# Crosstalk: the voltage at another input changes a reading by at most this fraction of the change.
CROSSTALK_MAX = 0.01
TURN_TOLERANCE = 0.05  # relative tolerance of one turn that a person makes by hand
# DAC codes of the step "outputs". The first, small codes show whether a motor is still connected.
CODES = (0, 50, -50, 500, 1000, 1700, 2000, -500, -1000, -1700, -2000)
# SPEED_MAX: speed in counts/tick above which the axis has a fault during the step "outputs".
# MOTION_MAX: motion in encoder counts that ends the step "outputs".
SPEED_MAX, MOTION_MAX = 1, 3
CODE_V = 20 / 4096  # voltage in V of one DAC code at the output of the +-10 V stage
STAGE_MAX_V = 0.1

# the bit "tick_unknown" of board_state is no error
NOT_COMPARED = mask("board_state", "tick_unknown")
# {name of a bit of board_state: text about the error and its remedy}
OUTPUT_ERRORS = {
    "dac": "the voltage at PA4 differs from the DAC code: nothing may load PA4 or drive it",
    "enable": "the level at PB0 differs from amp_enable: PB0 is shorted, or something drives it",
}
BOARD_ERRORS = {
    "image": "the image in the flash memory is damaged: run `write_image` again",
    "ram": "the RAM has failed: replace the chip",
    "supply": "the supply voltage is below 2.9 V: check the supply at 3V3",
    "reference": "the ADC reference is outside its band: the supply is not 3.3 V within 10 %",
    **OUTPUT_ERRORS,
    "tick": "the tick length differs from the second clock: replace the chip",
}


@dataclass(frozen=True)
class BoardFacts:
    """Properties of a board that steps of the bring-up need. `errors`: texts for the bits of
    board_state whose meaning depends on the board. `stage_codes`: DAC codes at which the person
    measures the voltage of the +-10 V stage. `source_ohm`: largest resistance in ohm of a voltage
    source at an input of the ADC."""

    errors: dict[str, str]
    openocd_config: str
    stage_codes: tuple[int, ...]
    source_ohm: int


# {text of object 1009h: properties of the board}. An unknown board is treated like the first one.
BOARDS = {
    "stm32f446": BoardFacts(
        errors={
            "clock_internal": "the 8 MHz of the ST-Link do not arrive at PH0, so the internal "
            "oscillator is in use: check the solder bridges (UM1724)",
            "option_bytes": "the option bytes for brown-out reset and write protection of the "
            "loader have other values: run `write_image` again, which sets them",
            "converter": "the converter of the force does not answer as expected: check SPI2 and "
            "force_converter, which is adc without a converter",
        },
        openocd_config="board/st_nucleo_f4.cfg",
        stage_codes=(0, 2000, -2000),
        source_ohm=10_000,
    ),
    "stm32g474": BoardFacts(
        errors={
            "clock_internal": "the crystal of 24 MHz at PF0 and PF1 does not start, so the "
            "internal oscillator is in use: check the crystal and its solder bridges (UM2505)",
            "option_bytes": "the option bytes for brown-out reset, start and write protection of "
            "the program have other values: run `write_image` again, which sets them",
            "converter": "this board has no connection for a converter of the force: set "
            "force_converter to adc, save, and reset the board",
        },
        openocd_config="board/st_nucleo_g4.cfg",
        # The output buffer of the DAC saturates at code 1799, which is 8.79 V at the +-10 V stage.
        stage_codes=(0, 1700, -1700),
        source_ohm=2_000,
    ),
}
CONTACTS = {
    mask("digital_inputs", "enable"): ("enable chain (PC0)", True),
    mask("digital_inputs", "limit_positive"): ("positive limit switch (PC1)", False),
    mask("digital_inputs", "limit_negative"): ("negative limit switch (PC2)", False),
}  # {bit of digital_inputs: (name of the contact, level while the contact is closed)}
CHANNELS = {"force": ("force_raw", "PA6", "PA7"), "current": ("current_raw", "PA7", "PA6")}


class Operator(Protocol):
    """The person at the board, who does actions and reports numbers."""

    def act(self, text: str) -> bool:
        """Asks for an action and waits for its end. Returns False if the person wants to skip the
        step."""

    def number(self, text: str, unit: str) -> float | None:
        """Asks the person for a number. Returns None if the person does not know the number."""


@dataclass(frozen=True)
class BringupRequest:
    """The request for a bring-up. It contains the names of the steps to do, or () for all steps."""

    steps: Sequence[str] = ()


@dataclass(frozen=True)
class BringupStep:
    """Result of one step of a bring-up: its verdict ("passed", "failed", "skipped"), a text, and
    the values that were read. The text states the finding and, after a failure, the remedy. The
    names of the values contain their units."""

    name: str
    verdict: str
    text: str
    values: dict[str, float]


@dataclass(frozen=True)
class BringupProtocol:
    """The protocol of the bring-up of a board: time (ISO 8601, UTC), connection, device name,
    version, serial number, and the steps that were done."""

    begun: str
    where: str
    device: str
    version: str
    serial_number: int | None
    object_table: str
    steps: list[BringupStep]

    @property
    def passed(self) -> bool:
        """Returns True if every step of the bring-up was done and passed."""
        done = {step.name for step in self.steps if step.verdict == PASSED}
        return done == set(STEPS)


class Skipped(Exception):
    """Exception: the person at the board skips a step."""


@dataclass(frozen=True)
class Bench:
    """The context of a bring-up: a board, the person at the board, and a clock in s."""

    axis: Axis
    operator: Operator
    clock: Callable[[], float]

    @property
    def facts(self) -> BoardFacts:
        """Returns the properties of the board. The name of the board is read from the axis."""
        first = next(iter(BOARDS.values()))
        return BOARDS.get(self.axis.link.text(HARDWARE_INDEX) or "", first)

    def act(self, text: str) -> None:
        """Asks the person for an action. Raises Skipped if the person skips the step."""
        if not self.operator.act(text):
            raise Skipped

    def number(self, text: str, unit: str) -> float:
        """Asks the person for a number that the step needs. Raises Skipped if the person does not
        know it."""
        found = self.operator.number(text, unit)
        if found is None:
            raise Skipped
        return found

    def board_state(self) -> int:
        """Returns the object board_state. Waits before until the board has compared its clocks."""
        for _ in self.axis.link.polls(SETTLE_S):
            state = self.axis.integer("board_state")
            if not state & NOT_COMPARED:
                break
        return state

    def mean_V(self, name: str) -> float:
        """Returns the mean voltage in V at an input of the ADC, read with 12 bits."""
        total = 0
        for _ in range(READINGS):
            total += self.axis.integer(name)
            self.axis.link.wait(0.01)
        return total / READINGS * SUPPLY_V / FULL_CODES


def passed(text: str, **values: float) -> BringupStep:
    """Returns the result of a step that has passed. step_of() adds the name of the step."""
    return BringupStep("", PASSED, text, values)


def failed(text: str, **values: float) -> BringupStep:
    """Returns the result of a step that has failed. step_of() adds the name of the step."""
    return BringupStep("", FAILED, text, values)


def errors_of(state: int, known: dict[str, str]) -> str:
    """Returns a text about the errors in a value of board_state, or an empty text if there are
    none."""
    bits = bits_in("board_state", state)
    return "; ".join(known[bit.key] for bit in bits if bit.key in known)


def causes_of(reset_cause: int) -> str:
    """Returns the names of the causes of the last reset, as text."""
    bits = bits_in("reset_cause", reset_cause)
    return ", ".join(bit.text for bit in bits) or "not known"


def check_identity(bench: Bench) -> BringupStep:
    """Compares the object table of the firmware with the object table of this program."""
    found = bench.axis.integer("object_table_hash")
    version = bench.axis.link.text(VERSION_INDEX) or ""
    if found != TABLE_HASH:
        return failed(
            f"the firmware {version} has the object table {found:08x}, this program has "
            f"{TABLE_HASH:08x}: flash an image of this version"
        )
    return passed(f"firmware {version}, object table {found:08x}")


def check_reset(bench: Bench) -> BringupStep:
    """Reads the cause of the last reset of the processor."""
    cause = bench.axis.integer("reset_cause")
    text = f"the last reset was by: {causes_of(cause)}"
    explained = cause & mask("reset_cause", "pin", "power") or cause == 0
    if explained:
        return passed(text, reset_cause=cause)
    return failed(f"{text}; core_fault_pc and the incident say more", reset_cause=cause)


def check_board(bench: Bench) -> BringupStep:
    """Reads the errors that the self-test of the board has found."""
    state = bench.board_state()
    found = errors_of(state, BOARD_ERRORS | bench.facts.errors)
    if state & NOT_COMPARED:
        found = found or "the second clock of the chip does not run: replace the chip"
    if found:
        return failed(found, board_state=state)
    return passed("oscillator, supply, image, RAM, reference and outputs are right")


def check_tick(bench: Bench) -> BringupStep:
    """Compares the tick rate of the board with the clock of this computer, and reads the longest
    duration of a tick."""
    axis, clock = bench.axis, bench.clock

    def stamped() -> tuple[float, float, int]:
        before = clock()
        ticks = axis.integer("tick_count")
        return before, clock(), ticks

    begin, overruns = stamped(), axis.integer("overruns")
    axis.link.wait(RATE_TIME_S)
    end = stamped()
    ticks = (end[2] - begin[2]) % 2**32
    least, most = ticks / (end[1] - begin[0]), ticks / max(end[0] - begin[1], 1e-9)
    deviation = axis.number("tick_deviation")
    time_us, late_us = axis.integer("tick_time_max"), axis.integer("tick_late_max")
    values = {
        "rate_least_Hz": least,
        "rate_most_Hz": most,
        "tick_deviation": deviation,
        "tick_time_max_us": float(time_us),
        "tick_late_max_us": float(late_us),
        "overruns": float(axis.integer("overruns") - overruns),
    }
    wanted = f"{TICKS_PER_S} ticks per second within {RATE_TOLERANCE:.0%}"
    if least > TICKS_PER_S * (1 + RATE_TOLERANCE) or most < TICKS_PER_S * (1 - RATE_TOLERANCE):
        text = f"expected {wanted}, got {least:.0f} to {most:.0f}: check the oscillator"
    elif abs(deviation) > DEVIATION_MAX:
        text = f"the tick length has changed by {deviation:.1%} against the second clock"
    elif values["overruns"]:
        text = (
            f"{values['overruns']:.0f} ticks were late: the main loop or an interrupt is too long"
        )
    elif not 0 < time_us <= TICK_TIME_MAX_US:
        text = (
            f"expected a tick of at most {TICK_TIME_MAX_US} us, got {time_us} us: check the clock"
        )
    elif late_us > TICK_LATE_MAX_US:
        text = f"expected a tick late by at most {TICK_LATE_MAX_US} us, got {late_us} us"
    else:
        return passed(f"ticks of at most {time_us} us, late by at most {late_us} us", **values)
    return failed(text, **values)


def error_at(axis: Axis, code: int, position: int) -> str:
    """Enables the axis and outputs a DAC code for 0.1 s. Returns a text about the errors of the
    outputs, or an empty text. `position`: position of the axis at rest, in encoder counts."""
    refusal = ""
    try:
        if code == 0:
            axis.enable("open loop", open_loop_code=0)
        axis.set(open_loop_code=code)
        axis.link.wait(0.1)
    except (Refused, NoAnswer) as error:
        refusal = str(error)
    found = errors_of(axis.integer("board_state"), OUTPUT_ERRORS)
    fault = axis.get("fault")["fault"]
    if abs(axis.integer("position") - position) > MOTION_MAX or fault == "overspeed":
        return "the encoder moved: disconnect the motor"
    return found or refusal or ("" if fault == "none" else f"the axis has the fault {fault}")


def check_outputs(bench: Bench) -> BringupStep:
    """Outputs DAC codes with the amplifier enabled. The board itself reads back the pins PA4 and
    PB0."""
    axis = bench.axis
    bench.act(
        "Disconnect the motor and the amplifier. Close the enable chain and both limit contacts. "
        "Connect PA6 and PA7 to their sources, or to a voltage of 0.5 V to 2.8 V."
    )
    values: dict[str, float] = {}
    found = errors_of(bench.board_state(), OUTPUT_ERRORS)
    if found:
        return failed(f"{found} (while the axis is disabled)")
    axis.reset_fault()
    # The first motion test is off, because it would wait for a motion. speed_max limits the speed.
    before = axis.get("first_motion_test", "speed_max")
    axis.set(first_motion_test="off", speed_max=SPEED_MAX)
    position = axis.integer("position")
    try:
        for code in CODES:
            found = error_at(axis, code, position)
            if found:
                return failed(f"{found} (at the DAC code {code})", dac_code=code)
            if code in bench.facts.stage_codes:
                text = f"Voltage of the +-10 V stage at the DAC code {code}, if there is a stage"
                volts = bench.operator.number(text, "V")
                if volts is not None:
                    values[f"stage_{code}_V"] = volts
    finally:
        axis.off()
        axis.put_back(**before)
    for code in bench.facts.stage_codes:
        volts = values.get(f"stage_{code}_V", code * CODE_V)
        if abs(volts - code * CODE_V) > STAGE_MAX_V:
            return failed(
                f"expected {code * CODE_V:.2f} V at the DAC code {code}, got {volts:.2f} V: trim "
                "offset and gain of the stage",
                **values,
            )
    return passed("PA4 and PB0 follow their commands", **values)


def check_channel(bench: Bench, channel: str) -> BringupStep:
    """Compares an input of the ADC with a voltmeter. The ADC converts the other input just before
    this one. Therefore the function then checks that the reading does not change with the voltage
    at the other input."""
    axis = bench.axis
    name, pin, other = CHANNELS[channel]
    bits = axis.integer("adc_bits")
    axis.set(adc_bits=12)
    try:
        wanted = bench.number(
            f"Connect {pin} to the source of the {channel}, at 0.5 V to 2.8 V, and {other} to "
            f"ground. Voltage at {pin} by a voltmeter",
            "V",
        )
        low = bench.mean_V(name)
        bench.act(f"Connect {other} to 3.3 V.")
        high = bench.mean_V(name)
    finally:
        axis.put_back(adc_bits=bits)
    crosstalk = (high - low) / SUPPLY_V
    values = {"voltmeter_V": wanted, "reading_V": low, "crosstalk": crosstalk}
    error = low - wanted
    kilohms = bench.facts.source_ohm / 1000
    if abs(crosstalk) > CROSSTALK_MAX:
        text = (
            f"{pin} follows {other} by {crosstalk:.1%}: the source of the {channel} has more than "
            f"{kilohms:g} kOhm, so add a follower"
        )
    elif abs(error) > VOLTAGE_SHARE * abs(wanted) + VOLTAGE_MAX_V:
        text = (
            f"expected {wanted:.3f} V at {pin}, got {low:.3f} V: the source has more than "
            f"{kilohms:g} kOhm and needs a follower, or {pin} is not connected to the source"
        )
    else:
        return passed(f"{low:.3f} V at {pin}, the voltmeter has {wanted:.3f} V", **values)
    return failed(text, **values)


def check_force(bench: Bench) -> BringupStep:
    """Checks the input of the force sensor."""
    return check_channel(bench, "force")


def check_current(bench: Bench) -> BringupStep:
    """Checks the input of the motor current."""
    return check_channel(bench, "current")


def check_encoder(bench: Bench) -> BringupStep:
    """Compares the encoder counts of one turn by hand with the expected number."""
    lines = bench.number("Lines of the encoder in one turn", "lines")
    begin = bench.axis.integer("position")
    bench.act("Turn the encoder by one turn in the direction of the workpiece, which is positive.")
    counts = bench.axis.integer("position") - begin
    counts = (counts + 2**31) % 2**32 - 2**31
    wanted = 4 * lines
    values = {"counts": counts, "counts_expected": wanted}
    if abs(counts - wanted) <= TURN_TOLERANCE * wanted:
        return passed(f"{counts} counts in a turn", **values)
    if abs(counts + wanted) <= TURN_TOLERANCE * wanted:
        text = "the encoder counts in the wrong direction: exchange A and B"
    elif abs(counts) <= TURN_TOLERANCE * wanted:
        text = f"{counts} counts in a turn: check the line receiver, its supply, and A and B"
    else:
        text = f"expected {wanted:.0f} counts in a turn, got {counts}: check A, B and the lines"
    return failed(text, **values)


def check_contacts(bench: Bench) -> BringupStep:
    """Asks the person to open each contact alone, and checks the digital inputs."""
    bench.act("Close the enable chain and both limit contacts.")
    axis = bench.axis
    closed = axis.integer("digital_inputs")
    for bit, (name, level) in CONTACTS.items():
        if bool(closed & bit) != level:
            return failed(f"the {name} reads as open: check its wire", digital_inputs=closed)
    for bit, (name, _) in CONTACTS.items():
        bench.act(f"Open the {name}.")
        now = axis.integer("digital_inputs")
        changed = (now ^ closed) & sum(CONTACTS)
        if changed != bit:
            what = ", ".join(CONTACTS[i][0] for i in CONTACTS if changed & i) or "no contact"
            return failed(f"expected a change of the {name}, got {what}", digital_inputs=now)
        bench.act(f"Close the {name} again.")
    return passed("each contact is read by its own input")


def can_state(bench: Bench, wanted: str) -> str:
    """Waits until the CAN controller has the wanted state, for a limited time. Returns its last
    state."""
    for _ in bench.axis.link.polls(SETTLE_S):
        state = str(bench.axis.get("can_state")["can_state"])
        if state == wanted:
            break
    return state


def check_can(bench: Bench) -> BringupStep:
    """Checks that frames on the CAN bus are acknowledged."""
    bench.act("Connect the CAN bus: a second node that is on, and 120 Ohm at both ends.")
    rate = bench.axis.integer("bit_rate")
    state = can_state(bench, "active")
    if state == "active":
        return passed("frames are acknowledged", bit_rate_kbit_s=rate)
    if state == "passive":
        return failed(
            "no other node acknowledges frames: check that a second node is on, that both have "
            f"{rate} kbit/s, and the terminations"
        )
    return failed("the controller has left the bus: CAN_H and CAN_L are shorted or exchanged")


def check_can_off(bench: Bench) -> BringupStep:
    """Asks the person to short the CAN bus and then to remove the short. Checks the state of the
    CAN controller in both cases."""
    bench.act("Short CAN_H to CAN_L while a node sends, and leave them shorted.")
    state = can_state(bench, "off")
    if state != "off":
        return failed(f"expected a controller that has left the bus, got {state}: no node has sent")
    bench.act("Open CAN_H and CAN_L again.")
    state = can_state(bench, "active")
    if state != "active":
        return failed(f"expected a controller that is back, got {state}: check the other node")
    # A connection over CAN, for example of a gateway, has lost the axis together with the bus.
    link = bench.axis.link
    if bench.axis.get("command_source")["command_source"] != COMMAND_SOURCES[link.source]:
        link.acquire()
    bench.axis.reset_fault()
    return passed("the controller left the bus and is back")


def check_watchdog(bench: Bench) -> BringupStep:
    """Asks the person to stop the processor core. Checks that the watchdog then resets the
    processor."""
    bench.act(
        "Run in another terminal, with the motor disconnected: openocd -f "
        f"{bench.facts.openocd_config} -c init -c 'mww 0xE0042008 0' -c halt -c shutdown. "
        "Wait until it has ended."
    )
    wanted = mask("reset_cause", "watchdog")
    return after_reset(bench, wanted, "watchdog", "the watchdog did not reset the core")


def after_reset(bench: Bench, wanted: int, name: str, otherwise: str) -> BringupStep:
    """Checks that the board reports the expected cause of the reset that a step has just caused."""
    cause = bench.axis.integer("reset_cause")
    if cause & wanted:
        return passed(f"the last reset was by: {causes_of(cause)}", reset_cause=cause)
    return failed(
        f"expected a reset by {name}, got {causes_of(cause)}: {otherwise}", reset_cause=cause
    )


def check_store(bench: Bench) -> BringupStep:
    """Checks that stored parameters still exist after the power was switched off and on."""
    axis = bench.axis
    parameter_set.store(axis)
    before = axis.integer("store_change_count")
    bench.act("Take the supply off, count to five, and switch the supply on again.")
    wanted = mask("reset_cause", "power")
    reset = after_reset(bench, wanted, "power-up", "the supply was not off for long enough")
    if reset.verdict == FAILED:
        return reset
    state = str(axis.get("store_state")["store_state"])
    changes = axis.integer("store_change_count")
    if state != "loaded" or changes != before:
        return failed(
            f"expected the stored parameters after the power-up, got the state {state} of the "
            "parameter store: replace the chip"
        )
    return passed("the parameters were stored and are back after the power-up")


STEPS: dict[str, Callable[[Bench], BringupStep]] = {
    "identity": check_identity,
    "reset": check_reset,
    "board": check_board,
    "tick": check_tick,
    "contacts": check_contacts,
    "encoder": check_encoder,
    "force": check_force,
    "current": check_current,
    "outputs": check_outputs,
    "can": check_can,
    "can-off": check_can_off,
    "store": check_store,
    "watchdog": check_watchdog,
}


def step_of(bench: Bench, name: str) -> BringupStep:
    """Does one step of the bring-up. If the axis refuses an access, the step has failed."""
    try:
        found = STEPS[name](bench)
    except Skipped:
        found = BringupStep("", SKIPPED, "skipped by the operator", {})
    except (Refused, NoAnswer) as error:
        found = failed(str(error))
    return BringupStep(name, found.verdict, found.text, found.values)


def bring_up(
    axis: Axis,
    operator: Operator,
    request: BringupRequest = BringupRequest(),
    clock: Callable[[], float] = time.monotonic,
) -> Iterator[BringupProtocol]:
    """Does the steps of a request in their order. After each step, yields the test report with all
    steps so far. `clock`: function that returns the time in s. This program must own the axis.
    Raises InputError for an unknown name of a step, and NoAnswer if the axis does not answer at the
    beginning."""
    for name in request.steps:
        if name not in STEPS:
            raise InputError(f"{name}: expected a step of the bring-up: {', '.join(STEPS)}")
    link = axis.link
    serial = "serial_number"
    protocol = BringupProtocol(
        datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        link.where,
        link.text(DEVICE_NAME_INDEX) or "",
        link.text(VERSION_INDEX) or "",
        axis.integer(serial) if link.reaches(serial) else None,
        f"{axis.integer('object_table_hash'):08x}",
        [],
    )
    bench = Bench(axis, operator, clock)
    for name in STEPS:
        if not request.steps or name in request.steps:
            protocol.steps.append(step_of(bench, name))
            yield protocol
