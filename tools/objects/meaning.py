"""What an object means to whoever exchanges its raw values: the table's hash, and the signatures by
which a stored value is judged.

Wording (meaning, title), the order of the table, comments and defaults are no part of it. A default
is not, because a client is right whatever an axis starts with, and a stored set knows the defaults
it was written against.
"""

import hashlib
import json
import zlib


def value_texts(o):
    """[(raw value, text)] of an object whose values have names."""
    return list(enumerate(o["enum"])) or [tuple(v) for v in o["values"]]


def signature_text(o):
    """What a raw value of an object stands for, as text."""
    names = ";".join(f"{value} {text}" for value, text in sorted(value_texts(o)))
    facts = (o["type"], o["unit"], repr(float(o["scale"])), o["min"], o["max"])
    return "|".join(map(str, (*facts, "+id" if o["node_id"] else "", names)))


def signature(o):
    """CRC-32 of that: equal where a value of one table may be used under the other."""
    return zlib.crc32(signature_text(o).encode())


def digest(objects, specials, coils, discretes):
    """SHA-256 of a table's meaning. objects: (index, sub-index, name, register, entry) of each."""
    rows = [
        (
            *(index, sub, name, register, o["kind"], signature_text(o)),
            *(o["access"], o["writable"], o["stored"], o["mappable"]),
        )
        for index, sub, name, register, o in objects
    ]
    canonical = {
        "objects": sorted(rows),
        "specials": sorted((s["index"], s["name"], s["type"]) for s in specials),
        "coils": sorted((b["address"], b["name"]) for b in coils),
        "discretes": sorted((b["address"], b["name"]) for b in discretes),
    }
    text = json.dumps(canonical, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
