"""`forceaxis axis params`: the parameters of a live axis as a file."""

import json
import sys

import click

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.cli.axis import axis
from forceaxis.cli.common import File, Verbs, as_json
from forceaxis.cli.live_options import connected, live, owned

skipping = click.option(
    "--skip", multiple=True, metavar="NAME", help="An object of the file to leave out. Repeatable."
)
with_measured = click.option(
    "--measured", is_flag=True, help="The table [measured] too: tare and points of a calibration."
)
FILE = click.argument("file", type=click.Path(dir_okay=False, exists=True))


@axis.group(
    cls=Verbs,
    epilog="""forceaxis axis params dump axis1.toml --axis 1
    forceaxis axis params load axis1.toml --axis 2 --dry-run
    forceaxis axis params load out/law/bank.toml --can can0
    forceaxis axis params store --can can0""",
)
def params():
    """Parameters of an axis as a TOML file: dump, diff, load; store, restore.

    A parameter is what the axis stores. Node id and bit rate are in no file; tare and points of a
    calibration, which belong to one sensor, are loaded and compared only with --measured.
    """


@params.command(
    epilog="""forceaxis axis params dump axis1.toml --axis 1
    forceaxis axis params dump --all --can can0 --node 3 > axis3.toml"""
)
@click.argument("file", type=File(), required=False)
@click.option("--all", "everything", is_flag=True, help="What is at its default too.")
@live
@as_json
def dump(file, everything, way, as_json):
    """Write the parameters that differ from their defaults to FILE, or print them.

    FILE also has what each value means (type, scale, unit, range), so that a later forceaxis can
    tell what it cannot load. Over Modbus a file has only what has a register, and by a gateway not
    the TPDOs and heartbeats that it sets up; `without` names them. --json prints {"file",
    "parameters": {name: value}} of those that FILE would have.
    """
    from forceaxis.axis import params as parameters

    with connected(way) as found:
        text = parameters.dump(found, everything)
    if file is not None:
        paths.replace_text(file, text)
    if as_json:
        from forceaxis import toml

        tables = toml.read_text(text)
        values = {n: v for part, t in tables.items() if part not in ("about", "objects")
                  for n, v in t.items()}  # fmt: skip
        click.echo(json.dumps({"file": file and str(file), "parameters": values}))
    elif file is not None:
        click.echo(paths.display(file))
    else:
        click.echo(text, nl=False)


@params.command(epilog="forceaxis axis params diff axis1.toml --axis 2")
@FILE
@skipping
@with_measured
@live
@as_json
def diff(file, skip, measured, way, as_json):
    """Show what the axis has otherwise than FILE: name, axis, file, unit.

    Exit status 1 where anything differs. What a dump does not name is compared with the defaults.
    --json: {"differences": [{"name", "axis", "file", "unit"}]}.
    """
    from forceaxis.axis import params as parameters

    with connected(way) as found:
        rows = [d.row() for d in parameters.differences(found, file, skip, measured)]
    if as_json:
        click.echo(json.dumps({"differences": rows}))
    else:
        for line in table(rows, ("name", "axis", "file", "unit")):
            click.echo(line)
    sys.exit(1 if rows else 0)


@params.command(
    epilog="""forceaxis axis params load axis1.toml --axis 2 --dry-run
    forceaxis axis params load out/law/bank.toml --can can0 --node 1"""
)
@FILE
@click.option("--dry-run", is_flag=True, help="Show what would be written, write nothing.")
@skipping
@with_measured
@live
@as_json
def load(file, dry_run, skip, measured, way, as_json):
    """Set the parameters of the axis, which is disabled, to those of FILE: all of them or none.

    FILE is one of `dump`, then what it does not name is set to its default; or the bank.toml of
    `forceaxis design`, then nothing else changes. What does not fit this object table is named and
    nothing is written; if the axis refuses a value, everything is put back. It is in force at once
    and kept by `params store`. --json: {"dry_run", "changes": [{"name", "axis", "file", "unit"}],
    "unchanged": n, "bank": {...}, "managed": [names that the gateway sets itself: left out]}.
    """
    from forceaxis.axis import params as parameters

    with connected(way) if dry_run else owned(way) as found:
        loaded = parameters.load(found, file, skip, measured, dry_run)
    rows = [change.row() for change in loaded.changed]
    same = loaded.concerned - len(rows)
    if as_json:
        result = {"dry_run": dry_run, "changes": rows, "unchanged": same, "bank": loaded.bank,
                  "managed": loaded.managed}  # fmt: skip
        click.echo(json.dumps(result))
        return
    for line in table(rows, ("name", "axis", "file", "unit")):
        click.echo(line)
    done = "would be written" if dry_run else "written"
    click.echo(f"{len(rows)} parameters {done}, {same} have their values")
    if loaded.managed:
        click.echo(f"left to the gateway: {', '.join(loaded.managed)}")
    if loaded.bank and not dry_run:
        states = [f"{key.removesuffix('_state')} {value}" for key, value in loaded.bank.items()]
        click.echo(", ".join(states).replace("_", " "))


@params.command(epilog="forceaxis axis params store --axis 1")
@live
@as_json
def store(way, as_json):
    """Keep all parameters of the axis over a power cut; waits until they are stored.

    The axis is disabled meanwhile. Exit status 1 where the store fails: the set before it counts.
    """
    from forceaxis.axis import params as parameters

    with owned(way) as found:
        parameters.store(found)
        where = found.link.where
    click.echo(json.dumps({"store_state": "saved"}) if as_json else f"{where}: stored")


@params.command(epilog="forceaxis axis params restore --axis 1 --yes")
@click.option("--yes", is_flag=True, help="Do not ask.")
@live
@as_json
def restore(yes, way, as_json):
    """Forget what is stored: the axis has its defaults from the next power-up on.

    A reset of the node (NMT) does the same. Until then nothing changes, and `params store` takes it
    back. The node id is forgotten too.
    """
    from forceaxis.axis import params as parameters

    if not yes:
        if not sys.stdin.isatty():
            raise InputError("params restore: expected --yes where nobody can be asked")
        click.confirm("Forget all parameters that the axis has stored?", abort=True)
    with owned(way) as found:
        parameters.restore(found)
        where = found.link.where
    if as_json:
        click.echo(json.dumps({"store_state": "restored"}))
    else:
        click.echo(f"{where}: defaults are in force after its next power-up or reset of the node")


def table(rows, columns):
    """Lines of {column: value} rows under their names; none where there are no rows."""
    if not rows:
        return
    cells = [
        list(columns),
        *([str(row[c]) if row[c] != "1" else "" for c in columns] for row in rows),
    ]
    widths = [max(len(line[i]) for line in cells) for i in range(len(columns))]
    for line in cells:
        yield "  ".join(f"{c:<{w}}" for c, w in zip(line, widths, strict=True)).rstrip()
