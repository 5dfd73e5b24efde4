"""The commands `gateway` and `monitor`, for axes on buses."""

import os
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import click

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.axis.address import Address, LcmAddress
from forceaxis.cli.common import (
    File,
    Positive,
    Subject,
    Verb,
    as_json,
    given,
    print_json,
    show,
)
from forceaxis.cli.live_options import ENVIRONMENT, AxisConnection, Kinds, on_option
from forceaxis.errors import expect_package

if TYPE_CHECKING:
    from forceaxis.bus.monitor_state import Watch
    from forceaxis.bus.sources import MonitorSettings, Source

GATEWAYS = Kinds(("lcm",), "because a monitor shows what gateways publish over LCM")
LOOPBACK, WEB_PORT, FOXGLOVE_PORT = "127.0.0.1", 8780, 8765


@click.command(
    cls=Verb,
    epilog="""forceaxis monitor
    forceaxis monitor --on "lcm:2@udpm://239.255.76.67:7700?ttl=0" --record out/axis2.log
    forceaxis monitor --replay out/axis2.log --speed 4
    # shows the same screen in a browser, read-only
    forceaxis monitor --web --port 8780
    # serves the same values to Foxglove, read-only
    forceaxis monitor --foxglove --record axes.mcap
    # one snapshot for a script
    forceaxis monitor --once --json""",
)
@on_option(
    GATEWAYS,
    "Show only this axis, lcm:2, or another LCM bus, lcm@URL or lcm:2@URL. Default: "
    f"{ENVIRONMENT}, else all axes of the bus LCM_DEFAULT_URL, else of that of liblcm, this "
    "machine.",
)
@click.option(
    "--record",
    type=File(),
    metavar="FILE",
    help="Record all messages into a new file: MCAP if its name ends in .mcap, else an LCM log.",
)
@click.option(
    "--replay",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Show a recording of this program or a log of lcm-logger instead of a bus.",
)
@click.option(
    "--speed", type=Positive(0.01, 1000), help="Speed of --replay. Default: 1, real time."
)
@click.option(
    "--once", is_flag=True, help="Print the state of the axes once, after --seconds, and end."
)
@click.option(
    "--seconds",
    type=Positive(0.05, 3600),
    default=1.0,
    show_default=True,
    help="Time in s for which --once receives.",
)
@click.option(
    "--model",
    type=Subject(paths.MODELS),
    metavar="MODEL",
    help="Model whose encoder converts positions to mm, for axes without user units (6092h).",
)
@click.option("--web", is_flag=True, help="Serve the screen to web browsers, read-only.")
@click.option(
    "--foxglove", is_flag=True, help="Serve topics to Foxglove over a WebSocket, read-only."
)
@click.option(
    "--host",
    metavar="ADDRESS",
    help="Address at which --web and --foxglove listen. Default: 127.0.0.1, this machine only.",
)
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    help="TCP port. Default: 8780 for --web, 8765 for --foxglove; 0: any free port.",
)
@as_json
def monitor(
    on: tuple[Address, ...],
    record: Path | None,
    replay: Path | None,
    speed: float | None,
    once: bool,
    seconds: float,
    model: str | None,
    web: bool,
    foxglove: bool,
    host: str | None,
    port: int | None,
    as_json: bool,
) -> None:
    """Show the axes of running gateways in a terminal: drive state, mode of operation, fault,
    values, strip charts and lost messages.

    The monitor shows what a gateway publishes (AXIS_n_STATE, _EVENT, _CAPTURE) and writes nothing
    to an axis. Forces are in N by the scale of the axis. Positions are in its user unit, in mm with
    --model, or in encoder counts. Commands are in V.
    Keys: f freezes the display, r records into a new log in this folder, c shows a capture, u
    changes between units and counts, arrows or 1 to 9 select the axis, + and - change the time
    span, q quits. With --once the exit status is 1 if no state was received or an axis is silent:
    its node sends nothing or is stopped, or its values are older than 1 s.

    --foxglove publishes each channel as JSON, /axis_1/state for AXIS_1_STATE, with the unit of each
    number in the schema, and each simulated or recorded sample as a message of its own. The topic
    /lcm/AXIS_1_STATE carries the bytes of the same messages. The command prints the address, and
    the file of a layout for axis 1. SIGINT or SIGTERM ends it.
    """
    bus = LcmAddress() if replay and not on else one_bus(on)
    url, axis = bus.url, bus.number
    is_server, has_address = web or foxglove, host is not None or port is not None
    expect_without("--replay", replay and (record or url), "neither --record nor lcm@URL")
    expect_without("--web", web and (once or record), "neither --once nor --record")
    expect_without("--foxglove", foxglove and (once or web), "neither --once nor --web")
    expect_with("--speed", speed and not replay, "--replay")
    expect_with("--json", as_json and not once, "--once")
    expect_with("--host, --port", has_address and not is_server, "--web or --foxglove")
    if not once and not is_server and not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise click.UsageError(
            "expected a terminal, got none; use --once, or --once --json, in a script"
        )
    from forceaxis.bus.monitor_state import Watch
    from forceaxis.bus.sources import MonitorSettings

    mm_per_count = encoder_mm(model) if model else None
    settings = MonitorSettings(url, axis, speed or 1.0, replay, mm_per_count)
    if foxglove:
        serve_foxglove(settings, given(host, LOOPBACK), given(port, FOXGLOVE_PORT), record)
    watch = Watch(mm_per_count)
    source = settings.source(watch)
    try:
        if record:
            source.record(record)
        if once:
            snapshot(watch, source, bus, seconds, as_json)
            return
        if not web:
            from forceaxis.bus.monitor import Monitor

            Monitor(source, watch, axis).run()
    finally:
        writer = source.writer
        source.close()
    if writer:
        click.echo(f"{paths.display(writer.path)}: {writer.count} messages")
    if web:
        serve(settings, given(host, LOOPBACK), given(port, WEB_PORT))


