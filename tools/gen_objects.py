#!/usr/bin/env python3
"""Generate the C object dictionary, its host metadata and the Python constants from one table.

usage: gen_objects.py [--check] [--root DIR]

Reads firmware/objects/axis_objects.toml and writes
  firmware/objects/generated/axis_objects.h       object numbers, structures, enums
  firmware/objects/generated/axis_objects.c       descriptor table: no strings, no float
  firmware/objects/generated/axis_objects_meta.h  host only: names, units, scales, texts, hash
  host/python/forceaxis/objects.py                the same for Python

--check writes nothing and ends with status 1 when a file is not what the table gives.
A bad table ends with status 2 and one line: file, object, key, what was expected.
"""

import argparse
import hashlib
import itertools
import json
import re
import sys
import tomllib
from pathlib import Path

TABLE = "firmware/objects/axis_objects.toml"
GENERATED = "firmware/objects/generated"
PYTHON = "host/python/forceaxis/objects.py"

TYPES = {
    "u8": (1, 0, 0xFF, "uint8_t"),
    "i8": (1, -0x80, 0x7F, "int8_t"),
    "u16": (2, 0, 0xFFFF, "uint16_t"),
    "i16": (2, -0x8000, 0x7FFF, "int16_t"),
    "u32": (4, 0, 0xFFFFFFFF, "uint32_t"),
    "i32": (4, -0x80000000, 0x7FFFFFFF, "int32_t"),
}
KINDS = ("parameter", "signal", "command")
PARTS = ("axis", "recorder", "drive", "canopen", "device")
ACCESS = ("rw", "ro", "wo")
KIND_ACCESS = {"parameter": ("rw",), "signal": ("ro",), "command": ("wo", "rw")}
WRITABLE = ("any", "disabled", "recorder_idle")
NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
KEYS = {
    "name": str,
    "kind": str,
    "part": str,
    "meaning": str,
    "type": str,
    "unit": str,
    "scale": (int, float),
    "min": int,
    "max": int,
    "default": int,
    "access": str,
    "writable": str,
    "enum": list,
    "enum_of": str,
    "count": int,
    "defaults": list,
    "index": int,
    "sub": int,
    "index_step": int,
    "per_index": int,
    "node_id": bool,
    "modbus": int,
    "stored": bool,
}
REQUIRED = ("name", "kind", "meaning", "type", "unit", "access", "index")
SPECIAL_KEYS = {"name": str, "meaning": str, "type": str, "index": int}
SPECIAL_TYPES = {"visible_string": "TEXT", "domain": "DOMAIN"}


class TableError(Exception):
    """One line for the user: object, key, what was expected."""


def fail(name, key, expected):
    raise TableError(f"{name}: {key}: {expected}")


def one_of(values):
    return "expected one of " + ", ".join(values)


