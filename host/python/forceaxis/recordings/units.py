"""Units of the columns of a source of recordings: their size in SI units, and the unit at the end
of a column name."""

import math
import re
from typing import NamedTuple

from forceaxis import _core
from forceaxis.recordings.signal_recording import UNITS

# SI units that are tried for a signal whose name does not define its unit
SI_UNITS = (
    *dict.fromkeys(UNITS.values()),
    *("s", "Hz", "rad/s", "kg", "m/s^2", "N/s", "N/m", "ohm", "1"),
)
NO_UNIT = ("", "-", "1", "none", "None", "raw", "LSB", "codes", "counts", "inc")
# Units that people write and that are not decimal multiples of SI units: {unit: (size, SI unit)}.
STANDARD_GRAVITY = 9.80665
POUND_FORCE_N = 4.4482216152605
INCH_M = 0.0254
CUSTOMARY = {
    **dict.fromkeys(("kgf", "kp", "kilopond"), (STANDARD_GRAVITY, "N")),
    **dict.fromkeys(("gf", "pond"), (STANDARD_GRAVITY * 1e-3, "N")),
    "tf": (STANDARD_GRAVITY * 1e3, "N"),
    "lbf": (POUND_FORCE_N, "N"),
    "ozf": (POUND_FORCE_N / 16, "N"),
    **dict.fromkeys(("klbf", "kip", "kips"), (POUND_FORCE_N * 1e3, "N")),
    "daN": (10.0, "N"),
    "GN": (1e9, "N"),
    "dyn": (1e-5, "N"),
    **dict.fromkeys(("inch", "inches", "in", "in.", "zoll"), (INCH_M, "m")),
    **dict.fromkeys(("mil", "mils", "thou"), (INCH_M * 1e-3, "m")),
    "dm": (0.1, "m"),
    **dict.fromkeys(("uin", "microinch", "microinches"), (INCH_M * 1e-6, "m")),
    **dict.fromkeys(("ft", "foot", "feet"), (12 * INCH_M, "m")),
    **dict.fromkeys(("yd", "yard"), (36 * INCH_M, "m")),
    "pm": (1e-12, "m"),
    "ips": (INCH_M, "m/s"),
    "ipm": (INCH_M / 60, "m/s"),
    "h": (3600.0, "s"),
    "Ncm": (0.01, "N m"),
}
# The same units without regard to capital letters, as in LBF. H is no hour, and IN is an input.
ANY_CASE = {unit.casefold(): size for unit, size in CUSTOMARY.items() if unit not in ("h", "in")}
# Units that are often used for a force and measure something else: {unit: unit of force}
NO_FORCES = {"kg": "kgf", "g": "gf", "t": "tf", "lb": "lbf", "lbs": "lbf", "oz": "ozf", "p": "gf"}
# Units with several sizes: {unit in lower case: these sizes}
AMBIGUOUS = dict.fromkeys(
    ("tonf", "ton-force", "ton", "tons"), "9806.65N (metric), 8896.443N (short) or 9964.016N (long)"
)
# Two units in a product or a quotient, such as "in-lbf" or "mm/sec"
PRODUCT = re.compile(r"^(?P<one>[A-Za-z]+)[ *.-](?P<two>[A-Za-z]+)$")
QUOTIENT = re.compile(r"^(?P<one>[A-Za-z]+)\s?/\s?(?P<two>[A-Za-z]+)$")
# Spellings of units: {spelling in lower case: unit}
SPELLINGS = {
    **dict.fromkeys(
        ("sec", "sec.", "secs", "second", "seconds", "sekunde", "sekunden", "sek"), "s"
    ),
    **dict.fromkeys(("msec", "millisecond", "milliseconds", "millisekunden"), "ms"),
    **dict.fromkeys(("usec", "microsecond", "microseconds", "mikrosekunden"), "us"),
    **dict.fromkeys(("nsec", "nanosecond", "nanoseconds"), "ns"),
    **dict.fromkeys(("minute", "minutes", "minuten", "min."), "min"),
    **dict.fromkeys(("hour", "hours", "hr", "stunden"), "h"),
    **dict.fromkeys(("volt", "volts"), "V"),
    **dict.fromkeys(("millivolt", "millivolts"), "mV"),
    **dict.fromkeys(("ampere", "amperes", "amp", "amps"), "A"),
    **dict.fromkeys(("newton", "newtons"), "N"),
    **dict.fromkeys(("kilonewton", "kilonewtons"), "kN"),
    **dict.fromkeys(("metre", "metres", "meter", "meters"), "m"),
    **dict.fromkeys(("millimetre", "millimetres", "millimeter", "millimeters"), "mm"),
    **dict.fromkeys(("micron", "microns", "micrometre", "micrometer"), "um"),
    "hertz": "Hz",
    "m/s2": "m/s^2",
    "m/s**2": "m/s^2",
}
# Units that are known by their names, but that no signal of a recording has.
OTHER_UNITS = ("%", "bar", "degC", "deg C", "°C", "°F", "K", "rpm", "deg", "°", "Pa", "MPa", "kPa",
               "W", "dB", "psi", "Value", "Sequence", "Index", "N/mm²", "N/mm^2")  # fmt: skip
