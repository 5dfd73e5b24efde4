"""The program `forceaxis`: it loads the Python module of a command, and runs the command. The exit
status is 0 on success, 1 if the run or check failed, and 2 for wrong usage or input."""

import importlib
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import cast

# With small matrices, several threads of the BLAS library need fifty times as long as one thread.
# NumPy reads the environment variable OPENBLAS_NUM_THREADS when NumPy is loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import click

from forceaxis._core import InputError
from forceaxis.cli import moved
from forceaxis.cli.common import fail, printed_streams

# Commands on the first page of the help: {heading: {commands: what these commands do}}.
# The first page of the help has to fit a terminal of 24 lines with 80 columns.
PAGE = {
    "Will my axis be stable?": {
        "new": "write a model and experiments of your axis from data sheets",
        "run": "run one experiment: the firmware controls the simulated axis",
        "sweep": "run it over ranges of parameters: where is it stable?",
        "loop": "analyse the force loop: largest gain, margins, plots, advice",
        "design": "design the force law with the largest bandwidth for all tolerances",
        "report": "write one page about a folder: gains, margins, verdicts, signals",
    },
    "Does the model describe my machine?": {
        "recording": "import, show, export, convert and replay recorded files",
        "compare": "compare recordings of the machine with what the model predicts",
        "measure": "measure the frequency response of a simulated or live axis",
        "identify": "identify parameters from recordings and measured responses",
    },
    "How do I run it on the bus?": {
        "axis": "check, move, press, set and record one axis, explain its incident",
        "tune": "measure a live axis, design its force law, verify and store the law",
        "cycle": "try the program of a press, load it, start it, collect results",
        "monitor, gateway": "watch running axes; put a CAN bus on LCM and Modbus TCP",
        "flash": "write the firmware to a board or, over the bus, to axes",
    },
    "How does it stay so, and what else is there?": {
        "test": "compare experiments with their recorded results, in CI",
        "objects, fmu": "objects of the firmware; plant or firmware as an FMI unit",
        "examples, thesis, bench, completion": "copies, checks, speed, the Tab key",
    },
}
WORDS = [word for rows in PAGE.values() for words in rows for word in words.split(", ")]

# Python modules of each command whose module has another name than the command.
# The list VERBS of the first module contains the command.
# Further modules add commands to a group of commands.
# The module of a command is loaded when the command is used.
MODULES = {
    **dict.fromkeys(("run", "sweep", "test"), ("experiments",)),
    **dict.fromkeys(("monitor", "gateway"), ("buses",)),
    "axis": (
        "axis", "axis_actions", "axis_check", "axis_health", "axis_params", "bringup", "incident",
    ),
    "cycle": ("cycle", "cycle_records", "cycle_judge"),
    "loop": ("loop", "loop_margins", "loop_models", "loop_advise"),
    "recording": ("recording", "recording_logs"),
}  # fmt: skip

# Exceptions that end a command with one text line and exit status 1.
# The exceptions are listed by name, so that their Python modules need not be loaded.
FAILURES = {
    "forceaxis._core.SimulationError",
    "forceaxis.experiments.link.LinkError",
    "forceaxis.chip.flash.FlashError",
    "forceaxis.bus.client.NoAnswer",
    "forceaxis.bus.client.Refused",
    "forceaxis.commission.refusal.Refusal",
    "forceaxis.thesis.tables.StaleFit",
}


def show_versions(context: click.Context, _parameter: click.Parameter, wanted: bool) -> None:
    if wanted:
        from forceaxis import versions

        for what, version in versions.rows():
            click.echo(f"{what:<24}{version}")
        context.exit()


