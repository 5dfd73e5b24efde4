"""C: the object dictionary of the firmware and its host metadata."""

from objects.meaning import law_signature, signature
from objects.table import (
    IN_CYCLE,
    PARTS,
    TYPES,
    WRITABLE,
    addresses,
    banner,
    canopen_address,
    describe_unit,
    expand,
    fail,
    register,
    registers,
    title,
)

FOLDER = "firmware/objects/generated"


def c_int(value):
    if value == -0x80000000:
        return "(-INT32_C(2147483647) - 1)"
    return f"INT32_C({value})" if value >= 0 else f"-INT32_C({-value})"


def as_int32(value):
    return value - (1 << 32) if value > 0x7FFFFFFF else value


C_BANNER = banner(("/* ", " */")) + "/* clang-format off */\n"
STRUCTS = tuple(
    (part, kind, f"{part}_{kind.removesuffix('eter')}s_t")
    for part in PARTS
    for kind in ("parameter", "signal")
)
BLOCKS = {(part, kind): f"AXIS_BLOCK_{part.upper()}_{kind.upper()}" for part, kind, _ in STRUCTS}


def struct_type(o):
    return next(t for part, kind, t in STRUCTS if (part, kind) == (o["part"], o["kind"]))


def constants_of(o):
    """Lists of the named raw values of an object with texts or bits."""
    prefix = "AXIS_" + o["name"].upper()
    if o["enum"] and o["enum_name"] == o["name"]:
        yield [(f"{prefix}_{text.upper()}", i) for i, text in enumerate(o["enum"])] + [
            (f"{prefix}_COUNT", len(o["enum"]))
        ]
    if o["values"] and o["values_name"] == o["name"]:
        named = [(f"{prefix}_{text.upper()}", value) for value, text in o["values"]]
        written = o["access"] != "ro"
        bounds = [(f"{prefix}_LEAST", o["min"]), (f"{prefix}_GREATEST", o["max"])]
        yield [*named, *(bounds if written else [])]
    if o["bits"]:
        masks = dict.fromkeys((f"{prefix}_{key.upper()}", 1 << n) for n, key, *_ in o["bits"])
        yield list(masks)


def addresses_of_bits(table):
    """Lists of the addresses of Modbus bits."""
    for kind, bits in (("COIL", table.coils), ("DISCRETE", table.discretes)):
        if bits:
            yield [(f"AXIS_{kind}_{bit['name'].upper()}", bit["address"]) for bit in bits] + [
                (f"AXIS_{kind}_COUNT", 1 + max(bit["address"] for bit in bits))
            ]


def enumeration(constants):
    """The constants as an enum; those beyond int as macros."""
    large = [(name, value) for name, value in constants if value > 0x7FFFFFFF]
    text = "".join(f"#define {name} UINT32_C({value})\n" for name, value in large)
    small = ",\n".join(f"  {c[0]} = {c[1]}" for c in constants if c not in large)
    return f"{text}enum {{\n{small}\n}};\n\n" if small else f"{text}\n"


def fault_texts(table):
    """Names of the faults; each has the error code of its name."""
    named = {o["name"]: o for o in table.entries}
    if not {"fault", "error_code"} <= set(named):
        return []
    codes = {text for _, text in named["error_code"]["values"]}
    for text in named["fault"]["enum"]:
        if text not in codes:
            fail("object error_code", "values", f"expected a code of the fault {text}")
    return named["fault"]["enum"]


def arrays(table, part):
    """(comment, declaration, rows) of each constant array of a part that follows from names."""
    if part == "axis" and (faults := fault_texts(table)):
        yield (
            "Error code of CiA 402 (603Fh) for each fault: the one with the name of the fault.",
            "uint16_t axis_fault_codes[AXIS_FAULT_COUNT]",
            [f"[AXIS_FAULT_{text.upper()}] = AXIS_ERROR_CODE_{text.upper()}" for text in faults],
        )
    for o in table.entries:
        if o["coding"] and o["part"] == part:
            name = o["name"].upper()
            yield (
                "Bits of the statusword (6041h) in each state; the other bits of the state are 0.",
                f"uint8_t axis_{o['name']}_words[AXIS_{name}_COUNT]",
                [
                    f"[AXIS_{name}_{text.upper()}] = {value:#04x}"
                    for text, (_, value, _) in zip(o["enum"], o["coding"], strict=True)
                ],
            )


