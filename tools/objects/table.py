"""The object table: read, checked, every default filled in."""

import itertools
import re
import tomllib
from typing import NamedTuple

from objects import meaning, released

TABLE = "firmware/objects/axis_objects.toml"
NUMBERS = "numbers.txt"  # beside the table

TYPES = {
    "u8": (1, 0, 0xFF, "uint8_t"),
    "i8": (1, -0x80, 0x7F, "int8_t"),
    "u16": (2, 0, 0xFFFF, "uint16_t"),
    "i16": (2, -0x8000, 0x7FFF, "int16_t"),
    "u32": (4, 0, 0xFFFFFFFF, "uint32_t"),
    "i32": (4, -0x80000000, 0x7FFFFFFF, "int32_t"),
}
KINDS = ("parameter", "signal", "command")
PARTS = ("axis", "law", "recorder", "drive", "canopen", "device")
ACCESS = ("rw", "ro", "wo")
KIND_ACCESS = {"parameter": ("rw",), "signal": ("ro",), "command": ("wo", "rw")}
WRITABLE = ("any", "disabled", "recorder_idle")
IN_CYCLE = ("free", "ends", "refused")
NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
KEYS = {
    "name": str,
    "title": str,
    "kind": str,
    "part": str,
    "meaning": str,
    "type": str,
    "unit": str,
    "quantity": str,
    "not_zero": bool,
    "scale": (int, float),
    "min": int,
    "max": int,
    "default": int,
    "access": str,
    "writable": str,
    "in_cycle": str,
    "enum": list,
    "enum_of": str,
    "values": list,
    "values_of": str,
    "bits": list,
    "bits_of": list,
    "coding": list,
    "count": int,
    "defaults": list,
    "index": int,
    "sub": int,
    "index_step": int,
    "per_index": int,
    "node_id": bool,
    "law": bool,
    "modbus": int,
    "stored": bool,
    "mappable": (bool, str),
}
# Units whose count may be one of the force or one of the encoder.
COUNTED = ("count", "code/count")
QUANTITIES = ("force", "encoder")
REQUIRED = ("name", "kind", "meaning", "type", "unit", "access", "index")
# The keys of the other kinds of entries. All are required except those of OPTIONAL.
SPECIAL_KEYS = {
    "name": str, "title": str, "meaning": str, "type": str, "access": str, "index": int, "sub": int,
}  # fmt: skip
RECORD_KEYS = {"title": str, "index": int, "count": int, "array": bool}
BIT_KEYS = {"name": str, "address": int, "meaning": str, "bit_of": list}
REFUSAL_KEYS = {"name": str, "number": int, "text": str, "aborts": list}
GATEWAY_KEYS = {"node_id": int, "first_sdo": int, "tpdo": list}
GATEWAY_TPDO_KEYS = {"transmission": int, "event_ms": int, "objects": list}
OPTIONAL = {
    "special": ("title", "access", "sub"), "record": ("count", "array"),
    "coil": ("meaning", "bit_of"), "discrete": ("meaning", "bit_of"), "refusal": ("aborts",),
}  # fmt: skip
# Kind of the data of an entry [[special]], by its type and access.
SPECIAL_TYPES = {
    ("visible_string", "ro"): "TEXT", ("domain", "ro"): "DOMAIN", ("domain", "wo"): "DOWNLOAD",
}  # fmt: skip
ONE_LINE = "expected one line without quotes, bars and backslashes"


class TableError(Exception):
    """One line for the user: object, key, what was expected."""


class Table(NamedTuple):
    entries: list  # [[object]], in the order of the file; an entry with count > 1 is one element
    specials: list
    records: dict  # {index: (title, whether it is an array)}
    coils: list
    discretes: list
    refusals: list
    gateway: dict | None  # [gateway]: how a gateway configures an axis
    digest: str  # SHA-256 over the meaning of the objects, see meaning.py
    release: released.Release  # version 0.1.0


