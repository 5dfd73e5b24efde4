"""The frames of nodes 1 to 6 as a DBC, for CAN analysers: with the default PDOs, and as a gateway
configures the nodes."""

from objects.meaning import value_texts
from objects.table import TYPES, addresses, fail, number

FILE = "firmware/objects/generated/forceaxis.dbc"
GATEWAY_FILE = "firmware/objects/generated/forceaxis-gateway.dbc"

NODES = range(1, 7)
HOST = "HOST"
NMT_COMMANDS = {
    1: "start",
    2: "stop",
    128: "enter_pre_operational",
    129: "reset_node",
    130: "reset_communication",
}
NMT_STATES = {0: "boot_up", 4: "stopped", 5: "operational", 127: "pre_operational"}
NMT_ID, HEARTBEAT_ID = 0, 0x700
SDOS_OF_AXIS = 4  # identifiers of the SDO channels of a gateway to an axis
SYNC_INDEX, EMCY_INDEX, HEARTBEAT_INDEX = 0x1005, 0x1014, 0x1017
ERROR_REGISTER_INDEX, ERROR_CODE_INDEX = 0x1001, 0x603F


class Signal:
    """One field of a frame, little-endian."""

    def __init__(self, name, bits, meaning, texts=(), signed=False, scale=1, span=None, unit=""):
        self.name, self.bits, self.meaning, self.texts = name, bits, meaning, texts
        self.signed, self.scale, self.unit = signed, scale, unit
        self.span = span or (0, (1 << bits) - 1)

    @classmethod
    def of(cls, name, o):
        return cls(
            name,
            8 * TYPES[o["type"]][0],
            o["meaning"],
            value_texts(o),
            o["type"][0] == "i",
            o["scale"],
            (o["min"], o["max"]),
            "" if o["unit"] == "1" else o["unit"],
        )


class Message:
    def __init__(self, cob_id, name, sender, signals, meaning, cycle_ms=0):
        self.cob_id, self.name, self.sender, self.signals = cob_id, name, sender, signals
        self.meaning, self.cycle_ms = meaning, cycle_ms


def default(found, index, sub):
    at = found.get((index, sub))
    return at.entry["defaults"][at.element] if at and at.what == "OBJECT" else None


def mapped(found, index, receive):
    """Signals of the default mapping at 1600h.. or 1A00h.."""
    signals = []
    for sub in range(1, (default(found, index, 0) or 0) + 1):
        at = found.get((index, sub))
        value = default(found, index, sub) or 0
        label = f"object {at.name if at else f'{index:#x}:{sub}'}"
        target = found.get((value >> 16, value >> 8 & 0xFF))
        if not target or target.what != "OBJECT":
            fail(label, "default", f"expected a mapped object, got {value:#010x}")
        o = target.entry
        if value & 0xFF != 8 * TYPES[o["type"]][0]:
            fail(label, "default", f"expected the {8 * TYPES[o['type']][0]} bits of {target.name}")
        refused = o["mappable"] != 1 if receive else not o["mappable"]
        if refused or o["access"] == ("ro" if receive else "wo"):
            fail(label, "default", f"expected an object that a PDO may carry, got {target.name}")
        signals.append(Signal.of(target.name, o))
    if sum(s.bits for s in signals) > 64:
        fail(f"object at {index:#x}", "defaults", "expected at most 64 bits")
    return signals


def cob_id(found, index, sub, node):
    """The default one of a node, whether switched on or not."""
    at = found.get((index, sub))
    if not at or at.what != "OBJECT":
        return None
    return (at.entry["defaults"][at.element] & 0x7FF) + (node if at.entry["node_id"] else 0)


def pdos(found, node):
    """The default PDOs."""
    for first, kind in ((0x1800, "TPDO"), (0x1400, "RPDO")):
        for i in range(4):
            cob = cob_id(found, first + i, 1, node)
            if cob is None:
                continue
            receive = kind == "RPDO"
            signals = mapped(found, first + i + 0x200, receive)
            off = default(found, first + i, 1) >> 31
            meaning = "default mapping" + ("; off until it is switched on" if off else "")
            cycle = 0 if receive or off else default(found, first + i, 5) or 0
            sender = HOST if receive else f"AXIS{node}"
            yield Message(cob, f"AXIS{node}_{kind}{i + 1}", sender, signals, meaning, cycle)


def pdos_of_gateway(found, gateway, node):
    """The PDOs as a gateway configures them: only the TPDOs differ from the default ones."""
    for i, tpdo in enumerate(gateway["tpdo"]):
        signals = [Signal.of(o["name"], o) for o in tpdo["objects"]]
        cob, name = cob_id(found, 0x1800 + i, 1, node), f"AXIS{node}_TPDO{i + 1}"
        yield Message(cob, name, f"AXIS{node}", signals, "mapped by a gateway", tpdo["event_ms"])
    yield from (m for m in pdos(found, node) if m.sender == HOST)


