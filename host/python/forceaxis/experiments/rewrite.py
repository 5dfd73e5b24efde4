"""Writes new values into the table [expect] of the text of an experiment."""

import difflib
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from forceaxis import toml
from forceaxis._core import InputError
from forceaxis.experiments.expect import (
    TOLERANCES,
    Examined,
    ExpectationCheck,
    Number,
    Obtained,
    Tolerance,
)

# Keys that an update adds to an empty table [expect].
FILLED_KEYS = ("verdict", "peak_force_N", "held_force_N", "final_value", "settle_s", "trace_hash")


def bare(checks: Sequence[ExpectationCheck]) -> bool:
    """Returns True if [expect] is empty or contains only the verdict. An update then adds keys to
    the table."""
    return all(check.key == "verdict" for check in checks)


def filled(text: str, values: Mapping[str, Obtained], checks: Sequence[ExpectationCheck]) -> str:
    """Returns the text of an experiment with the missing keys of FILLED_KEYS. They are added below
    the text line [expect]."""
    there = [check.key for check in checks]
    lines = [
        f"{key} = {json.dumps(written(values[key], TOLERANCES.get(key)))}\n"
        for key in FILLED_KEYS
        if values[key] is not None and key not in there
    ]
    return re.sub(
        r"^[ \t]*\[expect\][ \t]*(#.*)?(\n|\Z)",
        lambda header: header[0].rstrip("\n") + "\n" + "".join(lines),
        text,
        count=1,
        flags=re.M,
    )


def updated(text: str, examined: Examined) -> str:
    """Returns the text of an experiment with new expected values. If the run does not match a
    value, the value of the run replaces it. Limits are requirements and do not change."""
    import tomlkit

    try:
        document = tomlkit.parse(text)
    # tomlkit may refuse a text that the TOML reader of experiments accepts
    except tomlkit.exceptions.ParseError as error:
        file = examined.run.experiment
        raise InputError(f"{file}: file: expected TOML that can be edited, got: {error}") from None
    table = document["expect"]
    for check in [c for c in examined.checks if (not c.passed or c.warning) and c.agrees is None]:
        entry, allowed = table[check.key], TOLERANCES.get(check.key)
        if isinstance(check.expected, Number) and check.expected.value is None:
            continue
        if isinstance(entry, dict) and isinstance(check.obtained, float):
            own = {name: float(number) for name, number in entry.items() if name != "value"}
            entry["value"] = written(check.obtained, Tolerance(**own) if own else allowed)
        else:
            table[check.key] = written(check.obtained, allowed)
    return tomlkit.dumps(document)


def rewritten(file: str | Path, text: str, examined: Examined) -> str:
    """Returns the result of filled() or updated(). The result has the line ends of the original
    text.

    Raises InputError if a change outside of [expect] would be needed.
    """
    crlf = text.count("\r\n") == text.count("\n")
    old = text.replace("\r\n", "\n") if crlf else text
    new = updated(old, examined) if examined.checks else old
    if bare(examined.checks):
        new = filled(new, examined.measured.values, examined.checks)
    changes = difflib.SequenceMatcher(None, old.splitlines(), new.splitlines(), autojunk=False)
    lost = sum(end - start for kind, start, end, *_ in changes.get_opcodes() if kind != "equal")
    before, after = ({**toml.read_text(t), "expect": None} for t in (old, new))
    changed = sum(not c.passed or bool(c.warning) for c in examined.checks)
    filled_nothing = new == old and not examined.checks
    if before != after or lost > changed or filled_nothing:
        raise InputError(
            f"{file}: expect: expected a table [expect] whose values can be replaced; write "
            "[expect] at the end of the file, on a separate line"
        )
    return new.replace("\n", "\r\n") if crlf else new


def written(value: Obtained, allowed: Tolerance | None) -> Obtained:
    """Returns a value as the file shows it. A number has the fewest decimals with which its error
    is at most a hundredth of the tolerance. `allowed`: the tolerance, or None for a text."""
    if not isinstance(value, float) or allowed is None:
        return value
    near = allowed.of(value) / 100
    short = (round(value, decimals) for decimals in range(17))
    return next((s for s in short if abs(s - value) <= near), value)