class Address(NamedTuple):
    """The entry at a CANopen address."""

    what: str  # kind: OBJECT, COUNT, TEXT, DOMAIN, DOWNLOAD
    name: str  # name of the object or special
    entry: dict | None
    element: int  # element of the array; for a COUNT the highest sub-index


def fail(name, key, expected):
    raise TableError(f"{name}: {key}: {expected}")


def one_of(values):
    return "expected one of " + ", ".join(values)


def label_of(kind, raw, position):
    name = raw.get("name", raw.get("title"))
    return f"{kind} {name if isinstance(name, str) else f'number {position}'}"


def check_keys(label, raw, keys, required):
    for key in required:
        if key not in raw:
            fail(label, key, "expected a value, the key is missing")
    for key, value in raw.items():
        if key not in keys:
            fail(label, key, "unknown key, " + one_of(keys))
        kinds = keys[key] if isinstance(keys[key], tuple) else (keys[key],)
        if not isinstance(value, kinds) or (isinstance(value, bool) and bool not in kinds):
            fail(label, key, "expected a value of type " + " or ".join(k.__name__ for k in kinds))
    # These texts are copied to files with a syntax of their own. In an EDS file, a semicolon begins
    # a comment.
    for key, others in (("title", ";"), ("meaning", ""), ("unit", ""), ("text", "")):
        if key in raw and not is_line(raw[key], others):
            fail(label, key, ONE_LINE)
    if "name" in raw and not NAME.fullmatch(raw["name"]):
        fail(label, "name", "expected snake case")


def is_line(text, others=""):
    """Whether a text is one line without characters that a generated file gives a meaning."""
    return bool(text.strip()) and not re.search(rf'["\\|\x00-\x1f{others}]', text)


def check_object(raw, position, known):
    """The complete description of one table entry, every default filled in."""
    label = label_of("object", raw, position)
    check_keys(label, raw, KEYS, REQUIRED)
    name = raw["name"]
    if name in known:
        fail(label, "name", "expected a name used once, this one is there twice")
    o = dict(raw)
    o.setdefault("title", name.replace("_", " ").capitalize())
    o.setdefault("part", "axis")
    o.setdefault("scale", 1)
    o.setdefault("writable", "any")
    o.setdefault("default", 0)
    o.setdefault("count", 1)
    o.setdefault("sub", 0)
    o.setdefault("index_step", 0)
    o.setdefault("per_index", o["count"])
    o.setdefault("node_id", False)
    o.setdefault("not_zero", False)
    o.setdefault("law", False)
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
    check_quantity(label, o)
    check_in_cycle(label, o)
    if not 0 < float(o["scale"]) < float("inf"):
        fail(label, "scale", "expected a finite number above 0")
    if not 1 <= o["count"] <= 64:
        fail(label, "count", "expected 1 to 64")
    if o["stored"] and o["kind"] != "parameter":
        fail(label, "stored", f"expected false for a {o['kind']}")
    check_texts(label, o, raw, known)
    check_bits_of_value(label, o, raw, known)
    check_coding(label, o)
    check_range(label, o, raw, known)
    check_bits_have_names(label, o)
    check_addresses(label, o)
    if refusal := meaning.set_mappable(o, raw.get("mappable", True)):
        fail(label, "mappable", refusal)
    return o


def check_quantity(label, o):
    """Of what a count of the unit is a step, where the unit does not tell; else ""."""
    if (o["unit"] in COUNTED) != ("quantity" in o):
        other = "a value" if o["unit"] in COUNTED else "none"
        fail(label, "quantity", f"expected {other} for the unit {o['unit']}")
    if o.setdefault("quantity", "") not in ("", *QUANTITIES):
        fail(label, "quantity", f"{one_of(QUANTITIES)}, got {o['quantity']!r}")


def check_in_cycle(label, o):
    """What a change does to a running cycle. Whatever can be written then is judged one by one; the
    axis is enabled then, so the table itself refuses what is written while it is disabled."""
    if o["access"] == "ro" or o["writable"] == "disabled":
        if "in_cycle" in o:
            fail(label, "in_cycle", "expected none, it cannot be written while a cycle runs")
        o["in_cycle"] = "refused"
    elif o.get("in_cycle") not in IN_CYCLE:
        fail(label, "in_cycle", f"{one_of(IN_CYCLE)}, got {o.get('in_cycle')!r}")


