"""The manual's pages: every object, in Markdown and as a man page."""

from objects.meaning import value_texts
from objects.table import (
    PARTS,
    TABLE,
    TYPES,
    banner,
    canopen_address,
    describe_unit,
    register,
    register_width,
)

PAGE = "docs/objects/objects.md"
MAN = "docs/objects/forceaxis-objects.7"

GENERATED_MARKDOWN = banner(("<!-- ", " -->")) + "\n"
HEADINGS = {
    "axis": "Axis: modes, laws, limits, signals",
    "law": "Banks of the force law",
    "recorder": "Recorder",
    "drive": "Drive: CiA 402",
    "canopen": "CANopen communication: CiA 301",
    "device": "Device: source lock, store, identity, programs of cycles",
}
# What a change does while a cycle runs, in words; nothing where that is refused anyway, or free.
DURING = {"free": "", "ends": "ends a part", "refused": "not in a cycle"}
WHEN = {"any": "", "disabled": "while disabled", "recorder_idle": "while the recorder is idle"}
INTRO = """\
What the firmware knows by name, the same over every interface. {count} objects; the hash of what
the table means begins with `{digest}`.

* **address**: CANopen index:sub-index in hexadecimal, then the Modbus register: h holding, i input.
  The sub-index 0 of an index that has others reads the highest of them, where it is no object.
* **type** with the unit of one raw step; **range** and **default** are raw values x unit.
* **access**: rw, ro, wo; *s*: kept by the parameter store; *p*: a PDO may carry it; then when the
  object can be written: *while disabled* and so on, otherwise always. While a cycle runs, a write
  that changes an object with *not in a cycle* is refused; one that changes an object with *ends a
  part* acts at once and ends the cycle, and the part is bad with the outcome `changed`. `+id`: the
  node id is added to the default.
* An object written as `name_1..n` is n objects; their addresses follow each other.

"""


def values_text(o, separator):
    return separator.join(f"{value} {text}" for value, text in value_texts(o))


def engineering(o, value):
    return f"{value * float(o['scale']):.10g}"


def hexadecimal(o):
    """Bit fields: COB-IDs and mappings of CANopen."""
    return o["part"] == "canopen" and o["type"] == "u32"


def value_text(o, value):
    if hexadecimal(o):
        return f"{value:#x}"
    if o["enum"]:
        return o["enum"][value]
    return engineering(o, value)


def range_text(o):
    """The range; nothing if it follows from the type or the texts of the values."""
    if o["enum"] or (o["min"], o["max"]) == TYPES[o["type"]][1:3]:
        return ""
    if o["min"] == o["max"]:
        return value_text(o, o["min"])
    return f"{value_text(o, o['min'])} to {value_text(o, o['max'])}"


def default_text(o):
    """The default, or those of all elements where they differ."""
    if o["kind"] == "signal" and not any(o["defaults"]):
        return ""
    if o["access"] == "wo":
        return ""
    texts = [value_text(o, v) for v in o["defaults"]]
    if len(set(texts)) == 1:
        texts = texts[:1]
    elif o["per_index"] != o["count"]:
        # The mappings of one index are combined, without the unused ones.
        n = o["per_index"]
        rows = [texts[i : i + n] for i in range(0, len(texts), n)]
        unused = value_text(o, 0)
        texts = [" ".join(t for t in row if t != unused) or unused for row in rows]
    return ", ".join(texts) + (" +id" if o["node_id"] else "")


def limits(o):
    """The state in which a write is accepted, and what a change does to a cycle that runs; nothing:
    always, and nothing."""
    if o["access"] == "ro":
        return ""
    return WHEN[o["writable"]] or DURING[o["in_cycle"]]


def address_text(o):
    first, last = canopen_address(o, 0), canopen_address(o, o["count"] - 1)
    text = f"{first[0]:04x}:{first[1]:x}"
    if last != first:
        text += f" to {last[0]:04x}:{last[1]:x}"
    if o["modbus"] is not None:
        space = "h" if o["access"] == "rw" else "i"
        end = register(o, o["count"] - 1) + register_width(o) - 1
        text += f", {space} {o['modbus']:04x}" + (f"-{end:04x}" if end > o["modbus"] else "")
    return text


def name_text(o):
    return o["name"] if o["count"] == 1 else f"{o['name']}_1..{o['count']}"


def type_text(o):
    unit = describe_unit(o)
    if unit in ("1", "enum"):
        return o["type"]
    return f"{o['type']}, {unit}"


def access_text(o):
    flags = (" s" if o["stored"] else "") + ("", " p", " t")[o["mappable"]]
    when = limits(o)
    return o["access"] + flags + (f", {when}" if when else "")