IN_BRACKETS = re.compile(r"^(?P<name>.*?)\s*[\[(](?P<unit>[^\[\]()]*)[\])]\s*$")
INSIDE = re.compile(r"^(?P<name>.+?)\s*[\[(](?P<unit>[^\[\]()]+)[\])]\s*(?P<rest>\S.*)$")
EXPLAINED = re.compile(r"^(?P<unit>[^\[\]()]+?)\s*[\[(][^\[\]()]*[\])]$")  # such as N (Newton)
# A unit behind its name, such as "C1 in V", "Kraft / kN" or "Force, N"
BEHIND = re.compile(r"^(?P<name>.*?)(?:\s*[,/]\s*|(?:^|\s+)in\s+)(?P<unit>[^\s,]+)$")
NUMBER = re.compile(r"(\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?=\s*[A-Za-z])")  # in front of a unit
# Largest magnitude of the size of a unit and of an offset, and the inverse of the smallest size.
LARGEST = 1e100
# An offset behind a unit, such as N-250
OFFSET = re.compile(r"^(?P<unit>.*[^\d.eE^+-])(?P<offset>[-+]\d+(\.\d*)?([eE][-+]?\d+)?)$")
# Units that a column name may have at its end, after "_".
# Other one-letter units are not accepted there, because the letter may belong to the name.
ENDINGS = {
    **{unit: unit for unit in ("s", "ms", "us", "ns", "N", "kN", "mN", "mm", "um", "m", "mV")},
    **{unit: unit for unit in ("V", "A", "mA", "Nm", "Hz", "count")},
    **{unit: unit for unit in ("kgf", "gf", "kp", "lbf", "ozf", "daN", "MN", "inch", "mil")},
    **{f"{length}_per_s": f"{length}/s" for length in ("m", "mm", "um")},
}


class UnitText(NamedTuple):
    """A unit that a user has written, with an offset in this unit, such as "N-250"."""

    unit: str
    offset: float = 0.0


def plain(unit: str) -> str:
    """Returns a unit in the spelling that `quantity_in` accepts. `unit`: the unit in a usual
    spelling."""
    unit = unit.strip().replace("µ", "u").replace("μ", "u").replace("²", "^2").replace("·", " ")
    if found := EXPLAINED.match(unit):
        unit = found["unit"]
    unit = SPELLINGS.get(unit.casefold(), unit) if unit != "Nm" else "N m"
    return {"KN": "kN", "kNm": "kN m", "mNm": "mN m", "MM": "mm"}.get(unit, unit)