def check_texts(label, o, raw, known):
    """enum and values: names of raw values, own ones or those of an earlier object."""
    for key in ("enum", "values"):
        o[f"{key}_name"] = o["name"]
        if f"{key}_of" in o:
            if key in o:
                fail(label, f"{key}_of", f"expected either {key} or {key}_of")
            if not known.get(o[f"{key}_of"], {}).get(key):
                fail(label, f"{key}_of", f"expected an earlier object that has {key}")
            o[f"{key}_name"] = o[f"{key}_of"]
            o[key] = known[o[f"{key}_of"]][key]
    texts = o.setdefault("enum", [])
    if (
        ("enum" in raw and not texts)
        or len(set(map(str, texts))) != len(texts)
        or not all(isinstance(t, str) and NAME.fullmatch(t) for t in texts)
    ):
        fail(label, "enum", "expected a list of different snake case texts")
    if texts and "values" in o:
        fail(label, "values", "expected either enum or values")
    values = o.setdefault("values", [])
    if (
        ("values" in raw and not values)
        or not all(
            isinstance(v, list)
            and len(v) in (2, 3)
            and type(v[0]) is int
            and all(isinstance(t, str) and is_line(t) for t in v[1:])
            and NAME.fullmatch(v[1])
            for v in values
        )
        or any(len({v[k] for v in values}) != len(values) for k in (0, 1))
    ):
        fail(label, "values", "expected a list of different [number, snake case text, sentence]")
    if "values" in raw:
        o["sentences"] = {v[1]: v[2] for v in values if v[2:]}
        o["values"] = [v[:2] for v in values]
    shared = known.get(o["values_name"], {}).get("sentences", {})
    o.setdefault("sentences", shared)


def bits_of_other(label, raw, known):
    """bits_of: the bits with these keys of an earlier object."""
    name, *keys = raw["bits_of"] or [None]
    found = {bit[1]: bit for bit in known.get(name, {}).get("bits", [])}
    if "bits" in raw or not keys or not set(keys) <= set(found):
        fail(label, "bits_of", "expected an earlier object that has bits, and keys of its bits")
    return [list(bit) for key, bit in found.items() if key in keys]


def is_bit(bit, width):
    return (
        isinstance(bit, list)
        and len(bit) in (3, 4)
        and type(bit[0]) is int
        and 0 <= bit[0] < width
        and all(isinstance(t, str) and is_line(t) for t in bit[1:3])
        and NAME.fullmatch(bit[1])
        and all(type(mode) is int and -16 <= mode < 16 for mode in (bit[3:] or [[]])[0])
    )


def check_bits_of_value(label, o, raw, known):
    """bits: those of a value that is or has a set of bits, each [number, key, text], and the modes
    of operation in which the bit has this meaning if that is not so in all. Their texts end the
    meaning of the object."""
    width = 8 * TYPES[o["type"]][0]
    bits = bits_of_other(label, raw, known) if "bits_of" in raw else o.get("bits", [])
    if "bits" in raw and not bits:
        fail(label, "bits", "expected a list of [number, snake case key, text]")
    for bit in bits:
        if not is_bit(bit, width):
            fail(label, "bits", f"expected [0 to {width - 1}, snake case key, text], got {bit!r}")
    if len({bit[1] for bit in bits}) != len(bits):
        fail(label, "bits", "expected different keys")
    o["bits"] = [(*bit[:3], tuple((bit[3:] or [[]])[0])) for bit in bits]
    if bits:
        o["meaning"] += ": " + ", ".join(bit_texts(o))


def bit_texts(o, number=None):
    """A text for each bit of an object, or for the meanings of one."""
    for bit, _, text, modes in o["bits"]:
        of = f" (mode{'s' * (len(modes) > 1)} {', '.join(map(str, modes))})" if modes else ""
        if number is None:
            yield f"bit {bit} {text}{of}"
        elif bit == number:
            yield text + of


