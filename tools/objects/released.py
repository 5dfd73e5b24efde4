"""The stored objects of released tables whose sets do not describe themselves: version 0.1.0's.

A frozen file: nothing writes it. Later versions store each value with its signature and default.
"""

import csv
from typing import NamedTuple

from objects.meaning import signature

FILE = "released/0.1.0.csv"  # in the folder of the table


class Released(NamedTuple):
    """A stored object of a released table."""

    name: str
    facts: dict  # values from which its signature is computed
    default: int

    def fits(self, today):
        """Whether a stored value means the same under today's object: its range may have grown."""
        grown = today["min"] <= self.facts["min"] and self.facts["max"] <= today["max"]
        limits = {"min": today["min"], "max": today["max"]}
        return grown and signature({**self.facts, **limits}) == signature(today)


class Release(NamedTuple):
    digest: str  # eight digits, as in the parameter sets that it stored
    objects: dict  # {(index, sub-index): Released}


def load_release(path):
    """The frozen table; raises OSError."""
    with path.open(encoding="utf-8", newline="") as file:
        digest = file.readline().split()[-1]
        objects = {}
        for row in csv.DictReader(file):
            o = {
                "type": row["type"],
                "unit": row["unit"],
                "scale": float(row["scale"]),
                "min": int(row["min"]),
                "max": int(row["max"]),
                "node_id": row["node_id"] == "1",
                "enum": row["enum"].split(";") if row["enum"] else [],
                "values": [],
            }
            address = int(row["index"], 16), int(row["sub"])
            objects[address] = Released(row["name"], o, int(row["default"]))
    return Release(digest, objects)
