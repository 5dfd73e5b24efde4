"""The command line. Exit status: 0 done, 1 the run or check failed, 2 wrong usage or input."""

import importlib
import os
import pkgutil
import re
import subprocess
import sys
from pathlib import Path
from typing import cast

# Matrices here are small: threads of a BLAS that wait for each other cost fifty times the work
# where the cores are busy. Read when NumPy loads.
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
  forceaxis axis list --can can0    lists the axes and their states
  forceaxis axis check --can can0   guided first motion
  forceaxis tune --help             measures, designs, verifies, stores a law
Keep it from breaking in CI
  forceaxis test press --update     records the results of today
  forceaxis test press              status 1 and the figures if one changed"""

# {group: {verb: the module beside this one whose VERBS hold it}}; a module loads with its verb, and
# with it the modules NAME_..., which add verbs to it.
GROUPS = {
    "An axis and its runs": {
        "new": "new",
        "run": "experiments",
        "sweep": "experiments",
        "test": "experiments",
        "replay": "experiments",
        "report": "thesis",
        "objects": "objects",
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
    },
    "The thesis": {"tables": "thesis", "check-thesis": "thesis", "session": "thesis"},
    "This program": {"bench": "bench", "completion": "completion"},
}
MODULES = {verb: module for verbs in GROUPS.values() for verb, module in verbs.items()}

# Failures of what was asked for: one line and status 1. A class whose module is not loaded cannot
# have been raised.
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
    """The group of all verbs; the module of a verb is loaded when the verb is used."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(MODULES)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in MODULES:
            return None
        name = MODULES[cmd_name]
        for found in pkgutil.iter_modules(forceaxis.cli.__path__):
            if found.name.endswith("_text"):  # no verbs: the text of a result, loaded with it
                continue
            if found.name.startswith(f"{name}_"):
                importlib.import_module(f"forceaxis.cli.{found.name}")
        module = importlib.import_module(f"forceaxis.cli.{name}")
        return next(verb for verb in module.VERBS if verb.name == cmd_name)

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
    epilog="forceaxis run sim/experiments/contact.toml --set firmware.force_gain=7 --out out/g7\n"
    "forceaxis VERB --help",
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
    """Simulate the firmware of a force-controlled axis before you flash it."""
    if context.invoked_subcommand is None:
        formatter = context.make_formatter()
        cli.format_commands(context, formatter)
        click.echo(f"{cli.help}\n\n{JOBS}\n\n{formatter.getvalue()}\nforceaxis VERB --help")


def with_help(error: click.ClickException) -> str:
    """Return the message of a usage error; it names `--help` if it lacks what was expected."""
    text = error.format_message()
    context = getattr(error, "ctx", None)
    if re.search(r"\bexpected\b", text):
        return text
    end = "" if text[-1] in ".?" else ";"
    verb = context.command_path if context else "forceaxis VERB"
    return f"{text}{end} `{verb} --help` shows what is expected"


def with_table(message: str) -> str:
    """Return the message about an unknown name in [set], with the table that has this name."""
    wrong = re.search(r'set\.(\w+): expected one of the parameters .* got "\1"; correct', message)
    if wrong:
        from forceaxis.experiments.points import meant

        return message.replace("; correct", f"{meant(wrong[1])}; correct")
    return message


def main() -> None:
    """Run the program. An input error prints one line on standard error and exits with status 2."""
    with printed_streams():
        command_line()


def command_line() -> None:
    """Run one verb, or print one line that says why it cannot be run."""
    try:
        for text in sys.argv:
            text.encode()  # what is not UTF-8 is refused before anything sees it
        cli(standalone_mode=False)
    except click.exceptions.Abort:
        fail("interrupted", status=130)
    except click.exceptions.NoArgsIsHelpError as error:
        verbs = ", ".join(cast(click.Group, error.ctx.command).list_commands(error.ctx))
        fail(f"{error.ctx.command_path}: expected a verb: {verbs}")
    except click.ClickException as error:
        fail(with_help(error))
    except subprocess.TimeoutExpired as error:
        program = error.cmd if isinstance(error.cmd, str) else error.cmd[0]
        fail(f"{Path(program).name}: expected it to end within {error.timeout:g} s", status=1)
    except Exception as error:
        names = {f"{kind.__module__}.{kind.__qualname__}" for kind in type(error).__mro__}
        if names & FAILURES:
            fail(str(error), status=1)
        if "forceaxis._core.InputError" in names:
            fail(with_table(str(error)))
        if isinstance(error, FileNotFoundError) and error.filename:
            folder = Path(error.filename).parent
            what = f"file, there is none in {folder}" if folder.is_dir() else f"folder {folder}"
            fail(f"{error.filename}: expected a {what}; check the path")
        if isinstance(error, OSError):
            where = f"{error.filename}: " if error.filename else ""
            fail(f"{where}expected to be able to read and write here, {error.strerror}")
        if isinstance(error, UnicodeError):
            fail("expected UTF-8 in file names and files")
        raise