def check_bits_have_names(label, o):
    """Each bit that a client may write has a name, up to the highest bit of the range, unless the
    whole of the type may be written."""
    if not o["bits"] or o["access"] == "ro" or o["max"] == TYPES[o["type"]][2]:
        return
    named = sum({1 << bit for bit, *_ in o["bits"]})
    if named.bit_length() != o["max"].bit_length():
        fail(label, "bits", f"expected a name of the highest bit of {o['max']} and of none above")


def check_coding(label, o):
    """coding: [mask, value, text for people] of each text of the enum in a statusword."""
    coding = o.setdefault("coding", [])
    for row in coding:
        if not (
            isinstance(row, list)
            and [type(part) for part in row] == [int, int, str]
            and row[1] & ~row[0] == 0
            and is_line(row[2])
        ):
            fail(label, "coding", f"expected [mask, value, text], got {row!r}")
    if coding and len(coding) != len(o["enum"]):
        fail(label, "coding", "expected a row for each text of the enum")


def range_of_names(o, known):
    """(min, max) where they follow from the names of values, else None: from the least to the
    greatest of an object's own values, or as the object that `values_of` names has them."""
    if "values_of" in o:
        return known[o["values_of"]]["min"], known[o["values_of"]]["max"]
    if o["values"] and o["access"] != "ro":
        numbers = [number for number, _ in o["values"]]
        return min(numbers), max(numbers)
    return None


def check_range(label, o, raw, known):
    _, lowest, highest, _ = TYPES[o["type"]]
    texts = o["enum"]
    named = range_of_names(o, known)
    if named is not None and "min" not in raw and "max" not in raw:
        for value in named:
            if not lowest <= value <= highest:
                fail(label, "values", f"expected {lowest} to {highest}, got {value}")
        o["min"], o["max"] = named
    elif o["access"] != "ro" and not texts:
        for key in ("min", "max"):
            if key not in raw:
                fail(label, key, "expected a value, the key is missing")
    if texts and ("min" in raw or "max" in raw):
        fail(label, "min", "expected no range beside an enum")
    o.setdefault("min", 0 if texts else lowest)
    o.setdefault("max", len(texts) - 1 if texts else highest)
    if o["not_zero"] and not (o["min"] < 0 < o["max"] or 0 in (o["min"], o["max"])):
        fail(label, "not_zero", "expected false, the range does not contain 0")
    if o["not_zero"] and 0 in o.get("defaults", [o["default"]]):
        fail(label, "default", "expected another value than 0")
    if not lowest <= o["min"] <= highest:
        fail(label, "min", f"expected {lowest} to {highest}, got {o['min']}")
    if not o["min"] <= o["max"] <= highest:
        fail(label, "max", f"expected {o['min']} to {highest}, got {o['max']}")
    for value, _ in o["values"]:
        if not o["min"] <= value <= o["max"]:
            fail(label, "values", f"expected {o['min']} to {o['max']}, got {value}")
    if "default" in raw and "defaults" in raw:
        fail(label, "defaults", "expected either default or defaults")
    o.setdefault("defaults", [o["default"]] * o["count"])
    if len(o["defaults"]) != o["count"]:
        fail(label, "defaults", f"expected {o['count']} values, got {len(o['defaults'])}")
    # The value that is read from a command need not be a value that may be written.
    low, high = (lowest, highest) if o["kind"] == "command" else (o["min"], o["max"])
    for value in o["defaults"]:
        if type(value) is not int or not low <= value <= high:
            fail(label, "default", f"expected {low} to {high}, got {value}")


