"""A control law as one text, for example "pi:integral=4" or "lead:zero=40,pole=400,gain=0.01"."""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

from forceaxis.errors import ParameterError
from forceaxis.linear.loops import LAWS, VELOCITY_GAIN
from forceaxis.linear.settings import FirmwareLaw
from forceaxis.words import number, suggestion


class LawKey(NamedTuple):
    """One key in the text form of a control law. `parameter`: field of the class LoopSpec that the
    key sets (for the gain: field of LoopRequest). `unit`: unit of the value of the key."""

    parameter: str
    unit: str


KEYS = {
    "integral": LawKey("integral_rad_per_s", "rad/s"),
    "derivative": LawKey("derivative_s", "s"),
    "zero": LawKey("lead_zero_hz", "Hz"),
    "pole": LawKey("lead_pole_hz", "Hz"),
    "stiffness": LawKey("stiffness_N_per_m", "N/m"),
    "damping": LawKey("damping_Ns_per_m", "N s/m"),
    "velocity_gain": LawKey(VELOCITY_GAIN, "V s/m"),
    "gain": LawKey("gain", "V/N"),
    "force_gain": LawKey("firmware_gain", "DAC codes per count of the force reading at 8 bits"),
}
KEY_OF = {key.parameter: name for name, key in KEYS.items()}


@dataclass(frozen=True)
class LawText:
    """A control law that was read from a text. `law`: a key of LAWS, or None for the law of the
    experiment. For the other fields, see LoopRequest."""

    law: str | None = None
    parameters: dict[str, float] = field(default_factory=dict)
    gain: float | None = None
    firmware_gain: float | None = None
    firmware_law: FirmwareLaw | None = None


def described_laws() -> str:
    """Returns the names of all control laws with their keys, for example "pi:integral"."""
    return ", ".join(
        f"{law}:{','.join(KEY_OF[name] for name in names)}" if names else law
        for law, names in LAWS.items()
    )


def described_keys() -> str:
    """Returns the keys of the control laws with their units, for example "integral (rad/s)"."""
    return ", ".join(f"{name} ({key.unit})" for name, key in KEYS.items())


def parse_law(text: str) -> LawText:
    """Reads a control law from a text of the form NAME, NAME:KEY=VALUE,... or KEY=VALUE,... Does
    not check whether the law has these keys, because the law may belong to an experiment.

    Raises ParameterError for the parameter `law` if the text has another form, or names a law or a
    key that does not exist.
    """
    name, colon, rest = text.partition(":")
    if not colon and "=" in text:
        name, rest = "", text
    if (name or colon or not text) and name not in LAWS:
        raise ParameterError(
            "law",
            f"{text}: expected one of the laws {described_laws()}, got {name or 'no name'}"
            f"{suggestion(name, LAWS)}; a value follows its key as in pi:integral=4, and a file "
            "with a law ends in .toml or .json",
        )
    values: dict[str, float] = {}
    for pair in rest.split(",") if rest or colon else ():
        key, _, value = pair.partition("=")
        if key not in KEYS:
            raise ParameterError(
                "law",
                f"{text}: expected KEY=VALUE with one of the keys {described_keys()}, got "
                f"{pair or 'nothing'}{suggestion(key, KEYS)}",
            )
        found = _number(value)
        if found is None or KEYS[key].parameter in values:
            got = f"{value or 'none'}" if found is None else "a second one"
            raise ParameterError(
                "law", f"{text}: expected one number in {KEYS[key].unit} for {key}, got {got}"
            )
        values[KEYS[key].parameter] = found
    gain, firmware_gain = (values.pop(name, None) for name in ("gain", "firmware_gain"))
    return LawText(name or None, values, gain, firmware_gain)


def _number(text: str) -> float | None:
    try:
        found = number(text)
    except ValueError:
        return None
    return found if math.isfinite(found) else None
