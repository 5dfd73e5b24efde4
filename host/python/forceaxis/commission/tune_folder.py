"""The folder of a tuning. It contains the request, the identity of the axis, and a JSON file for
each finished step.

A dataclass defines the content of each file. If a file is damaged or missing, the error text has
one line and states the remedy.
"""

import copy
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np

from forceaxis import linear
from forceaxis._core import InputError
from forceaxis.axis.axis import Axis
from forceaxis.commission import as_found, known
from forceaxis.commission.as_found import FolderFile
from forceaxis.commission.level import Samples
from forceaxis.commission.sine_excitation import SineTestResult
from forceaxis.commission.tune_results import MeasuredResponses, PressedResponse, SlowChange
from forceaxis.design import sets
from forceaxis.identify.fit import read_response

R = TypeVar("R")

# names of model files in the folder
RESPONSES_MODEL, FITTED_MODEL = "responses.toml", "model.toml"
PROPOSED_MODEL = "proposed.toml"  # the model with the lines of a refusal
COMPLETED_MODELS = "completed-{}.toml"  # models with one, two and more added parts
TOUCH_DOWN_COLUMNS = ("time_s", "force_N", "predicted_N")
NEW_FOLDER = "delete the folder or give another one"


@dataclass(frozen=True)
class StepFile(Generic[R]):
    """The content of the file of a finished step. It has the result of the step and its duration in
    s, by the wall clock and by the clock of the axis."""

    seconds: float
    axis_seconds: float
    result: R


@dataclass(frozen=True)
class TuningOrder:
    """The request for a tuning: the options of `tune`. `model`: path or file name of the model,
    which contains the prior values.

    `forces`: forces in N at which responses are measured. `over`: tolerances as texts NAME=PERCENT%
    or NAME=LOW..HIGH. `priors`: texts NAME=VALUE or NAME=VALUE+-PERCENT%, which replace prior
    values of the model. `states`: states in which the model is linearised, as texts ELEMENT=STATE.
    `ms`: largest permitted Ms. `averages`: number of averages for each response. `travel_mm`:
    largest motion in mm out of contact, and `squeeze_mm`: in contact. `approach_mm_per_s`: speed of
    the approach. If one of these three is None, it follows from the model (machine_bounds). `seed`:
    seed of the noise.
    """

    model: str
    forces: tuple[float, ...]
    over: tuple[str, ...]
    priors: tuple[str, ...] = ()
    states: tuple[str, ...] = ()
    ms: float = 2.0
    force_max_N: float = math.inf
    band_hz: tuple[float, float] = (1.0, 100.0)
    averages: int = 8
    travel_mm: float | None = None
    squeeze_mm: float | None = None
    approach_mm_per_s: float | None = None
    seed: int = 1


@dataclass(frozen=True)
class TuningIdentity:
    """Identity of the tuning in a folder: the request, the content of the model, and the identity
    of the axis."""

    order: TuningOrder
    model_sha256: str
    object_table_hash: int | None = None
    serial_number: int | None = None


TUNE = FolderFile("tune.json", TuningIdentity, NEW_FOLDER)
BEFORE = FolderFile(
    "before.json", as_found.RawValues, f"switch the axis off and on, then {NEW_FOLDER}"
)
BETWEEN = FolderFile("between.json", SlowChange, "delete measure.json, the step is done again")
SHAKEN = FolderFile(
    "shaken.json", SineTestResult, "delete that file and measure.json, the step is done again"
)
LEVELS = FolderFile("measure.json", StepFile[dict[str, PressedResponse]])