def one_bus(on: tuple[Address, ...]) -> LcmAddress:
    """Return the bus address that --on or the environment variable FORCEAXIS_AXIS gives. Without
    both, return the address of the default LCM bus. Raises UsageError for several addresses, and
    InputError."""
    if len(on) > 1:
        raise click.UsageError(f"--on: expected one address, got {len(on)}")
    found = AxisConnection(on, accepted=GATEWAYS).chosen().addresses
    return next((one for one in found if isinstance(one, LcmAddress)), LcmAddress())


def expect_without(option: str, wrong: object, others: str) -> None:
    """Raise UsageError if `wrong` is true. The message says that `option` cannot be used together
    with the options `others`."""
    if wrong:
        raise click.UsageError(
            f"{option}: expected {others} together with this option; remove one of the options"
        )


def expect_with(options: str, wrong: object, other: str) -> None:
    """Raise UsageError if `wrong` is true. The message says that `options` can only be used
    together with the option `other`."""
    if wrong:
        first = other.partition(" ")[0]
        raise click.UsageError(
            f"{options}: expected {other} together with this; add {first} or remove {options}"
        )


def encoder_mm(model: str) -> float:
    """Return the length of one encoder count in mm, from the encoder of `model`. Raises InputError
    if the model has no encoder."""
    from forceaxis.linear import system

    encoder = system.facts(model).encoder
    if not encoder:
        raise InputError(
            f"--model {model}: expected a model with an [encoder], got a model without an encoder"
        )
    return 1e3 / encoder.scale


def serve(settings: "MonitorSettings", host: str, port: int) -> NoReturn:
    """Serve the monitor to web browsers until a signal such as SIGTERM ends the program. The exit
    status is 128 plus the number of the signal."""
    from forceaxis.bus.sources import AddressError

    expect_package("--web", "textual_serve", "textual-serve", "web")
    from forceaxis.bus import monitor_web

    ready = lambda url: show([("monitor", url)])  # noqa: E731
    try:
        sys.exit(128 + monitor_web.serve(settings, host, port, ready))
    except AddressError as error:
        raise InputError(f"--host {host} --port {port}: {error}") from None


def serve_foxglove(
    settings: "MonitorSettings", host: str, port: int, record: Path | None
) -> NoReturn:
    """Serve topics to Foxglove until a signal such as SIGTERM ends the program. The exit status is
    128 plus the number of the signal."""
    from forceaxis.bus.sources import AddressError

    expect_package("--foxglove", "foxglove", "foxglove-sdk", "foxglove")
    from forceaxis.bus import foxglove_server

    def ready(url: str) -> None:
        show([("foxglove", url), ("layout", paths.quoted(foxglove_server.LAYOUT))])

    try:
        sys.exit(128 + foxglove_server.serve(settings, host, port, record, ready))
    except AddressError as error:
        raise InputError(f"--host {host} --port {port}: {error}") from None


def snapshot(
    watch: "Watch", source: "Source", bus: LcmAddress, seconds: float, as_json: bool
) -> None:
    """Print the latest state of each axis. The exit status is 1 if no state was received, or if an
    axis is silent."""
    from forceaxis.bus.sources import ReplaySource
    from forceaxis.cli.buses_text import snapshot_text

    replayed = isinstance(source, ReplaySource)
    if isinstance(source, ReplaySource):
        source.play_all()
    else:
        time.sleep(seconds)
    axis = bus.number
    shown = watch.snapshot(source.name, source.now_us(), axis, source.trouble)
    if as_json:
        print_json(shown)
    elif shown.axes:
        click.echo(snapshot_text(shown))
    if not shown.axes:
        which = "an axis" if axis is None else f"axis {axis}"
        within = "" if replayed else f" within {seconds:g} s; is its gateway running?"
        click.echo(f"forceaxis: {source.name}: expected a state of {which}{within}", err=True)
    silent = [number for number, state in shown.axes.items() if state.silent]
    if silent:
        one = AxisConnection((replace(bus, number=int(silent[0])),)).options()
        click.echo(
            f"forceaxis: {source.name}: expected live axes, axis {', '.join(silent)} is silent; "
            "check power and bus of the axis, and start a stopped node with `forceaxis axis start "
            f"{one}`",
            err=True,
        )
    if silent or not shown.axes:
        source.close()
        sys.exit(1)


@click.command(
    cls=Verb,
    context_settings={"ignore_unknown_options": True, "help_option_names": []},
    epilog="""forceaxis gateway --can vcan0 --axes 1,2 --set force_gain=5
    forceaxis gateway --help""",
)
@click.argument("args", nargs=-1, type=click.UNPROCESSED)
def gateway(args: tuple[str, ...]) -> None:
    """Run the gateway, a program that controls the axes of a CAN bus as CANopen master and makes
    the axes available over LCM and Modbus TCP.

    SIGTERM or SIGINT ends it. `forceaxis gateway --help` lists its options.
    """
    from forceaxis.experiments import link

    program = link.program("gateway")
    sys.stdout.flush()
    os.execv(program, ["forceaxis gateway", *args])


VERBS = (gateway, monitor)