def check_object(raw, position, known):
    """The complete description of one table entry, every default filled in."""
    name = raw.get("name")
    label = f"object {name if isinstance(name, str) else f'number {position}'}"
    for key in REQUIRED:
        if key not in raw:
            fail(label, key, "expected a value, the key is missing")
    for key, value in raw.items():
        if key not in KEYS:
            fail(label, key, "unknown key, " + one_of(KEYS))
        kinds = KEYS[key] if isinstance(KEYS[key], tuple) else (KEYS[key],)
        if not isinstance(value, kinds) or (isinstance(value, bool) and bool not in kinds):
            fail(label, key, "expected a value of type " + " or ".join(k.__name__ for k in kinds))
    if not NAME.fullmatch(name):
        fail(label, "name", "expected snake case")
    if name in known:
        fail(label, "name", "expected a name used once, this one is there twice")
    o = dict(raw)
    o.setdefault("part", "axis")
    o.setdefault("scale", 1)
    o.setdefault("writable", "any")
    o.setdefault("default", 0)
    o.setdefault("count", 1)
    o.setdefault("sub", 0)
    o.setdefault("index_step", 0)
    o.setdefault("per_index", o["count"])
    o.setdefault("node_id", False)
    o.setdefault("modbus", None)
    o.setdefault("stored", o["kind"] == "parameter")
    for key, values in (
        ("kind", KINDS),
        ("part", PARTS),
        ("type", TYPES),
        ("access", ACCESS),
        ("writable", WRITABLE),
    ):
        if o[key] not in values:
            fail(label, key, f"{one_of(values)}, got {o[key]!r}")
    if o["access"] not in KIND_ACCESS[o["kind"]]:
        allowed = " or ".join(KIND_ACCESS[o["kind"]])
        fail(label, "access", f"expected {allowed} for a {o['kind']}")
    for key in ("meaning", "unit"):
        if not o[key].strip() or any(c in o[key] for c in '"\\\n'):
            fail(label, key, "expected one line without quotes or backslashes")
    if not 0 < float(o["scale"]) < float("inf"):
        fail(label, "scale", "expected a finite number above 0")
    if not 1 <= o["count"] <= 64:
        fail(label, "count", "expected 1 to 64")
    o["enum_name"] = name
    if "enum_of" in o:
        if "enum" in o:
            fail(label, "enum_of", "expected either enum or enum_of")
        if not known.get(o["enum_of"], {}).get("enum"):
            fail(label, "enum_of", "expected an earlier object that has an enum")
        o["enum_name"] = o["enum_of"]
        o["enum"] = known[o["enum_of"]]["enum"]
    texts = o.setdefault("enum", [])
    if (
        ("enum" in raw and not texts)
        or len(set(map(str, texts))) != len(texts)
        or not all(isinstance(t, str) and NAME.fullmatch(t) for t in texts)
    ):
        fail(label, "enum", "expected a list of different snake case texts")
    _, lowest, highest, _ = TYPES[o["type"]]
    if o["access"] != "ro" and not texts:
        for key in ("min", "max"):
            if key not in raw:
                fail(label, key, "expected a value, the key is missing")
    if texts and ("min" in raw or "max" in raw):
        fail(label, "min", "expected no range beside an enum")
    o.setdefault("min", 0 if texts else lowest)
    o.setdefault("max", len(texts) - 1 if texts else highest)
    if not lowest <= o["min"] <= highest:
        fail(label, "min", f"expected {lowest} to {highest}, got {o['min']}")
    if not o["min"] <= o["max"] <= highest:
        fail(label, "max", f"expected {o['min']} to {highest}, got {o['max']}")
    o.setdefault("defaults", [o["default"]] * o["count"])
    if len(o["defaults"]) != o["count"]:
        fail(label, "defaults", f"expected {o['count']} values, got {len(o['defaults'])}")
    for value in o["defaults"] if o["kind"] != "command" else ():
        if not isinstance(value, int) or not o["min"] <= value <= o["max"]:
            fail(label, "default", f"expected {o['min']} to {o['max']}, got {value}")
    check_addresses(label, o)
    return o


def check_addresses(label, o):
    if not 0x1000 <= o["index"] <= 0xFFFF:
        fail(label, "index", f"expected 0x1000 to 0xffff, got {o['index']:#x}")
    if o["per_index"] < 1 or o["count"] % o["per_index"]:
        fail(label, "per_index", f"expected a divisor of {o['count']}, got {o['per_index']}")
    if not 0 <= o["sub"] <= 255 - o["per_index"]:
        fail(label, "sub", f"expected 0 to 254, got {o['sub']}")
    if o["modbus"] is not None:
        if o["access"] == "wo":
            fail(label, "modbus", "expected none for an object that cannot be read")
        if not 0 <= o["modbus"] <= 0xFFFF:
            fail(label, "modbus", f"expected 0 to 0xffff, got {o['modbus']:#x}")


def check_specials(table, known):
    """Texts and blocks of bytes that are no numbers: [[special]] entries."""
    specials = table.get("special", [])
    for position, raw in enumerate(specials, 1):
        label = f"special {raw.get('name', f'number {position}')}"
        for key, kind in SPECIAL_KEYS.items():
            if not isinstance(raw.get(key), kind):
                fail(label, key, f"expected a value of type {kind.__name__}")
        unknown = set(raw) - set(SPECIAL_KEYS)
        if unknown:
            fail(label, sorted(unknown)[0], "unknown key, " + one_of(SPECIAL_KEYS))
        if raw["type"] not in SPECIAL_TYPES:
            fail(label, "type", f"{one_of(SPECIAL_TYPES)}, got {raw['type']!r}")
        if raw["name"] in known:
            fail(label, "name", "expected a name used once, this one is there twice")
    return specials


def canopen_address(o, i):
    """(index, sub) of element i of an entry."""
    if o["index_step"]:
        return o["index"] + i * o["index_step"], o["sub"]
    return o["index"] + i // o["per_index"], o["sub"] + i % o["per_index"]


