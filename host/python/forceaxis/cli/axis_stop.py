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
from queue import SimpleQueue
from types import FrameType
from typing import TYPE_CHECKING

import click

from forceaxis.axis import address as addresses
from forceaxis.axis.address import SerialAddress
from forceaxis.cli.live_options import AxisConnection, warn_of_link
from forceaxis.pages.commands import with_commands

if TYPE_CHECKING:
    from forceaxis.axis.actions import AxisStatus
    from forceaxis.axis.axis import Axis
    from forceaxis.results import Convertible

# Longest time in s that the first command of a stop waits for its answer, besides the time that the
# serial line needs for the bits of request and answer. An axis answers within some ms.
FIRST_ANSWER_S = 0.3
REQUEST_BITS = 200  # bits of request and answer on a serial line, with pauses
# Number of times that an axis of a line is commanded before the program waits for any of them. The
# second time is for an axis whose first request was disturbed.
FIRST_ROUNDS = 2

Describe = Callable[["Axis", str, "AxisStatus"], str]


@dataclass(frozen=True)
class StoppedAxis:
    """One of several axes that `forceaxis axis stop` has stopped."""

    axis: str  # its address
    state: AxisStatus
    text: str

    def result(self) -> dict[str, Convertible]:
        """Return the address and the state for --json."""
        return {"axis": self.axis, **vars(self.state)}


Outcome = StoppedAxis | str  # a stopped axis, or the text of an error


@dataclass(frozen=True)
class AxisOutcome:
    """The outcome of the stop of one axis with its address."""

    address: str
    outcome: Outcome


Told = AxisOutcome | None  # None: the user or the system has interrupted the program


def stop_all(
    each: Sequence[AxisConnection], describe: Describe, report: Callable[[Outcome], None]
) -> None:
    """Stop several axes, and call report() with the outcome for each axis as soon as it is known.
    describe(axis, prefix, state) is the text about a stopped axis. After Ctrl-C or SIGTERM, end the
    program as soon as each axis has been commanded; after a second one, at once."""
    lines = lines_of(each)
    told: SimpleQueue[Told] = SimpleQueue()
    commanded = [threading.Event() for _ in lines]
    waiting = [str(one.address) for line in lines for one in line]
    with interrupts(told) as interrupt:
        for line, event in zip(lines, commanded, strict=True):
            threading.Thread(
                target=stop_line, args=(line, describe, told, event), daemon=True
            ).start()
        while waiting and (done := told.get()) is not None:
            waiting.remove(done.address)
            report(done.outcome)
        if not interrupt:
            return
        for event in commanded:
            event.wait()
        click.echo(
            "forceaxis: interrupted; each axis that can be reached was commanded to stop"
            + (f", without a report yet: {', '.join(waiting)}" if waiting else ""),
            err=True,
        )
        sys.exit(128 + interrupt[0])


@contextlib.contextmanager
def interrupts(told: SimpleQueue[Told]) -> Iterator[list[int]]:
    """Context manager during which Ctrl-C and SIGTERM put None into the queue `told` the first
    time, so that no axis is left without its command. The second time, they end the program. The
    list has the number of the first signal, if there was one."""
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
    """Return the connections in lists of those that must not be open at the same time, such as the
    axes of one serial device. An axis that has several addresses is in the result once."""
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
    """Stop the axes of one line and put each outcome into the queue `told`. The event `commanded`
    is set when each of the axes has been commanded or cannot be reached."""
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
    """Print a warning for each further bit rate of one serial device, because at most one of them
    is that of its axes. The axes are commanded at every given rate all the same."""
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
    """Command each axis of a line to stop, without waiting for the stop. Return the axes, those
    without an answer first, because they may still move."""
    silent = [*line]
    for _ in range(FIRST_ROUNDS):
        silent = [one for one in silent if not answers_command(one)]
    return [*silent, *(one for one in line if one not in silent)]


def answers_command(connection: AxisConnection) -> bool:
    """Send the command to stop once to an axis. Return True if the axis has accepted it."""
    from forceaxis.axis.actions import QUICK_STOP

    rate = rate_of(connection)
    timeout_s = FIRST_ANSWER_S + (REQUEST_BITS / rate if rate else 0.0)
    # Errors are those of this axis alone, and are reported when the axis is commanded again.
    with contextlib.suppress(Exception), contextlib.closing(connection.link(timeout_s)) as link:
        link.write({"controlword": QUICK_STOP})
        return True
    return False


def stop_one(connection: AxisConnection, describe: Describe, commanded: threading.Event) -> Outcome:
    """Stop one of several axes. Return its state, or the text of the error. An error belongs to
    this axis alone, because the other axes have to be stopped all the same."""
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
