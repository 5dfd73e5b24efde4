"""Code that all commands use: layout of the help, common options with their types, error messages,
progress and colours."""

import contextlib
import io
import json
import math
import os
import re
import shutil
import sys
import textwrap
import threading
import time
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TextIO, TypeVar, cast

import click
from click.shell_completion import CompletionItem

from forceaxis import paths, progress
from forceaxis._core import InputError
from forceaxis.cli import former_options
from forceaxis.errors import ParameterError
from forceaxis.pages.commands import with_commands
from forceaxis.words import number, printable, suggestion

if TYPE_CHECKING:
    from forceaxis.experiments.link import LinkOptions
    from forceaxis.results import Convertible

T = TypeVar("T")
Callback = TypeVar("Callback", bound=Callable[..., None])  # type of the function of a command

# Longest first sentence of a help text in characters: the library click cuts longer ones.
FIRST_SENTENCE_LENGTH = 300


# Control sequences that the program itself writes: click.style and the start of the progress line.
OWN_SEQUENCES = re.compile("((?:\r?\x1b\\[(?:0|1|22|3[0-9]|39|9[0-7])?m|\r\x1b\\[2K)+)")


class Printed(io.TextIOWrapper):
    """A standard stream for output to a terminal. Control sequences in texts from buses and files
    are printed as visible characters, so that these texts cannot change the terminal. The colours
    that the program itself writes are still shown. If a text of the library tells the user to call
    a function for an axis, the printed text has the command with the address of this axis
    instead."""

    def __init__(self, stream: TextIO) -> None:
        super().__init__(
            stream.buffer, stream.encoding, stream.errors, line_buffering=True, write_through=True
        )

    def write(self, text: str) -> int:
        """Write `text` to the stream, and return its length. Control sequences that the program
        itself did not write become visible characters."""
        pieces = OWN_SEQUENCES.split(with_commands(text, axis_option()))
        pieces[::2] = [printable(piece, keep="\n\t\r") for piece in pieces[::2]]
        super().write("".join(pieces))
        return len(text)


AXIS_OPTION = "forceaxis.axis_option"  # key in `meta` of a click context


def set_axis_option(option: str) -> None:
    """Store the option that selected the axis of the running command, such as "--on can0:5", for
    later messages."""
    if context := click.get_current_context(silent=True):
        context.meta[AXIS_OPTION] = option


def axis_option() -> str:
    """Return the option that selected the axis of the running command, such as "--on can0:5".
    Return "" for a command without an axis."""
    context = click.get_current_context(silent=True)
    return str(context.meta.get(AXIS_OPTION, "")) if context else ""


@contextlib.contextmanager
def printed_streams() -> Iterator[None]:
    """Replace standard output and standard error by `Printed` streams during a `with` block. Binary
    output is not changed."""
    before = sys.stdout, sys.stderr
    streams = [Printed(s) if hasattr(s, "buffer") else s for s in before]
    sys.stdout, sys.stderr = streams
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before
        for stream in streams:
            if isinstance(stream, Printed):
                # Without detach(), the end of this stream would close the earlier stream's file.
                stream.detach()


# Options whose name differs from the name of the library parameter: {parameter: option}.
OTHER_NAMES = {
    "names": "--fit",
    "states": "--mode", "overrides": "--set", "forces_N": "--force", "force_max_N": "--force-max",
    "band_hz": "--band", "resolution_hz": "--resolution",
    "can": "--on", "modbus": "--on", "url": "--on",
}  # fmt: skip


def option_of(command: click.Command, parameter: str) -> str | None:
    """Return the name of the option with which the user of `command` sets a parameter of the
    library, such as "--timing" for "timing". If the user sets this parameter by an argument, return
    the argument's name in the help. Return None if neither an option nor an argument sets this
    parameter."""
    if any("--law" in known.opts for known in command.params):
        from forceaxis.linear.law_text import KEY_OF

        if parameter in KEY_OF:
            return f"--law {KEY_OF[parameter]}"
    wanted = OTHER_NAMES.get(parameter, "--" + parameter.lower().replace("_", "-"))
    for known in command.params:
        if wanted in known.opts:
            return wanted
    for known in command.params:
        if known.name == parameter.lower():
            is_argument = isinstance(known, click.Argument)
            return (
                known.make_metavar(click.Context(command))
                if is_argument
                else max(known.opts, key=len)
            )
    return None