def factor_of(unit: str, wanted: str) -> float | None:
    """Returns the size of a unit in the SI unit `wanted`. Returns None if the unit measures another
    quantity. Instead of a unit, a quantity such as "0.5 um" may give the size of one count."""
    if wanted in ("1", "count") and unit.strip() in (*NO_UNIT, "count"):
        return 1.0
    text = plain(unit)
    number = NUMBER.match(text)
    count, alone = (float(number[0]), text[number.end() :].strip()) if number else (1.0, text)
    size, measured = CUSTOMARY.get(alone, (0.0, ""))
    found: float | None
    if measured:
        found = count * size if measured == wanted else None
    else:
        found = _core.quantity_in(text if text[:1].isdigit() else f"1 {text}", wanted)
        found = found or count * _composed(alone, wanted)
    return found if found and 1 / LARGEST <= found <= LARGEST else None


def _composed(unit: str, wanted: str) -> float:
    """Returns the size of a unit in capital letters, or of a product or a quotient of two units, in
    the SI unit `wanted`, and 0.0 for another unit."""
    size, measured = ANY_CASE.get(unit.casefold(), (0.0, ""))
    if measured == wanted:
        return size
    if wanted == "m/s" and (found := QUOTIENT.match(unit)):
        time_s = factor_of(found["two"], "s")
        return (factor_of(found["one"], "m") or 0.0) / time_s if time_s else 0.0
    if wanted == "N m" and (found := PRODUCT.match(unit)):
        for force, length in (("one", "two"), ("two", "one")):
            name = NO_FORCES.get(found[force], found[force])  # oz-in is a torque
            force_N, arm_m = factor_of(name, "N"), factor_of(found[length], "m")
            if force_N and arm_m:
                return force_N * arm_m
    return 0.0


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
    return si_unit_of(text) is not None or text.strip().casefold() in map(str.casefold, OTHER_UNITS)


def unit_text_of(text: str) -> UnitText:
    """Splits what a user has written as a unit, such as "N-250", into unit and offset."""
    found = None if is_unit(text) else OFFSET.match(text)
    offset = float(found["offset"]) if found else math.inf
    return UnitText(found["unit"], offset) if found and abs(offset) <= LARGEST else UnitText(text)


def hint_of(unit: str, wanted: str) -> str:
    """Returns what a user can write in place of a unit that is not known."""
    text = plain(unit)
    if wanted == "N" and (force := NO_FORCES.get(text.casefold())):
        return (
            f"{text} measures a mass; for the weight of this mass write :{force}, which is "
            f"{factor_of(force, 'N'):.6g} N"
        )
    if wanted == "N" and (sizes := AMBIGUOUS.get(text.casefold())):
        return f"{text} has several sizes; write the one that is meant: {sizes}"
    if text != text.casefold() and factor_of(text.casefold(), wanted):
        return f"write :{text.casefold()} if this unit is meant, otherwise its size"
    size = {"N": "9.80665N", "m": "25.4mm"}.get(wanted, f"0.5{wanted}")
    return f"for another unit or a count write its size, such as :{size}"


def split_name(header: str) -> tuple[str, str | None]:
    """Splits the text above a column, such as "Fz [N]", "Fz (N)", "Fz_N", "Fz in N" or "Fz, N",
    into (name, unit). The unit is None if the text contains none."""
    text = header.strip().strip('"').strip()
    if found := IN_BRACKETS.match(text):
        return found["name"].strip(), found["unit"].strip()
    if (found := INSIDE.match(text)) and is_unit(found["unit"]):  # such as "Force (N) Run 1"
        return f"{found['name']} {found['rest']}", found["unit"].strip()
    for ending, unit in sorted(ENDINGS.items(), key=lambda one: -len(one[0])):
        if text.endswith(f"_{ending}"):
            return text, unit
    if (found := BEHIND.match(text)) and found["unit"] not in NO_UNIT and is_unit(found["unit"]):
        return found["name"].strip(), found["unit"]
    return text, None
