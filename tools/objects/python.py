"""The same for Python: host/python/forceaxis/objects.py."""

import json

from objects.table import banner, canopen_address, expand, register, title

FILE = "host/python/forceaxis/objects.py"


def generate_python(table):
    entries, digest = table.entries, table.digest
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
        "    stored: bool  # kept by the parameter store\n"
        "    title: str  # CANopen's name\n"
        "    node_id: bool  # a COB-ID to whose default the node id is added\n"
        "    mappable: bool  # a PDO may carry it, as far as its access allows\n"
        "    values: tuple[tuple[int, str], ...]  # names of some raw values, where no enum\n\n\n"
        "class AxisBit(NamedTuple):\n"
        '    """A coil or a discrete input of Modbus."""\n\n'
        "    address: int\n    name: str\n    meaning: str\n\n\n"
        f'OBJECTS_HASH = "{digest}"\n\nOBJECTS = (\n',
    ]
    for number, name, o, i in expand(entries):
        q = json.dumps
        index, sub = canopen_address(o, i)
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
            ("title", q(title(o, i))),
            ("node_id", o["node_id"]),
            ("mappable", o["mappable"]),
        ):
            out.append(f"        {key}={value},\n")
        values = [f"({value}, {q(text)})" for value, text in o["values"]]
        for key, texts in (("enum", [q(t) for t in o["enum"]]), ("values", values)):
            line = "(" + "".join(f"{t}, " for t in texts).rstrip() + ")"
            if len(line) <= 80:
                out.append(f"        {key}={line},\n")
            else:
                out.append(f"        {key}=(\n")
                out.extend(f"            {t},\n" for t in texts)
                out.append("        ),\n")
        out.append("    ),\n")
    out.append(")\n\nBY_NAME = {o.name: o for o in OBJECTS}\n")
    for name, bits in (("COILS", table.coils), ("DISCRETES", table.discretes)):
        out.append(f"\n{name} = (\n")
        for bit in bits:
            texts = ", ".join(json.dumps(bit[key]) for key in ("name", "meaning"))
            out.append(f"    AxisBit({bit['address']}, {texts}),\n")
        out.append(")\n")
    return "".join(out)


def generate(table):
    """{path below the root: text}"""
    return {FILE: generate_python(table)}