@dataclass(frozen=True)
class MeasuredFile(FolderFile[StepFile[MeasuredResponses]]):
    """The three files of the step `measure`. The file LEVELS is written last, because its existence
    means that the step is done."""

    def read(self, folder: Path) -> StepFile[MeasuredResponses] | None:
        """Returns the result of the step, or None if the step was not done yet. Raises
        InputError."""
        levels = LEVELS.read(folder)
        if levels is None:
            return None
        result = MeasuredResponses(levels.result, BETWEEN.required(folder), SHAKEN.read(folder))
        return StepFile(levels.seconds, levels.axis_seconds, result)

    def write(self, folder: Path, content: StepFile[MeasuredResponses]) -> None:
        """Replaces the three files of the step `measure`."""
        result = content.result
        BETWEEN.write(folder, result.between)
        # Without a new result of the test with sines, the file of an earlier result is deleted.
        if result.shaken is None:
            (folder / SHAKEN.name).unlink(missing_ok=True)
        else:
            SHAKEN.write(folder, result.shaken)
        LEVELS.write(folder, StepFile(content.seconds, content.axis_seconds, result.levels))


MEASURED = MeasuredFile(LEVELS.name, StepFile[MeasuredResponses])


def small_of(name: str) -> str:
    """Returns the name of the folder for the response with the smaller amplitude. `name`: response
    with the larger amplitude."""
    return f"{name}-small"


@dataclass(frozen=True)
class TouchDownRecord:
    """The content of the file of a first contact: times in s from the contact, recorded force in N,
    and predicted force in N."""

    time_s: Samples
    force_N: Samples
    predicted_N: Samples


def read_touch_down(file: Path) -> TouchDownRecord:
    """Reads the file of a first contact. Raises InputError for a damaged file."""
    try:
        table = np.genfromtxt(file, delimiter=",", names=True)
        good = table.dtype.names == TOUCH_DOWN_COLUMNS and table.ndim == 1 and len(table) > 1
        record = TouchDownRecord(*(table[name] for name in TOUCH_DOWN_COLUMNS))
        good = good and bool(np.isfinite(record.time_s).all())
    # NumPy raises TypeError if the file has no column names
    except (ValueError, LookupError, TypeError):
        good = False
    if not good:
        raise InputError(
            f"{file}: expected a file that `tune` has written, with numbers in the columns "
            f"{', '.join(TOUCH_DOWN_COLUMNS)}; delete this file and verify.json, so that `tune` "
            "repeats the step"
        )
    return record


class TuningFolder(as_found.AxisFolder):
    """The first argument of each step of a tuning. It has the axis, which this program owns and
    which is disabled, the request, and the folder, which is created if it does not exist.

    say(text): function that shows each step and its actions. Raises InputError if the request names
    something that the model does not have.
    """

    def __init__(
        self, axis: Axis, order: TuningOrder, folder: str | Path,
        say: as_found.Say = as_found.say_nothing,
    ) -> None:  # fmt: skip
        super().__init__(axis, folder, say)
        self.order, self.given = order, linear.find_model(order.model)
        # This call may raise InputError, so it must come before any file is written.
        known.priors(str(self.given), order.over, order.priors)
        #: states of the elements in which the loops are linearised
        self.states: dict[str, str] = linear.states(order.states)
        if self.states:
            # This call raises InputError for a state that the model does not have.
            sets.slopes(self.given, fixed=self.states)

    @property
    def model(self) -> Path:
        """Path of the model. It is the given file, or the file in the folder to which the step
        `fit` has added the measured friction."""
        own = self.folder / FITTED_MODEL
        return own if own.exists() else self.given

    def with_part(self, model: Path, priors: tuple[str, ...]) -> "TuningFolder":
        """Returns this tuning with another model in place of the given one, and with further
        priors."""
        other = copy.copy(self)
        other.given, other.order = model, replace(self.order, priors=self.order.priors + priors)
        return other

    def check_response(self, name: str, step: str) -> None:
        """Raises InputError if the folder of a response is damaged. `step`: name of the step that
        has measured the response."""
        try:
            read_response(self.folder / name, self.given)
        except InputError as error:
            raise InputError(
                f"{error}; delete {step}.json, so that `tune` repeats the step"
            ) from None
