"""The electronic data sheet (EDS) of CiA 306, from which a CANopen master knows the objects of an
axis, and the device configuration file (DCF) of an axis behind a gateway.

Only keys of the standard: units are in the manual and in the DBC."""

from objects.table import TABLE, TYPES, addresses, bit_texts, canopen_address, expand, fail, title

FILE = "firmware/objects/generated/forceaxis.eds"
GATEWAY_FILE = "firmware/objects/generated/forceaxis-gateway.dcf"

DATA_TYPES = {"i8": 2, "i16": 3, "i32": 4, "u8": 5, "u16": 6, "u32": 7}
SPECIAL_DATA_TYPES = {"TEXT": 9, "DOMAIN": 15, "DOWNLOAD": 15}
DOMAIN, VARIABLE, ARRAY, RECORD = 2, 7, 8, 9
MANDATORY = (0x1000, 0x1001, 0x1018)
BAUD_RATES = (10, 20, 50, 125, 250, 500, 800, 1000)
TPDO_OFF = 1 << 31  # bit of a COB-ID
SLOWEST_BAUD_RATE = 125  # kbit/s; at lower rates the default PDOs of one axis fill the bus


def section(name, keys):
    return f"[{name}]\n" + "".join(f"{key}={value}\n" for key, value in keys) + "\n"


def file_info(file):
    # A fixed date, so that equal tables generate equal files.
    yield "FileName", file.rpartition("/")[2]
    yield "FileVersion", 1
    yield "FileRevision", 1
    yield "EDSVersion", "4.0"
    yield "Description", "force-controlled axis"
    for what in ("Creation", "Modification"):
        yield f"{what}Time", "12:00AM"
        yield f"{what}Date", "01-01-2026"
        yield ("CreatedBy" if what == "Creation" else "ModifiedBy"), "tools/gen_objects.py"
    if file == GATEWAY_FILE:
        yield "LastEDS", FILE.rpartition("/")[2]


def commissioning():
    """The node of the DCF. Its values follow $NODEID, so another id may be written here."""
    yield "NodeID", 1
    yield "NodeName", "axis_1"
    yield "Baudrate", BAUD_RATES[-1]
    yield "NetNumber", 1
    yield "NetworkName", ""
    yield "CANopenManager", 0
    yield "LSS_SerialNumber", 0


def device_info(found):
    def identity(sub):
        at = found.get((0x1018, sub))
        return f"0x{at.entry['defaults'][at.element]:08X}" if at else "0x00000000"

    def count(first):
        return len({index for index, _ in found if first <= index < first + 0x200})

    yield "VendorName", "forceaxis"
    yield "VendorNumber", identity(1)
    yield "ProductName", "forceaxis axis"
    yield "ProductNumber", identity(2)
    yield "RevisionNumber", identity(3)
    yield "OrderCode", "forceaxis"
    for rate in BAUD_RATES:
        yield f"BaudRate_{rate}", int(rate >= SLOWEST_BAUD_RATE)
    yield "SimpleBootUpMaster", 0
    yield "SimpleBootUpSlave", 1
    yield "Granularity", 8
    yield "DynamicChannelsSupported", 0
    yield "GroupMessaging", 0
    yield "NrOfRXPDO", count(0x1400)
    yield "NrOfTXPDO", count(0x1800)
    yield "LSS_Supported", 1


def literal(o, value):
    """A value in the notation of data sheets: COB-IDs, mappings and bit fields in hexadecimal."""
    width = TYPES[o["type"]][0]
    if o["part"] == "canopen" and o["type"] == "u32":
        return f"0x{value:0{2 * width}X}"
    return str(value)


def variable(at, configured=None):
    """Keys of one value; `configured` is the value that a master writes, or None."""
    if at.what == "COUNT":
        yield "ParameterName", "Highest sub-index supported"
        yield "ObjectType", f"0x{VARIABLE:X}"
        yield "DataType", f"0x{DATA_TYPES['u8']:04X}"
        yield "AccessType", "const"
        yield "DefaultValue", at.element
        yield "PDOMapping", 0
        return
    if at.what in SPECIAL_DATA_TYPES:
        yield "ParameterName", at.entry["title"]
        yield "ObjectType", f"0x{VARIABLE if at.what == 'TEXT' else DOMAIN:X}"
        yield "DataType", f"0x{SPECIAL_DATA_TYPES[at.what]:04X}"
        yield "AccessType", at.entry["access"]
        yield "PDOMapping", 0
        return
    o, default = at.entry, at.entry["defaults"][at.element]
    inside = o["min"] <= default <= o["max"]
    _, lowest, highest, _ = TYPES[o["type"]]
    yield "ParameterName", title(o, at.element)
    yield "ObjectType", f"0x{VARIABLE:X}"
    yield "DataType", f"0x{DATA_TYPES[o['type']]:04X}"
    yield "AccessType", "rwr" if o["mappable"] == 2 else o["access"]  # CiA 306: a PDO may send it
    # The value that is read from a command differs from the written value, so it has no limits.
    if inside or o["access"] == "wo":
        if o["min"] > lowest:
            yield "LowLimit", literal(o, o["min"])
        if o["max"] < highest:
            yield "HighLimit", literal(o, o["max"])
    if o["access"] != "wo":
        text = literal(o, default)
        yield "DefaultValue", f"$NODEID+{text}" if o["node_id"] else text
    if configured is not None:
        text = literal(o, configured)
        yield "ParameterValue", f"$NODEID+{text}" if o["node_id"] else text
    yield "PDOMapping", int(o["mappable"] != 0)


