"""Stops several axes for `forceaxis axis stop`.

Each axis is commanded before the program waits for any axis of the same line. The time until the
last axis is commanded then depends on no ramp, and on each silent axis only by one short time-out.
"""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from types import FrameType
from typing import TYPE_CHECKING

import click

from forceaxis import signals
from forceaxis.axis import address as addresses
from forceaxis.axis.address import SerialAddress
from forceaxis.cli.live_options import AxisConnection, warn_of_link
from forceaxis.pages.commands import with_commands

if TYPE_CHECKING:
    from forceaxis.axis.actions import AxisStatus
    from forceaxis.axis.axis import Axis
    from forceaxis.results import Convertible

# Longest time in s to wait for the answer to a stop command. An axis answers within some ms.
# The time in which a serial line transmits the bits of request and answer is added to it.
FIRST_ANSWER_S = 0.3
REQUEST_BITS = 200  # bits of request and answer on a serial line, with pauses
# Number of stop commands that each axis of a serial line gets before the program waits for answers.
# The second command is for an axis whose first request was disturbed.
FIRST_ROUNDS = 2

Describe = Callable[["Axis", str, "AxisStatus"], str]


@dataclass(frozen=True)
class StoppedAxis:
    """One of several axes that `forceaxis axis stop` has stopped."""

    axis: str  # its address
    state: AxisStatus
    text: str

    def result(self) -> dict[str, Convertible]:
        """Return the address and the state of a stopped axis, as the option --json prints them."""
        return {"axis": self.axis, **vars(self.state)}


Outcome = StoppedAxis | str  # a stopped axis, or the text of an error


@dataclass(frozen=True)
class AxisOutcome:
    """The address of an axis that was commanded to stop, and the outcome: the stopped axis or an
    error."""

    address: str
    outcome: Outcome


Told = AxisOutcome | None  # None: the user or the system has interrupted the program


def stop_all(
    each: Sequence[AxisConnection], describe: Describe, report: Callable[[Outcome], None]
) -> None:
    """Stop several axes. As soon as the outcome for an axis is known, call report() with this
    outcome. describe(axis, prefix, state) returns the text about a stopped axis. After Ctrl-C or
    SIGTERM, end the program as soon as each axis has been commanded to stop. After a second Ctrl-C
    or SIGTERM, end the program at once."""
    lines = lines_of(each)
    told: SimpleQueue[Told] = SimpleQueue()
    commanded = [threading.Event() for _ in lines]
    waiting = [str(one.address) for line in lines for one in line]
    with interrupts(told) as interrupt:
        for line, event in zip(lines, commanded, strict=True):
            threading.Thread(
                target=stop_line, args=(line, describe, told, event), daemon=True
            ).start()
        while waiting and (done := first_told(told)) is not None:
            waiting.remove(done.address)
            report(done.outcome)
        if not interrupt:
            return
        for event in commanded:
            signals.wait(event)
        click.echo(
            "forceaxis: interrupted; each axis that can be reached was commanded to stop"
            + (f", without a report yet: {', '.join(waiting)}" if waiting else ""),
            err=True,
        )
        sys.exit(128 + interrupt[0])


def first_told(told: SimpleQueue[Told]) -> Told:
    """Wait until the queue has an element, remove the first element and return it. Signals of the
    system are handled meanwhile."""
    while True:
        with contextlib.suppress(Empty):
            return told.get(timeout=signals.NOTICED_S)


@contextlib.contextmanager
def interrupts(told: SimpleQueue[Told]) -> Iterator[list[int]]:
    """Context manager that handles Ctrl-C and SIGTERM. The first signal puts None into the queue
    `told` and does not end the program, so that each axis is still commanded to stop. The second
    signal ends the program. The context returns a list, which has the number of the first signal as
    soon as this signal was received."""
    first: list[int] = []

    def interrupt(number: int, _frame: FrameType | None) -> None:
        if first:
            raise KeyboardInterrupt(number)
        first.append(number)
        told.put(None)

    before = {one: signal.signal(one, interrupt) for one in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield first
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)