def with_options(command: click.Command, error: InputError) -> str:
    """Return the message of `error`, with names of options of `command` in place of names of
    library parameters. A parameter is replaced if its name is between backticks or begins the
    message."""
    text = str(error)
    if isinstance(error, ParameterError):
        text = f"{option_of(command, error.parameter) or error.parameter}: {error.text}"
    return options_in(command, text)


def options_in(command: click.Command, text: str) -> str:
    """Return `text` with names of options of `command` in place of names of library parameters.
    Only names between backticks are replaced."""
    return re.sub(r"`(\w+)`", lambda named: option_of(command, named[1]) or named[0], text)


def given(value: T | None, default: T) -> T:
    """Return the value of an option, or `default` if the user did not give the option."""
    return default if value is None else value


class Verb(click.Command):
    """A command of `forceaxis`. Its help shows examples with the same line breaks as in the source
    code. Its error messages name options of the command instead of parameters of the library."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if any("--on" in option.opts for option in self.params):
            former_options.expect_none(ctx, args)
        return super().parse_args(ctx, args)

    def invoke(self, ctx: click.Context) -> None:
        try:
            super().invoke(ctx)
        except InputError as error:
            raise InputError(with_options(self, error)) from error

    def format_epilog(
        self: click.Command, ctx: click.Context, formatter: click.HelpFormatter
    ) -> None:
        if self.epilog:
            formatter.write_paragraph()
            formatter.write("Example:\n")
            for line in self.epilog.strip().splitlines():
                formatter.write(f"  {line.strip()}\n")


class Slow(Verb):
    """A command whose computation can last many seconds. Until the command prints its result, a
    terminal shows the progress of the computation."""

    def invoke(self, ctx: click.Context) -> None:
        with waiting(self.name):
            super().invoke(ctx)


def done_waiting() -> None:
    """Clear the progress line on the terminal. A command calls this function before it prints a
    result."""
    if stop := click.get_current_context().meta.get("forceaxis.waiting"):
        stop()


def listed(context: click.Context, formatter: click.HelpFormatter, verbs: Iterable[str]) -> None:
    """Write a list of commands to the help. Each row has the name of a command, and the first
    sentence of the help of this command."""
    group = cast(click.Group, context.command)
    found = [(name, cast(click.Command, group.get_command(context, name))) for name in verbs]
    formatter.write_dl(
        [(name, verb.get_short_help_str(FIRST_SENTENCE_LENGTH)) for name, verb in found]
    )


class Verbs(click.Group):
    """A group of commands: `forceaxis axis` is a group with the command `forceaxis axis move`. The
    help lists the commands under the headings of `sections`, or in alphabetical order without
    `sections`."""

    command_class = Verb
    format_epilog = Verb.format_epilog

    def __init__(
        self,
        name: str | None = None,
        sections: Mapping[str, Sequence[str]] | None = None,
        **attributes: Any,
    ) -> None:
        super().__init__(name, **attributes)
        self.sections = sections or {}

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all commands. The commands of `sections` come first, in order."""
        first = [name for names in self.sections.values() for name in names]
        return first + [name for name in super().list_commands(ctx) if name not in first]

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        sections = self.sections or {"Commands": self.list_commands(ctx)}
        for heading, names in sections.items():
            with formatter.section(heading):
                listed(ctx, formatter, names)


