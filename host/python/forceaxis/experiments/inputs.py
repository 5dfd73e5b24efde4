"""Inputs of an experiment without a run: parameters, firmware objects, tables of the file."""

from collections.abc import Sequence
from dataclasses import dataclass
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
