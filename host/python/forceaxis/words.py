"""Functions that prepare numbers and texts for users: digits, plurals, control characters, and
suggestions for a misspelled name."""

import difflib
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

OptionValue = str | int | float | Path | None

# Characters that would control a terminal on which a text is printed.
# The set contains the control characters of ASCII and Latin-1, and some characters of Unicode.
# The characters of Unicode separate lines or paragraphs, or change the writing direction.
_OBEYED = re.compile("[\x00-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069]")


def plain(value: float, digits: int = 3) -> str:
    """Returns a number as text with `digits` significant digits, for a user.

    Numbers with five or more digits have separators of thousands (28,890). Numbers below 1e3 have
    an exponent if %g gives an exponent, and numbers from 1e7 on always have an exponent.
    """
    rounded = float(f"{value:.{digits}g}")
    if not 1e3 <= abs(rounded) < 1e7:
        return f"{value:.{digits}g}"
    decimals = max(0, digits - len(str(int(abs(rounded)))))
    text = f"{rounded:,.{decimals}f}"
    return text if abs(rounded) >= 1e4 else text.replace(",", "")


def printable(text: str, keep: str = "") -> str:
    """Makes a text from a bus or a file safe for a terminal. Each character that would control the
    terminal becomes a visible escape sequence (ESC becomes `\\x1b`). The characters in `keep` do
    not change."""
    return _OBEYED.sub(lambda c: c[0] if c[0] in keep else ascii(c[0])[1:-1], text)


def number(text: str | float) -> float:
    """Returns the number in a text that a user has written. Raises ValueError for a text that is
    not a number. A text with an underscore, such as 1_0, is also refused: Python would read it as
    10, but the user probably meant 1.0."""
    if "_" in str(text):
        raise ValueError(f"{text}: expected a number without underscores")
    return float(text)


def counted(number: int, noun: str) -> str:
    """Returns a number with a noun in singular or plural: "1 mode", "2 modes"."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def suggestion(name: str, known: Iterable[str]) -> str:
    """Returns the end of a message about an unknown name: "; did you mean NAME?", or an empty text
    if no known name is similar."""
    meant = difflib.get_close_matches(name, list(known), 2, 0.65)
    return f"; did you mean {' or '.join(meant)}?" if meant else ""


def option_words(**options: OptionValue | Sequence[OptionValue]) -> list[str]:
    """Returns the arguments of a Python function as words of a command line. For example,
    lcm_url="x" becomes the two words `--lcm-url` and `x`. True gives the option without a value,
    and a list gives the option once for each of its elements. None, False and an empty text give no
    option."""
    words = []
    for name, given in options.items():
        option = f"--{name.replace('_', '-')}"
        if isinstance(given, bool):
            words += [option] * given
        else:
            values = [given] if isinstance(given, OptionValue) else given
            words += [word for v in values if v not in (None, "") for word in (option, str(v))]
    return words
