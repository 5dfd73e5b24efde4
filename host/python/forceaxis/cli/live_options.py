"""Options that select the connection to an axis, and context managers that connect to the axis."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import os
import shlex
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Concatenate, ParamSpec

import click
from click.shell_completion import CompletionItem

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.axis import address as addresses
from forceaxis.axis.address import Address, LcmAddress, SimAddress
from forceaxis.cli.common import (
    Callback,
    Subject,
    fail,
    options_in,
    set_axis_option,
    set_option,
)
from forceaxis.errors import ParameterError

if TYPE_CHECKING:
    from forceaxis.axis.axis import Axis
    from forceaxis.axis.link import Link

Verb = Callable[..., None]
P = ParamSpec("P")
LiveVerb = Callable[Concatenate["AxisConnection", P], None]

ENVIRONMENT = "FORCEAXIS_AXIS"  # environment variable with an address, used without --on


@dataclass(frozen=True)
class Kinds:
    """The kinds of address that a command accepts, as keys of address.EXAMPLES. `why`: end of the
    error message for other kinds, which states why the command accepts none of them."""

    kinds: tuple[str, ...] = tuple(addresses.EXAMPLES)
    why: str = ""


ANY = Kinds()
RECORDED = Kinds(("can", "lcm", "sim"), "because a recording cannot be read over Modbus")
STARTED = Kinds(
    ("can", "lcm"), "because NMT, which stops and starts nodes, is a service of CANopen"
)


class AxisAddress(click.ParamType[Address | InputError]):
    """Type of the option --on, the address of an axis. A shell can complete CAN interfaces, serial
    devices and simulated axes. `keeps_wrong`: True if a wrong address is no error at once. Its
    InputError is then the value of the option, and the command reports it after it has used the
    other addresses."""

    name = "address"

    def __init__(
        self, accepted: Kinds = ANY, is_repeatable: bool = False, keeps_wrong: bool = False
    ) -> None:
        self.accepted, self.is_repeatable = accepted, is_repeatable
        self.keeps_wrong = keeps_wrong

    def convert(
        self,
        value: str | Address | InputError,
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> Address | InputError:
        if not isinstance(value, str):
            return value
        try:
            return self.address("--on", value)
        except InputError as error:
            if self.keeps_wrong:
                return error
            raise

    def address(self, source: str, text: str) -> Address:
        """Return the address in `text`. Raises InputError for another text, or for a kind of
        address that the command does not accept. `source`: option or environment variable with the
        text."""
        try:
            found = addresses.parse(text)
        except InputError as error:
            raise InputError(f"{source}: {error}") from None
        if found.kind not in self.accepted.kinds:
            raise InputError(
                f"{source}: {text}: expected an address such as "
                f"{addresses.examples(self.accepted.kinds)}, {self.accepted.why}"
            )
        if not isinstance(found, SimAddress):
            return found
        path = EXPERIMENT.convert(found.experiment, None, None)
        # Messages show the name of an experiment. The search by this name finds its file again.
        is_name = found.experiment == Path(path).stem
        return found if is_name else dataclasses.replace(found, experiment=str(path))

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        kinds = self.accepted.kinds
        known = [f"{kind}:" for kind in ("lcm", "sim") if kind in kinds]
        known += [f"{name}" for name in can_interfaces() if "can" in kinds]
        known += [f"serial:{device}" for device in serial_devices() if "serial" in kinds]
        known += ["tcp://"] * ("tcp" in kinds)
        if incomplete.startswith("sim:"):
            known = [f"sim:{name}" for name in EXPERIMENT.files()]
        return [CompletionItem(text) for text in known if text.startswith(incomplete)]


EXPERIMENT = Subject(paths.EXPERIMENTS, as_path=True)
CAN_HARDWARE = "280"  # hardware type of a CAN interface in Linux (ARPHRD_CAN)


def can_interfaces(folder: Path = Path("/sys/class/net")) -> list[str]:
    """Return the names of the CAN interfaces of this machine."""
    types = sorted(folder.glob("*/type"))
    return [path.parent.name for path in types if path.read_text().strip() == CAN_HARDWARE]


def serial_devices(folder: Path = Path("/dev")) -> list[str]:
    """Return the paths of the serial devices on USB of this machine."""
    return sorted(str(path) for kind in ("USB", "ACM") for path in folder.glob(f"tty{kind}*"))


@dataclass(frozen=True)
class AxisConnection:
    """The connection that the user has selected: the addresses of the option --on, and the values
    of --set and --model. `source`: the option or environment variable from which the address
    comes."""

    addresses: tuple[Address, ...] = ()
    overrides: tuple[str, ...] = ()
    accepted: Kinds = ANY
    source: str = "--on"
    model: str | None = None  # path of a model whose encoder converts encoder counts to mm
    wrong: tuple[InputError, ...] = ()  # errors of further addresses, for several()

    @property
    def is_simulated(self) -> bool:
        return bool(self.addresses) and all(isinstance(a, SimAddress) for a in self.addresses)

    @property
    def address(self) -> Address:
        """The address of the axis. Only the connection that one() returns has this property,
        because it has exactly one address."""
        return self.addresses[0]

    def chosen(self, is_bus: bool = False) -> AxisConnection:
        """Return this connection. If the user gave no --on, but the environment variable
        FORCEAXIS_AXIS has an address, return a connection with this address, and print the address.
        The printed address has the number of the axis, so that the user sees which axis is used.
        `is_bus`: True to use the address of the bus alone, without the number of an axis. Raises
        InputError."""
        text = os.environ.get(ENVIRONMENT)
        found = self
        if text and not self.addresses and not self.wrong:
            address = AxisAddress(self.accepted).address(ENVIRONMENT, text)
            address = addresses.bus(address) if is_bus else addresses.numbered(address)
            has_axis = isinstance(address, SimAddress) or address.number is not None
            click.echo(f"{'axis' if has_axis else 'bus'} {address} from {ENVIRONMENT}", err=True)
            found = dataclasses.replace(self, addresses=(address,), source=ENVIRONMENT)
        if found.overrides and not found.is_simulated and (found.addresses or is_bus):
            raise InputError(
                "--set: expected a simulated axis together with this option; add --on "
                "sim:EXPERIMENT or remove --set"
            )
        return found

    def several(self) -> tuple[list[AxisConnection], list[str]]:
        """Return a connection for each different address that the user has given, and a text for
        each error in the options. Raises InputError if the user gave no address."""
        wrong = [str(error) for error in self.wrong]
        try:
            found = self.chosen()
        except InputError as error:
            if not self.addresses:
                raise
            wrong.append(str(error))
            found = dataclasses.replace(self, overrides=())
        each = []
        for address in dict.fromkeys(map(addresses.numbered, found.addresses)):
            try:
                each.append(dataclasses.replace(found, addresses=(address,)).one())
            except InputError as error:
                wrong.append(str(error))
        return (each, wrong) if each or wrong else ([found.one()], [])

    def one(self) -> AxisConnection:
        """Return the connection to the axis that the user has selected. Raises InputError if the
        user has selected no axis or several axes.
        """
        found = self.chosen()
        if len(found.addresses) != 1:
            raise InputError(
                "expected the address of one axis, as --on ADDRESS or in the environment "
                f"variable {ENVIRONMENT}, such as {addresses.examples(self.accepted.kinds)}, got "
                f"{len(found.addresses) or 'no'} addresses"
            )
        if isinstance(found.address, LcmAddress) and found.address.number is None:
            raise InputError(
                f"{found.source}: {found.address}: expected an address with the number of an "
                "axis, such as lcm:2"
            )
        return found

    def link(self, timeout_s: float | None = None) -> Link:
        """Connect to the axis and return the open connection. `timeout_s`: longest time in s to
        wait for an answer, by default that of the kind of connection. Raises InputError for wrong
        options and NoAnswer if the axis does not respond."""
        address = self.address
        if isinstance(address, SimAddress):
            address = dataclasses.replace(address, overrides=self.overrides)
        try:
            found = address.link(timeout_s)
        except ParameterError as error:
            raise InputError(f"{self.source}: {error.text}") from None
        if self.model is not None:
            from forceaxis import linear

            try:
                found.use_model(linear.find_model(self.model))
            except InputError:
                found.close()
                raise
        return found

    def options(self) -> str:
        """Return the option that selects this axis, as text for use in another command."""
        address = self.address
        if isinstance(address, SimAddress):
            shown = paths.display(address.experiment)
            address = dataclasses.replace(address, experiment=shown)
        return f"--on {shlex.quote(str(address))}"


def on_option(
    accepted: Kinds = ANY,
    help_text: str = "",
    is_repeatable: bool = False,
    keeps_wrong: bool = False,
) -> Callable[[Callback], Callback]:
    """Return a decorator that adds the option --on to a command. The function of the command
    receives a tuple of addresses as the parameter `on`. `is_repeatable`: True if the command can
    use several addresses. `keeps_wrong`: True if the command reports a wrong address only after it
    has used the others."""
    example = addresses.examples(accepted.kinds)
    repeated = " Repeatable." if is_repeatable else ""
    return click.option(
        "--on",
        multiple=True,
        type=AxisAddress(accepted, is_repeatable, keeps_wrong),
        metavar="ADDRESS",
        help=help_text or f"Address of the axis: {example}. Default: {ENVIRONMENT}.{repeated}",
    )


def options(
    accepted: Kinds = ANY, is_repeatable: bool = False, keeps_wrong: bool = False
) -> Callable[[LiveVerb[P]], Verb]:
    """Return a decorator that adds the options of a connection to a command. The function of the
    command receives the values of the options as an `AxisConnection`, which may have no address or
    several. `is_repeatable`: True if the command can use several addresses. `keeps_wrong`: True if
    the command reports a wrong address only after it has used the others."""

    def decorated(command: LiveVerb[P]) -> Verb:
        @functools.wraps(command)
        def with_connection(
            on: tuple[Address | InputError, ...],
            overrides: tuple[str, ...] = (),
            *arguments: P.args,
            **given: P.kwargs,
        ) -> None:
            right = tuple(one for one in on if not isinstance(one, InputError))
            wrong = tuple(one for one in on if isinstance(one, InputError))
            command(AxisConnection(right, overrides, accepted, wrong=wrong), *arguments, **given)

        found: Verb = with_connection
        if "sim" in accepted.kinds:
            text = "A parameter of the model. For a simulated axis: as in `forceaxis run`."
            found = set_option(text)(found)
        return on_option(accepted, is_repeatable=is_repeatable, keeps_wrong=keeps_wrong)(found)

    return decorated


def live_over(accepted: Kinds) -> Callable[[LiveVerb[P]], Verb]:
    """Return a decorator that adds the options of a connection to a command that needs exactly one
    axis. The function of the command receives the values of the options as an
    `AxisConnection`."""

    def decorated(command: LiveVerb[P]) -> Verb:
        @functools.wraps(command)
        def with_one(connection: AxisConnection, *arguments: P.args, **given: P.kwargs) -> None:
            command(connection.one(), *arguments, **given)

        return options(accepted)(with_one)

    return decorated


def live(command: LiveVerb[P]) -> Verb:
    """Add the options of a connection to a command that needs exactly one axis. The address may be
    of any bus. For certain buses only, use live_over()."""
    return live_over(ANY)(command)


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
    130. The signal SIGTERM ends it with exit status 143."""
    from forceaxis.axis.axis import Axis

    axis: Axis | None = None
    before = signal.signal(signal.SIGTERM, _terminate)
    with errors(connection):
        try:
            axis = Axis(connection.link())
            warn_of_link(axis)
            yield axis
        except KeyboardInterrupt as interrupt:
            end = f", {axis.link.where} {axis.close()}" if axis else ""
            click.echo(f"forceaxis: interrupted{end}", err=True)
            sys.exit(143 if interrupt.args == (signal.SIGTERM,) else 130)
        finally:
            signal.signal(signal.SIGTERM, before)
            if axis:
                axis.close()


