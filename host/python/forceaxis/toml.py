"""TOML files, read by the same reader as models and experiments."""

import difflib
from pathlib import Path

from forceaxis import _core


def read(path: Path | str) -> dict:
    """The file's tables. Raises InputError: file, line, what was expected."""
    return _core.read_toml(str(path))


def read_text(text: str) -> dict:
    """The tables of a text. Raises InputError."""
    return _core.parse_toml(text)


def expect_keys(table, known, fail):
    """Refuse all keys but the known ones, at once, by fail(key, message), which raises."""
    unknown = [key for key in table if key not in known]
    if not unknown:
        return
    meant = [n for key in unknown for n in difflib.get_close_matches(key, known, 1)]
    hint = f"; did you mean {', '.join(dict.fromkeys(meant))}?" if meant else ""
    these = "this key" if len(unknown) == 1 else "these keys"
    fail(
        unknown[0],
        f"expected one of {', '.join(known)}, got {', '.join(unknown)}{hint}; "
        f"remove or rename {these}",
    )
