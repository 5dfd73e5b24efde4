"""`forceaxis axis params`: parameters of an axis as a file, and the parameter store of the axis."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.cli.axis import axis
from forceaxis.cli.common import File, Verbs, aligned, as_json, print_json, print_result
from forceaxis.cli.live_options import AxisConnection, connected, live, owned
from forceaxis.results import to_json

if TYPE_CHECKING:
    from forceaxis.axis.parameter_set import DifferenceShown

skipping = click.option(
    "--skip", multiple=True, metavar="NAME", help="Leave out this object of the file. Repeatable."
)
with_measured = click.option(
    "--measured", is_flag=True, help="Include the table [measured]: tare and calibration points."
)
FILE = click.argument("file", type=click.Path(dir_okay=False, exists=True))


@axis.group(
    cls=Verbs,
    epilog="""forceaxis axis params dump axis1.toml --on lcm:1
    forceaxis axis params load axis1.toml --on lcm:2 --dry-run
    forceaxis axis params load out/law/bank.toml --on can0
    forceaxis axis params store --on can0""",
)
def params() -> None:
    """Write the parameters of an axis to a TOML file, compare an axis with a file, load a file,
    store the parameters in the axis, or delete the stored parameters.

    A parameter is an object that the axis can store. A file never contains node id and bit rate.
    Tare and calibration points belong to one sensor. They are loaded and compared only with
    --measured.
    """


@params.command(
    epilog="""forceaxis axis params dump axis1.toml --on lcm:1
    forceaxis axis params dump --all --on can0:3 > axis3.toml"""
)
@click.argument("file", type=File(), required=False)
@click.option("--all", "everything", is_flag=True, help="Include default values.")
@live
@as_json
def dump(connection: AxisConnection, file: Path | None, everything: bool, as_json: bool) -> None:
    """Write all parameters of the axis that differ from their default values to FILE, or print
    these parameters if FILE is missing.

    FILE also contains type, scale, unit and range of each value, so that a later version can name
    what it cannot load. Over Modbus, FILE has only the objects with a register. Through a gateway,
    FILE lacks the TPDOs and heartbeats that the gateway sets up. The key `without` names what is
    missing. --json prints {"file", "parameters": {name: value}}.
    """
    from forceaxis.axis import parameter_set

    with connected(connection) as found:
        text = parameter_set.dump(found, everything)
    if file is not None:
        paths.replace_text(file, text)
    if as_json:
        from forceaxis import toml

        tables = toml.read_text(text)
        values = {n: v for part, t in tables.items() if part not in ("about", "objects")
                  for n, v in t.items()}  # fmt: skip
        print_json({"file": file and str(file), "parameters": values})
    elif file is not None:
        click.echo(paths.display(file))
    else:
        click.echo(text, nl=False)


@params.command(epilog="forceaxis axis params diff axis1.toml --on lcm:2")
@FILE
@skipping
@with_measured
@live
@as_json
def diff(
    connection: AxisConnection, file: str, skip: Sequence[str], measured: bool, as_json: bool
) -> None:
    """Compare the parameters of the axis with FILE. For each parameter that differs, print the
    value in the axis, the value in FILE and the unit.

    A parameter that a dump does not contain is compared with its default. The exit status is 1 if
    a value differs.
    --json: {"differences": [{"name", "axis", "file", "unit"}]}.
    """
    from forceaxis.axis import parameter_set

    with connected(connection) as found:
        rows = [d.shown() for d in parameter_set.differences(found, file, skip, measured)]
    if as_json:
        print_json({"differences": rows})
    else:
        for line in table(rows):
            click.echo(line)
    sys.exit(1 if rows else 0)


@params.command(
    epilog="""forceaxis axis params load axis1.toml --on lcm:2 --dry-run
    forceaxis axis params load out/law/bank.toml --on can0:1"""
)
@FILE
@click.option("--dry-run", is_flag=True, help="Print the changes, write nothing.")
@skipping
@with_measured
@live
@as_json
def load(
    connection: AxisConnection,
    file: str,
    dry_run: bool,
    skip: Sequence[str],
    measured: bool,
    as_json: bool,
) -> None:
    """Write the values of FILE to the parameters of a disabled axis. If one value cannot be
    written, none of the parameters changes.

    FILE is a dump or the bank.toml of `forceaxis design`. With a dump, parameters that are not in
    FILE get their defaults. With a bank, nothing else changes. If a value does not match the object
    table of the axis, the command names the value and writes nothing. If the axis refuses a value,
    all earlier values are written back. The values are active at once. `params store` keeps them
    over a power cut. --json: {"dry_run", "changes": [{"name", "axis", "file", "unit"}],
    "unchanged": n, "bank": {...}, "managed": [names that the gateway sets itself and that are left
    out]}.
    """
    from forceaxis.axis import parameter_set

    with connected(connection) if dry_run else owned(connection) as found:
        loaded = parameter_set.load(found, file, skip, measured, dry_run)
    rows = [change.shown() for change in loaded.changed]
    same = loaded.concerned - len(rows)
    if as_json:
        print_json({"dry_run": dry_run, "changes": rows, "unchanged": same, "bank": loaded.bank,
                    "managed": loaded.managed})  # fmt: skip
        return
    for line in table(rows):
        click.echo(line)
    done = "would be written" if dry_run else "written"
    click.echo(f"{len(rows)} parameters {done}, {same} have their values")
    if loaded.managed:
        click.echo(f"left to the gateway: {', '.join(loaded.managed)}")
    bank = to_json(loaded.bank)
    if bank and not dry_run:
        states = [f"{key.removesuffix('_state')} {value}" for key, value in bank.items()]
        click.echo(", ".join(states).replace("_", " "))


@params.command(epilog="forceaxis axis params store --on lcm:1")
@live
@as_json
def store(connection: AxisConnection, as_json: bool) -> None:
    """Store all parameters of the axis in its non-volatile memory, so that the axis keeps the
    parameters when the power is off.

    The axis is disabled while it stores. If storing fails, the exit status is 1 and the parameter
    set that was stored before remains valid.
    """
    from forceaxis.axis import parameter_set

    with owned(connection) as found:
        parameter_set.store(found)
        where = found.link.where
    print_result({"store_state": "saved"}, as_json, lambda: f"{where}: stored")


@params.command(epilog="forceaxis axis params restore --on lcm:1 --yes")
@click.option("--yes", is_flag=True, help="Do not ask for consent.")
@live
@as_json
def restore(connection: AxisConnection, yes: bool, as_json: bool) -> None:
    """Delete the parameters that are stored in the axis. After the next power-up the axis has the
    default values.

    The defaults also become active with a reset of the node (NMT). Before that nothing changes, and
    `params store` cancels the deletion. The stored node id is deleted too.
    """
    from forceaxis.axis import parameter_set

    if not yes:
        if not sys.stdin.isatty():
            raise InputError(
                "params restore: expected the option --yes, because the command cannot ask for "
                "consent without a terminal"
            )
        click.confirm("Delete all parameters that the axis has stored?", abort=True)
    with owned(connection) as found:
        parameter_set.restore(found)
        where = found.link.where
    text = f"{where}: defaults become active at its next power-up or reset of the node"
    print_result({"store_state": "restored"}, as_json, lambda: text)


def table(rows: Sequence[DifferenceShown]) -> list[str]:
    """Return a table of all parameters whose values in axis and file differ, as text lines. The
    first text line is the heading. If no parameter differs, return no text line."""
    cells = [
        ["" if value == "1" else str(value) for value in (row.name, row.axis, row.file, row.unit)]
        for row in rows
    ]
    return aligned([["name", "axis", "file", "unit"], *cells], range(4)) if rows else []
