"""Reads TOML files with the reader that also reads models and experiments. Also writes values as
TOML text."""

import datetime
import difflib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from forceaxis import _core

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    # Writable: type of the values that can be written as TOML text.
    Writable = (
        str | int | float | bool | Path | datetime.date | np.generic | NDArray[np.generic]
        | Sequence["Writable"] | Mapping[str, "Writable"]
    )  # fmt: skip

TomlValue = str | int | float | bool | datetime.date | list["TomlValue"] | dict[str, "TomlValue"]


def read(path: Path | str) -> dict[str, Any]:
    """Returns the tables of a TOML file. Raises InputError with file, line number and the expected
    content."""
    return _core.read_toml(str(path))


def read_text(text: str) -> dict[str, Any]:
    """Returns the tables of a TOML text. Raises InputError."""
    return _core.parse_toml(text)


def write_text(value: Mapping[str, Any]) -> str:
    """Returns a table as TOML text. Inner tables are written inline, and NumPy values as plain
    values. Raises TypeError for a value that TOML cannot represent."""
    return "".join(f"{value_text(str(key))} = {value_text(item)}\n" for key, item in value.items())


def value_text(value: "Writable") -> str:
    """Returns a value as TOML text. Raises TypeError for a value that TOML cannot represent."""
    if hasattr(value, "tolist"):  # an array or a scalar of NumPy
        value = value.tolist()
    match value:
        case bool():
            return str(value).lower()
        case int() | float():
            return repr(value)
        case str() | Path():
            return json.dumps(str(value), ensure_ascii=False)
        case datetime.date():
            return value.isoformat()
        case list() | tuple():
            return f"[{', '.join(map(value_text, value))}]"
        case Mapping():
            items = (f"{value_text(str(k))} = {value_text(v)}" for k, v in value.items())
            return f"{{{', '.join(items)}}}"
    raise TypeError(f"got {value!r}")


def expect_keys(
    table: Iterable[str], known: Sequence[str], fail: Callable[[str, str], NoReturn], kind: str = ""
) -> None:
    """Checks the keys of a table in a TOML file. If there are unknown keys, calls the function
    fail(key, message) once, with a message about all of them. fail() must raise an exception.
    `kind`: text that describes the known keys in the message, which otherwise lists them."""
    unknown = [key for key in table if key not in known]
    if not unknown:
        return
    meant = [n for key in unknown for n in difflib.get_close_matches(key, known, 1)]
    hint = f"; did you mean {', '.join(dict.fromkeys(meant))}?" if meant else ""
    these = "this key" if len(unknown) == 1 else "these keys"
    fail(
        unknown[0],
        f"expected {kind or 'one of ' + ', '.join(known)}, got {', '.join(unknown)}{hint}; remove "
        f"or rename {these}",
    )