def lines_of(each: Sequence[AxisConnection]) -> list[list[AxisConnection]]:
    """Return the connections to axes in groups, each a list. Connections in one group must not be
    open at the same time, for example because they use one serial device. If several addresses
    select the same axis, the result has this axis only once."""
    lines: dict[object, dict[object, AxisConnection]] = {}
    for one in each:
        line = lines.setdefault(addresses.shared(one.address), {})
        line.setdefault((rate_of(one), one.address.number), one)
    return [[*line.values()] for line in lines.values()]


def rate_of(connection: AxisConnection) -> int | None:
    """Return the bit rate of a serial line in bit/s, or None for another kind of connection."""
    address = connection.address
    return addresses.bit_rate(address) if isinstance(address, SerialAddress) else None


def stop_line(
    line: Sequence[AxisConnection],
    describe: Describe,
    told: SimpleQueue[Told],
    commanded: threading.Event,
) -> None:
    """Stop the axes of one serial line, and put the outcome for each axis into the queue `told`.
    Set the event `commanded` when each of these axes has been commanded to stop or cannot be
    reached."""
    try:
        if len(line) > 1:
            warn_of_rates(line)
            line = command_all(line)
            commanded.set()
        for one in line:
            told.put(AxisOutcome(str(one.address), stop_one(one, describe, commanded)))
    finally:
        commanded.set()


def warn_of_rates(line: Sequence[AxisConnection]) -> None:
    """Print a warning if the user gave several bit rates for one serial device. Its axes can only
    use one of them; nevertheless the axes are commanded at each given bit rate."""
    first = line[0]
    rates = {rate_of(one): one for one in reversed(line)}
    for rate, one in rates.items():
        if rate != rate_of(first):
            click.echo(
                f"forceaxis: warning: {one.address}: expected the bit rate of "
                f"{first.address}, {rate_of(first)} bit/s, on the same device, got {rate} bit/s",
                err=True,
            )


def command_all(line: Sequence[AxisConnection]) -> list[AxisConnection]:
    """Command each axis of a serial line to stop, without waiting until the axes stand still.
    Return all axes. Axes that did not answer come first in this list, because they may still
    move."""
    silent = [*line]
    for _ in range(FIRST_ROUNDS):
        silent = [one for one in silent if not answers_command(one)]
    return [*silent, *(one for one in line if one not in silent)]


def answers_command(connection: AxisConnection) -> bool:
    """Send one stop command to an axis. Return True if the axis has accepted this command."""
    from forceaxis.axis.actions import QUICK_STOP

    rate = rate_of(connection)
    timeout_s = FIRST_ANSWER_S + (REQUEST_BITS / rate if rate else 0.0)
    # The errors concern this axis alone. They are reported when the axis is commanded again.
    with contextlib.suppress(Exception), contextlib.closing(connection.link(timeout_s)) as link:
        link.write({"controlword": QUICK_STOP})
        return True
    return False


def stop_one(connection: AxisConnection, describe: Describe, commanded: threading.Event) -> Outcome:
    """Stop one of several axes. Return the state of the stopped axis, or the text of an error. An
    error does not raise an exception, because the other axes still have to be stopped."""
    from forceaxis.axis import actions
    from forceaxis.axis.axis import Axis

    where = str(connection.address)
    try:
        with contextlib.closing(Axis(connection.link())) as axis:
            if not commanded.is_set():
                actions.command_stop(axis)
                commanded.set()
            warn_of_link(axis)
            now = axis.stop()
            return StoppedAxis(where, now, describe(axis, f"{where}: stopped", now))
    except Exception as error:
        text = with_commands(str(error) or repr(error), connection.options())
        return f"{where}: {' '.join(text.split())}"
