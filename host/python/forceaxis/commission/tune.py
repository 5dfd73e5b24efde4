"""A force law for a live axis: measured, identified, designed, simulated, written, verified, kept.

`Tuning(axis, order, folder).run()` does STEPS one after the other. Each is a function of tune_steps
that ends with a result, a JSON file of its own in the folder, or with a Refusal. What is there is
not done again, so a tuning goes on where it was broken off.
"""

import hashlib
import json
import math
import time
from dataclasses import asdict, dataclass

from forceaxis import linear
from forceaxis._core import InputError
from forceaxis.axis.link import TICKS_PER_S, NoAnswer, Refused
from forceaxis.commission import as_found, known, tune_files, tune_fit, tune_steps
from forceaxis.commission.refusal import Refusal, of_link
from forceaxis.design import sets
from forceaxis.design.cases import GainCut
from forceaxis.identify.fit import read_response

STEPS = ("check", "free", "measure", "fit", "design", "simulate", "write", "verify", "store")
FILE = "tune.json"
# The step from which on a tuning is done again where something changed; check() always is.
AGAIN_FROM = {
    "model": "fit", "forces": "measure", "over": "fit", "priors": "fit", "states": "fit",
    "ms": "design",
    "force_max_N": "simulate", "band_hz": "free", "averages": "free", "travel_mm": "free",
    "seed": "free",
}  # fmt: skip


def _text(value):
    """A field of an Order for people."""
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)


@dataclass(frozen=True)
class Order:
    """What is asked for. model: path or stem of the axis' model, whose values are what is known
    of it; priors: NAME=VALUE or NAME=VALUE+-PERCENT% of what is known better or worse; states:
    ELEMENT=STATE, in which the model is linearised."""

    model: str
    forces: tuple
    over: tuple
    priors: tuple = ()
    states: tuple = ()
    ms: float = 2.0
    force_max_N: float = math.inf
    band_hz: tuple = (1.0, 100.0)
    averages: int = 8
    travel_mm: float = 1.0
    seed: int = 1