def changes(table):
    """[(address, initial, fits)] of version 0.1.0's stored objects that this table describes
    otherwise: fits where only the default differs."""
    today = {canopen_address(o, i): (o, i) for _, _, o, i in expand(table.entries) if o["stored"]}
    found = []
    for (index, sub), old in sorted(table.release.objects.items()):
        o, i = today.get((index, sub), (None, 0))
        fits = o is not None and old.fits(o)
        if not fits or o["defaults"][i] != old.default:
            found.append((index * 256 + sub, old.default, fits))
    return found


def former_names(table):
    """[(address, name)] of version 0.1.0's stored objects that no longer have their addresses."""
    today = {canopen_address(o, i) for _, _, o, i in expand(table.entries)}
    return [
        (index * 256 + sub, old.name)
        for (index, sub), old in sorted(table.release.objects.items())
        if (index, sub) not in today
    ]


def guarded(name, includes, body):
    """A header."""
    guard = f"FIRMWARE_OBJECTS_GENERATED_{name.upper()}_H_"
    lines = "".join(f"#include {include}\n" for include in includes)
    return f"{C_BANNER}#ifndef {guard}\n#define {guard}\n\n{lines}\n{body}#endif\n"


def part_header(part):
    return f"axis_objects_{part}"


def generate_table_header(table):
    """What is the same whatever objects there are."""
    out = ["enum { AXIS_OBJ_NONE = 0 };\n\n"]
    out.append("/* Results of an access to an object. A refused access changes nothing. */\n")
    out.append("typedef enum {\n  FW_OK = 0")
    out.extend(
        f",\n  /* {refusal['text']} */\n  FW_ERROR_{refusal['name'].upper()} = {refusal['number']}"
        for refusal in table.refusals
    )
    out.append("\n} fw_error_t;\n\n")
    out.append("enum {")
    out.append(",".join(f" AXIS_TYPE_{t.upper()} = {i}" for i, t in enumerate(TYPES)))
    out.append(" };\nenum { AXIS_ACCESS_RW = 0, AXIS_ACCESS_RO = 1, AXIS_ACCESS_WO = 2 };\n")
    out.append(
        "/* No PDO carries it; any PDO, as far as its access allows; a TPDO alone. */\n"
        "enum { AXIS_MAPPABLE_NEVER = 0, AXIS_MAPPABLE_BOTH = 1, AXIS_MAPPABLE_SENT = 2 };\n"
    )
    out.append("enum {")
    out.append(",".join(f" AXIS_WRITABLE_{w.upper()} = {i}" for i, w in enumerate(WRITABLE)))
    out.append(
        " };\n/* What a write does to a running cycle that changes the value. */\nenum {"
        + ",".join(f" AXIS_IN_CYCLE_{w.upper()} = {i}" for i, w in enumerate(IN_CYCLE))
    )
    out.append(" };\n/* The structure that holds the value; a command has none. */\nenum {\n")
    out.extend(f"  {block} = {i},\n" for i, block in enumerate(BLOCKS.values()))
    out.append(f"  AXIS_BLOCK_NONE = {len(BLOCKS)}\n}};\n\n")
    out.append(
        "typedef struct {\n"
        "  int32_t min;       /* raw; written values outside min..max are refused */\n"
        "  int32_t max;\n"
        "  int32_t initial;   /* raw value after power-up */\n"
        "  uint32_t signature; /* of a stored object: CRC-32 of type, unit, scale, range, node_id\n"
        "                         and names of values; a stored value fits where it is equal */\n"
        "  uint16_t offset;   /* bytes from the start of its structure */\n"
        "  uint8_t block;     /* AXIS_BLOCK_ */\n"
        "  uint8_t type;      /* AXIS_TYPE_ */\n"
        "  uint8_t access;    /* AXIS_ACCESS_ */\n"
        "  uint8_t writable;  /* AXIS_WRITABLE_ */\n"
        "  uint8_t stored;    /* kept by the parameter store */\n"
        "  uint8_t node_id;   /* a COB-ID: the node id is added to the initial value */\n"
        "  uint8_t mappable;  /* AXIS_MAPPABLE_ */\n"
        "  uint8_t not_zero;  /* 1: 0 is refused, although it lies between min and max */\n"
        "  uint8_t in_cycle;  /* AXIS_IN_CYCLE_ */\n"
        "} axis_object_t;\n\n"
        "/* Indexed by object number; entry 0 is unused. Objects of type u32 carry the 32\n"
        " * bits of their values in min, max and initial. */\n"
        "extern const axis_object_t axis_objects[];\n\n"
    )
    out.append(
        "/* What lies at a CANopen address. */\n"
        "enum {\n"
        "  AXIS_ADDRESS_OBJECT = 0, /* value: the object's number */\n"
        "  AXIS_ADDRESS_COUNT = 1,  /* value: the highest sub-index, u8, read only */\n"
        "  AXIS_ADDRESS_TEXT = 2,   /* a text, read only */\n"
        "  AXIS_ADDRESS_DOMAIN = 3, /* bytes of any number, read only */\n"
        "  AXIS_ADDRESS_DOWNLOAD = 4 /* bytes of any number, write only */\n"
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
    out.append(
        "/* A stored object of version 0.1.0 that this table describes otherwise. */\n"
        "typedef struct {\n"
        "  uint32_t address; /* CANopen index times 256 plus sub-index; 0 ends the list */\n"
        "  int32_t initial;  /* its default then */\n"
        "  uint8_t fits;     /* 1: only the default is another, a stored value still fits */\n"
        "} axis_change_t;\n\n"
        "extern const axis_change_t axis_changes_0_1_0[];\n\n"
    )
    out.extend(map(enumeration, addresses_of_bits(table)))
    return guarded("axis_table", ["<stdint.h>"], "".join(out))


def generate_part_header(table, part):
    """Numbers, named values and structures of the objects of a part."""
    entries = [o for o in table.entries if o["part"] == part]
    out = ["/* Object numbers, the same in every interface of the firmware. */\nenum {\n"]
    out.extend(f"  AXIS_OBJ_{n.upper()} = {number},\n" for number, n, _, _ in expand(entries))
    out.append("};\n\n")
    for o in entries:
        out.extend(map(enumeration, constants_of(o)))
    for _, kind, type_name in (struct for struct in STRUCTS if struct[0] == part):
        # The widest members come first, so that the structure has no padding.
        fields = sorted(
            (o for o in entries if o["kind"] == kind), key=lambda o: -TYPES[o["type"]][0]
        )
        out.append("typedef struct {\n")
        for o in fields:
            array = f"[{o['count']}]" if o["count"] > 1 else ""
            out.append(
                f"  {TYPES[o['type']][3]} {o['name']}{array}; "
                f"/* {o['meaning']} [{describe_unit(o)}] */\n"
            )
        out.append(f"}} {type_name};\n\n")
    for comment, declaration, _ in arrays(table, part):
        out.append(f"/* {comment} */\nextern const {declaration};\n\n")
    includes = ["<stdint.h>", f'"{FOLDER}/axis_table.h"']
    return guarded(part_header(part), includes, "".join(out))


def generate_header(table):
    """All parts, and what changes with each object: numbers of objects, hashes."""
    entries, specials, digest = table.entries, table.specials, table.digest
    count = sum(o["count"] for o in entries)
    out = [f"enum {{ AXIS_OBJ_COUNT = {count + 1} /* one past the last number */ }};\n\n"]
    out.append(
        "/* First 32 bits of the SHA-256 of what the table means: addresses, names, types, units,\n"
        " * scales, ranges, access, names of values. Programs with the same one mean the same.\n"
        " * Defaults and wording are no part of it. */\n"
        f"#define AXIS_OBJECTS_HASH32 UINT32_C(0x{digest[:8]})\n"
        f'#define AXIS_OBJECTS_HASH_TEXT "{digest[:8]}"\n'
        "/* CRC-32 of name, type, unit and scale of each object that the force law computes "
        "with. */\n"
        f"#define AXIS_LAW_SIGNATURE UINT32_C(0x{law_signature(entries):08x})\n"
        "/* The table's hash of version 0.1.0, as its parameter sets carry it. */\n"
        f"#define AXIS_OBJECTS_HASH32_0_1_0 UINT32_C(0x{table.release.digest})\n\n"
    )
    counts = {
        "stored": sum(o["count"] for o in entries if o["stored"]),
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
        "extern const axis_register_t axis_input[AXIS_INPUT_COUNT];\n\n"
        "extern const axis_object_t axis_objects[AXIS_OBJ_COUNT];\n\n"
    )
    includes = [f'"{FOLDER}/{part_header(part)}.h"' for part in PARTS]
    return guarded("axis_objects", includes, "".join(out))


def generate_source(table):
    entries, specials = table.entries, table.specials
    out = [
        C_BANNER,
        f'#include "{FOLDER}/axis_objects.h"\n\n#include <stddef.h>\n\n',
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
            f"        UINT32_C(0x{signature(o) if o['stored'] else 0:08x}), "
            f"{offset}, {block}, AXIS_TYPE_{o['type'].upper()}, "
            f"AXIS_ACCESS_{o['access'].upper()}, AXIS_WRITABLE_{o['writable'].upper()}, "
            f"{int(o['stored'])}, {int(o['node_id'])}, {int(o['mappable'])}, "
            f"{int(o['not_zero'])}, AXIS_IN_CYCLE_{o['in_cycle'].upper()}}},\n"
        )
    out.append("};\n\n")
    for _, declaration, rows in (a for part in PARTS for a in arrays(table, part)):
        out.append(f"const {declaration} = {{\n")
        out.extend(f"    {row},\n" for row in rows)
        out.append("};\n\n")
    out.append("const axis_address_t axis_addresses[AXIS_ADDRESSES_COUNT] = {\n")
    for (index, sub), at in addresses(entries, specials).items():
        value = {
            "OBJECT": f"AXIS_OBJ_{at.name.upper()}",
            "COUNT": str(at.element),
        }.get(at.what, f"0x{index:04X}")
        out.append(f"    {{0x{index:04X}, {sub}, AXIS_ADDRESS_{at.what}, {value}}},\n")
    out.append("};\n")
    for space, writable in (("holding", True), ("input", False)):
        count = f"AXIS_{space.upper()}_COUNT"
        out.append(f"\nconst axis_register_t axis_{space}[{count}] = {{\n")
        out.extend(
            f"    {{0x{first:04X}, AXIS_OBJ_{name.upper()}}},\n"
            for first, _, name in registers(entries, writable)
        )
        out.append("};\n")
    out.append("\nconst axis_change_t axis_changes_0_1_0[] = {\n")
    out.extend(
        f"    {{0x{address:06X}, {c_int(as_int32(initial))}, {int(fits)}}},\n"
        for address, initial, fits in changes(table)
    )
    out.append("    {0, 0, 0},\n};\n")
    return "".join(out)


def array_of(comment, fields, name, type_name, rows):
    """A type and a constant array of it."""
    count = f"{name.upper()}_COUNT"
    members = "".join(f"  {field};{note and f' /* {note} */'}\n" for field, note in fields)
    body = "".join(f"    {{{', '.join(row)}}},\n" for row in rows)
    return (
        f"/* {comment} */\ntypedef struct {{\n{members}}} {type_name};\n\n"
        f"#define {count} {len(rows)}\n"
        f"static const {type_name} {name}[{count}] = {{\n{body}}};\n\n"
    )


def of_bits(table):
    rows = [
        (
            *map(str, (number, bit)),
            *(f'"{key}"', f'"{text}"'),
            f"UINT32_C({sum(1 << (mode + 16) for mode in modes)})",
        )
        for number, _, o, _ in expand(table.entries)
        for bit, key, text, modes in o["bits"]
    ]
    fields = (
        ("uint16_t object", ""),
        ("uint8_t bit", ""),
        ("const char *key", "snake case"),
        ("const char *text", ""),
        ("uint32_t modes", "modes of operation with this meaning: bits mode + 16; 0: all"),
    )
    return "Bits of the values.", fields, "axis_object_bits", "axis_object_bit_t", rows


def of_values(table):
    rows = [
        (*map(str, (number, value)), f'"{text}"', f'"{o["sentences"].get(text, "")}"')
        for number, _, o, _ in expand(table.entries)
        for value, text in o["values"]
    ]
    fields = (
        ("uint16_t object", ""),
        ("int32_t value", ""),
        ("const char *text", "snake case"),
        ("const char *sentence", "such as the cause of a fault, or empty"),
    )
    comment = "Names of single raw values, of objects that are no enum."
    return comment, fields, "axis_value_texts", "axis_value_text_t", rows


def of_states(table):
    rows = [
        (f"{mask:#04x}", f"{value:#04x}", f'"{text}"')
        for o in table.entries
        for mask, value, text in o["coding"]
    ]
    fields = (
        ("uint16_t mask", ""),
        ("uint16_t value", ""),
        ("const char *text", "for people"),
    )
    comment = "States of CiA 402: (statusword & mask) == value in exactly one of them."
    return comment, fields, "axis_status_states", "axis_status_state_t", rows


def of_refusals(table):
    rows = [
        (
            *(str(refusal["number"]), f'"{refusal["name"]}"', f'"{refusal["text"]}"'),
            f"{{{', '.join(f'UINT32_C({code:#010x})' for code in refusal['aborts']) or '0'}}}",
        )
        for refusal in table.refusals
    ]
    fields = (
        ("int32_t error", "FW_ERROR_"),
        ("const char *name", "snake case"),
        ("const char *text", "for people"),
        ("uint32_t aborts[4]", "SDO abort codes that say so; 0: no further one"),
    )
    return "Results of a refused access.", fields, "axis_refusals", "axis_refusal_t", rows


def generate_meta(table):
    entries, digest = table.entries, table.digest
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
        f"  const char *part;       /* {', '.join(PARTS)} */\n"
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
        "  const char *title;      /* CANopen's name */\n"
        "  int node_id;            /* a COB-ID to whose default the node id is added */\n"
        "  int mappable;           /* AXIS_MAPPABLE_ */\n"
        "  const char *quantity;   /* force or encoder: of what a count is a step */\n"
        "  const char *in_cycle;   /* free, ends, refused: a change while a cycle runs */\n"
        "} axis_object_meta_t;\n\n"
    )
    objects = sorted(expand(entries), key=lambda object: object[0])
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
            f'{int(o["stored"])}, "{title(o, i)}", {int(o["node_id"])}, {int(o["mappable"])}, '
            f'"{o["quantity"]}", "{o["in_cycle"]}"}},\n'
        )
    out.append("};\n\n")
    for rows in (of_bits(table), of_values(table), of_states(table), of_refusals(table)):
        out.append(array_of(*rows))
    out.append(
        "/* Stored objects of version 0.1.0 at whose addresses there is none any more. */\n"
        "typedef struct {\n"
        "  uint32_t address; /* CANopen index times 256 plus sub-index; 0 ends the list */\n"
        "  const char *name;\n"
        "} axis_former_name_t;\n\n"
        "static const axis_former_name_t axis_former_names[] = {\n"
    )
    out.extend(f'    {{0x{address:06X}, "{name}"}},\n' for address, name in former_names(table))
    out.append('    {0, ""},\n};\n\n')
    out.append(
        "/* Single bits of Modbus. */\n"
        "typedef struct {\n"
        "  uint16_t address;\n"
        "  const char *name;    /* snake case */\n"
        "  const char *meaning; /* one sentence */\n"
        "} axis_bit_meta_t;\n"
    )
    for name, bits in (("coils", table.coils), ("discretes", table.discretes)):
        count = f"AXIS_{name.upper()}_META_COUNT"
        out.append(
            f"\n#define {count} {len(bits)}\n"
            f"static const axis_bit_meta_t axis_{name}_meta[{count}] = {{\n"
        )
        out.extend(f'    {{{b["address"]}, "{b["name"]}", "{b["meaning"]}"}},\n' for b in bits)
        out.append("};\n")
    out.append("\n#endif\n")
    return "".join(out)