def is_array(subs):
    """Whether all elements are alike, where the table does not state it."""
    return len({at.entry["type"] for sub, at in subs.items() if sub}) == 1


def check_titles(names):
    """Readers look objects up by name: the names of one dictionary or record are different."""
    seen = {}
    for where, name in names:
        if name in seen:
            other = seen[name]
            fail(f"object at {where}", "title", f"expected another than {name}, which {other} has")
        seen[name] = where


def title_of(o, index):
    """Name of one of the indices that an entry lies at: numbered, if there are several."""
    if not o.get("index_step") and o.get("per_index") == o.get("count"):
        return o["title"]
    return f"{o['title']} {(index - o['index']) // (o['index_step'] or 1) + 1}"


def describe(index, subs, records, configured):
    """{section: keys} of an index; the first section is its own."""
    if set(subs) == {0}:
        keys = dict(variable(subs[0], configured.get((index, 0))))
        return {f"{index:04X}": keys | {"ParameterName": title_of(subs[0].entry, index)}}
    first = subs[min(sub for sub in subs if sub)]
    title, array = records.get(index, (title_of(first.entry, index), is_array(subs)))
    own = {
        "ParameterName": title,
        "ObjectType": f"0x{ARRAY if array else RECORD:X}",
        "SubNumber": len(subs),
    }
    members = {
        f"{index:04X}sub{sub:X}": dict(variable(at, configured.get((index, sub))))
        for sub, at in subs.items()
    }
    check_titles((name, keys["ParameterName"]) for name, keys in members.items())
    return {f"{index:04X}": own, **members}


def texts_of_bits(entries):
    """A line for each bit of the objects that have bits."""
    for _, _, o, i in expand(entries):
        index, sub = canopen_address(o, i)
        for text in bit_texts(o):
            yield f"{index:04X}:{sub:X} {title(o, i)}, {text}"


def list_of(index):
    if index in MANDATORY:
        return "MandatoryObjects"
    return "ManufacturerObjects" if 0x2000 <= index < 0x6000 else "OptionalObjects"


def configured_by_gateway(found, gateway):
    """{(index, sub-index): raw value} of the TPDOs of an axis behind a gateway."""
    values = {}
    for i, tpdo in enumerate(gateway["tpdo"]):
        communication, mapping, carried = 0x1800 + i, 0x1A00 + i, tpdo["objects"]
        at = found[communication, 1]
        values[communication, 1] = at.entry["defaults"][at.element] & ~TPDO_OFF
        values[communication, 2] = tpdo["transmission"]
        if tpdo["event_ms"]:
            values[communication, 5] = tpdo["event_ms"]
        values[mapping, 0] = len(carried)
        for sub, o in enumerate(carried, 1):
            values[mapping, sub] = o["index"] << 16 | o["sub"] << 8 | 8 * TYPES[o["type"]][0]
    return values


def generate(table):
    """{path below the root: text}"""
    found = addresses(table.entries, table.specials)
    files = {FILE: text_of(table, found, FILE, {})}
    if table.gateway:
        configured = configured_by_gateway(found, table.gateway)
        files[GATEWAY_FILE] = text_of(table, found, GATEWAY_FILE, configured)
    return files


def text_of(table, found, file, configured):
    """The content of a file; `configured`: values that a master writes, by their addresses."""
    objects = {}
    for (index, sub), at in found.items():
        objects.setdefault(index, {})[sub] = at
    described = {
        index: describe(index, subs, table.records, configured) for index, subs in objects.items()
    }
    check_titles((f"{i:04X}", d[f"{i:04X}"]["ParameterName"]) for i, d in described.items())
    comments = (
        "Generated by tools/gen_objects.py; do not edit.",
        f"Table {TABLE}",
        f"SHA-256 {table.digest}",
        *texts_of_bits(table.entries),
    )
    lines = [(f"Line{i}", comment) for i, comment in enumerate(comments, 1)]
    out = [
        section("FileInfo", file_info(file)),
        section("DeviceInfo", device_info(found)),
        *([section("DeviceComissioning", commissioning())] if configured else []),
        section("DummyUsage", ((f"Dummy{i:04X}", 1) for i in range(1, 8))),
        section("Comments", [("Lines", len(lines)), *lines]),
    ]
    for name in ("MandatoryObjects", "OptionalObjects", "ManufacturerObjects"):
        indices = [index for index in objects if list_of(index) == name]
        rows = ((i, f"0x{index:04X}") for i, index in enumerate(indices, 1))
        out.append(section(name, [("SupportedObjects", len(indices)), *rows]))
        for index in indices:
            out.extend(section(name, keys.items()) for name, keys in described[index].items())
    return "".join(out).rstrip("\n") + "\n"
