"""Units of the columns of a source of recordings: their size in SI units, and the unit at the end
of a column name."""

import re

from forceaxis import _core
from forceaxis.recordings.signal_recording import UNITS

# SI units that are tried for a signal whose name does not define its unit
SI_UNITS = (
    *dict.fromkeys(UNITS.values()),
    *("s", "Hz", "rad/s", "kg", "m/s^2", "N/s", "N/m", "ohm", "1"),
)
NO_UNIT = ("", "-", "1", "none", "None", "raw", "LSB", "codes", "counts", "inc")
IN_BRACKETS = re.compile(r"^(?P<name>.*?)\s*[\[(](?P<unit>[^\[\]()]*)[\])]\s*$")
# Units that a column name may have at its end, after "_".
# Other one-letter units are not accepted there, because the letter may belong to the name.
ENDINGS = {
    **{unit: unit for unit in ("s", "ms", "us", "ns", "N", "kN", "mN", "mm", "um", "m", "mV")},
    **{unit: unit for unit in ("V", "A", "mA", "Nm", "Hz", "count")},
    **{f"{length}_per_s": f"{length}/s" for length in ("m", "mm", "um")},
}


def plain(unit: str) -> str:
    """Returns a unit in the spelling that `quantity_in` accepts. `unit`: the unit in a usual
    spelling."""
    unit = unit.strip().replace("µ", "u").replace("μ", "u").replace("²", "^2").replace("·", " ")
    return {"Nm": "N m", "sec": "s", "msec": "ms", "m/s2": "m/s^2", "Newton": "N"}.get(unit, unit)


def factor_of(unit: str, wanted: str) -> float | None:
    """Returns the size of a unit in the SI unit `wanted`. Returns None if the unit measures another
    quantity. Instead of a unit, a quantity such as "0.5 um" may give the size of one count."""
    if wanted in ("1", "count") and unit.strip() in (*NO_UNIT, "count"):
        return 1.0
    text = plain(unit)
    size = _core.quantity_in(text if text[:1].isdigit() else f"1 {text}", wanted)
    return size if size and size > 0 else None


def si_unit_of(unit: str) -> tuple[str, float] | None:
    """Returns (SI unit, factor) of a unit. Returns None for an unknown unit. A column without a
    unit has the SI unit "1"."""
    if unit.strip() in NO_UNIT:
        return "1", 1.0
    for wanted in SI_UNITS:
        if factor := factor_of(unit, wanted):
            return wanted, factor
    return None


def is_unit(text: str) -> bool:
    """Returns True if a text is a unit, or a text that means that a column has no unit."""
    return si_unit_of(text) is not None or text.strip() in ("%", "bar", "degC", "°C", "rpm")


def split_name(header: str) -> tuple[str, str | None]:
    """Splits the text above a column, such as "Fz [N]", "Fz (N)" or "Fz_N", into (name, unit). The
    unit is None if the text contains none."""
    text = header.strip().strip('"').strip()
    if found := IN_BRACKETS.match(text):
        return found["name"].strip(), found["unit"].strip()
    for ending, unit in sorted(ENDINGS.items(), key=lambda one: -len(one[0])):
        if text.endswith(f"_{ending}"):
            return text, unit
    return text, None