def addresses(entries, specials):
    """{(index, sub): (what, value)}: objects, texts, and the highest sub-index of each record."""
    found = {}

    def add(label, address, entry):
        if address in found:
            index, sub = address
            fail(label, "index", f"expected an unused address, {index:#x}:{sub} is taken")
        found[address] = entry

    for _, name, o, i in expand(entries):
        add(f"object {name}", canopen_address(o, i), ("OBJECT", f"AXIS_OBJ_{name.upper()}"))
    for special in specials:
        label = f"special {special['name']}"
        add(label, (special["index"], 0), (SPECIAL_TYPES[special["type"]], special["index"]))
    for index in {index for index, sub in found if sub > 0}:
        highest = max(sub for i, sub in found if i == index)
        found.setdefault((index, 0), ("COUNT", highest))
    return dict(sorted(found.items()))


def registers(entries, writable):
    """[(register, number of registers, object name)] of the holding or the input registers."""
    found = []
    for _, name, o, i in expand(entries):
        if o["modbus"] is not None and (o["access"] == "rw") == writable:
            width = 2 if TYPES[o["type"]][0] == 4 else 1
            found.append((o["modbus"] + i * width, width, name))
    found.sort()
    for (first, width, name), (second, _, other) in itertools.pairwise(found):
        if first + width > second:
            fail(f"object {other}", "modbus", f"expected an unused register, {name} is there")
    return found


