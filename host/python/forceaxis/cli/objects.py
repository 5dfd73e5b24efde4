"""`forceaxis objects`: list the objects of the firmware, and write files that describe these
objects."""

import shutil
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

import click

from forceaxis import objects, paths
from forceaxis.cli.common import Callback, File, Verb, as_json, print_json, print_result
from forceaxis.words import suggestion

DETAIL_COLUMNS = 80
FILES = {
    "eds": ("forceaxis.eds", "CANopen data sheet (CiA 306)"),
    "dbc": ("forceaxis.dbc", "frames of nodes 1 to 6 with their default PDOs, as a DBC"),
    "gateway_dbc": ("forceaxis-gateway.dbc", "frames of nodes 1 to 6 behind a gateway, as a DBC"),
    "gateway_dcf": ("forceaxis-gateway.dcf", "configuration of an axis behind a gateway (DCF)"),
    "ros2": ("forceaxis-bus.yml", "bus description of ros2_canopen, with one axis, as YAML"),
    "modbus": ("forceaxis-modbus.csv", "Modbus registers and bits, CSV"),
}
FILE_OPTIONS = [f"--{kind.replace('_', '-')}" for kind in FILES]


def file_options(verb: Callback) -> Callback:
    """Add options to the command `objects`, one for each kind of file that can describe the
    objects."""
    for name, (_, content) in reversed(list(zip(FILE_OPTIONS, FILES.values(), strict=True))):
        option = click.option(name, type=File(), metavar="FILE", help=f"Write the {content}.")
        verb = option(verb)
    return verb


def addresses(o: objects.AxisObject) -> tuple[str, str]:
    """Return the CANopen address and the Modbus register of an object, as two texts. The register
    is an empty text if the object has none."""
    space = "h" if o.access == "rw" else "i"
    return f"{o.index:04x}:{o.sub:x}", f"{space} {o.modbus:04x}" if o.modbus >= 0 else ""


def span(o: objects.AxisObject) -> str:
    unit = "" if o.unit == "1" else f" {o.unit}"
    low, high = (f"{v * o.scale:.12g}" for v in (o.min, o.max))
    return ", ".join(o.enum) or f"{low} to {high}{unit}"


def writable(o: objects.AxisObject) -> str:
    return {"any": "", "disabled": "; written only while disabled"}.get(
        o.writable, "; written only while the recorder is idle"
    )


def in_cycle(o: objects.AxisObject) -> str:
    if o.access == "ro" or o.writable == "disabled":
        return ""
    return {"ends": "a change acts at once and ends the part", "refused": "no change"}.get(
        o.in_cycle, ""
    )


def line(o: objects.AxisObject) -> str:
    canopen, modbus = addresses(o)
    text = f"{o.meaning} [{span(o)}{writable(o)}]"
    whole = f"{o.name:26} {canopen:7} {modbus:6} {o.access:3} {text}"
    # Without a terminal, each object is printed on one text line for other programs.
    if not sys.stdout.isatty():
        return whole
    width = max(60, shutil.get_terminal_size().columns)
    return textwrap.fill(whole, width, subsequent_indent=" " * 28, break_on_hyphens=False)


def details(o: objects.AxisObject) -> Iterator[str]:
    """Yield the text lines about one object: its meaning, addresses, type, range, default value,
    access, named values, storage, and PDOs that may contain it."""
    yield from textwrap.wrap(f"{o.name}: {o.meaning}", DETAIL_COLUMNS, subsequent_indent="  ")
    size = 32 if o.type.endswith("32") else 16
    registers = f"{o.modbus:#06x}" + (f" and {o.modbus + 1:#06x}" if size == 32 else "")
    space = "holding" if o.access == "rw" else "input"
    default = o.enum[o.default] if o.enum else f"{o.default * o.scale:g}"
    rows = (
        ("CANopen", f"{o.index:04X}h, sub-index {o.sub}: {o.title}"),
        ("Modbus", f"{space} register {registers}" if o.modbus >= 0 else "not reached"),
        ("type", f"{o.type}, raw value x {o.scale:g}" + ("" if o.unit == "1" else f" {o.unit}")),
        ("range", span(o) + (f" (raw {o.min} to {o.max})" if o.scale != 1 else "")),
        ("default", default + (" + node id" if o.node_id else "")),
        ("access", o.access + writable(o)),
        ("in cycle", in_cycle(o)),
        ("values", ", ".join(f"{v} {t}" for v, t in (*enumerate(o.enum), *o.values))),
        ("stored", "kept by the parameter store" if o.stored else ""),
        ("PDO", ("", "may be mapped", "may be sent")[o.mappable]),
    )
    for key, text in rows:
        if text:
            yield from textwrap.wrap(
                f"  {key:8} {text}", DETAIL_COLUMNS, subsequent_indent=" " * 11
            )


@click.command(
    name="objects",
    cls=Verb,
    epilog="forceaxis objects force\nforceaxis objects force_gain\n"
    "forceaxis objects --eds forceaxis.eds --dbc forceaxis.dbc\n"
    "forceaxis objects --eds forceaxis.eds --ros2 forceaxis-bus.yml",
)
@click.argument("pattern", default="")
@file_options
@as_json
def objects_(pattern: str, as_json: bool, **files: Path | None) -> None:
    """List the objects of the firmware (parameters, commands and signals), or write files that
    describe the objects for other programs.

    The list has name, CANopen index:sub-index and Modbus register (h holding, i input) in
    hexadecimal, access, meaning and range. PATTERN selects objects by a part of their name. With
    the full name of an object, the command prints all its properties. `--set firmware.NAME` and the
    table [firmware] of an experiment accept these names.

    A value is a number in the unit of the object, or a quantity that the model converts to it:
    "75 N", "12 mm/s", "0.5 V", "40 Hz", "2 ms", "400 kN/m", with the prefixes n u m c k M."""
    wanted = {kind: path for kind, path in files.items() if path}
    if wanted and pattern:
        raise click.UsageError(
            f"{pattern}: expected no pattern together with {', '.join(FILE_OPTIONS)}, because "
            "these files describe all objects"
        )
    if len({path.resolve() for path in wanted.values()}) < len(wanted):
        raise click.UsageError(
            f"{', '.join(FILE_OPTIONS)}: expected a different file for each option, got the same "
            "file twice"
        )
    for kind, path in wanted.items():
        shutil.copyfile(paths.OBJECT_FILES / FILES[kind][0], path)
    if wanted:
        print_result(
            {"objects_hash": objects.OBJECTS_HASH, "written": wanted},
            as_json,
            lambda: "\n".join(map(paths.display, wanted.values())),
        )
        return
    rows = [o for o in objects.OBJECTS if pattern in o.name]
    if not rows:
        hint = suggestion(pattern, objects.BY_NAME)
        raise click.UsageError(
            f"{pattern}: expected a part of the name of an object, got no match{hint}"
        )
    if as_json:
        print_json(rows)
        return
    if exact := objects.BY_NAME.get(pattern):
        for text in details(exact):
            click.echo(text)
        rows.remove(exact)
    for o in rows:
        click.echo(line(o))


VERBS = (objects_,)
