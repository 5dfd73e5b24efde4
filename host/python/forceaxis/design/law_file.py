"""Reads the control law of the firmware from a file. The file is an experiment, a file with
parameters of an axis (the bank.toml of a design, or the dump of an axis), or the design.json of a
tuning."""

from pathlib import Path

from forceaxis import files, toml
from forceaxis._core import InputError
from forceaxis.axis import parameter_file
from forceaxis.design.banks import BankFigures
from forceaxis.errors import ParameterError
from forceaxis.linear import bank, settings
from forceaxis.linear.bank import Bank
from forceaxis.linear.law_text import LawText, parse_law
from forceaxis.linear.settings import FirmwareLaw
from forceaxis.objects import BY_NAME
from forceaxis.results import from_json

EXPECTED = (
    "a file with a law: an experiment, the bank.toml of a design, the dump of the "
    "parameters of an axis, or the design.json of a tuning"
)

COEFFICIENTS = "b0, b1, b2, a1, a2"  # of a second-order section


def law_of(text: str) -> LawText:
    """Returns the control law from `text`. The text is a law as for parse_law(), or the path of a
    file whose name ends in .toml or .json. Raises ParameterError for the parameter `law`."""
    path = Path(text)
    read = {".toml": _of_toml, ".json": _of_design}.get(path.suffix)
    if read is None:
        return parse_law(text)
    if not path.is_file():
        raise ParameterError(
            "law", f"{text}: expected a file with a law, but there is no such file"
        )
    try:
        return LawText(firmware_law=read(path))
    except InputError as error:
        raise ParameterError("law", str(error)) from None


def _of_toml(path: Path) -> FirmwareLaw:
    table = toml.read(path)
    if settings.is_experiment(table):
        return settings.of(path)
    if "about" not in table and [*table] != ["firmware"]:
        files.refuse(path, EXPECTED, "other tables", "choose another file")
    return _of_parameters(path)


def _of_parameters(path: Path) -> FirmwareLaw:
    """Returns the force law that the parameters of an axis select. The mode of operation is not
    used: an axis does not store it, and it could select a law of motion."""
    known = parameter_file.BY_NAME
    given = parameter_file.read(path, node_id=1)
    raw = {name: known[name].default for name in given.defaults} | given.values
    values = {name: number * known[name].scale for name, number in raw.items()}
    try:
        selected = bank.of_settings(values)
    except KeyError as missing:
        raise InputError(
            f"{path}: expected all values of the filter bank {values['force_bank']:g}, which "
            f"force_bank selects, but the value {missing.args[0]} is missing"
        ) from None
    if selected:
        return FirmwareLaw(law="bank", bank=selected)
    if not values.get("force_gain"):
        files.refuse(
            path, "force_bank or force_gain, one of which gives the law", "neither",
            "give a file with a law",
        )  # fmt: skip
    return FirmwareLaw(force_gain=values["force_gain"])


def _of_design(path: Path) -> FirmwareLaw:
    table = files.read_json(path, EXPECTED)
    step = table.get("result", table)
    figures = step.get("bank") if isinstance(step, dict) else None
    if figures is None:
        files.refuse(path, EXPECTED, "JSON without a bank", "choose another file")
    where = f"{path}: bank"
    return FirmwareLaw(law="bank", bank=_stored(where, from_json(BankFigures, figures, where)))


def _stored(where: str, given: BankFigures) -> Bank:
    """Returns the bank with the values that the firmware stores. Raises InputError, which begins
    with `where`, for a value that the firmware cannot store, as for the bank of an experiment."""
    most = BY_NAME["bank_sections_1"].max
    if len(given.sections) > most:
        raise InputError(
            f"{where}: sections: expected at most {most} second-order sections, got "
            f"{len(given.sections)}"
        )
    count = len(COEFFICIENTS.split(","))
    for number, section in enumerate(given.sections, 1):
        if len(section) != count:
            raise InputError(
                f"{where}: sections: section {number}: expected the {count} coefficients "
                f"{COEFFICIENTS}, got {len(section)} numbers"
            )
        for value in section:
            _expect(f"{where}: sections: section {number}", "bank_coefficient_1", value)
    # A bank whose gain is 0 is not a law.
    _expect(f"{where}: force_gain", "bank_gain_1", given.force_gain, bank.GAIN_STEP)
    _expect(f"{where}: integral_rad_per_s", "bank_integral_1", given.integral_rad_per_s)
    _expect(f"{where}: velocity_gain", "bank_velocity_gain_1", given.velocity_gain)
    return given.bank.quantised()


def _expect(where: str, name: str, value: float, least: float | None = None) -> None:
    """Raises InputError for a value that is not in the range of an object of the firmware."""
    known = BY_NAME[name]
    low, high = known.min * known.scale if least is None else least, known.max * known.scale
    if not low <= value <= high:
        raise InputError(f"{where}: expected a number from {low:.6g} to {high:.6g}, got {value:g}")
