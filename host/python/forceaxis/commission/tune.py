"""Tunes the force law of an axis: measures, fits, designs, simulates, writes, verifies and stores
it.

`Tuning(axis, order, folder).run()` runs the steps of STEP_TABLE in order. Each step is a function
whose arguments are the folder and the results of earlier steps. It returns its own result or raises
a Refusal. The result is written to a JSON file of the folder. A step with such a file is not run
again, so an interrupted tuning continues with the next step.
"""

import hashlib
import time
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from forceaxis._core import InputError
from forceaxis.axis.axis import Axis
from forceaxis.axis.link import TICKS_PER_S, NoAnswer, Refused
from forceaxis.commission import as_found, tune_files, tune_fit, tune_measure, tune_steps
from forceaxis.commission.refusal import Refusal, of_link
from forceaxis.commission.sine_test import SineTestResult
from forceaxis.commission.tune_files import StepFile, StepTimes, TuningIdentity, TuningOrder
from forceaxis.commission.tune_folder import TuningFolder
from forceaxis.commission.tune_results import (
    Checked,
    Designed,
    Fitted,
    FreeResponse,
    MeasuredResponses,
    PressedResponse,
    Simulated,
    SlowChange,
    StepRefusal,
    Stored,
    TuningSummary,
    Verified,
    Written,
)
from forceaxis.results import from_json, to_json


@dataclass(frozen=True)
class TuningStep:
    """One step of a tuning. function(folder, *results of the steps in `takes`) returns an instance
    of `result`; line(folder, result): the text that reports the result."""

    name: str
    function: Callable[..., Any]
    result: type
    takes: tuple[str, ...]
    line: Callable[[TuningFolder, Any], str]


STEP_TABLE = {
    step.name: step
    for step in (
        TuningStep("check", tune_steps.check, Checked, (), tune_steps.check_line),
        TuningStep("free", tune_measure.free, FreeResponse, ("check",), tune_measure.free_line),
        TuningStep("measure", tune_measure.measure, MeasuredResponses, ("check", "free"),
             tune_measure.measure_line),
        TuningStep("fit", tune_fit.fit, Fitted, ("free", "measure"), tune_fit.fit_line),
        TuningStep("design", tune_steps.design, Designed, ("fit", "check"), tune_steps.design_line),
        TuningStep("simulate", tune_steps.simulate, Simulated, ("design", "check", "fit"),
             tune_steps.simulate_line),
        TuningStep("write", tune_steps.write, Written, ("design",), tune_steps.write_line),
        TuningStep("verify", tune_steps.verify, Verified,
             ("write", "design", "measure", "check", "fit"), tune_steps.verify_line),
        TuningStep("store", tune_steps.store, Stored, ("verify", "design"), tune_steps.store_line),
    )
}  # fmt: skip
STEPS = tuple(STEP_TABLE)
FILE = tune_files.TUNE
# {field of the order: first step that has to run again after a change}. The step `check` always
# runs.
AGAIN_FROM = {
    "model": "fit", "forces": "measure", "over": "fit", "priors": "fit", "states": "fit",
    "ms": "design",
    "force_max_N": "simulate", "band_hz": "free", "averages": "free", "travel_mm": "free",
    "seed": "free",
}  # fmt: skip
# {step: type of its result}; the step `measure` has two more files.
FILE_TYPES: dict[str, Any] = {name: step.result for name, step in STEP_TABLE.items()}
FILE_TYPES["measure"] = dict[str, PressedResponse]


def _text(value: Any) -> str:
    """A field of an order as text."""
    return ", ".join(map(str, value)) if isinstance(value, tuple) else str(value)


def _changes(before: TuningOrder, after: TuningOrder) -> dict[str, str]:
    """{field: its old and new value as text} of all changed fields except `model`."""
    pairs = {f.name: (getattr(before, f.name), getattr(after, f.name)) for f in fields(after)}
    return {
        name: f"{name} {_text(old)} to {_text(new)}"
        for name, (old, new) in pairs.items() if name != "model" and old != new
    }  # fmt: skip


