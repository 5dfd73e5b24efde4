"""`forceaxis axis`: read, set up and move one axis over any connection."""

from __future__ import annotations

import dataclasses
import fnmatch
import sys
import textwrap
import time
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

import click

from forceaxis import objects
from forceaxis._core import InputError
from forceaxis.axis import address as addresses
from forceaxis.axis.address import Address, LcmAddress, SimAddress
from forceaxis.cli import live_options
from forceaxis.cli.axis_stop import StoppedAxis, stop_all
from forceaxis.cli.common import (
    Object,
    Positive,
    Verbs,
    aligned,
    as_json,
    fitted,
    print_json,
    print_result,
)
from forceaxis.cli.live_options import (
    STARTED,
    AxisConnection,
    connected,
    live,
    live_in_mm,
    live_over,
    owned,
    warn_of_newtons,
)
from forceaxis.pages.commands import with_commands
from forceaxis.results import to_json

if TYPE_CHECKING:
    from forceaxis.axis.actions import AxisStatus, PressSample
    from forceaxis.axis.axis import Axis
    from forceaxis.axis.scan import ScannedAxis


@click.group(
    cls=Verbs,
    epilog="""forceaxis axis list --on can0
    forceaxis axis get --on lcm:1 force fault
    forceaxis axis set --on can0:3 force_gain=7
    forceaxis axis press --on sim:hold_biquad 30""",
)
def axis() -> None:
    """Operate one axis over its bus: read and write objects, move the axis, press on the workpiece,
    set the tare, record signals.

    \b
    Each command needs the address of one axis, as --on or in FORCEAXIS_AXIS:
      can0:5                    node 5 on the CAN interface can0
      lcm:2                     axis 2 of a gateway; lcm:2@URL on another LCM bus
      tcp://192.168.1.5/3       Modbus TCP, unit 3; tcp://HOST:PORT/3 with a port
      serial:/dev/ttyUSB0:3     Modbus RTU, unit 3; with a bit rate
                                serial:/dev/ttyUSB0@19200:3
      sim:contact               simulated axis of an experiment, name or path;
                                sim:contact@FILE keeps its parameters in FILE

    The number is 1 if an address on CAN or Modbus has none. With can0:5@125 this program has the
    node id 125, if another program on the bus has 126. A command that takes the axis from
    FORCEAXIS_AXIS prints first which axis it is.

    A command that moves the axis owns it while it runs. At its end, and after Ctrl-C, the axis is
    disabled and released. If the command is killed, the watchdog of the axis disables it.
    """


