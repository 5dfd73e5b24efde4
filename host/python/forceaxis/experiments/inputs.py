"""Inputs of an experiment without a run: parameters, firmware objects, tables of the file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

from forceaxis import _core
from forceaxis.experiments.run_result import Converters, Criterion, read_converters
from forceaxis.linear.plant_facts import ParameterFacts

# The table [expect] of an experiment file, before its keys and values are checked.
ExpectTable: TypeAlias = dict[str, Any]


@dataclass(frozen=True)
class Inputs:
    """The inputs of an experiment, with all overrides."""

    title: str
    model: Path
    contacts: list[str]  # names of the contacts of the model
    converters: Converters
    firmware: dict[str, float]  # {firmware object: value that is written before the first tick}
    expect: ExpectTable | None
    inputs_hash: str
    criterion: Criterion | None  # limits of the verdict, from the table [verdict]
    # reason why the table [verdict] cannot be evaluated; None if it can be evaluated
    not_evaluable: str | None
    # values of the parameters of the model after the overrides
    parameters: dict[str, ParameterFacts]
    unused: list[str]  # names of the parameters that have no effect on the model


@cache
def numeric_keys() -> Mapping[str, Mapping[str, str]]:
    """Returns {first word of an override: {key with a number: unit}} for the keys of an experiment
    file, "experiment", and for the keys of its table [verdict], "verdict"."""
    tables = {table["path"]: table["keys"] for table in _core.experiment_format()}
    return {
        room: {key["key"]: key["unit"] for key in keys if key["form"] in ("number", "integer")}
        for room, keys in (("experiment", tables[""]), ("verdict", tables["verdict"]))
    }


def read_inputs(
    experiment: str | Path, overrides: Sequence[str] = (), text: str | None = None
) -> Inputs:
    """Returns the inputs of an experiment. `text` replaces the content of the file. Raises
    InputError with file, key and the expected value."""
    given = _core.inputs(str(experiment), list(overrides), text=text)
    return Inputs(
        title=given["title"],
        model=Path(given["model"]),
        contacts=given["contacts"],
        converters=read_converters(given["converters"]),
        firmware=given["firmware"],
        expect=given["expect"],
        inputs_hash=given["inputs_hash"],
        criterion=given["criterion"],
        not_evaluable=given["not_evaluable"],
        parameters={name: ParameterFacts(**p) for name, p in given["parameters"].items()},
        unused=given["unused"],
    )
