"""The program `forceaxis`, which loads the Python module of a command and runs the command.
The exit status is 0 on success, 1 if the run or check failed, and 2 for wrong usage or input."""

import importlib
import os
import pkgutil
import re
import subprocess
import sys
from pathlib import Path
from typing import cast

# With small matrices, several threads of the BLAS library need fifty times as long as one thread.
# On a busy computer the threads wait for each other. NumPy reads this variable when NumPy is
# loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import click

import forceaxis.cli
from forceaxis.cli.common import Verb, fail, listed, printed_streams

JOBS = """\
Check my axis
  forceaxis new press               writes its model from the data sheets
  forceaxis run press/contact.toml --out out/press
  forceaxis report press            one page: gain, margins, runs
Put it on the bus
  forceaxis axis list --on can0    lists the axes and their states
  forceaxis axis check --on can0   guided first motion
  forceaxis tune --help             measures, designs, verifies, stores a law
Keep it from breaking in CI
  forceaxis test press --update     records the results of today
  forceaxis test press              status 1 and the figures if one changed"""

# The Python module of each command, in groups for the help. The list VERBS of a Python module
# contains its commands. A module MODULE is loaded when one of its commands is used. Modules
# MODULE_... are then also loaded, because they add commands to MODULE.
GROUPS = {
    "An axis and its runs": {
        "new": "new",
        "run": "experiments",
        "sweep": "experiments",
        "cycle": "cycle",
        "test": "experiments",
        "replay": "experiments",
        "recording": "recording",
        "compare": "compare",
        "report": "thesis",
        "objects": "objects",
        "fmu": "fmu",
        "examples": "examples",
    },
    "Its force loop": {
        "limit": "loops",
        "design": "design",
        "advise": "advise",
        "compliance": "advise",
        "step": "loops",
        "nyquist": "loops",
        "rlocus": "loops",
        "bode": "models",
        "poles": "models",
        "modes": "models",
        "linearise": "models",
        "beam": "models",
        "measure": "measure",
        "identify": "identify",
    },
    "On a bus or a chip": {
        "axis": "axis",
        "tune": "tune",
        "incident": "incident",
        "monitor": "buses",
        "log": "buses",
        "gateway": "buses",
        "flash": "flash",
        "bringup": "bringup",
    },
    "The thesis": {"tables": "thesis", "check-thesis": "thesis", "session": "thesis"},
    "This program": {"bench": "bench", "completion": "completion"},
}
MODULES = {verb: module for verbs in GROUPS.values() for verb, module in verbs.items()}

# Exceptions that end a command with one text line and exit status 1. The exceptions are listed
# by name, so that the Python modules of the exceptions need not be loaded.
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
        return list(MODULES)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in MODULES:
            return None
        name = MODULES[cmd_name]
        for found in pkgutil.iter_modules(forceaxis.cli.__path__):
            # A module "..._text" has no commands, only functions for printed text.
            if found.name.endswith("_text"):
                continue
            if found.name.startswith(f"{name}_"):
                importlib.import_module(f"forceaxis.cli.{found.name}")
        module = importlib.import_module(f"forceaxis.cli.{name}")
        verbs: tuple[click.Command, ...] = module.VERBS
        return next(verb for verb in verbs if verb.name == cmd_name)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args and args[0] not in MODULES and not args[0].startswith("-"):
            raise click.exceptions.NoSuchCommand(args[0], possibilities=MODULES, ctx=ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        for group, verbs in GROUPS.items():
            with formatter.section(group):
                listed(ctx, formatter, verbs)

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        Verb.format_epilog(self, ctx, formatter)


@click.group(
    cls=Program,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="forceaxis run contact --set firmware.force_gain=7 --out out/g7\n"
    "forceaxis COMMAND --help",
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
        formatter = context.make_formatter()
        cli.format_commands(context, formatter)
        click.echo(f"{cli.help}\n\n{JOBS}\n\n{formatter.getvalue()}\nforceaxis COMMAND --help")


def with_help(error: click.ClickException) -> str:
    """Return the message of a usage error. If the message does not state what was expected, a hint
    to `--help` is added."""
    text = error.format_message()
    context = getattr(error, "ctx", None)
    if re.search(r"\bexpected\b", text):
        return text
    end = "" if text[-1] in ".?" else ";"
    command = context.command_path if context else "forceaxis COMMAND"
    return f"{text}{end} `{command} --help` shows what is expected"


def with_table(message: str) -> str:
    """Return `message` with a hint if the table [set] of a file has an unknown name, and another
    table of the file format has the same name. Return other messages unchanged."""
    wrong = re.search(r'set\.(\w+): expected one of the parameters .* got "\1"; correct', message)
    if wrong:
        from forceaxis.experiments.points import meant

        return message.replace("; correct", f"{meant(wrong[1])}; correct")
    return message


def main() -> None:
    """Run the program `forceaxis`. Terminal control characters in texts from buses and files are
    not sent to the terminal."""
    with printed_streams():
        command_line()


def _run() -> None:
    """Run the command, and exit with its status unless that is 0. Commands return None; click
    returns the status of Context.exit()."""
    if status := cli(prog_name="forceaxis", standalone_mode=False):
        sys.exit(status)


def command_line() -> None:
    """Run the command that sys.argv names. After an expected error, print one text line on
    standard error and exit with status 1, 2 or 130 (Ctrl-C)."""
    try:
        for text in sys.argv:
            text.encode()  # raises UnicodeError if an argument is not valid UTF-8
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