class Tuning(TuningFolder):
    """Runs the steps on an Axis that is owned and disabled. The folder `folder` may be new.

    say(text): reports each step and its actions. If the folder contains a tuning with another order
    or model, the results that do not depend on the change are kept and reported. Raises InputError
    if the folder belongs to another axis, contains a damaged file, or if the order names something
    that the model lacks.
    """

    def __init__(
        self, axis: Axis, order: TuningOrder, folder: str | Path,
        say: as_found.Say = as_found.say_nothing,
    ) -> None:  # fmt: skip
        super().__init__(axis, order, folder, say)
        self.step = STEPS[0]
        # Steps that are done and remain valid when an earlier step runs again.
        self.kept: frozenset[str] = frozenset()
        self.refused: StepRefusal | None = None
        self.check_files(FILE_TYPES)
        self._claim()

    def _claim(self) -> None:
        """Writes the order into the folder and keeps the steps that the change of order does not
        affect. Raises InputError for a folder of another axis."""
        known = self.axis.get("object_table_hash", "serial_number")
        # The order as it reads from the file: 30 becomes 30.0 and a list becomes a tuple.
        order = from_json(TuningOrder, to_json(self.order))
        digest = hashlib.sha256(self.given.read_bytes()).hexdigest()
        identity = TuningIdentity(order, digest, **known)
        held = self.read(FILE, TuningIdentity)
        if held is not None and held != identity:
            other = [key for key in known if getattr(held, key) != known[key]]
            if other:
                raise InputError(
                    f"{self.folder}: expected a tuning of the same axis, got another "
                    f"{', '.join(other)}; give another folder"
                )
            self._renew(held, identity)
        self.write(FILE, identity)

    def _renew(self, held: TuningIdentity, identity: TuningIdentity) -> None:
        """Deletes the results of the steps that depend on a change of order or model, and reports
        it."""
        changes = _changes(held.order, identity.order)
        first = [STEPS.index(AGAIN_FROM[name]) for name in changes]
        if held.model_sha256 != identity.model_sha256:
            changes["model"] = "the model"
            first.append(STEPS.index(AGAIN_FROM["model"]))
        if not first:  # only the name of the model has changed
            return
        done = [step for step in STEPS if self._file(step).exists()]
        kept = [step for step in done if step != STEPS[0] and STEPS.index(step) < min(first)]
        for step in STEPS:
            if step not in kept:
                self._file(step).unlink(missing_ok=True)
        self.kept = frozenset(kept)
        if done:
            self.say(
                f"changed since: {', '.join(changes.values())}; kept: "
                f"{', '.join(kept) or 'nothing'}; the rest is done again"
            )

    def _file(self, step: str) -> Path:
        return self.folder / f"{step}.json"

    def done(self, step: str) -> StepFile | None:
        """The file of a step, with its result; None if the step is not done."""
        held = tune_files.read_step(self._file(step), FILE_TYPES[step])
        if held is None or step != "measure":
            return held
        between = self.read(tune_files.BETWEEN, SlowChange)
        if between is None:
            raise InputError(f"{self.folder / tune_files.BETWEEN}: expected that file")
        shaken = self.read(tune_files.SHAKEN, SineTestResult)
        return held._replace(result=MeasuredResponses(held.result, between, shaken))

    def result(self, step: str) -> Any:
        """The result of a step that is done. Raises Refusal if the step is not done."""
        held = self.done(step)
        if held is None:
            raise Refusal(step, "expected that step to be done before; do it alone first")
        return held.result

    def _keep(self, step: str, done: StepFile) -> None:
        """Writes the files of a step; the file that marks the step as done is written last."""
        if isinstance(done.result, MeasuredResponses):
            self.write(tune_files.BETWEEN, done.result.between)
            if done.result.between.friction_N > 0:
                self.write(tune_files.SHAKEN, done.result.shaken)
            else:  # the file belongs to a measurement that is replaced
                (self.folder / tune_files.SHAKEN).unlink(missing_ok=True)
            done = done._replace(result=done.result.levels)
        tune_files.write_step(self.folder, step, done)

    def run(self, only: str | None = None) -> TuningSummary:
        """Runs the steps that are not done, or only the step `only`, done or not; returns the
        summary. After a Refusal or another exception, the axis has its previous parameters."""
        self.step = only or STEPS[0]
        try:
            if len(self.order.forces) < 2:
                raise Refusal(
                    "levels", f"expected at least two forces, got {len(self.order.forces)}: what "
                    "depends on the force cannot be told from what does not; give 30 and 150"
                )  # fmt: skip
            with as_found.kept(self):
                for self.step in (only,) if only else STEPS:
                    self._do(STEP_TABLE[self.step], bool(only))
        except (Refusal, Refused, NoAnswer) as error:
            refusal = error if isinstance(error, Refusal) else of_link(self.axis, error)
            lines = refusal.lines or None
            self.refused = StepRefusal(self.step, refusal.name, refusal.text, lines)
            if lines:
                for line in ("to be added to the model:", *lines.splitlines()):
                    self.say(line)
            raise refusal from None
        return self.summary()

    def _do(self, step: TuningStep, again: bool) -> None:
        index = STEPS.index(step.name)
        place = f"{index + 1}/{len(STEPS)} {step.name}"
        if not again and self.done(step.name) is not None:
            self.say(f"{place}: done before")
            return
        for later in STEPS[index:]:  # later steps depend on the replaced result
            if later == step.name or later not in self.kept:
                self._file(later).unlink(missing_ok=True)
        began, tick = time.monotonic(), self.axis.read("tick_count")
        try:
            result = step.function(self, *map(self.result, step.takes))
        except (Refusal, Refused, NoAnswer) as error:
            if step.name == STEPS[0] and isinstance(error, Refusal):  # as the axis was found
                raise
            raise of_link(self.axis, error) from None
        took = time.monotonic() - began
        ticks = (self.axis.read("tick_count") - tick) % 2**32
        times = StepTimes(round(took, 3), round(ticks / TICKS_PER_S, 3))
        self._keep(step.name, StepFile(times, result))
        self.say(f"{place}: {step.line(self, result)} ({took:.1f} s)")

    def summary(self) -> TuningSummary:
        """The results that are known so far."""
        files = {step: held for step in STEPS if (held := self.done(step)) is not None}
        known = TuningSummary(
            axis=self.axis.link.where,
            folder=str(self.folder),
            seconds={step: held.times.seconds for step, held in files.items()},
            axis_seconds={step: held.times.axis_seconds for step, held in files.items()},
            refused=self.refused,
        )
        for held in files.values():
            known = self._with(known, held.result)
        fitted = files["fit"].result if "fit" in files else None
        if "measure" in files:
            known = replace(known, holds=tuple(tune_fit.holds(files["measure"].result, fitted)))
        return known

    def _with(self, known: TuningSummary, result: Any) -> TuningSummary:
        """A summary to which the result of one more step is added."""
        if isinstance(result, Fitted):
            return replace(
                known, parameters=result.parameters, friction=result.friction,
                friction_lines=result.lines,
            )  # fmt: skip
        if isinstance(result, Designed):
            return replace(
                known, bank=result.bank, worst=result.worst, p=result.p,
                on_fitted=result.on_fitted, limited_by=result.limited_by, cut=result.cut or None,
                cuts=tuple(cut.text for cut in result.gain_cuts), times_p=result.times_p,
                simulated=tuple(row for row in result.simulated if row.law == "design"),
                Ms_predicted=result.worst.Ms,
            )  # fmt: skip
        if isinstance(result, Simulated):
            return replace(known, simulated=known.simulated + result.contacts)
        if isinstance(result, Written):
            return replace(known, certificate_state=result.certificate_state)
        if isinstance(result, Verified):
            largest = max((level.Ms for level in result.levels.values()), default=None)
            return replace(known, levels=result.levels or None, Ms_verified=largest)
        if isinstance(result, Stored):
            return replace(known, stored=result.stored)
        return known