def shown(value: float | str) -> str:
    """Return the value of an object as text. A floating-point value has six significant digits."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def lines(axis: Axis, values: Mapping[str, float | str]) -> Iterator[str]:
    """Yield one text line for each object in `values` ({object name: value}), with the value and
    its unit. A force is shown in N and in force counts."""
    from forceaxis.axis import quantity

    width = max((len(name) for name in values), default=0)
    readings = [name for name in values if quantity.is_reading(objects.BY_NAME[name])]
    newton = quantity.force_per_count(axis) if readings else 0.0
    for name, value in values.items():
        text = shown(value)
        if name in readings and not isinstance(value, str):
            text = f"{value * newton:.6g} N ({text} force counts)"
        elif not isinstance(value, str) and (unit := objects.unit_in_words(objects.BY_NAME[name])):
            text += f" {unit}"
        yield f"{name:<{width}}  {text}"


def assignments(words: Sequence[str]) -> dict[str, str]:
    """Return {NAME: VALUE} from a list of texts "NAME=VALUE". Raises InputError for a text that
    does not have this form."""
    for word in words:
        name, equals, value = word.partition("=")
        if not (name and equals and value):
            raise InputError(f"{word}: expected NAME=VALUE, such as force_gain=7")
    return dict(word.split("=", 1) for word in words)


def in_mm(axis: Axis, position: int) -> str:
    """Convert a position from encoder counts to mm, and return it as text, such as " (12.3 mm)".
    Return "" if the number of encoder counts per metre is unknown."""
    from forceaxis.axis import quantity

    scale = quantity.per_metre(axis, objects.BY_NAME["position"])
    return "" if scale is None else f" ({1e3 * position / scale:.6g} mm)"


def print_state(axis: Axis, prefix: str, as_json: bool, **more: float) -> None:
    """Print the drive state, mode of operation, fault, position and force of the axis, in one text
    line or as JSON."""
    from forceaxis.axis import actions

    now = actions.state(axis)
    if as_json:
        print_json({**to_json(now), **more})
    else:
        click.echo(fitted(state_text(axis, prefix, now), 2))


def state_text(axis: Axis, prefix: str, now: AxisStatus) -> str:
    """Return the text line about the state `now` of an axis."""
    return (
        f"{prefix}: {now.state}, mode {now.mode}, fault {now.fault}, position "
        f"{now.position} encoder counts{in_mm(axis, now.position)}, force "
        f"{now.force_N:.4g} N ({now.force:.4g} force counts)"
    )


@axis.command(
    "list",
    epilog="""forceaxis axis list
    forceaxis axis list --on can0
    forceaxis axis list --on tcp://192.168.1.5 --json""",
)
@live_options.options()
@as_json
def list_axes(connection: AxisConnection, as_json: bool) -> None:
    """List the axes on a bus, each with node id, name, firmware version, object table, drive state
    and fault.

    --on is the address of the bus. On can0, the command lists the nodes 1 to 127 that answer or
    send. On a Modbus line, it lists the units 1 to 127 that answer (20 s on a serial line). On lcm,
    it lists the axes of all gateways. Default: the bus of FORCEAXIS_AXIS, otherwise lcm. --json
    adds the mode of operation and the owner. The exit status is 1 if no axis is found.
    """
    with live_options.errors():
        rows = scanned(connection)
    if as_json:
        print_json(rows)
    elif rows:
        click.echo("\n".join(table_of(rows)))
    if not rows:
        click.echo("forceaxis: no axis was found", err=True)
        sys.exit(1)


def scanned(connection: AxisConnection) -> list[ScannedAxis]:
    """Search the bus that --on selects, and return the axes on this bus. Raises InputError if --on
    selects several buses, or one axis instead of a bus."""
    from forceaxis.axis import scan

    found = connection.chosen(is_bus=True)
    if len(found.addresses) > 1 or any(one.number for one in found.addresses):
        bus = addresses.bus(found.address)
        raise InputError(f"expected the address of one bus, without an axis, such as --on {bus}")
    if found.is_simulated:
        return [scan.scanned(found.link())]
    bus = found.address if found.addresses else LcmAddress()
    return [with_address(bus, row) for row in scan.on_bus(bus)]


def with_address(bus: Address, row: ScannedAxis) -> ScannedAxis:
    """Return `row`, the table row of one axis that was found on the bus `bus`. If the row has a
    note with commands, the address of the axis is added to these commands."""
    if row.note is None or row.id is None or isinstance(bus, SimAddress):
        return row
    on = AxisConnection((dataclasses.replace(bus, number=row.id),)).options()
    return dataclasses.replace(row, note=with_commands(row.note, on))


def table_of(rows: Sequence[ScannedAxis]) -> Iterator[str]:
    """Yield the text lines of the table that `forceaxis axis list` prints, with one row for each
    axis. A note about an axis follows its row, in text lines of at most 76 characters."""
    cells = [["id", "name", "version", "table", "state", "fault"]]
    for row in rows:
        # A firmware version may be followed by the object table and the commit.
        version = row.version and row.version.split(" ")[0]
        values = (row.id, row.name, version, row.table, row.state, row.fault)
        cells.append(["-" if v is None else str(v).replace("_", " ") for v in values])
    head, *lines = aligned(cells, range(6))
    yield head
    for line, row in zip(lines, rows, strict=True):
        yield line
        yield from textwrap.wrap(row.note or "", 76, initial_indent="  ", subsequent_indent="  ")


