"""Shared by verbs: the form of their help, options, errors."""

import contextlib
import os
import shutil
import sys
import textwrap
import threading
import time
from pathlib import Path

import click

from forceaxis.experiments import link


class Verb(click.Command):
    """A verb whose help keeps the example's line breaks."""

    def format_epilog(self, ctx, formatter):
        if self.epilog:
            formatter.write_paragraph()
            formatter.write("Example:\n")
            for line in self.epilog.strip().splitlines():
                formatter.write(f"  {line.strip()}\n")


class Verbs(click.Group):
    """A verb that has verbs of its own."""

    command_class = Verb
    format_epilog = Verb.format_epilog


class Folder(click.Path):
    """A folder to write to; the writer creates it."""

    def __init__(self):
        super().__init__(file_okay=False, path_type=Path)

    def convert(self, value, param, ctx):
        if value == "":
            self.fail("expected the name of a folder", param, ctx)
        return super().convert(value, param, ctx)


class Positive(click.ParamType):
    """A number from `low` to `high`, which are above 0."""

    name = "float"

    def __init__(self, low=1e-6, high=1e6):
        self.low, self.high = low, high

    def convert(self, value, param, ctx):
        try:
            number = float(value)
        except ValueError:
            number = float("nan")
        if not self.low <= number <= self.high:
            text = f"expected a number from {self.low:g} to {self.high:g}, got {value}"
            self.fail(text, param, ctx)
        return number


class File(click.Path):
    """A file to write."""

    def __init__(self):
        super().__init__(dir_okay=False, path_type=Path)


as_json = click.option("--json", "as_json", is_flag=True, help="Print one JSON object, only that.")
threads = click.option(
    "--threads", type=click.IntRange(1, 256), default=None, help="Default: one per core."
)


def linked(command):
    """The options of a verb that can run the firmware as another process."""
    for option in (
        click.option("--inject", default="", hidden=True, help="For tests: faults of the link."),
        click.option("--link-can", default="vcan1", show_default=True, help="CAN interface."),
        click.option("--lcm-url", default="", help="Default: a port of the run's own."),
        click.option(
            "--link",
            "kind",
            type=click.Choice(link.KINDS),
            help="Run the firmware as a process of its own, in lock-step over this; inproc: as "
            "usual, but both sides hash the trace; pil-stm32: the image on an emulated chip. Where "
            "the kernel has no CAN, socketcan runs in a guest (tools/vcan).",
        ),
    ):
        command = option(command)
    return command


def link_of(kind, lcm_url, link_can, inject):
    """The Link of the options, or None; may restart the command in a guest that has CAN."""
    if kind is None:
        return None
    over = link.Link(kind, lcm_url, link_can, inject)
    link.under_vcan(over)
    return over


COLOURS = {
    **dict.fromkeys(("stable", "passed"), "green"),
    **dict.fromkeys(("unstable", "failed", "error"), "red"),
    "updated": "yellow",
}


def coloured(text, word=None):
    """A text in the colour of the outcome that it, or `word`, is; plain under NO_COLOR. click.echo
    takes colours out where standard output is no terminal."""
    colour = COLOURS.get((word or text).strip())
    plain = os.environ.get("NO_COLOR") or not colour
    return text if plain else click.style(text, fg=colour, bold=True)


def show(rows):
    """Print (key, text) rows; on a terminal within its width, the verdict in its colour."""
    indent = " " * 13
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else 0
    for key, text in rows:
        line = f"{key:12} {text}"
        if width and key not in ("trace hash", "axis hash", "again", "files"):  # are copied whole
            line = textwrap.fill(line, max(width, 40), subsequent_indent=indent,
                                 break_on_hyphens=False, break_long_words=False)  # fmt: skip
        if key == "verdict":
            word = text.partition(":")[0]
            line = line.replace(word, coloured(word), 1)
        click.echo(line)


@contextlib.contextmanager
def waiting(what):
    """On a terminal, say after two seconds what is under way and for how long it has been."""
    if not sys.stderr.isatty():
        yield
        return
    over, began = threading.Event(), time.monotonic()

    def report():
        pause = 2.0
        while not over.wait(pause):
            pause = 0.5
            sys.stderr.write(f"\r\x1b[2K{what}, {time.monotonic() - began:.0f} s")
            sys.stderr.flush()

    thread = threading.Thread(target=report, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
        if time.monotonic() - began > 2:
            sys.stderr.write("\r\x1b[2K")
            sys.stderr.flush()


def fail(message, status=2):
    """Print one line on standard error and exit."""
    click.echo("forceaxis: " + " ".join(message.split()), err=True)
    sys.exit(status)
