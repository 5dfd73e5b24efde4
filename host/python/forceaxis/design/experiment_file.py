"""Experiment files of a design: their firmware settings, and their text as a document that can be
edited."""

from pathlib import Path
from typing import Any, TypedDict

import tomlkit

from forceaxis import _core, toml
from forceaxis.results import JsonObject

BANK = 1  # number of the filter bank of the firmware into which a design is written
# firmware objects that limit the output after a contact loss
LOSS = ("contact_loss_cap", "contact_loss_dwell")
# Value of a firmware object, or {key: value} of a filter bank.
FirmwareValue = float | str | JsonObject


class Impulse(TypedDict):
    """An impulse in N s on a body."""

    body: str
    N_s: float


class Write(TypedDict, total=False):
    """One element [[at]] of an experiment: firmware settings or an impulse at a time in s."""

    time_s: float
    firmware: dict[str, FirmwareValue]
    impulse: Impulse


class ExperimentText(TypedDict, total=False):
    """The tables and keys of an experiment file that a design writes. tomlkit.dumps converts such a
    dict to text."""

    title: str
    model: str
    duration_s: float
    set: dict[str, float | str]
    firmware: dict[str, FirmwareValue]
    at: list[Write]
    verdict: dict[str, float | bool]
    expect: dict[str, str]


def document(experiment: Path) -> ExperimentText:
    """Returns an experiment file as an editable document that keeps the comments of the file."""
    found: Any = tomlkit.parse(experiment.read_text(encoding="utf-8-sig"))
    text: ExperimentText = found
    return text


def firmware_values(experiment: Path | None) -> dict[str, float]:
    """Returns {object: value in the unit of the object} from the table [firmware] of an experiment.
    The result is empty without an experiment."""
    return _core.inputs(str(experiment))["firmware"] if experiment else {}


def firmware_table(experiment: Path | None) -> dict[str, float | str]:
    """Returns the table [firmware] of an experiment, with the values as they are in the file. The
    result is empty without an experiment."""
    if experiment is None:
        return {}
    table: dict[str, float | str] = toml.read(experiment).get("firmware", {})
    return table


def text_of(experiment: ExperimentText) -> str:
    """Returns the text of an experiment file that has no comments."""
    found = tomlkit.document()
    found.update(experiment)
    return tomlkit.dumps(found)