@axis.command(
    epilog="""forceaxis axis get --on lcm:1 force position fault
    forceaxis axis get --on can0 'recorder_*' --json"""
)
@click.argument("names", nargs=-1, required=True, type=Object(), metavar="NAME...")
@live
@as_json
def get(connection: AxisConnection, names: Sequence[str], as_json: bool) -> None:
    """Read objects of the axis and print their values in engineering units, such as N or mm.

    NAME is the name of an object, or a pattern such as 'tare*' for all objects that match.
    `forceaxis objects` lists the names. An axis that another client owns can be read too.
    """
    wanted = []
    for name in names:
        fitting = fnmatch.filter((o.name for o in objects.OBJECTS if o.access != "wo"), name)
        wanted += fitting if fitting else [name]
    with connected(connection) as axis:
        values = axis.get(*dict.fromkeys(wanted))
        print_result(values, as_json, lambda: "\n".join(lines(axis, values)))


@axis.command(
    "set",
    epilog="""forceaxis axis set --on lcm:1 force_gain=7 position_gain=4
    forceaxis axis set --on can0 force_setpoint=75N recorder_trigger_edge=rising
    forceaxis axis set --on can0 --model press/model.toml approach_velocity_max="4 mm/s\"""",
)
@click.argument("words", nargs=-1, required=True, type=Object("="), metavar="NAME=VALUE...")
@live_in_mm
@as_json
def set_objects(connection: AxisConnection, words: Sequence[str], as_json: bool) -> None:
    """Write values in engineering units to objects of the axis, in the order of the arguments, and
    print the new values.

    A value may have a unit: "75 N", "10 mm", "4 mm/s", "2 s", "3 V". Nothing is written if a name
    is unknown, a value is out of its range, or the axis would limit a target. An axis that another
    client of the same bus has enabled stays enabled. `axis params store` keeps the values over a
    power cut. A simulated axis begins each command with the values of its experiment.
    """
    with owned(connection, shared=True) as axis:
        values = assignments(words)
        axis.set(**values)
        readable = [name for name in values if objects.BY_NAME[name].access != "wo"]
        back = axis.get(*readable)
        print_result(back, as_json, lambda: "\n".join(lines(axis, back)))
        kept = {name: value for name, value in back.items() if objects.BY_NAME[name].stored}
        live_options.warn_of_forgotten(axis, connection, kept)


@axis.command(
    epilog="""forceaxis axis stop --on can0:3
    forceaxis axis stop --on can0:1 --on can0:2 --on lcm:7"""
)
@live_options.options(is_repeatable=True, keeps_wrong=True)
@as_json
def stop(connection: AxisConnection, as_json: bool) -> None:
    """Stop one or more axes by a quick stop, even if another client owns them.

    Several axes are stopped at the same time. Those of one Modbus line are commanded one after the
    other, before the first of them is waited for. If an axis cannot be reached, the others are
    stopped all the same, and the exit status is 1. It is 2 if an address is wrong. --json prints
    one object for each axis.

    The object quick_stop_option selects whether the axis stops by a ramp or at once. Before its
    owner can enable the axis again, the owner has to send a controlword that does not enable.
    """
    each, wrong = connection.several()
    if len(each) == 1 and not wrong:
        with connected(each[0]) as axis:
            axis.stop()
            print_state(axis, "stopped", as_json)
        return
    failed: list[str] = []

    def report(done: StoppedAxis | str) -> None:
        if isinstance(done, StoppedAxis):
            print_result(done.result(), as_json, partial(fitted, done.text, 2))
        else:
            failed.append(done)
            click.echo(f"forceaxis: {done}", err=True)

    try:
        stop_all(each, state_text, report)
    finally:
        for text in wrong:
            click.echo(f"forceaxis: {text}", err=True)
    if failed or wrong:
        sys.exit(2 if wrong else 1)


@axis.command(epilog="forceaxis axis start --on can0:3")
@live_over(STARTED)
@as_json
def start(connection: AxisConnection, as_json: bool) -> None:
    """Start a node that NMT has stopped, so that it answers and sends again. `axis list` shows such
    a node.

    A start enables no drive. The stop has disabled the drive, and its owner has to enable it again.
    A gateway starts its axes by itself. On lcm, the command waits until the gateway has done so.
    """
    with connected(connection) as axis:
        axis.link.start()
        print_state(axis, "started", as_json)