def check_addresses(label, o):
    first, count = o["index"], o["count"]
    if not 0x1000 <= first <= 0x9FFF:
        fail(label, "index", f"expected 0x1000 to 0x9fff, got {first:#x}")
    if o["index_step"] < 0:
        fail(label, "index_step", f"expected 0 or more, got {o['index_step']}")
    if o["index_step"] and o["per_index"] != count:
        fail(label, "per_index", "expected either index_step or per_index")
    if o["per_index"] < 1 or count % o["per_index"]:
        fail(label, "per_index", f"expected a divisor of {count}, got {o['per_index']}")
    in_one = 1 if o["index_step"] else o["per_index"]
    if in_one > 1 and o["sub"] == 0:
        fail(label, "sub", "expected 1 or more: sub-index 0 says how many there are")
    if not 0 <= o["sub"] <= 255 - in_one:
        fail(label, "sub", f"expected 0 to {255 - in_one}, got {o['sub']}")
    # The areas of CiA 301: communication, manufacturer, standardised profile.
    part = o["part"]
    for index in (first, canopen_address(o, count - 1)[0]):
        if (index < 0x2000 and part != "canopen") or (index >= 0x6000 and part != "drive"):
            ranges = {"canopen": "0x1000 to 0x5fff", "drive": "0x2000 to 0x9fff"}
            expected = ranges.get(part, "0x2000 to 0x5fff")
            fail(label, "index", f"expected {expected} for part {part}, got {index:#x}")
        if index > 0x9FFF:
            fail(label, "index", f"expected none above 0x9fff, got {index:#x}")
    if o["node_id"] and (o["type"] != "u32" or part != "canopen"):
        fail(label, "node_id", "expected false but for a COB-ID: u32, part canopen")
    if o["modbus"] is not None:
        if o["access"] == "wo":
            fail(label, "modbus", "expected none for an object that cannot be read")
        last = 0x10000 - count * register_width(o)
        if not 0 <= o["modbus"] <= last:
            fail(label, "modbus", f"expected 0 to {last:#x}, got {o['modbus']:#x}")


def check_list(table, kind, keys):
    """The [[kind]] entries, each with its label."""
    found = table.get(kind, [])
    if not isinstance(found, list) or not all(isinstance(e, dict) for e in found):
        fail("object table", kind, f"expected [[{kind}]]")
    for position, raw in enumerate(found, 1):
        label = label_of(kind, raw, position)
        check_keys(label, raw, keys, [k for k in keys if k not in OPTIONAL[kind]])
        yield label, dict(raw)


def check_specials(table, known):
    """Texts and blocks of bytes that are no numbers: [[special]] entries."""
    specials = []
    for label, special in check_list(table, "special", SPECIAL_KEYS):
        types = dict.fromkeys(kind for kind, _ in SPECIAL_TYPES)
        if special["type"] not in types:
            fail(label, "type", f"{one_of(types)}, got {special['type']!r}")
        special.setdefault("access", "ro")
        if (special["type"], special["access"]) not in SPECIAL_TYPES:
            accesses = [access for kind, access in SPECIAL_TYPES if kind == special["type"]]
            fail(label, "access", f"{one_of(accesses)}, got {special['access']!r}")
        if not 0 <= special.setdefault("sub", 0) <= 254:
            fail(label, "sub", f"expected 0 to 254, got {special['sub']}")
        if special["name"] in known:
            fail(label, "name", "expected a name used once, this one is there twice")
        if not 0x1000 <= special["index"] <= 0x9FFF:
            fail(label, "index", f"expected 0x1000 to 0x9fff, got {special['index']:#x}")
        known.add(special["name"])
        special.setdefault("title", special["name"].replace("_", " ").capitalize())
        specials.append(special)
    return specials


def check_records(table, found):
    """{index: (title, is an array)} of the [[record]] entries: names of what has sub-indices."""
    records = {}
    for label, record in check_list(table, "record", RECORD_KEYS):
        count = record.get("count", 1)
        if not 1 <= count <= 64:
            fail(label, "count", "expected 1 to 64")
        for i in range(count):
            index = record["index"] + i
            if index in records:
                fail(label, "index", f"expected an index named once, {index:#x} is there twice")
            if not any(at == index and sub > 0 for at, sub in found):
                fail(label, "index", f"expected one with sub-indices, got {index:#x}")
            title = record["title"] if count == 1 else f"{record['title']} {i + 1}"
            records[index] = (title, record.get("array", False))
    return records


