#!/usr/bin/env python3
"""Generate the files of firmware, host and third-party tools from the table of objects.

usage: gen_objects.py [--check] [--root DIR]

Reads firmware/objects/axis_objects.toml, and what 0.1.0 stored in released/ beside it, and writes
  firmware/objects/numbers.txt                     the order of the numbers; new objects at the end
  firmware/objects/generated/axis_table.h          types of the tables, results of accesses
  firmware/objects/generated/axis_objects_*.h      numbers, structures, enums of one part
  firmware/objects/generated/axis_objects.h        all parts, number of objects, hashes
  firmware/objects/generated/axis_objects.c        descriptor tables: no strings, no float
  firmware/objects/generated/axis_objects_meta.h   host, Python: names, units, scales, texts, hash
  firmware/objects/generated/axis_gateway.h        host: how a gateway configures an axis
  firmware/objects/generated/forceaxis.eds         for CANopen masters, CiA 306
  firmware/objects/generated/forceaxis.dbc         the frames of nodes 1 to 6
  firmware/objects/generated/forceaxis-gateway.*   DBC of a bus with a gateway, DCF of an axis
  firmware/objects/generated/forceaxis-bus.yml     a bus with one axis, for ros2_canopen
  firmware/objects/generated/forceaxis-modbus.csv  registers and bits
  docs/objects/                                    the manual's pages

--check writes nothing and ends with status 1 when a file is not up to date.
A bad table ends with status 2 and one line: file, object, key, what was expected.
"""

import argparse
import sys
from pathlib import Path

from objects import c, dbc, eds, manual, modbus, numbers, ros2
from objects.table import TABLE, TableError, load_table


def generate(root):
    """{path below the root: text} of every generated file."""
    table = load_table(root / TABLE)
    files = numbers.generate(table)
    for output in (c, eds, dbc, ros2, modbus, manual):
        files |= output.generate(table)
    return files


def main(argv=None):
    parser = argparse.ArgumentParser(description="generate what the object table describes")
    parser.add_argument("--check", action="store_true", help="write nothing, status 1 when stale")
    parser.add_argument(
        "--root", type=Path, default=Path(__file__).resolve().parent.parent, help="project folder"
    )
    args = parser.parse_args(argv)
    try:
        files = generate(args.root)
    except TableError as error:
        print(f"{TABLE}: {error}", file=sys.stderr)
        return 2
    stale = [
        name
        for name, text in files.items()
        if not (args.root / name).is_file()
        or (args.root / name).read_text(encoding="utf-8") != text
    ]
    if args.check:
        for name in stale:
            print(f"{name}: stale, run tools/gen_objects.py", file=sys.stderr)
        return 1 if stale else 0
    for name in stale:
        (args.root / name).parent.mkdir(parents=True, exist_ok=True)
        (args.root / name).write_text(files[name], encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