def load_table(path):
    """(table entries, special entries, their SHA-256). An entry with count > 1 stays one entry."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise TableError(f"object table: cannot be read ({error.strerror})") from error
    try:
        table = tomllib.loads(data.decode("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise TableError(f"object table: expected TOML, {error}") from error
    unknown = set(table) - {"object", "special"}
    if unknown:
        fail("object table", sorted(unknown)[0], "unknown key, expected [[object]] or [[special]]")
    entries = table.get("object")
    if (
        not isinstance(entries, list)
        or not entries
        or not all(isinstance(e, dict) for e in entries)
    ):
        fail("object table", "object", "expected at least one [[object]]")
    known = {}
    for position, raw in enumerate(entries, 1):
        o = check_object(raw, position, known)
        known[o["name"]] = o
    expanded = set()
    for o in known.values():
        for name in expanded_names(o):
            if name in expanded:
                fail(f"object {o['name']}", "count", f"expected unused names, {name} is taken")
            expanded.add(name)
    entries = list(known.values())
    specials = check_specials(table, expanded)
    addresses(entries, specials)
    for writable in (True, False):
        registers(entries, writable)
    return entries, specials, hashlib.sha256(data).hexdigest()


def expanded_names(o):
    if o["count"] == 1:
        return [o["name"]]
    return [f"{o['name']}_{i}" for i in range(1, o["count"] + 1)]


def expand(entries):
    """(number, name, entry, index in the C array) of every object."""
    number = 0
    for o in entries:
        for index, name in enumerate(expanded_names(o)):
            number += 1
            yield number, name, o, index


def c_int(value):
    if value == -0x80000000:
        return "(-INT32_C(2147483647) - 1)"
    return f"INT32_C({value})" if value >= 0 else f"-INT32_C({-value})"


def as_int32(value):
    return value - (1 << 32) if value > 0x7FFFFFFF else value


def banner(comment):
    return f"{comment[0]}Generated by tools/gen_objects.py from {TABLE}; do not edit.{comment[1]}\n"


C_BANNER = banner(("/* ", " */")) + "/* clang-format off */\n"
STRUCTS = tuple(
    (part, kind, f"{part}_{kind.removesuffix('eter')}s_t")
    for part in PARTS
    for kind in ("parameter", "signal")
)
BLOCKS = {(part, kind): f"AXIS_BLOCK_{part.upper()}_{kind.upper()}" for part, kind, _ in STRUCTS}


def struct_type(o):
    return next(t for part, kind, t in STRUCTS if (part, kind) == (o["part"], o["kind"]))


def generate_header(entries, specials, digest):
    objects = list(expand(entries))
    out = [C_BANNER]
    out.append(
        "#ifndef FIRMWARE_OBJECTS_GENERATED_AXIS_OBJECTS_H_\n"
        "#define FIRMWARE_OBJECTS_GENERATED_AXIS_OBJECTS_H_\n\n#include <stdint.h>\n\n"
    )
    out.append(
        "/* Object numbers, the same in every interface of the firmware. */\nenum {\n"
        "  AXIS_OBJ_NONE = 0,\n"
    )
    out.extend(f"  AXIS_OBJ_{name.upper()} = {number},\n" for number, name, _, _ in objects)
    out.append(f"  AXIS_OBJ_COUNT = {len(objects) + 1} /* one past the last number */\n}};\n\n")
    for o in entries:
        if o["enum"] and o["enum_name"] == o["name"]:
            prefix = "AXIS_" + o["name"].upper()
            out.append("enum {\n")
            out.extend(f"  {prefix}_{text.upper()} = {i},\n" for i, text in enumerate(o["enum"]))
            out.append(f"  {prefix}_COUNT = {len(o['enum'])}\n}};\n\n")
    for part, kind, type_name in STRUCTS:
        # Widest first, so that the structure has no holes.
        fields = sorted(
            (o for o in entries if (o["part"], o["kind"]) == (part, kind)),
            key=lambda o: -TYPES[o["type"]][0],
        )
        out.append("typedef struct {\n")
        for o in fields:
            array = f"[{o['count']}]" if o["count"] > 1 else ""
            out.append(
                f"  {TYPES[o['type']][3]} {o['name']}{array}; "
                f"/* {o['meaning']} [{describe_unit(o)}] */\n"
            )
        out.append(f"}} {type_name};\n\n")
    out.append(
        "/* First 32 bits of the table's SHA-256: programs that have the same mean the same. */\n"
        f"#define AXIS_OBJECTS_HASH32 UINT32_C(0x{digest[:8]})\n"
        f'#define AXIS_OBJECTS_HASH_TEXT "{digest[:8]}"\n\n'
    )
    out.append("enum {")
    out.append(",".join(f" AXIS_TYPE_{t.upper()} = {i}" for i, t in enumerate(TYPES)))
    out.append(" };\nenum { AXIS_ACCESS_RW = 0, AXIS_ACCESS_RO = 1, AXIS_ACCESS_WO = 2 };\n")
    out.append("enum {")
    out.append(",".join(f" AXIS_WRITABLE_{w.upper()} = {i}" for i, w in enumerate(WRITABLE)))
    out.append(" };\n/* The structure that holds the value; a command has none. */\nenum {\n")
    out.extend(f"  {block} = {i},\n" for i, block in enumerate(BLOCKS.values()))
    out.append(f"  AXIS_BLOCK_NONE = {len(BLOCKS)}\n}};\n\n")
    out.append(
        "typedef struct {\n"
        "  int32_t min;       /* raw; written values outside min..max are refused */\n"
        "  int32_t max;\n"
        "  int32_t initial;   /* raw value after power-up */\n"
        "  uint16_t offset;   /* bytes from the start of its structure */\n"
        "  uint8_t block;     /* AXIS_BLOCK_ */\n"
        "  uint8_t type;      /* AXIS_TYPE_ */\n"
        "  uint8_t access;    /* AXIS_ACCESS_ */\n"
        "  uint8_t writable;  /* AXIS_WRITABLE_ */\n"
        "  uint8_t stored;    /* kept by the parameter store */\n"
        "  uint8_t node_id;   /* a COB-ID: the node id is added to the initial value */\n"
        "} axis_object_t;\n\n"
        "/* Indexed by object number; entry 0 is unused. Objects of type u32 carry the 32\n"
        " * bits of their values in min, max and initial. */\n"
        "extern const axis_object_t axis_objects[AXIS_OBJ_COUNT];\n\n"
    )
    out.append(
        "/* What lies at a CANopen address. */\n"
        "enum {\n"
        "  AXIS_ADDRESS_OBJECT = 0, /* value: the object's number */\n"
        "  AXIS_ADDRESS_COUNT = 1,  /* value: the highest sub-index, u8, read only */\n"
        "  AXIS_ADDRESS_TEXT = 2,   /* a text, read only */\n"
        "  AXIS_ADDRESS_DOMAIN = 3  /* bytes of any number, read only */\n"
        "};\n\n"
        "typedef struct {\n"
        "  uint16_t index;\n"
        "  uint8_t sub;\n"
        "  uint8_t what; /* AXIS_ADDRESS_ */\n"
        "  uint16_t value;\n"
        "} axis_address_t;\n\n"
        "typedef struct {\n"
        "  uint16_t first; /* register; 32-bit objects take two */\n"
        "  uint16_t object;\n"
        "} axis_register_t;\n\n"
    )
    counts = {
        "addresses": len(addresses(entries, specials)),
        "holding": len(registers(entries, True)),
        "input": len(registers(entries, False)),
    }
    out.append("enum {\n")
    out.append(",\n".join(f"  AXIS_{n.upper()}_COUNT = {c}" for n, c in counts.items()))
    out.append(
        "\n};\n\n"
        "/* By index, then sub-index. */\n"
        "extern const axis_address_t axis_addresses[AXIS_ADDRESSES_COUNT];\n"
        "/* Modbus registers, by number: those that can be written, those that cannot. */\n"
        "extern const axis_register_t axis_holding[AXIS_HOLDING_COUNT];\n"
        "extern const axis_register_t axis_input[AXIS_INPUT_COUNT];\n\n#endif\n"
    )
    return "".join(out)


def describe_unit(o):
    if o["enum"]:
        return "enum"
    scale = float(o["scale"])
    if scale == 1:
        return o["unit"]
    inverse = 1 / scale
    text = f"1/{int(inverse)}" if inverse == int(inverse) else repr(scale)
    return f"{text} {o['unit']}"


def generate_source(entries, specials):
    out = [
        C_BANNER,
        f'#include "{GENERATED}/axis_objects.h"\n\n#include <stddef.h>\n\n',
        "const axis_object_t axis_objects[AXIS_OBJ_COUNT] = {\n",
    ]
    for _, name, o, index in expand(entries):
        if o["kind"] == "command":
            offset, block = "0", "AXIS_BLOCK_NONE"
        else:
            field = o["name"] if o["count"] == 1 else f"{o['name']}[{index}]"
            offset = f"(uint16_t)offsetof({struct_type(o)}, {field})"
            block = BLOCKS[o["part"], o["kind"]]
        out.append(
            f"    [AXIS_OBJ_{name.upper()}] = {{{c_int(as_int32(o['min']))}, "
            f"{c_int(as_int32(o['max']))}, {c_int(as_int32(o['defaults'][index]))},\n"
            f"        {offset}, {block}, AXIS_TYPE_{o['type'].upper()}, "
            f"AXIS_ACCESS_{o['access'].upper()}, AXIS_WRITABLE_{o['writable'].upper()}, "
            f"{int(o['stored'])}, {int(o['node_id'])}}},\n"
        )
    out.append("};\n\nconst axis_address_t axis_addresses[AXIS_ADDRESSES_COUNT] = {\n")
    for (index, sub), (what, value) in addresses(entries, specials).items():
        out.append(f"    {{0x{index:04X}, {sub}, AXIS_ADDRESS_{what}, {value}}},\n")
    out.append("};\n")
    for table, writable in (("holding", True), ("input", False)):
        count = f"AXIS_{table.upper()}_COUNT"
        out.append(f"\nconst axis_register_t axis_{table}[{count}] = {{\n")
        out.extend(
            f"    {{0x{first:04X}, AXIS_OBJ_{name.upper()}}},\n"
            for first, _, name in registers(entries, writable)
        )
        out.append("};\n")
    return "".join(out)


def register(o, i):
    """First register of element i, or -1."""
    return -1 if o["modbus"] is None else o["modbus"] + i * (2 if TYPES[o["type"]][0] == 4 else 1)


def generate_meta(entries, digest):
    out = [C_BANNER]
    out.append(
        "#ifndef FIRMWARE_OBJECTS_GENERATED_AXIS_OBJECTS_META_H_\n"
        "#define FIRMWARE_OBJECTS_GENERATED_AXIS_OBJECTS_META_H_\n\n"
        "/* Host only: what a person or a file needs to know of each object. */\n\n"
        "#include <stdint.h>\n\n"
        "typedef struct {\n"
        "  uint16_t object;        /* AXIS_OBJ_ number */\n"
        "  uint16_t size_bytes;    /* 1, 2 or 4 */\n"
        "  const char *name;       /* snake case */\n"
        "  const char *kind;       /* parameter, signal, command */\n"
        "  const char *part;       /* axis, recorder */\n"
        "  const char *meaning;    /* one sentence */\n"
        "  const char *type;       /* u8 i8 u16 i16 u32 i32 */\n"
        "  const char *unit;       /* of raw * scale */\n"
        "  double scale;           /* engineering value = raw * scale */\n"
        "  int64_t min;            /* raw, inclusive */\n"
        "  int64_t max;\n"
        "  int64_t initial;        /* raw value after power-up */\n"
        "  const char *access;     /* rw, ro, wo */\n"
        "  const char *writable;   /* any, disabled, recorder_idle */\n"
        "  const char *enum_texts; /* texts of 0, 1, 2, ... and commas; or empty */\n"
        "  uint16_t index;         /* CANopen */\n"
        "  uint8_t sub;\n"
        "  int32_t modbus;         /* first register, holding if rw, input if ro; -1: none */\n"
        "  int stored;             /* kept by the parameter store */\n"
        "} axis_object_meta_t;\n\n"
    )
    objects = list(expand(entries))
    out.append(f'#define AXIS_OBJECTS_HASH "{digest}"\n')
    out.append(f"#define AXIS_OBJECTS_META_COUNT {len(objects)}\n\n")
    out.append(
        "/* Entry i describes object number i + 1. */\n"
        "static const axis_object_meta_t axis_objects_meta[AXIS_OBJECTS_META_COUNT] = {\n"
    )
    for number, name, o, i in objects:
        index, sub = canopen_address(o, i)
        strings = [
            f'"{s}"' for s in (name, o["kind"], o["part"], o["meaning"], o["type"], o["unit"])
        ]
        out.append(
            f"    {{{number}, {TYPES[o['type']][0]}, {', '.join(strings)},\n"
            f"     {float(o['scale'])!r}, INT64_C({o['min']}), INT64_C({o['max']}), "
            f'INT64_C({o["defaults"][i]}), "{o["access"]}", "{o["writable"]}", '
            f'"{",".join(o["enum"])}", 0x{index:04X}, {sub}, {register(o, i)}, '
            f"{int(o['stored'])}}},\n"
        )
    out.append("};\n\n#endif\n")
    return "".join(out)


def generate_python(entries, digest):
    out = [
        banner(("# ", "")),
        '"""The firmware\'s objects: number, name, unit, scale, range, access, texts."""\n\n',
        "from typing import NamedTuple\n\n\n"
        "class AxisObject(NamedTuple):\n"
        '    """One parameter, signal or command; engineering value = raw * scale."""\n\n'
        "    number: int\n    name: str\n    kind: str\n    part: str\n    meaning: str\n"
        "    type: str\n    unit: str\n    scale: float\n    min: int\n    max: int\n"
        "    default: int\n    access: str\n    writable: str\n    enum: tuple[str, ...]\n"
        "    index: int  # CANopen\n    sub: int\n"
        "    modbus: int  # first register, holding if rw, input if ro; -1: none\n"
        "    stored: bool  # kept by the parameter store\n\n\n"
        f'OBJECTS_HASH = "{digest}"\n\nOBJECTS = (\n',
    ]
    for number, name, o, i in expand(entries):
        q = json.dumps
        index, sub = canopen_address(o, i)
        enum = "(" + "".join(f"{q(t)}, " for t in o["enum"]).rstrip() + ")"
        out.append("    AxisObject(\n")
        for key, value in (
            ("number", number),
            ("name", q(name)),
            ("kind", q(o["kind"])),
            ("part", q(o["part"])),
            ("meaning", q(o["meaning"])),
            ("type", q(o["type"])),
            ("unit", q(o["unit"])),
            ("scale", repr(float(o["scale"]))),
            ("min", o["min"]),
            ("max", o["max"]),
            ("default", o["defaults"][i]),
            ("access", q(o["access"])),
            ("writable", q(o["writable"])),
            ("index", f"0x{index:04X}"),
            ("sub", sub),
            ("modbus", register(o, i)),
            ("stored", o["stored"]),
        ):
            out.append(f"        {key}={value},\n")
        if len(enum) + 14 <= 100:
            out.append(f"        enum={enum},\n")
        else:
            out.append("        enum=(\n")
            out.extend(f"            {q(t)},\n" for t in o["enum"])
            out.append("        ),\n")
        out.append("    ),\n")
    out.append(")\n\nBY_NAME = {o.name: o for o in OBJECTS}\n")
    return "".join(out)


def generate(root):
    """{path below the root: text} of every generated file."""
    entries, specials, digest = load_table(root / TABLE)
    return {
        f"{GENERATED}/axis_objects.h": generate_header(entries, specials, digest),
        f"{GENERATED}/axis_objects.c": generate_source(entries, specials),
        f"{GENERATED}/axis_objects_meta.h": generate_meta(entries, digest),
        PYTHON: generate_python(entries, digest),
    }


def main(argv=None):
    parser = argparse.ArgumentParser(description="generate C and Python from the object table")
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
