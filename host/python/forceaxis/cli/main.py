"""The command line. Exit status: 0 done, 1 the run or check failed, 2 wrong usage or input."""

import importlib
import os
import pkgutil
import subprocess
import sys
from pathlib import Path

# Matrices here are small: threads of a BLAS that wait for each other cost fifty times the work
# where the cores are busy. Read when NumPy loads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import click

import forceaxis.cli
from forceaxis import versions
from forceaxis._core import InputError, SimulationError
from forceaxis.axis.link import NoAnswer, Refused
from forceaxis.chip import flash
from forceaxis.cli.common import fail
from forceaxis.commission.refusal import Refusal
from forceaxis.experiments import link
from forceaxis.thesis import tables


def show_versions(context, _parameter, wanted):
    if wanted:
        for what, version in versions.rows():
            click.echo(f"{what:<24}{version}")
        context.exit()


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=show_versions,
    help="Show the versions of firmware, object table, LCM types and files, and exit.",
)
def cli():
    """Firmware for force-controlled axes around an exact plant: run it before you flash it."""


# Every module beside this one lists its verbs.
for found in pkgutil.iter_modules(forceaxis.cli.__path__):
    for verb in getattr(importlib.import_module(f"forceaxis.cli.{found.name}"), "VERBS", ()):
        cli.add_command(verb)


def main():
    """Entry point: every mistake of the user is one line on standard error and exit status 2."""
    try:
        for text in sys.argv:
            text.encode()  # what is not UTF-8 is refused before anything sees it
        cli(standalone_mode=False)
    except InputError as error:
        fail(str(error))
    except (SimulationError, link.LinkError, flash.FlashError, NoAnswer, Refused, Refusal) as error:
        fail(str(error), status=1)
    except subprocess.TimeoutExpired as error:
        program = error.cmd if isinstance(error.cmd, str) else error.cmd[0]
        fail(f"{Path(program).name}: expected it to end within {error.timeout:g} s", status=1)
    except click.exceptions.Abort:
        sys.exit(130)
    except click.ClickException as error:
        fail(error.format_message())
    except tables.StaleFit as error:
        fail(str(error), status=1)
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        fail(f"{where}expected to be able to read and write here, {error.strerror}")
    except UnicodeError:
        fail("expected UTF-8 in file names and files")