@axis.command(epilog="forceaxis axis reset --on lcm:1")
@live
@as_json
def reset(connection: AxisConnection, as_json: bool) -> None:
    """Reset the latched fault of the axis. The exit status is 1 if the cause of the fault is still
    present."""
    from forceaxis.axis.drive import FaultObjects

    with owned(connection) as axis:
        axis.reset_fault()
        axis.wait_for(FaultObjects, lambda s: s.fault == "none", "the fault to be reset", 1.0)
        print_state(axis, "reset", as_json)


# With this setting, a negative number such as -500 is an argument of a command and not an option.
NEGATIVE = {"ignore_unknown_options": True}


@axis.command(
    context_settings=NEGATIVE,
    epilog="""forceaxis axis enable --on lcm:1 "profile velocity" target_velocity=3000
    forceaxis axis enable --on can0 -1 force_setpoint=30 --seconds 10""",
)
@click.argument("mode")
@click.argument("words", nargs=-1, metavar="[NAME=VALUE]...")
@click.option("--seconds", type=Positive(0.01, 1e6), help="Duration in s. Default: until Ctrl-C.")
@live_in_mm
@as_json
def enable(
    connection: AxisConnection,
    mode: str,
    words: Sequence[str],
    seconds: float | None,
    as_json: bool,
) -> None:
    """Enable the axis in a mode of operation for the time --seconds, or until Ctrl-C, and then
    disable the axis.

    MODE is a number or a name, as "profile position". The objects are written before the axis is
    enabled. Targets are written again afterwards, because a target acts only while the axis is
    enabled. Values may have units, as in `axis set`. The exit status is 1 if the axis is disabled
    before the time is over, or if another client lowers a bound so that the axis limits a target.
    """
    from forceaxis.axis import actions, bounds
    from forceaxis.axis.axis import MODES
    from forceaxis.bus import state_names

    number = int(mode) if mode.lstrip("-").isdigit() else MODES.get(mode, mode)
    moved = state_names.FORCE_MODES | state_names.TARGET_MODES | state_names.PROFILE_MODES
    with owned(connection) as axis:
        values = assignments(words)
        targets = {n: v for n, v in actions.expect(axis, values).items() if n in bounds.BOUNDS}
        axis.enable(number, **values)
        axis.set(**{name: v for name, v in values.items() if name.startswith("target_")})
        if axis.read("position_gain") == 0 and number in moved:
            click.echo("position_gain is 0: the axis neither approaches nor follows", err=True)
        if not as_json:
            print_state(axis, "enabled", False)
        passed, limited = 0.0, False
        while seconds is None or passed < seconds:
            step = 0.1 if seconds is None else min(0.1, seconds - passed)
            axis.link.wait(step)
            passed += step
            word = axis.integer("statusword")
            if state_names.drive_state(word) != "operation enabled":
                print_state(axis, "no longer enabled", as_json)
                sys.exit(1)
            if word & bounds.INTERNAL_LIMIT and not limited:
                axis.expect_unlimited(targets, "while it was enabled")
            limited = bool(word & bounds.INTERNAL_LIMIT)
        print_state(axis, "after", as_json, seconds=passed)


force_max = click.option(
    "--force-max", metavar="FORCE", help='Force above which the axis stops: "120 N", or counts.'
)


approach_speed = click.option(
    "--speed",
    metavar="SPEED",
    help='Largest approach speed, "4 mm/s" or "1600 count/s". Default: approach_velocity_max.',
)


