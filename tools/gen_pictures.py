#!/usr/bin/env python3
"""Draw the pictures of the design pages.

usage: gen_pictures.py [--check] [--root DIR]

Writes docs/design/NAME.svg from docs/design/NAME.dot with the program dot of Graphviz, so that a
page shows its picture in a checkout and on a forge.

--check writes nothing and ends with status 1 when a picture is not up to date. Versions of Graphviz
place the same boxes differently, so the check compares boxes, arrows, texts and colours, not
coordinates.
"""

import argparse
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

FOLDER = "docs/design"
# Attributes that depend on the place of an element and on the version of Graphviz.
PLACES = {"id", "transform", "points", "d", "x", "y", "cx", "cy", "rx", "ry", "text-anchor"}


def drawn(source):
    """The SVG of a Graphviz file, without the name of the version."""
    done = subprocess.run(["dot", "-Tsvg", source], capture_output=True, text=True, check=False)
    if done.returncode or done.stderr:
        sys.exit(fail(f"{source}: expected a text that dot accepts: {done.stderr.strip()}"))
    return re.sub(r"<!--.*?-->\n?", "", done.stdout, flags=re.DOTALL)


def structure(svg):
    """Boxes, arrows and clusters of a picture with texts and colours, in the order of their titles,
    or None for a text that is no SVG."""
    try:
        groups = ET.fromstring(svg).findall(".//{*}g")
    except ET.ParseError:
        return None
    same = {"none": "transparent"}  # two versions name no line so
    found = []
    for group in groups:
        parts = [
            (
                child.tag.rpartition("}")[2],
                sorted((k, same.get(v, v)) for k, v in child.attrib.items() if k not in PLACES),
                (child.text or "").strip(),
            )
            for child in group
            if not child.tag.endswith("}g")
        ]
        found.append((group.get("class"), parts))
    return sorted(found, key=repr)


def fail(message):
    print(f"gen_pictures: {message}", file=sys.stderr)
    return 2


def main():
    parser = argparse.ArgumentParser(description="draw the pictures of the design pages")
    parser.add_argument("--check", action="store_true", help="write nothing, status 1 when stale")
    parser.add_argument("--root", type=Path, default=Path(__file__).resolve().parents[1])
    args = parser.parse_args()
    folder = args.root / FOLDER
    pictures = {p.with_suffix(".svg"): drawn(p) for p in sorted(folder.glob("*.dot"))}
    there = {p: p.read_text() for p in folder.glob("*.svg")}
    stale = sorted(
        path.name
        for path in pictures.keys() | there.keys()
        if path not in pictures
        or path not in there
        or structure(there[path]) != structure(pictures[path])
    )
    if args.check:
        for name in stale:
            print(f"gen_pictures: {FOLDER}/{name} is stale: run tools/gen_pictures.py")
        return 1 if stale else 0
    for path in there.keys() - pictures.keys():
        path.unlink()
    for path, text in pictures.items():
        if path.name in stale:
            path.write_text(text)
    print(f"gen_pictures: {len(pictures)} pictures, {len(stale)} written")
    return 0


if __name__ == "__main__":
    sys.exit(main())
