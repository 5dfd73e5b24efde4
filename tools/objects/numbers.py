"""The order of the object numbers: a name a line. It is read again, so that a new object gets the
next number wherever it stands in the table. Two branches that each add an object conflict here:
keep the lines of both, and generate again."""

from objects.table import NUMBERS, TABLE


def generate(table):
    """{path below the root: text}"""
    names = [o["name"] for o in sorted(table.entries, key=lambda o: o["number"])]
    return {TABLE.rpartition("/")[0] + f"/{NUMBERS}": "".join(f"{name}\n" for name in names)}