def generate_gateway(table):
    """How a gateway configures an axis: for the gateway alone."""
    rows = [
        f"{{{tpdo['transmission']}, {tpdo['event_ms']}, "
        f"{{{', '.join('AXIS_OBJ_' + o['name'].upper() for o in tpdo['objects'])}}}}}"
        for tpdo in table.gateway["tpdo"]
    ]
    body = (
        f"#define AXIS_GATEWAY_NODE_ID {table.gateway['node_id']} /* its own, by default */\n"
        "/* First identifier of the SDO channels of the axis with node id 1. */\n"
        f"#define AXIS_GATEWAY_FIRST_SDO {table.gateway['first_sdo']:#x}\n\n"
        "typedef struct {\n"
        "  uint8_t transmission; /* 18xxh:2 */\n"
        "  uint16_t event_ms;    /* 18xxh:5; 0: left as it is */\n"
        "  uint16_t objects[4];  /* AXIS_OBJ_, in the order of the frame; NONE ends it */\n"
        "} axis_gateway_tpdo_t;\n\n"
        f"#define AXIS_GATEWAY_TPDO_COUNT {len(rows)}\n"
        "static const axis_gateway_tpdo_t axis_gateway_tpdos[AXIS_GATEWAY_TPDO_COUNT] = {\n"
        + "".join(f"    {row},\n" for row in rows)
        + "};\n\n"
    )
    return guarded("axis_gateway", [f'"{FOLDER}/axis_objects.h"'], body)


def generate(table):
    """{path below the root: text}"""
    gateway = {f"{FOLDER}/axis_gateway.h": generate_gateway(table)} if table.gateway else {}
    return {
        **gateway,
        f"{FOLDER}/axis_table.h": generate_table_header(table),
        **{f"{FOLDER}/{part_header(part)}.h": generate_part_header(table, part) for part in PARTS},
        f"{FOLDER}/axis_objects.h": generate_header(table),
        f"{FOLDER}/axis_objects.c": generate_source(table),
        f"{FOLDER}/axis_objects_meta.h": generate_meta(table),
    }
