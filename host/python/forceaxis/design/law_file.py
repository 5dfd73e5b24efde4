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
from forceaxis.linear.law_text import LawText, parse_law
from forceaxis.linear.settings import FirmwareLaw
from forceaxis.results import from_json

EXPECTED = (
    "a file with a law: an experiment, the bank.toml of a design, the dump of the "
    "parameters of an axis, or the design.json of a tuning"
)


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
            f"{path}: expected all values of the bank {values['force_bank']:g} that force_bank "
            f"selects, got none of {missing.args[0]}"
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
    return FirmwareLaw(law="bank", bank=from_json(BankFigures, figures, f"{path}: bank").bank)
