"""The folder of a tuning with its order and its axis: the common argument of all steps."""

from pathlib import Path

from forceaxis import linear
from forceaxis.axis.axis import Axis
from forceaxis.commission import as_found, known, tune_files
from forceaxis.commission.tune_files import TuningOrder
from forceaxis.commission.tune_results import PressedResponse
from forceaxis.design import sets
from forceaxis.identify.fit import read_response

RESPONSES_MODEL, FITTED_MODEL = "responses.toml", "model.toml"  # files of the folder


class TuningFolder(as_found.AxisFolder):
    """An Axis that is owned and disabled, an order, and `folder`, which may be new.

    say(text): reports each step and its actions. Raises InputError if the order names something
    that the model lacks.
    """

    def __init__(
        self, axis: Axis, order: TuningOrder, folder: str | Path,
        say: as_found.Say = as_found.say_nothing,
    ) -> None:  # fmt: skip
        super().__init__(axis, folder, say)
        self.order, self.given = order, linear.find_model(order.model)
        # raises InputError before a file is written
        known.priors(str(self.given), order.over, order.priors)
        #: states in which the loops are linearised
        self.states: dict[str, str] = linear.states(order.states)
        if self.states:
            # raises InputError for a state that the model lacks
            sets.slopes(self.given, fixed=self.states)

    @property
    def model(self) -> Path:
        """Path of the model: the given file, or the file to which `fit` has added measured
        friction."""
        own = self.folder / FITTED_MODEL
        return own if own.exists() else self.given

    def replace_levels(self, levels: dict[str, PressedResponse]) -> None:
        """Replaces the levels in the result of `measure`, which has to be done."""
        held = tune_files.read_step(self.folder / "measure.json", dict[str, PressedResponse])
        if held is not None:
            tune_files.write_step(self.folder, "measure", held._replace(result=levels))

    def check_files(self, results: dict[str, object]) -> None:
        """Raises InputError for a damaged file. results: {step: type of its result}."""
        tune_files.check(self.folder, results, lambda path: read_response(path, self.given))