def meaning_text(o):
    texts = values_text(o, ", ")
    return o["meaning"] + (f": {texts}" if texts else "")


def markdown_table(header, rows):
    lines = [header, ["---"] * len(header), *rows]
    return "".join("| " + " | ".join(cells) + " |\n" for cells in lines)


def of_part(table, part):
    return [o for o in table.entries if o["part"] == part]


def generate_page(table):
    count = sum(o["count"] for o in table.entries)
    out = [GENERATED_MARKDOWN, "# Objects\n\n"]
    out.append(INTRO.format(count=count, digest=table.digest[:8]))
    header = ("name", "address", "type", "range", "default", "access", "meaning")
    for part in PARTS:
        rows = [
            (
                f"`{name_text(o)}`",
                address_text(o),
                type_text(o),
                range_text(o),
                default_text(o),
                access_text(o),
                meaning_text(o),
            )
            for o in of_part(table, part)
        ]
        if rows:
            out.append(f"## {HEADINGS[part]}\n\n{markdown_table(header, rows)}\n")
    if rows := list(fault_rows(table)):
        out.append("## Faults and error codes\n\n")
        out.append(markdown_table(("name", "603Fh", "fault", "meaning"), rows) + "\n")
    if table.specials:
        rows = [
            (f"`{s['name']}`", special_address(s), special_type(s), s["meaning"])
            for s in table.specials
        ]
        out.append("## Texts and blocks of bytes\n\n")
        out.append(markdown_table(("name", "address", "type", "meaning"), rows))
    return "".join(out).rstrip("\n") + "\n"


def fault_rows(table):
    """Name, error code, number of the fault and sentence of each error code but that of none."""
    named = {o["name"]: o for o in table.entries}
    if not {"fault", "error_code"} <= set(named):
        return
    codes, faults = named["error_code"], named["fault"]["enum"]
    for code, text in codes["values"]:
        if code:
            number = str(faults.index(text)) if text in faults else ""
            yield f"`{text}`", f"{code:04X}h", number, codes["sentences"].get(text, "")


def special_address(s):
    return f"{s['index']:04x}:{s['sub']:x}"


def special_type(s):
    return s["type"].replace("_", " ") + (", write only" if s["access"] == "wo" else "")


def roff(text):
    """The text with roff's special characters escaped."""
    text = text.replace("\\", "\\e").replace("-", "\\-")
    return f"\\&{text}" if text[:1] in (".", "'") else text


def generate_man(table):
    out = [
        banner(('.\\" ', "")),
        '.TH FORCEAXIS\\-OBJECTS 7 2026\\-01\\-01 forceaxis "forceaxis manual"\n',
        ".SH NAME\nforceaxis\\-objects \\- objects of the axis firmware and their addresses\n",
        ".SH DESCRIPTION\n"
        "Each object has a name, an address in CANopen (index:sub\\-index, hexadecimal) and most\n"
        "a Modbus register (h holding, i input, hexadecimal).\n"
        "Ranges and defaults are engineering values: raw value times unit.\n"
        "s: kept by the parameter store.\n"
        "p: a PDO may carry it; t: a TPDO alone.\n"
        "not in a cycle, ends a part: what a change of the value does while a cycle runs.\n"
        "+id: the node id is added.\n"
        f"The hash of what the table means begins with {table.digest[:8]}.\n",
    ]
    for part in PARTS:
        objects = of_part(table, part)
        if not objects:
            continue
        out.append(f".SH {roff(HEADINGS[part].upper())}\n")
        for o in objects:
            facts = [address_text(o), type_text(o)]
            if range_text(o):
                facts.append(range_text(o))
            if default_text(o):
                facts.append(f"default {default_text(o)}")
            facts.append(access_text(o))
            out.append(f".TP\n.B {roff(name_text(o))}\n")
            out.append(f"{roff('; '.join(facts))}\n.br\n{roff(meaning_text(o))}\n")
    if table.specials:
        out.append(".SH TEXTS AND BLOCKS OF BYTES\n")
    for s in table.specials:
        out.append(f".TP\n.B {roff(s['name'])}\n{special_address(s)}; ")
        out.append(f"{roff(special_type(s))}\n.br\n{roff(s['meaning'])}\n")
    out.append(
        ".SH FILES\n.TP\n.I " + roff(TABLE) + "\nThe table that this page, the data sheet and the\n"
        "firmware's own dictionary are generated from.\n"
        ".SH SEE ALSO\n.B forceaxis objects \\-\\-help\n"
    )
    return "".join(out)


def generate(table):
    """{path below the root: text}"""
    return {PAGE: generate_page(table), MAN: generate_man(table)}