class Folder(click.Path):
    """Type of an option for the folder to which a command writes results. The folder need not
    exist."""

    def __init__(self) -> None:
        super().__init__(file_okay=False, path_type=Path)

    def convert(
        self,
        value: str | os.PathLike[str],
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> str | bytes | os.PathLike[str]:
        if value == "":
            self.fail("expected the name of a folder", param, ctx)
        return super().convert(value, param, ctx)


class Positive(click.ParamType[float]):
    """Type of an option for a number from `low` to `high`, which are both above 0."""

    name = "float"

    def __init__(self, low: float = 1e-6, high: float = 1e6) -> None:
        self.low, self.high = low, high

    def convert(
        self, value: str | float, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        try:
            found = number(value)
        except ValueError:
            found = math.nan
        if not self.low <= found <= self.high:
            text = f"expected a number from {self.low:g} to {self.high:g}, got {value}"
            self.fail(text, param, ctx)
        return found


class File(click.Path):
    """Type of an option for the path of a file that the command writes."""

    def __init__(self) -> None:
        super().__init__(dir_okay=False, path_type=Path)


class Kind(click.Choice[str]):
    """Type of the option --link, which selects the connection between the firmware process and the
    plant process. The Python module for these connections is loaded only for a command that has
    this option."""

    def __init__(self) -> None:
        from forceaxis.experiments import link

        super().__init__(link.KINDS)


class Subject(click.ParamType[str | Path]):
    """Type of an argument for a file that the command reads. The user enters the path of the file.
    For a file in one of `folders`, the file name without ".toml" is enough. The function of the
    command receives the entered text, or a Path if `as_path` is True."""

    name = "file"

    def __init__(self, *folders: Path, as_path: bool = False) -> None:
        self.folders, self.as_path = folders, as_path

    def files(self) -> dict[str, Path]:
        """Return the paths of all files in the folders as {file name without ".toml": path}. If two
        folders contain the same file name, return the path in the first folder."""
        return {p.stem: p for f in reversed(self.folders) for p in sorted(f.glob("*.toml"))}

    def convert(
        self, value: str | Path, param: click.Parameter | None, ctx: click.Context | None
    ) -> str | Path:
        text = str(value)
        path, known = Path(text), self.files()
        is_stem = text and path.parent == Path() and path.suffix != ".toml" and not path.exists()
        if is_stem and text not in known and len(text) < 256:
            kind = "MODEL" if paths.MODELS in self.folders else "EXPERIMENT"
            places = " or ".join(paths.display(f) for f in self.folders)
            raise InputError(
                f"{kind}: {text}: expected a path ending in .toml or a name of a file in {places}"
                f"{suggestion(text, known)}"
            )
        if not is_stem and path.suffix == ".toml" and not path.exists():
            near = [p.name for p in path.parent.glob("*.toml")] if path.parent.is_dir() else []
            if meant := suggestion(path.name, near):
                raise InputError(f"{text}: file: expected a readable file, got none{meant}")
            if not path.is_absolute() and (paths.ROOT / path).is_file():
                raise InputError(
                    f"{text}: file: expected a readable file, got none; for the file that comes "
                    f"with forceaxis, give the name {path.stem} alone"
                )
        if not self.as_path:
            return value
        return Path(paths.display(known[text])) if is_stem else path

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        return [
            *(CompletionItem(stem) for stem in self.files() if stem.startswith(incomplete)),
            CompletionItem(incomplete, type="file"),
        ]


class Override(click.ParamType[str]):
    """Type of the option --set, whose value is a text NAME=VALUE. A shell can complete the names of
    model parameters and of firmware objects, and the named values of an object."""

    name = "override"

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        return [CompletionItem(text) for text in completed(ctx, incomplete)]


def set_option(text: str) -> Callable[[Callback], Callback]:
    """Return a decorator that adds the option --set to a command. `text` is the help of the
    option."""
    return click.option(
        "--set", "overrides", multiple=True, type=Override(), metavar="NAME=VALUE", help=text
    )


def mode_option(name: str) -> Callable[[Callback], Callback]:
    """Return a decorator that adds the option --mode to a command. The option selects states of
    elements, such as an open contact. The function of the command receives these states as the
    parameter `name`."""
    return click.option(
        "--mode",
        name,
        multiple=True,
        metavar="ELEMENT=STATE",
        help="State of one element, with the names of events.csv (sensor=apart, rail=stuck, "
        "drive.amplifier=high outer). Default: contacts are pressed, frictions slide if the drive "
        "can overcome them, backlashes are closed, all other elements are in the middle of their "
        "range. The command prints the states if the model has a choice. Repeatable.",
    )


class Parameter(click.ParamType[str]):
    """Type of an option for a text NAME=VALUE about a parameter of the model. A shell can complete
    the names of the parameters."""

    name = "parameter"

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        return [CompletionItem(n) for n in _parameters(ctx) if n.startswith(incomplete)]


class Object(click.ParamType[str]):
    """Type of an argument for the name of a firmware object. With `end="="`, the argument is a text
    NAME=VALUE, and the object must be writable. A shell can complete the names of the objects."""

    name = "object"

    def __init__(self, end: str = "") -> None:
        self.end = end

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        from forceaxis import objects

        known = (o.name + self.end for o in objects.OBJECTS if "w" in o.access or not self.end)
        return [CompletionItem(name) for name in sorted(known) if name.startswith(incomplete)]


def completed(ctx: click.Context, text: str) -> list[str]:
    """Return all texts with which a shell can complete `--set TEXT`: names of firmware objects and
    their named values, names of model parameters, and the two names for the duration of the
    experiment and for the time window of the verdict."""
    from forceaxis import objects

    name, equals, _ = text.partition("=")
    if equals:
        known = objects.BY_NAME.get(name.removeprefix("firmware."))
        values = [f"{name}={value}" for value in known.enum] if known else []
        return [value for value in values if value.startswith(text)]
    names = [f"firmware.{o.name}=" for o in objects.OBJECTS if o.access == "rw"]
    names += ["experiment.duration_s=", "verdict.window_s=", *_parameters(ctx)]
    return sorted(n for n in names if n.startswith(text))


def _parameters(ctx: click.Context) -> list[str]:
    """Return the text "NAME=" for each parameter of the model that the command line names. Return
    an empty list if the command line names no model or if the model cannot be read."""
    from forceaxis import _core, toml
    from forceaxis.linear import plant_facts, settings

    # The last option has no value yet, so the library click has left the arguments in `args`.
    arguments = [p.name for p in ctx.command.params if isinstance(p, click.Argument)] + [
        "model",
        "sim",
    ]
    subject = next(filter(None, map(ctx.params.get, arguments)), None)
    subject = subject or next(iter(ctx.args), None)
    if not subject:
        return []
    try:
        path = settings.find(str(subject))
        table = toml.read(path)
        if settings.is_experiment(table):
            path = path.parent / table["model"]
        return [f"{name}=" for name in plant_facts.read(str(path)).parameters]
    except (_core.InputError, OSError):
        return []


as_json = click.option(
    "--json", "as_json", is_flag=True, help="Print one JSON object and nothing else."
)
codes_option = click.option(
    "--codes",
    is_flag=True,
    help="Plot codes of ADC and DAC and encoder counts instead of N, V and mm.",
)
threads = click.option(
    "--threads",
    type=click.IntRange(1, 256),
    default=None,
    help="Number of threads. Default: one per core.",
)


def linked(command: Callback) -> Callback:
    """Add the options --link, --lcm-url and --link-can to a command that can run the firmware as
    a separate process."""
    for option in (
        click.option("--inject", default="", hidden=True, help="Faults of the link, for tests."),
        click.option(
            "--link-can",
            default="vcan1",
            show_default=True,
            help="CAN interface of --link socketcan.",
        ),
        click.option("--lcm-url", default="", help="LCM bus of --link lcm. Default: a free port."),
        click.option(
            "--link",
            "kind",
            type=Kind(),
            metavar="inproc|lcm|socketcan|pil-BOARD",
            help="Run the firmware as a separate process, in lock-step with the plant over this "
            "link. inproc: in one process, but both sides compute the trace hash. pil-BOARD: the "
            "image of a board on its emulator, such as pil-stm32 or pil-microbit. If the kernel "
            "has no CAN, socketcan runs in a guest kernel (tools/vcan).",
        ),
    ):
        command = option(command)
    return command


def link_of(kind: str | None, lcm_url: str, link_can: str, inject: str) -> "LinkOptions | None":
    """Return the settings of the connection to a separate firmware process, or None without the
    option --link. If the connection needs CAN and the kernel does not support CAN, the command is
    started again in a guest kernel that supports CAN."""
    if kind is None:
        return None
    from forceaxis.experiments import link

    over = link.LinkOptions(kind, lcm_url, link_can, inject)
    link.under_vcan(over)
    return over


COLOURS = {
    **dict.fromkeys(("stable", "passed"), "green"),
    **dict.fromkeys(("unstable", "failed", "error"), "red"),
    **dict.fromkeys(("not_met", "never_in_contact", "updated"), "yellow"),
}


def coloured(text: str, word: str | None = None) -> str:
    """Return `text` in the colour that belongs to the result `word`, such as "stable" or "failed".
    Without `word`, `text` itself is the result. Return `text` unchanged if no colour belongs to the
    result, or if the environment variable NO_COLOR exists."""
    colour = COLOURS.get((word or text).strip())
    plain = os.environ.get("NO_COLOR") or not colour
    return text if plain else click.style(text, fg=colour, bold=True)


def fitted(text: str, indent: int = 0) -> str:
    """Wrap a text line to the width of the terminal and indent the continuation lines by `indent`
    characters. Without a terminal, return the text line unchanged."""
    if not sys.stdout.isatty():
        return text
    width = max(shutil.get_terminal_size().columns, 40)
    return textwrap.fill(text, width, subsequent_indent=" " * indent, break_on_hyphens=False,
                         break_long_words=False)  # fmt: skip


def fitted_lines(text: str) -> str:
    """Wrap text lines of the form "key text" to the width of the terminal. Text lines whose text
    contains two consecutive spaces are rows of a table, and are not wrapped."""
    return "\n".join(
        line if "  " in line[13:].strip() else fitted(line, 13) for line in text.splitlines()
    )


def show(rows: Iterable[tuple[str, str]]) -> None:
    """Print rows (key, text), one text line for each row. On a terminal, long texts are wrapped,
    and the text of the verdict is coloured."""
    done_waiting()
    for key, text in rows:
        line = f"{key:12} {text}"
        # Texts that the user copies must not be wrapped.
        if key not in ("trace hash", "axis hash", "again", "files"):
            line = fitted(line, 13)
        if key == "verdict":
            word = text.partition(":")[0]
            line = line.replace(word, coloured(word), 1)
        click.echo(line)


def print_json(result: "Convertible") -> None:
    """Print a result as JSON on one text line. The result is a dataclass, or a dict or list of
    results."""
    from forceaxis.results import to_json

    done_waiting()
    text = json.dumps(to_json(result), allow_nan=False)
    if option := axis_option():
        text = with_commands(text, json.dumps(option)[1:-1])
    context = click.get_current_context(silent=True)
    click.echo(options_in(context.command, text) if context else text)


def print_result(
    result: "Convertible", as_json: bool, text: Callable[[], str], out: Path | None = None
) -> None:
    """Print a result as JSON, or as the text that the function `text` returns. If the command wrote
    files to the folder `out`, the last text line names this folder."""
    if as_json:
        print_json(result)
        return
    done_waiting()
    click.echo(text())
    if out:
        click.echo(f"files        {paths.quoted(out)}")


def aligned(rows: Sequence[Sequence[str]], to_the_left: Container[int] = (0,)) -> list[str]:
    """Return the text lines of a table with aligned columns. Columns whose index is in
    `to_the_left` are aligned to the left. All other columns are aligned to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.ljust(width) if i in to_the_left else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


@contextlib.contextmanager
def waiting(what: str | None) -> Iterator[None]:
    """Show the progress of the command `what` on standard error during a `with` block. A terminal
    shows one text line, which appears after two seconds and is then updated. Without a terminal,
    each phase of the computation is written as one text line."""
    if not sys.stderr.isatty():
        with progress.told(lambda phase: click.echo(f"{what}: {phase}", err=True)):
            yield
        return
    over, began = threading.Event(), time.monotonic()

    def report() -> None:
        pause = 2.0
        while not over.wait(pause):
            pause = 0.5
            text = f"{what}, {time.monotonic() - began:.0f} s"
            text += f", {progress.shown}" if progress.shown else ""
            sys.stderr.write(f"\r\x1b[2K{text[: shutil.get_terminal_size().columns - 1]}")
            sys.stderr.flush()

    thread = threading.Thread(target=report, daemon=True)
    thread.start()

    def stop() -> None:
        if not over.is_set():
            over.set()
            thread.join()
            if time.monotonic() - began > 2:
                sys.stderr.write("\r\x1b[2K")
                sys.stderr.flush()

    meta = click.get_current_context().meta
    meta["forceaxis.waiting"] = stop
    try:
        yield
    finally:
        stop()


def fail(message: str, status: int = 2) -> NoReturn:
    """Print an error message on one text line of standard error and exit with `status`, by default
    2."""
    click.echo("forceaxis: " + " ".join(message.split()), err=True)
    sys.exit(status)
