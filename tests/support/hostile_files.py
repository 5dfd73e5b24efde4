"""Hostile files: mutations that know the structure of a format, and mutations of bytes."""

import copy
import csv
import io
import json

import numpy as np

DEEP = "\0deep\0"  # stands for a value that is nested too deeply
ODD = [
    None, True, False, 0, -1, 1, 2**31, 2**63, -(2**63) - 1, 10**30, 1e-320, 1e300, -1e300,
    float("inf"), float("nan"), "", "x", "0", "x" * 5000, "\u0000\u202e", "NaN", [], {}, [[]],
    [{}], {"x": 1}, [1, "x"], DEEP,
]  # fmt: skip


def of_bytes(data, random):
    """Returns bytes with one to three small errors."""
    found = bytearray(data)
    for _ in range(random.randint(1, 3)):
        at = random.randrange(len(found) + 1)
        kind = random.randrange(5)
        if kind == 0 and found:
            found[at % len(found)] ^= 1 << random.randrange(8)
        elif kind == 1:
            del found[at : at + random.choice([1, 4, 100, len(found)])]
        elif kind == 2:
            found[at:at] = random.randbytes(random.choice([1, 4, 16]))
        elif kind == 3:
            found[at:at] = found[at : at + random.choice([4, 64])]
        else:
            found[at : at + 4] = random.choice(
                [b"\xff\xff\xff\xff", b"\0\0\0\0", b"\x7f\xff\xff\xff"]
            )
    return bytes(found)


def places(value, at=()):
    """Returns the places of all values in nested tables and lists."""
    found = [at] if at else []
    items = value.items() if isinstance(value, dict) else enumerate(value)
    for key, inner in items:
        if isinstance(inner, dict | list):
            found += places(inner, (*at, key))
        else:
            found.append((*at, key))
    return found


def of_tree(tree, random):
    """Returns a copy of nested tables and lists in which one to three values are odd, missing,
    doubled or renamed."""
    tree = copy.deepcopy(tree)
    for _ in range(random.randint(1, 3)):
        every = places(tree)
        if not every:
            break
        *way, key = random.choice(every)
        holder = tree
        for step in way:
            holder = holder[step]
        kind = random.randrange(4)
        if kind == 0:
            del holder[key]
        elif kind == 1 and isinstance(holder, dict):
            holder[random.choice(["x", "", "name", "format"])] = holder.pop(key)
        elif kind == 1:
            holder.insert(key, holder[key])
        else:
            holder[key] = copy.deepcopy(random.choice(ODD))
    return tree


def json_text(tree):
    """Returns JSON, with `DEEP` as a list in a list for 100,000 times, and 1e400 for infinity."""
    text = json.dumps(tree).replace("Infinity", "1e400")
    return text.replace(json.dumps(DEEP), "[" * 100_000 + "]" * 100_000).encode()


def toml_value(value):
    match value:
        case None:
            return "{}"
        case bool():
            return str(value).lower()
        case float() | int():
            return repr(value)
        case str():
            return "[" * 5000 + "]" * 5000 if value == DEEP else json.dumps(value)
        case list():
            return "[" + ", ".join(map(toml_value, value)) + "]"
        case dict():
            inner = (f"{json.dumps(str(k))} = {toml_value(v)}" for k, v in value.items())
            return "{" + ", ".join(inner) + "}"
    return str(value)


def toml_text(tree):
    """Returns TOML, with all inner tables in one line."""
    return "".join(f"{json.dumps(str(k))} = {toml_value(v)}\n" for k, v in tree.items()).encode()


def of_rows(text, random):
    """Returns the text of a CSV file with odd cells, rows and names."""
    rows = list(csv.reader(io.StringIO(text.decode())))
    for _ in range(random.randint(1, 3)):
        row = random.choice([0, random.randrange(len(rows))])
        kind = random.randrange(5)
        if kind == 0:
            del rows[row]
        elif kind == 1:
            rows.insert(row, rows[row][: random.randrange(len(rows[row]) + 1)])
        elif kind == 2:
            del rows[1:]
        elif rows[row]:
            odd = random.choice([*map(str, ODD), "1e400", "1,5", "=1", '"', "9" * 400])
            rows[row][random.randrange(len(rows[row]))] = odd
        if not rows:
            return b""
    out = io.StringIO()
    csv.writer(out).writerows(rows)
    return out.getvalue().encode("utf-8", "surrogatepass")


def odd_array(values, random):
    """Returns an array of another kind, size or content."""
    return random.choice([
        lambda: values[:0], lambda: values[:1], lambda: values[:-1], lambda: values[::-1],
        lambda: values * np.nan, lambda: values * 0, lambda: values * 1e200,
        lambda: np.where(np.arange(values.size) % 7, values.ravel(), np.inf),
        lambda: values.astype("S8"), lambda: values.astype("U"), lambda: values.astype(bool),
        lambda: values.astype(np.float16), lambda: values.astype(complex), lambda: values[None],
        lambda: np.array(values.ravel()[:1].sum()), lambda: values.astype("M8[us]"),
        lambda: np.array([("a", 1)], dtype=[("x", "U1"), ("y", "i4")]),
        lambda: np.full(values.shape, 2**63 - 1, np.uint64),
    ])()  # fmt: skip


def of_arrays(arrays, random):
    """Returns arrays of which one to three are odd, missing or renamed."""
    arrays = dict(arrays)
    for _ in range(random.randint(1, 3)):
        if not arrays:
            break
        name = random.choice(sorted(arrays))
        kind = random.randrange(5)
        if kind == 0:
            del arrays[name]
        elif kind == 1:
            arrays[random.choice(["x", "time_s", "a/b", "é"])] = arrays.pop(name)
        elif arrays[name].dtype.kind in "fiu":
            with np.errstate(all="ignore"):
                arrays[name] = odd_array(np.atleast_1d(arrays[name]).astype(float), random)
    return arrays


def npz(arrays):
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()
