"""The Modbus map: a table to read and one to load."""

import csv
import io

from objects.manual import GENERATED_MARKDOWN, limits, markdown_table, range_text, values_text
from objects.table import describe_unit, expand, register, register_width

CSV = "firmware/objects/generated/forceaxis-modbus.csv"
PAGE = "docs/objects/modbus.md"

COLUMNS = (
    "space",
    "address",
    "registers",
    "name",
    "type",
    "unit",
    "scale",
    "min",
    "max",
    "access",
    "writable",
    "in_cycle",
    "meaning",
    "values",
)
INTRO = """\
The map of the RTU server in the firmware and of the TCP server at the gateway; the unit id is the
axis. Addresses are those on the wire and begin at 0 (`mbpoll` counts from 1 unless told `-0`).

* Functions, alike on both: 1, 2 read coils and discrete inputs; 3, 4 read holding and input
  registers; 5, 15 write coils; 6, 16 write registers; 22 mask write; 23 write, then read; 8
  diagnostics (0 echo, 10 to 18 counters); 17 server id; 43/14 device identification.
* On TCP unit 255, or 0, is the gateway itself: functions 8, 17 and 43/14, exception 1 to any other.
* A 32-bit object takes two registers, the higher half first unless `modbus_word_order` says
  otherwise. One half can be read, since masters cut long reads wherever 125 registers end; but the
  halves of two requests may be of two values: read both with one. A write to one half is exception
  3. Negative values are two's complement over the object's registers; an 8-bit one is extended to
  16 bits.
* Engineering value = raw value x unit. One request sees the values of one tick on RTU; at the
  gateway each object is of a tick of its own.
* Exceptions: 1 function, 2 no such register or bit, 3 value out of range, a write to half of a
  32-bit object or a malformed request, 4 not in this state, or another bus owns the axis
  (`command_source`), or no memory for parameters, 6 the store is at work; on TCP also 10 no axis of
  this unit, 11 the axis does not answer. A refused request changes nothing.
* Written "not in a cycle": a change of the value while a cycle runs is exception 4. "Ends a part":
  it acts at once, and the part is bad with the outcome `changed`.
* Read `object_table_hash` before you write: its value is {digest} if the firmware has this table.

"""


def rows(table, holding):
    found = [
        (register(o, i), name, o, i)
        for _, name, o, i in expand(table.entries)
        if o["modbus"] is not None and (o["access"] == "rw") == holding
    ]
    return sorted(found, key=lambda row: row[0])


def generate_csv(table):
    out = io.StringIO()
    sheet = csv.writer(out, lineterminator="\n")
    sheet.writerow(COLUMNS)
    for space, bits, access in (("coil", table.coils, "rw"), ("discrete", table.discretes, "ro")):
        for b in bits:
            fixed = ["bit", "1", 1, 0, 1, access, "any", "free", b["meaning"], ""]
            sheet.writerow([space, b["address"], 1, b["name"], *fixed])
    for space in ("holding", "input"):
        for address, name, o, _ in rows(table, space == "holding"):
            sheet.writerow(
                [
                    *(space, address, register_width(o), name, o["type"], o["unit"]),
                    *(repr(float(o["scale"])), o["min"], o["max"], o["access"], o["writable"]),
                    o["in_cycle"] if o["access"] != "ro" else "",
                    *(o["meaning"], values_text(o, ";")),
                ]
            )
    return out.getvalue()


def register_table(table, holding):
    header = ("address", "name", "type", "unit", "range")
    header += ("written", "meaning") if holding else ("meaning",)
    lines = []
    for address, name, o, _ in rows(table, holding):
        last = address + register_width(o) - 1
        span = f"{address:#06x}" + (f"-{last:04x}" if last > address else "")
        unit = "" if describe_unit(o) in ("1", "enum") else describe_unit(o)
        texts = values_text(o, ", ")
        meaning = o["meaning"] + (f": {texts}" if texts else "")
        cells = (span, f"`{name}`", o["type"], unit, range_text(o))
        lines.append((*cells, limits(o), meaning) if holding else (*cells, meaning))
    return markdown_table(header, lines)


def bit_table(bits):
    lines = [(str(b["address"]), f"`{b['name']}`", b["meaning"]) for b in bits]
    return markdown_table(("address", "name", "meaning"), lines)


def generate_page(table):
    out = [GENERATED_MARKDOWN, "# Modbus map\n\n", INTRO.format(digest=f"0x{table.digest[:8]}")]
    for heading, text in (
        ("Holding registers (functions 3, 6, 16)", register_table(table, True)),
        ("Input registers (function 4)", register_table(table, False)),
        ("Coils (functions 1, 5, 15)", bit_table(table.coils)),
        ("Discrete inputs (function 2)", bit_table(table.discretes)),
    ):
        out.append(f"## {heading}\n\n{text}\n")
    return "".join(out).rstrip("\n") + "\n"


def generate(table):
    """{path below the root: text}"""
    return {CSV: generate_csv(table), PAGE: generate_page(table)}
