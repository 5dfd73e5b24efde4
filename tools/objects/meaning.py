"""The meaning of raw values: the table's hash for clients, and the signatures that decide whether a
stored value is used.

Wording (meaning, title), the order of the table, comments and defaults are no part of it. A default
is not, because clients do not depend on the value at power-up, and a stored set holds the defaults
it was written with.
"""

import hashlib
import json
import zlib

# The column `mappable` as a number: no PDO may carry the object; every PDO that its access allows
# may carry it; only a TPDO may carry it.
MAPPABLE = (False, True, "sent")


def set_mappable(o, permitted):
    """Sets o["mappable"] to a number of MAPPABLE; a text that says what is wrong with `permitted`.

    A PDO may carry what changes from tick to tick, not set-up parameters. A command has no value
    that a TPDO could send.
    """
    if permitted not in MAPPABLE or (permitted == "sent" and o["access"] != "rw"):
        return 'expected true, false, or "sent" of an object that is read and written'
    answers = o["kind"] == "command" and o["access"] != "wo"
    free = o["writable"] == "any" and not o["stored"]
    carried = bool(permitted) and o["part"] != "canopen" and free and not answers
    o["mappable"] = MAPPABLE.index(permitted) if carried else 0
    return None


def value_texts(o):
    """[(raw value, text)] of an object whose values have names."""
    return list(enumerate(o["enum"])) or [tuple(v) for v in o["values"]]


def signature_text(o):
    """The meaning of an object's raw values as a text."""
    names = ";".join(f"{value} {text}" for value, text in sorted(value_texts(o)))
    facts = (o["type"], o["unit"], repr(float(o["scale"])), o["min"], o["max"])
    return "|".join(map(str, (*facts, "+id" if o["node_id"] else "", names)))


def signature(o):
    """CRC-32 of that: equal where a value of one table may be used under the other."""
    return zlib.crc32(signature_text(o).encode())


def law_signature(entries):
    """CRC-32 of what the force law computes with: name, type, unit and scale of those objects."""
    facts = (
        (o["name"], o["type"], o["unit"], repr(float(o["scale"]))) for o in entries if o["law"]
    )
    return zlib.crc32("\n".join(sorted(map("|".join, facts))).encode())


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
        "specials": sorted(
            (s["index"], s["sub"], s["name"], s["type"], s["access"]) for s in specials
        ),
        "coils": sorted((b["address"], b["name"]) for b in coils),
        "discretes": sorted((b["address"], b["name"]) for b in discretes),
    }
    text = json.dumps(canonical, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