def warn_of_link(axis: Axis) -> None:
    """Print the warning of the connection to an axis, if there is one."""
    if axis.link.warning:
        click.echo(f"forceaxis: warning: {axis.link.warning}", err=True)


def warn_of_newtons(axis: Axis, connection: AxisConnection) -> None:
    """Print a warning if `force_scale` of the axis was never set, because forces in N are then
    wrong. For a simulated axis this warning is not needed, because the connection compares
    `force_scale` with the model."""
    from forceaxis.axis import quantity

    force_scale, date = axis.number("force_scale"), axis.integer("calibration_date")
    if not connection.is_simulated and quantity.never_set(force_scale, date):
        scale = f"force_scale ({force_scale * 1e-6:g} N/count)"
        click.echo(
            f"forceaxis: warning: {axis.link.where}: {scale} was never set, so forces in N are "
            "wrong unless the sensor has this scale; set force_scale, or use "
            f"`forceaxis axis calibrate {connection.options()}`",
            err=True,
        )


def warn_of_power_up(axis: Axis) -> None:
    """Print a warning if the axis loses values at its next power-up although they may be stored."""
    lost = axis.link.forgets()
    if not lost:
        return
    values = ", ".join(f"{name} = {value:g}" for name, value in lost.items())
    options = " ".join(f"--set firmware.{name}={axis.get(name)[name]}" for name in lost)
    click.echo(
        f"forceaxis: warning: {axis.link.where}: each command powers it up, and it then has "
        f"{values} again; give the next commands {options}, also `axis params store`, which keeps "
        "the values in the file of its store",
        err=True,
    )


def warn_of_forgotten(axis: Axis, connection: AxisConnection, values: Mapping[str, object]) -> None:
    """Print a warning that a simulated axis loses the written `values` when the command ends. The
    warning shows the options with which another command begins with the same values."""
    if not connection.is_simulated or not values:
        return
    options = " ".join(f"--set firmware.{name}={value}" for name, value in values.items())
    click.echo(
        f"forceaxis: warning: {axis.link.where} is powered up by each command and forgets what "
        f"this one has set; give the next commands {options}",
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
    """Context manager that reports errors of an axis. If the axis refuses a request or a step, or
    does not respond, print one text line and exit with status 1. A command in this text line has
    the option --on, because the environment variable may select another axis."""
    from forceaxis.axis.link import NoAnswer, Refused

    if connection is not None:
        set_axis_option(connection.options())
    try:
        yield
    except (Refused, NoAnswer) as error:
        fail(str(error), status=1)
    except Exception as error:
        from forceaxis.commission.refusal import Refusal

        if isinstance(error, Refusal):
            command = click.get_current_context().command
            fail(options_in(command, str(error)), status=1)
        raise


def _terminate(number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt(number)
