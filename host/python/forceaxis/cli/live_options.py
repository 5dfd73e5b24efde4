"""Options that select the connection to an axis, and context managers that connect to the axis."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import signal
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Concatenate, ParamSpec

import click

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.cli.common import Subject, fail, set_option

if TYPE_CHECKING:
    from forceaxis.axis.axis import Axis
    from forceaxis.axis.link import Link

Verb = Callable[..., None]
P = ParamSpec("P")
LiveVerb = Callable[Concatenate["AxisConnection", P], None]

# Same value as in axis/can.py. The module axis/can.py is loaded only for a connection over CAN.
OWN_NODE = 126
CONNECTIONS = "--axis N, --can INTERFACE, --modbus URL or --sim EXPERIMENT"


@dataclass(frozen=True)
class AxisConnection:
    """Connection to one axis as selected by the user: the values of the options --axis, --can,
    --modbus and --sim, and of further options for these connections."""

    axis: int | None = None
    lcm_url: str | None = None
    can: str | None = None
    node: int = 1
    own_node: int = OWN_NODE
    modbus: str | None = None
    sim: Path | None = None
    overrides: tuple[str, ...] = ()
    store: str = ""
    model: str | None = None  # path of a model whose encoder converts encoder counts to mm

    def link(self) -> Link:
        """Connect to the axis and return the open connection. Raises InputError for wrong options
        and NoAnswer if the axis does not respond."""
        found = self._connect()
        if self.model is not None:
            from forceaxis import linear

            try:
                found.use_model(linear.find_model(self.model))
            except InputError:
                found.close()
                raise
        return found

    def _connect(self) -> Link:
        if self.axis is not None:
            from forceaxis.axis.gateway import GatewayLink

            return GatewayLink(self.axis, self.lcm_url)
        if self.can is not None:
            from forceaxis.axis.can import CanLink

            return CanLink(self.can, self.node, self.own_node)
        if self.modbus is not None:
            from forceaxis.axis.modbus import ModbusLink

            return ModbusLink(self.modbus, self.node)
        from forceaxis.axis.sim import SimLink

        return SimLink(self.sim or "", self.overrides, self.store)

    def options(self) -> str:
        """Return the options that select this axis as text, for use in another command."""
        if self.axis is not None:
            return f"--axis {self.axis}" + (f" --lcm-url {self.lcm_url}" if self.lcm_url else "")
        if self.can is not None:
            return f"--can {self.can} --node {self.node}"
        if self.modbus is not None:
            return f"--modbus {self.modbus} --node {self.node}"
        return f"--sim {paths.quoted(str(self.sim))}"

    def expect_one(self) -> None:
        """Raise InputError unless the options select exactly one connection."""
        given = [one for one in (self.axis, self.can, self.modbus, self.sim) if one is not None]
        if len(given) != 1:
            raise InputError(f"expected exactly one connection to an axis, one of {CONNECTIONS}")
        for option, is_given, belongs in (
            ("--lcm-url", self.lcm_url is not None, self.axis),
            ("--set", self.overrides != (), self.sim),
            ("--store", self.store != "", self.sim),
        ):
            if is_given and belongs is None:
                with_what = "--axis" if option == "--lcm-url" else "--sim"
                raise InputError(
                    f"{option}: expected {with_what} together with this option; add {with_what} "
                    f"or remove {option}"
                )


OPTIONS = (
    click.option(
        "--axis", type=click.IntRange(1, 127), help="Number of an axis behind a gateway, over LCM."
    ),
    click.option(
        "--lcm-url", help="LCM bus of --axis. Default: LCM_DEFAULT_URL, else that of liblcm."
    ),
    click.option("--can", metavar="INTERFACE", help="CAN interface, as can0 or vcan0."),
    click.option(
        "--node",
        type=click.IntRange(1, 127),
        default=1,
        show_default=True,
        help="Node id of the axis with --can, Modbus unit with --modbus.",
    ),
    click.option(
        "--own-node",
        type=click.IntRange(1, 127),
        default=OWN_NODE,
        show_default=True,
        help="Node id of this program with --can; the axis supervises its heartbeat.",
    ),
    click.option(
        "--modbus",
        metavar="URL",
        help="Modbus connection: tcp://HOST[:PORT] or /dev/ttyUSB0[:BAUD].",
    ),
    click.option(
        "--sim",
        type=Subject(paths.EXPERIMENTS, as_path=True),
        metavar="EXPERIMENT",
        help="A simulated axis that runs this experiment; it does not run in real time.",
    ),
    set_option("A parameter of the model. With --sim: as in `forceaxis run`."),
    click.option(
        "--store", default="", metavar="FILE", help="File of the parameter store of --sim."
    ),
)


def options(command: LiveVerb[P]) -> Verb:
    """Add the options of a connection to a command. The function of the command receives the
    values of the options as an `AxisConnection`, which may select no axis or several axes."""

    @functools.wraps(command)
    def with_connection(
        axis: int | None,
        lcm_url: str | None,
        can: str | None,
        node: int,
        own_node: int,
        modbus: str | None,
        sim: Path | None,
        overrides: tuple[str, ...],
        store: str,
        *arguments: P.args,
        **given: P.kwargs,
    ) -> None:
        connection = AxisConnection(
            axis, lcm_url, can, node, own_node, modbus, sim, overrides, store
        )
        command(connection, *arguments, **given)

    found: Verb = with_connection
    for option in reversed(OPTIONS):
        found = option(found)
    return found


def live(command: LiveVerb[P]) -> Verb:
    """Add the options of a connection to a command that needs exactly one axis. The function of
    the command receives the values of the options as an `AxisConnection`."""

    @functools.wraps(command)
    def with_one(connection: AxisConnection, *arguments: P.args, **given: P.kwargs) -> None:
        connection.expect_one()
        command(connection, *arguments, **given)

    return options(with_one)


def live_in_mm(command: LiveVerb[P]) -> Verb:
    """Add the options of a connection to exactly one axis, and the option --model. The encoder of
    the model converts encoder counts to mm."""

    @functools.wraps(command)
    def with_model(
        connection: AxisConnection, model: str | None, *arguments: P.args, **given: P.kwargs
    ) -> None:
        command(dataclasses.replace(connection, model=model), *arguments, **given)

    option = click.option(
        "--model",
        type=Subject(paths.MODELS),
        help="Model whose encoder converts counts to mm. Not needed for a simulated axis or for an "
        "axis with user units (6092h, 60A8h).",
    )
    return option(live(with_model))


@contextlib.contextmanager
def connected(connection: AxisConnection) -> Iterator[Axis]:
    """Connect to an axis for a `with` block. Ctrl-C in the block ends the program with exit status
    130; the signal SIGTERM ends the program with exit status 143."""
    from forceaxis.axis.axis import Axis

    axis: Axis | None = None
    before = signal.signal(signal.SIGTERM, _terminate)
    with errors(connection):
        try:
            axis = Axis(connection.link())
            if axis.link.warning:
                click.echo(f"forceaxis: warning: {axis.link.warning}", err=True)
            yield axis
        except KeyboardInterrupt as interrupt:
            end = f", {axis.link.where} {axis.close()}" if axis else ""
            click.echo(f"forceaxis: interrupted{end}", err=True)
            sys.exit(143 if interrupt.args == (signal.SIGTERM,) else 130)
        finally:
            signal.signal(signal.SIGTERM, before)
            if axis:
                axis.close()


def warn_of_newtons(axis: Axis, connection: AxisConnection) -> None:
    """Print a warning if `force_scale` of the axis was never set, because forces in N are then
    wrong. This function prints no warning for a simulated axis, because the connection of a
    simulated axis compares `force_scale` with the model."""
    from forceaxis.axis import quantity

    force_scale, date = axis.number("force_scale"), axis.integer("calibration_date")
    if connection.sim is None and quantity.never_set(force_scale, date):
        scale = f"force_scale ({force_scale * 1e-6:g} N/count)"
        click.echo(
            f"forceaxis: warning: {axis.link.where}: {scale} was never set, so forces in N are "
            "wrong unless the sensor has this scale; set force_scale, or use "
            "`forceaxis axis calibrate`",
            err=True,
        )


@contextlib.contextmanager
def owned(connection: AxisConnection, shared: bool = False) -> Iterator[Axis]:
    """Connect to an axis and acquire the axis for a `with` block. At the end of the block the axis
    is disabled and released. `shared`: see Axis.acquire()."""
    with connected(connection) as axis:
        axis.acquire(shared)
        yield axis


@contextlib.contextmanager
def errors(connection: AxisConnection | None = None) -> Iterator[None]:
    """During a `with` block: if the axis refuses a request or does not respond, print one text line
    and exit with status 1."""
    from forceaxis.axis.link import NoAnswer, Refused

    try:
        yield
    except (Refused, NoAnswer) as error:
        text = str(error)
        if connection is not None:
            text = text.replace("reset_fault()", "`forceaxis axis reset`")
            for verb in ("reset", "start", "stop"):
                command = f"`forceaxis axis {verb}"
                text = text.replace(f"{command}`", f"{command} {connection.options()}`")
        fail(text, status=1)


def _terminate(number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt(number)