class Tuning(as_found.Folder):
    """The steps on an Axis that is owned and disabled, in `folder`, which need not exist.

    say(text): a line for each step and for what it does. A folder of another order or model goes on
    with what that does not touch, and says what. Raises InputError where the folder holds a tuning
    of another axis or a damaged file, or the order names what the model has not.
    """

    def __init__(self, axis, order, folder, say=lambda text: None):
        super().__init__(axis, folder, say)
        self.kept = frozenset()  # steps that are done and stay so when one before them is again
        self.order, self.given, self.refused = order, linear.find_model(order.model), None
        known.priors(str(self.given), order.over, order.priors)  # before anything is written
        self.states = linear.states(order.states)  #: {element: state} that loops are taken in
        if self.states:
            sets.slopes(self.given, fixed=self.states)  # refuses what the model has not
        tune_files.check(self.folder, lambda path: read_response(path, self.given))
        self._claim()

    @property
    def model(self):
        """Path of the model: the one given, with the friction that fit() found and it lacks."""
        own = self.folder / tune_fit.MODEL
        return own if own.exists() else self.given

    def _claim(self):
        """Takes the folder for this order: steps that what changed since does not touch stay done.
        Refuses a folder of another axis."""
        known = self.axis.get("object_table_hash", "serial_number")
        identity = {
            "order": json.loads(json.dumps(asdict(self.order), default=str)),
            "model_sha256": hashlib.sha256(self.given.read_bytes()).hexdigest(),
            **known,
        }
        held = self.read(FILE)
        if held is not None and held != identity:
            other = [key for key in known if held.get(key) != known[key]]
            if other:
                raise InputError(
                    f"{self.folder}: expected a tuning of the same axis, got another "
                    f"{', '.join(other)}; give another --out"
                )
            self._renew(held, identity)
        self.write(FILE, identity)

    def _renew(self, held, identity):
        """Leaves only the steps that stay valid of what was done for `held`, and says so."""
        old, new = held["order"], identity["order"]
        old = {"states": []} | old  # of a folder before there was --mode
        changes = {n: f"{n} {_text(old.get(n))} to {_text(new[n])}" for n in new
                   if n != "model" and old.get(n) != new[n]}  # fmt: skip
        first = [STEPS.index(AGAIN_FROM[name]) for name in changes]
        if held["model_sha256"] != identity["model_sha256"]:
            changes["model"] = "the model"
            first.append(STEPS.index(AGAIN_FROM["model"]))
        if not first:  # the same model by another name
            return
        done = [step for step in STEPS if (self.folder / f"{step}.json").exists()]
        kept = [step for step in done if step != STEPS[0] and STEPS.index(step) < min(first)]
        for step in STEPS:
            if step not in kept:
                (self.folder / f"{step}.json").unlink(missing_ok=True)
        self.kept = frozenset(kept)
        if done:
            self.say(
                f"changed since: {', '.join(changes.values())}; kept: "
                f"{', '.join(kept) or 'nothing'}; the rest is done again"
            )

    def result(self, step):
        """What a step that is done came to. Raises Refusal for one that is not."""
        held = self.read(f"{step}.json")
        if held is None:
            raise Refusal(step, f"expected that step to be done before; run --only {step}")
        return held["result"]

    def run(self, only=None):
        """Does the steps that are not done, or `only` that one, done or not; the summary. After a
        Refusal, or whatever else ends it early, the axis has what it had before."""
        self.step = only or STEPS[0]
        try:
            if len(self.order.forces) < 2:
                raise Refusal(
                    "levels", f"expected at least two forces, got {len(self.order.forces)}: what "
                    "depends on the force cannot be told from what does not; give --force 30,150"
                )  # fmt: skip
            with as_found.kept(self):
                for self.step in (only,) if only else STEPS:
                    self._do(self.step, bool(only))
        except (Refusal, Refused, NoAnswer) as error:
            refusal = error if isinstance(error, Refusal) else of_link(self.axis, error)
            self.refused = {"step": self.step, "name": refusal.name, "text": refusal.text}
            if refusal.lines:
                self.refused["lines"] = refusal.lines
                for line in ("to be added to the model:", *refusal.lines.splitlines()):
                    self.say(line)
            raise refusal from None
        return self.summary()

    def _do(self, step, again):
        place = f"{STEPS.index(step) + 1}/{len(STEPS)}"
        if not again and self.read(f"{step}.json") is not None:
            self.say(f"{place} {step}: done before")
            return
        for later in STEPS[STEPS.index(step) :]:  # would follow from what is replaced
            if later == step or later not in self.kept:
                (self.folder / f"{later}.json").unlink(missing_ok=True)
        began, tick = time.monotonic(), self.axis.read("tick_count")
        try:
            result, line = getattr(tune_steps, step)(self)
        except (Refusal, Refused, NoAnswer) as error:
            if step == STEPS[0] and isinstance(error, Refusal):  # as the axis was found
                raise
            raise of_link(self.axis, error) from None
        took = time.monotonic() - began
        ticks = (self.axis.read("tick_count") - tick) % 2**32
        times = {"seconds": round(took, 3), "axis_seconds": round(ticks / TICKS_PER_S, 3)}
        self.write(f"{step}.json", times | {"result": result})
        self.say(f"{place} {step}: {line} ({took:.1f} s)")

    def summary(self):
        """What is known so far, as `--json` prints it."""
        done = {step: self.read(f"{step}.json") for step in STEPS}
        held = {step: value["result"] for step, value in done.items() if value is not None}
        fitted, designed = held.get("fit", {}), held.get("design", {})
        levels = held.get("verify", {}).get("levels", {})
        return {
            "axis": self.axis.link.where,
            "folder": str(self.folder),
            "parameters": fitted.get("parameters"),
            "bank": designed.get("bank"),
            "worst": designed.get("worst"),
            "p": designed.get("p"),
            "on_fitted": designed.get("on_fitted"),
            "limited_by": designed.get("limited_by"),
            "cut": designed.get("cut") or None,
            "cuts": [GainCut(**cut).text for cut in designed.get("gain_cuts", ())],
            "simulated": [
                *(row for row in designed.get("simulated", ()) if row["law"] == "design"),
                *held.get("simulate", {}).get("contacts", ()),
            ],
            "holds": tune_fit.holds(self),
            "Ms_predicted": designed.get("worst", {}).get("Ms"),
            "Ms_verified": max((one["Ms"] for one in levels.values()), default=None),
            "levels": levels or None,
            "certificate_state": held.get("write", {}).get("certificate_state"),
            "stored": held.get("store", {}).get("stored", False),
            "times_p": designed.get("times_p"),
            "friction": fitted.get("friction"),
            "friction_lines": fitted.get("lines"),
            "seconds": {step: done[step]["seconds"] for step in held},
            "axis_seconds": {step: done[step]["axis_seconds"] for step in held},
            "refused": self.refused,
        }
