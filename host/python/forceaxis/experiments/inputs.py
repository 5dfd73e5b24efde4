"""Inputs of an experiment, read without a run: parameters, firmware objects, tables of the file."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from forceaxis import _core
from forceaxis.experiments.run_result import Converters, Criterion, read_converters, read_criterion
from forceaxis.linear.plant_facts import ParameterFacts

ExpectTable: TypeAlias = dict[str, Any]  # the table [expect] of a file, with any keys and values


@dataclass(frozen=True)
class Inputs:
    """Inputs of an experiment with its overrides."""

    title: str
    model: Path
    contacts: list[str]  # their names
    converters: Converters
    firmware: dict[str, float]  # object that is written before the first tick -> value
    expect: ExpectTable | None
    inputs_hash: str
    criterion: Criterion | None  # the table [verdict]
    # reason for which the table [verdict] cannot be evaluated; None: it can
    not_evaluable: str | None
    parameters: dict[str, ParameterFacts]  # of the model, with the overrides
    unused: list[str]  # parameters that do not change the model


def read_inputs(
    experiment: str | Path, overrides: Sequence[str] = (), text: str | None = None
) -> Inputs:
    """The inputs of an experiment. text: replaces the content of the file. Raises InputError with
    file, key and the expected value."""
    given = _core.inputs(str(experiment), list(overrides), text=text)
    return Inputs(
        title=given["title"],
        model=Path(given["model"]),
        contacts=given["contacts"],
        converters=read_converters(given["converters"]),
        firmware=given["firmware"],
        expect=given["expect"],
        inputs_hash=given["inputs_hash"],
        criterion=read_criterion(given["criterion"]),
        not_evaluable=given["not_evaluable"],
        parameters={name: ParameterFacts(**p) for name, p in given["parameters"].items()},
        unused=given["unused"],
    )