def sdos(found, gateway, node):
    """Requests and answers of SDO. The bytes after the first one have a meaning that depends on
    earlier frames of the transfer, which a DBC cannot express."""
    channels = {"SDO": tuple(cob_id(found, 0x1200, sub, node) for sub in (1, 2))}
    if gateway:
        first = gateway["first_sdo"] + SDOS_OF_AXIS * (node - 1)
        channels |= {"SDO_MODBUS": (first, first + 1), "SDO_LCM": (first + 2, first + 3)}
    for name, (request, answer) in channels.items():
        for cob, kind, sender in (
            (request, "REQUEST", HOST), (answer, "ANSWER", f"AXIS{node}"),
        ):  # fmt: skip
            if cob is not None:
                signals = [
                    Signal("sdo_command", 8, "command specifier of CiA 301, or a block's number"),
                    Signal("sdo_content", 56, "index, sub-index and data, or a segment"),
                ]
                yield Message(cob, f"AXIS{node}_{name}_{kind}", sender, signals, "SDO transfer")


def heartbeat(name, node, sender, period):
    state = Signal("nmt_state", 8, "state of the node", list(NMT_STATES.items()))
    return Message(HEARTBEAT_ID + node, name, sender, [state], "boot-up, heartbeat", period)


def messages(found, gateway=None):
    """Every frame of the nodes; as `gateway` configures them, if it is not None."""
    error_code = found.get((ERROR_CODE_INDEX, 0))
    codes = value_texts(error_code.entry) if error_code else []
    register = found.get((ERROR_REGISTER_INDEX, 0))
    command = Signal("nmt_command", 8, "what to do", list(NMT_COMMANDS.items()))
    target = Signal("nmt_node", 8, "node id; 0: all")
    yield Message(NMT_ID, "NMT", HOST, [command, target], "network management")
    sync = cob_id(found, SYNC_INDEX, 0, 0)
    if sync:
        yield Message(sync, "SYNC", HOST, [], "synchronisation")
    if gateway:
        yield heartbeat("GATEWAY_HEARTBEAT", gateway["node_id"], HOST, 0)
    for node in NODES:
        axis = f"AXIS{node}"
        emcy = cob_id(found, EMCY_INDEX, 0, node)
        if emcy:
            signals = [
                Signal("emcy_code", 16, "error code; none: an error has gone", codes),
                Signal("emcy_register", 8, register.entry["meaning"] if register else ""),
                Signal("emcy_info", 8, "the fault, or what else the code stands for"),
            ]
            yield Message(emcy, f"{axis}_EMCY", axis, signals, "emergency")
        yield from pdos_of_gateway(found, gateway, node) if gateway else pdos(found, node)
        yield from sdos(found, gateway, node)
        period = 0 if gateway else default(found, HEARTBEAT_INDEX, 0) or 0
        yield heartbeat(f"{axis}_HEARTBEAT", node, axis, period)


def generate(table):
    """{path below the root: text}"""
    found = addresses(table.entries, table.specials)
    files = {FILE: text_of(table, messages(found), "Default PDOs of forceaxis nodes 1 to 6")}
    if table.gateway:
        title = "Forceaxis nodes 1 to 6 behind a gateway"
        files[GATEWAY_FILE] = text_of(table, messages(found, table.gateway), title)
    return files


def text_of(table, found, title):
    nodes = [HOST, *(f"AXIS{node}" for node in NODES)]
    out = ['VERSION ""\n\nNS_ :\n\nBS_:\n\n', f"BU_: {' '.join(nodes)}\n\n"]
    comments = [f'CM_ "{title}. Generated by tools/gen_objects.py; object table {table.digest}";\n']
    values, cycles = [], []
    for m in sorted(found, key=lambda m: m.cob_id):
        size = sum(s.bits for s in m.signals) // 8
        if m.name.endswith("_EMCY"):
            size = 8  # the last four bytes are 0
        out.append(f"BO_ {m.cob_id} {m.name}: {size} {m.sender}\n")
        if m.sender != HOST:
            receivers = HOST
        elif "_" in m.name:
            receivers = m.name.partition("_")[0]
        else:
            receivers = ",".join(nodes[1:])
        start = 0
        for s in m.signals:
            low, high = (number(v * s.scale) for v in s.span)
            out.append(
                f" SG_ {s.name} : {start}|{s.bits}@1{'-' if s.signed else '+'} "
                f'({number(s.scale)},0) [{low}|{high}] "{s.unit}" {receivers}\n'
            )
            start += s.bits
            comments.append(f'CM_ SG_ {m.cob_id} {s.name} "{s.meaning}";\n')
            if s.texts:
                texts = "".join(f'{value} "{text}" ' for value, text in s.texts)
                values.append(f"VAL_ {m.cob_id} {s.name} {texts};\n")
        out.append("\n")
        comments.append(f'CM_ BO_ {m.cob_id} "{m.meaning}";\n')
        if m.cycle_ms:
            cycles.append(f'BA_ "GenMsgCycleTime" BO_ {m.cob_id} {m.cycle_ms};\n')
    attributes = [
        'BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;\n',
        'BA_DEF_DEF_ "GenMsgCycleTime" 0;\n',
    ]
    return "".join([*out, *comments, *attributes, *cycles, *values])