def check_bits(table, kind, known):
    """Single bits of Modbus: [[coil]] and [[discrete]] entries, by address."""
    bits, names = {}, set()
    for label, bit in check_list(table, kind, BIT_KEYS):
        if not 0 <= bit["address"] <= 0xFFFF:
            fail(label, "address", f"expected 0 to 65535, got {bit['address']}")
        if bit["address"] in bits:
            other = bits[bit["address"]]["name"]
            fail(label, "address", f"expected an unused one, {other} is there")
        if bit["name"] in names:
            fail(label, "name", "expected a name used once, this one is there twice")
        names.add(bit["name"])
        if ("meaning" in bit) == ("bit_of" in bit):
            fail(label, "meaning", "expected either meaning or bit_of")
        if "bit_of" in bit:
            bit["meaning"] = meaning_of_bit(label, bit.pop("bit_of"), known)
        bits[bit["address"]] = bit
    return [bits[address] for address in sorted(bits)]


def meaning_of_bit(label, bit_of, known):
    """The meaning of the single bit of an object, such as ["statusword", 10]."""
    name, number = (*bit_of, None, None)[:2]
    if len(bit_of) != 2 or not known.get(name, {}).get("bits") or type(number) is not int:
        fail(label, "bit_of", "expected [object that has bits, number of the bit]")
    texts = ", ".join(bit_texts(known[name], number))
    return f"{name} bit {number}" + (f": {texts}" if texts else "")


def check_refusals(table):
    """The results of a refused access: [[refusal]] entries, from number -1 on."""
    refusals = []
    for label, refusal in check_list(table, "refusal", REFUSAL_KEYS):
        if refusal["number"] != -len(refusals) - 1:
            fail(label, "number", f"expected {-len(refusals) - 1}, the next one")
        aborts = refusal.setdefault("aborts", [])
        others = [code for r in refusals for code in r["aborts"]]
        if len(aborts) > 4 or not all(type(c) is int and c not in others for c in aborts):
            fail(label, "aborts", "expected up to 4 SDO abort codes that no other refusal has")
        refusals.append(refusal)
    return refusals


def check_gateway(table, known):
    """[gateway], with the entries of the objects of its TPDOs; None if the table has none."""
    if "gateway" not in table:
        return None
    raw = table["gateway"]
    check_keys("gateway", raw, GATEWAY_KEYS, GATEWAY_KEYS)
    tpdos = []
    for number, tpdo in enumerate(raw["tpdo"], 1):
        label = f"gateway TPDO {number}"
        check_keys(label, tpdo, GATEWAY_TPDO_KEYS, GATEWAY_TPDO_KEYS)
        for name in tpdo["objects"]:
            if not known.get(name, {}).get("mappable") or known[name]["count"] > 1:
                fail(label, "objects", f"expected objects that a PDO may carry, got {name}")
        carried = [known[name] for name in tpdo["objects"]]
        if len(carried) > 4 or sum(TYPES[o["type"]][0] for o in carried) > 8:
            fail(label, "objects", "expected at most 4 objects and 64 bits")
        tpdos.append(tpdo | {"objects": carried})
    return raw | {"tpdo": tpdos}


def expanded_names(o):
    if o["count"] == 1:
        return [o["name"]]
    return [f"{o['name']}_{i}" for i in range(1, o["count"] + 1)]


def expand(entries):
    """(number, name, entry, index in the C array) of every object."""
    for o in entries:
        for index, name in enumerate(expanded_names(o)):
            yield o["number"] + index, name, o, index


def canopen_address(o, i):
    """(index, sub) of element i of an entry."""
    if o["index_step"]:
        return o["index"] + i * o["index_step"], o["sub"]
    return o["index"] + i // o["per_index"], o["sub"] + i % o["per_index"]