class Program(click.Group):
    """The command `forceaxis` with all commands. The Python module of a command is loaded
    only when the command is used, so that the program starts fast."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return WORDS

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in WORDS:
            return None
        first, *_ = [
            importlib.import_module(f"forceaxis.cli.{name}")
            for name in MODULES.get(cmd_name, (cmd_name,))
        ]
        verbs: tuple[click.Command, ...] = first.VERBS
        return next(verb for verb in verbs if verb.name == cmd_name)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args and args[0] in moved.COMMANDS:
            raise InputError(moved.told(args, ctx))
        if args and args[0] not in WORDS and not args[0].startswith("-"):
            raise click.exceptions.NoSuchCommand(args[0], possibilities=WORDS, ctx=ctx)
        return super().resolve_command(ctx, args)

    def format_help(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        formatter.write(
            "Usage: forceaxis COMMAND ...    forceaxis COMMAND --help    forceaxis --version\n"
        )
        for heading, rows in PAGE.items():
            formatter.write(f"{heading}\n")
            for words, about in rows.items():
                formatter.write(f"  {words:<9}  {about}\n")


@click.group(
    cls=Program,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=show_versions,
    help="Show the versions of firmware, object table, LCM types and files, and exit.",
)
@click.pass_context
def cli(context: click.Context) -> None:
    """Simulate the firmware of a force-controlled axis before you flash the firmware."""
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


def with_help(error: click.ClickException) -> str:
    """Return the message of a usage error. If the message does not state what was expected, a hint
    to `--help` is added. If the user typed an option or command of an earlier version, the message
    shows the command line for the present version, or says what to do instead."""
    text = error.format_message()
    context = getattr(error, "ctx", None)
    if isinstance(error, click.exceptions.NoSuchOption) and context:
        if instead := moved.gone(error):
            return instead
        known = [name for option in context.command.params for name in option.opts]
        if error.option_name in moved.LAW_OPTIONS and "--law" in known:
            line = moved.present_line(sys.argv[1:])
            return f"{error.option_name}: expected `{line}`, got an earlier option"
    if re.search(r"\bexpected\b", text):
        return text
    end = "" if text[-1] in ".?" else ";"
    command = context.command_path if context else "forceaxis COMMAND"
    return f"{text}{end} `{command} --help` shows what is expected"


def with_table(message: str) -> str:
    """Return the error message `message`. If the error is a wrong key in the table [set] of a file,
    add a hint that names the table in which this key is valid."""
    wrong = re.search(r'set\.(\w+): expected one of the parameters .* got "\1"; correct', message)
    if wrong:
        from forceaxis.experiments.points import meant

        return message.replace("; correct", f"{meant(wrong[1])}; correct")
    return message


def main() -> None:
    """Run the program `forceaxis`. Control characters in texts from buses and files are made
    visible, and do not reach the terminal."""
    with printed_streams():
        command_line()


def _run() -> None:
    """Run the command of the user. If the command ends with an exit status other than 0, exit the
    program with this status."""
    if status := cli(prog_name="forceaxis", standalone_mode=False):
        sys.exit(status)


def command_line() -> None:
    """Run the command that sys.argv names. After an expected error, print one text line on
    standard error and exit with status 1, 2 or 130 (Ctrl-C)."""
    try:
        for text in sys.argv:
            text.encode()  # this call raises UnicodeError if an argument is not valid UTF-8
        _run()
    except click.exceptions.Abort:
        fail("interrupted", status=130)
    except click.exceptions.NoArgsIsHelpError as error:
        verbs = ", ".join(cast(click.Group, error.ctx.command).list_commands(error.ctx))
        fail(f"{error.ctx.command_path}: expected a command: {verbs}")
    except click.ClickException as error:
        fail(with_help(error))
    except subprocess.TimeoutExpired as error:
        program = error.cmd if isinstance(error.cmd, str) else error.cmd[0]
        fail(
            f"{Path(program).name}: expected the program to end within {error.timeout:g} s; "
            "try again when the computer is less busy",
            status=1,
        )
    except Exception as error:
        names = {f"{kind.__module__}.{kind.__qualname__}" for kind in type(error).__mro__}
        if names & FAILURES:
            fail(str(error), status=1)
        if "forceaxis._core.InputError" in names:
            fail(with_table(str(error)))
        if isinstance(error, FileNotFoundError) and error.filename:
            folder = Path(error.filename).parent
            missing = "no such file" if folder.is_dir() else f"no folder {folder}"
            fail(f"{error.filename}: expected a file, but there is {missing}; check the path")
        if isinstance(error, OSError):
            where = f"{error.filename}: " if error.filename else ""
            fail(
                f"{where}expected permission and space to read and write, got: {error.strerror}; "
                "check the path"
            )
        if isinstance(error, UnicodeError):
            fail("expected UTF-8 in arguments, file names and files, got other bytes")
        raise