@axis.command(
    context_settings=NEGATIVE,
    epilog="""forceaxis axis move --on lcm:1 36000 --speed "20000 count/s"
    forceaxis axis move --on can0:3 -500
    forceaxis axis move --on can0 --model press/model.toml "-10 mm" --speed "5 mm/s\"""",
)
@click.argument("position")
@click.option(
    "--speed",
    metavar="SPEED",
    help='Speed of the move: "5 mm/s" or "2000 count/s". Default: trajectory_velocity.',
)
@click.option(
    "--timeout",
    type=Positive(0.1, 3600),
    default=60.0,
    show_default=True,
    help="Longest duration of the move, s.",
)
@force_max
@live_in_mm
@as_json
def move(
    connection: AxisConnection,
    position: str,
    speed: str | None,
    timeout: float,
    force_max: str | None,
    as_json: bool,
) -> None:
    """Move the axis to the position POSITION. Disable the axis after the move.

    POSITION is a length, as "10 mm", or a number in encoder counts or user units, from the zero of
    the axis. If the measured force exceeds --force-max
    (default: 32 counts), the axis is disabled in the same tick with the fault force_max. It still
    has its kinetic energy at that moment.
    """
    from forceaxis.axis import actions, quantity

    quantity.expect_written("POSITION", position, "10 mm")
    quantity.expect_speed("--speed", speed, "5 mm/s")
    with owned(connection) as axis:
        bound = actions.most_counts(axis, force_max) or actions.MOVE_COUNTS
        actions.move(axis, position, speed, timeout, bound)
        print_state(axis, "reached", as_json)


@axis.command(
    context_settings=NEGATIVE,
    epilog="""forceaxis axis press --on lcm:1 75N --seconds 5 --retract 2000
    forceaxis axis press --on sim:press/contact.toml "75 N" --speed "4 mm/s" --retract "5 mm"
    forceaxis axis press --on can0 30""",
)
@click.argument("force")
@click.option(
    "--seconds",
    type=Positive(0.1, 3600),
    default=3.0,
    show_default=True,
    help="Time in contact, s.",
)
@approach_speed
@click.option(
    "--approach",
    type=Positive(0.1, 3600),
    default=10.0,
    show_default=True,
    help="Time in s without contact after which the axis stops with the fault no_contact.",
)
@click.option(
    "--retract",
    metavar="DISTANCE",
    help='Release the force after pressing, then move back by this distance, "5 mm" or encoder '
    "counts, not faster than --speed. Default: the axis is disabled in contact.",
)
@force_max
@live_in_mm
@as_json
def press(
    connection: AxisConnection,
    force: str,
    seconds: float,
    speed: str | None,
    approach: float,
    retract: str | None,
    force_max: str | None,
    as_json: bool,
) -> None:
    """Approach the workpiece, press on the workpiece with the force FORCE, print the measured
    force, and disable the axis.

    FORCE "75 N" selects mode 4 with the active force law or bank. FORCE 30 is in counts at 8 bits
    and selects mode -1, the P law with force_gain. Afterwards all parameters have their earlier
    values. If the measured force exceeds --force-max (default: twice FORCE and 8 counts), the axis
    is disabled in the same tick. A FORCE above a limit of the axis (6072h, 60E0h, 60E1h, sensor
    range) is refused before the axis moves, as is a FORCE of 0 or less. The exit status is 1 if
    the mean force over the second half of the time differs from FORCE by more than 2 % and 0.6
    counts, or if a limit is lowered while it presses.
    """
    from forceaxis.axis import actions, quantity

    wanted = quantity.force(force)
    actions.expect_pressing(wanted)
    quantity.expect_speed("--speed", speed, "4 mm/s")
    quantity.expect_written("--retract", retract, "5 mm")
    begin = time.monotonic()
    with owned(connection) as axis:

        def report(now: PressSample) -> None:
            count = now.force
            at = f"{time.monotonic() - begin:.1f} s, " if not connection.is_simulated else ""
            click.echo(f"{at}force {count * per_count:.4g} N ({count:.4g} force counts)")

        warn_of_newtons(axis, connection)
        per_count, where = quantity.force_per_count(axis), axis.link.where
        order = actions.PressOrder(seconds, speed, approach, force_max, retract)
        held = actions.press(axis, wanted, order, None if as_json else report)
        apart = held.retracted_position
        mm = "" if apart is None else in_mm(axis, apart)
    if as_json:
        print_json(held)
    else:
        click.echo(
            f"held {held.force_N:.4g} N ({held.force_count:.4g} force counts), "
            f"{held.least_N:.4g} to {held.most_N:.4g} N, peak {held.peak_N:.4g} N"
        )
        if apart is not None:
            click.echo(f"apart at position {apart} encoder counts{mm}")
    if held.not_held:
        click.echo(f"forceaxis: {where}: {with_commands(held.not_held)}", err=True)
        sys.exit(1)


VERBS = (axis,)