def addresses(entries, specials):
    """{(index, sub): Address}: objects, texts, and the highest sub-index of each record."""
    found = {}

    def add(label, address, entry):
        if address in found:
            index, sub = address
            fail(label, "index", f"expected an unused address, {index:#x}:{sub} is taken")
        found[address] = entry

    for _, name, o, i in expand(entries):
        add(f"object {name}", canopen_address(o, i), Address("OBJECT", name, o, i))
    for special in specials:
        what = SPECIAL_TYPES[special["type"], special["access"]]
        address = Address(what, special["name"], special, 0)
        add(f"special {special['name']}", (special["index"], special["sub"]), address)
    highest = {}
    for index, sub in found:
        highest[index] = max(sub, highest.get(index, 0))
    for index, sub in highest.items():
        if not sub:
            continue
        count = found.setdefault((index, 0), Address("COUNT", "", None, sub))
        if count.what != "COUNT" and (count.what != "OBJECT" or count.entry["type"] != "u8"):
            expected = f"expected u8 at sub-index 0 of {index:#x}, which has others"
            fail(f"object {count.name}", "type", expected)
    return dict(sorted(found.items()))


def title(o, i):
    """CANopen's name of element i: numbered within its index."""
    alone = o["index_step"] or o["per_index"] == 1
    return o["title"] if alone else f"{o['title']} {i % o['per_index'] + 1}"


def register_width(o):
    """Modbus registers that one element takes."""
    return 2 if TYPES[o["type"]][0] == 4 else 1


def register(o, i):
    """First register of element i, or -1."""
    return -1 if o["modbus"] is None else o["modbus"] + i * register_width(o)


def registers(entries, writable):
    """[(register, number of registers, object name)] of the holding or the input registers."""
    found = sorted(
        (register(o, i), register_width(o), name)
        for _, name, o, i in expand(entries)
        if o["modbus"] is not None and (o["access"] == "rw") == writable
    )
    for (first, width, name), (second, _, other) in itertools.pairwise(found):
        if first + width > second:
            fail(f"object {other}", "modbus", f"expected an unused register, {name} is there")
    return found


def load_table(path):
    """The checked table; raises TableError."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise TableError(f"object table: cannot be read ({error.strerror})") from error
    try:
        table = tomllib.loads(data.decode("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise TableError(f"object table: expected TOML, {error}") from error
    kinds = ("object", *OPTIONAL, "gateway")
    unknown = set(table) - set(kinds)
    if unknown:
        fail("object table", sorted(unknown)[0], "unknown key, " + one_of(kinds))
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
    set_numbers(known, path.parent / NUMBERS)
    entries = list(known.values())
    specials = check_specials(table, expanded)
    found = addresses(entries, specials)
    for writable in (True, False):
        registers(entries, writable)
    records = check_records(table, found)
    bits = check_bits(table, "coil", known), check_bits(table, "discrete", known)
    objects = [
        (*canopen_address(o, i), name, register(o, i), o) for _, name, o, i in expand(entries)
    ]
    digest = meaning.digest(objects, specials, *bits)
    refusals, gateway = check_refusals(table), check_gateway(table, known)
    return Table(entries, specials, records, *bits, refusals, gateway, digest, read_release(path))


def set_numbers(known, path):
    """Sets the number of the first object of each entry: those of the file first, in its order, and
    then new ones, so that no number changes because an entry is new."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    before = dict.fromkeys(line for line in lines if line in known)
    number = 1
    for name in [*before, *(name for name in known if name not in before)]:
        known[name]["number"] = number
        number += known[name]["count"]


def read_release(path):
    try:
        return released.load_release(path.parent / released.FILE)
    except OSError as error:
        raise TableError(f"{released.FILE}: cannot be read ({error.strerror})") from error


def banner(comment):
    return f"{comment[0]}Generated by tools/gen_objects.py from {TABLE}; do not edit.{comment[1]}\n"


def number(value):
    """Shortest text of a number that reads back the same."""
    return str(int(value)) if value == int(value) else repr(float(value))


def describe_unit(o):
    if o["enum"]:
        return "enum"
    scale = float(o["scale"])
    if scale == 1:
        return o["unit"]
    inverse = 1 / scale
    text = f"1/{int(inverse)}" if inverse == int(inverse) else f"{scale:.7g}"
    return f"{text} {o['unit']}"
