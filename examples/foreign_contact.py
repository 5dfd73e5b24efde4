#!/usr/bin/env python3
"""A machine with a controller of its own: a model is fitted to one recorded first contact, and
predicts the contact at another speed.

python examples/foreign_contact.py examples/robot_force_mode.toml touch.csv --map force=F_N:N \\
    --speed 0.1 --predict 0.25 --out touch.png

Only the force has to be recorded. MODEL has a [machine_controller] and the parameters `approach`
(speed of the approach in m/s) and `gap` (m); `run_up` is the time from the start to the contact
(s), if the model needs one. Each parameter whose source is "guess" is fitted, by
a factor of 2.5 as standard deviation. A resonance above half the sampling rate cannot be followed
sample by sample. So two things are compared: the force after a Gaussian low pass, and the rms of
what the low pass takes away. The range of a prediction is that of all fits that are nearly as good
as the best one. It is no confidence interval.
"""

import argparse
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from forceaxis import drawing, toml
from forceaxis._core import TICKS_PER_SECOND, InputError, Plant, SimulationError
from forceaxis.cli.common import aligned
from forceaxis.recordings import signal_recording, touch
from forceaxis.recordings.importing import ImportRequest, import_source
from forceaxis.recordings.reading import read_source
from forceaxis.recordings.signal_recording import Floats
from forceaxis.recordings.touch import ContactFigures, ForceLevel
from forceaxis.words import plain
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import least_squares

SMOOTHED_S = 0.8e-3  # standard deviation of the low pass: -3 dB at 166 Hz
BEFORE_S = 0.006  # of the contact, from which on the force is compared
# From the start of a simulation to the contact, if the model has no `run_up`: the first of these
# times after which the machine has its speed, or the best one.
RUN_UPS_S = (0.5, 1.0, 2.0, 4.0)
LATEST_S = 0.3  # by which a contact may be later than that
PHASES = 4  # number of runs of a prediction: each one meets the ticks at another phase
SAMPLINGS = 16  # phases of the sampling for which the largest sample is found
FACTOR, FACTORS_MAX = np.log(2.5), 2.2  # of a guess; largest change in standard deviations
OFFSET, STEP = 10.0, 0.005  # of the search, in standard deviations
FIRST_STRETCH_S, KEPT = 0.03, 8  # of the first search, and number of fits that go on
SPREADS = (0.3, 0.3)  # from the three best fits, of the further searches
SHIFT_S = 2e-3  # standard deviation of the time of the contact
FORCE_SHARE, RING_SHARE = 0.01, 0.006  # of the largest force that counts as one deviation
RING_WINDOWS_S = (0.0, 0.004, 0.008, 0.016, 0.03)
NEARLY_AS_GOOD = 1.5  # largest sum of squares of a fit, relative to that of the best one
IMPULSE_WITHIN, TIME_WITHIN = 0.1, 0.15  # relative errors above which a figure is not reproduced
SPEED_WITHIN = 0.02  # relative error of the speed at the contact


@dataclass(frozen=True)
class Force:
    """A force in N with the time in s after the first contact, both (n,), equally spaced."""

    time_s: Floats
    force: Floats

    @property
    def step_s(self) -> float:
        """Returns the distance of the samples."""
        return float(self.time_s[1] - self.time_s[0])

    def smooth(self) -> Floats:
        """Returns the force after the low pass, (n,)."""
        return np.asarray(gaussian_filter1d(self.force, SMOOTHED_S / self.step_s, mode="nearest"))

    def ring(self, shift_s: float = 0.0) -> Floats:
        """Returns the rms in N of what the low pass takes away, in each window."""
        rest = (self.force - self.smooth()) ** 2
        edges = np.searchsorted(self.time_s, np.array(RING_WINDOWS_S) + shift_s)
        return np.sqrt([rest[a : max(b, a + 1)].mean() for a, b in pairwise(edges)])

    def until(self, span_s: float) -> "Force":
        """Returns the force up to `span_s` after the contact."""
        inside = self.time_s <= span_s
        return Force(self.time_s[inside], self.force[inside])

    def figures(self, level: ForceLevel) -> ContactFigures:
        """Returns the figures of the contact, computed from the force after the low pass."""
        return touch.figures_of(self.time_s, self.smooth(), level)

    def aligned(self, level: ForceLevel) -> "Force":
        """Returns the force with time 0 where the force after the low pass exceeds the level."""
        touch_s = touch.touch_of(self.time_s, self.smooth(), level)
        return self if touch_s is None else Force(self.time_s - touch_s, self.force)

    def peaks(self, step_s: float) -> Floats:
        """Returns the largest of samples with the distance `step_s`, for each phase."""
        phases = np.arange(SAMPLINGS) * step_s / SAMPLINGS
        at = np.arange(self.time_s[0], self.time_s[-1] - step_s, step_s)
        return np.array([np.interp(at + p, self.time_s, self.force).max() for p in phases])


@dataclass(frozen=True)
class Recorded:
    """A recorded contact. `level`: level of contact of the force after the low pass."""

    name: str
    force: Force
    level: ForceLevel


def _limits(tables: dict[str, Any]) -> None:
    """Bounds the force of the drive, and so its acceleration, and delays the measured force by the
    8 ms of a bus with cycles of 2 ms."""
    controller, drive = tables["machine_controller"], tables["drive"]
    if controller["law"] == "table" or drive["type"] != "first_order":
        raise InputError("--structure limits: expected a law of the force and a first_order drive")
    tables["parameters"]["f_limit"] = {"value": 150.0, "unit": "N", "source": "guess"}
    drive["force_limit"] = "f_limit"
    controller |= {"delay_ticks": 12, "cycle_ticks": 3}


def _dead_zone(tables: dict[str, Any]) -> None:
    """Makes the spring at the body of the drive a spring with play."""
    springs, body = tables["spring"], tables["drive"]["body"]
    found = next((spring for spring in springs if body in spring["between"]), None)
    if found is None:
        raise InputError("--structure dead-zone: expected a spring at the body of the drive")
    springs.remove(found)
    tables["parameters"]["play"] = {"value": 20e-6, "unit": "m", "source": "guess"}
    tables.setdefault("backlash", []).append({**found, "width": "play"})


def _path_end(tables: dict[str, Any]) -> None:
    """Ends the travel of the body of the drive behind the contact, as the stroke of a flange."""
    parameters = tables["parameters"]
    parameters["stroke"] = {"value": 200e-6, "unit": "m", "source": "guess"}
    parameters["k_end"] = {"value": 1e6, "unit": "N/m", "source": "guess"}
    parameters["b_end"] = {"value": 1e3, "unit": "N s/m", "source": "guess"}
    end = {"name": "end", "between": [tables["drive"]["body"], "ground"], "high": "stroke",
           "stiffness": "k_end", "damping": "b_end"}  # fmt: skip
    tables.setdefault("stop", []).append(end)


# Structures that a model may lack: each changes its tables.
STRUCTURES: dict[str, Callable[[dict[str, Any]], None]] = {
    "limits": _limits, "dead-zone": _dead_zone, "path-end": _path_end,
}  # fmt: skip


def with_structures(model: Path, names: Sequence[str], folder: Path) -> Path:
    """Returns the model with further structures, a file of `folder`, or the model itself without
    any. Raises InputError."""
    if not names:
        return model
    tables = toml.read(model)
    for name in names:
        STRUCTURES[name](tables)
    file = folder / model.name
    file.write_text(toml.write_text(tables), encoding="utf-8")
    return file


def recorded(path: Path, signals: str) -> Recorded:
    """Returns the contact in a recording, or in the file of another program, from which the force
    is imported as `signals` says. Raises InputError, OSError."""
    if signal_recording.is_recording(path):
        recording = signal_recording.read(path)
    else:
        recording = import_source(read_source(path), path, ImportRequest([signals])).recording
    if "force" not in recording:
        raise InputError(f"{path.name}: expected a recording with the signal force")
    signal = recording["force"]
    time_s = np.linspace(signal.true_time_s[0], signal.true_time_s[-1], len(signal.values))
    if np.abs(time_s - signal.true_time_s).max() > (time_s[1] - time_s[0]) / 4:
        raise InputError(f"{path.name}: expected equally spaced samples; cut the file at its gaps")
    level = touch.level_of(time_s, Force(time_s, signal.values).smooth(), path.name)
    level, zero = ForceLevel(0.0, level.noise, level.contact), level.zero
    return Recorded(path.name, Force(time_s, signal.values - zero).aligned(level), level)


class Machine:
    """The machine of a model. A point is a vector: the logarithm of each fitted parameter relative
    to its guess, divided by FACTOR."""

    def __init__(self, model: Path, signal: str) -> None:
        tables = toml.read(model)
        known = tables.get("parameters", {})
        if missing := [n for n in ("approach", "gap") if n not in known]:
            raise InputError(f"{model}: parameters: expected {' and '.join(missing)}")
        if "machine_controller" not in tables or not tables.get("contact"):
            raise InputError(f"{model}: expected a [machine_controller] and a [[contact]]")
        self.guesses = {n: float(p["value"]) for n, p in known.items() if p["source"] == "guess"}
        if not self.guesses:
            raise InputError(f'{model}: parameters: expected some with source = "guess"')
        given = known.get("run_up")
        self.run_ups_s = (float(given["value"]),) if given else RUN_UPS_S
        self.model, self.signals = (
            str(model),
            [signal, f"{tables['contact'][0]['name']}.deflection"],
        )

    def values(self, point: Floats) -> dict[str, float]:
        """Returns the parameters of a point."""
        factors = np.exp(FACTOR * point)
        return {n: float(v * f) for (n, v), f in zip(self.guesses.items(), factors, strict=True)}

    def contact(self, point: Floats, speed: float, span_s: float) -> tuple[Force, float]:
        """Returns the force in a contact, and the relative error of the speed at the contact.
        Raises InputError, SimulationError."""
        found: list[tuple[Force, float]] = []
        for run_up_s in self.run_ups_s:
            found.append(self._contact(self.values(point), speed, run_up_s, span_s))
            if abs(found[-1][1]) < SPEED_WITHIN:
                break
        return min(found, key=lambda one: abs(one[1]))

    def _contact(
        self, values: dict[str, float], speed: float, run_up_s: float, span_s: float
    ) -> tuple[Force, float]:
        lasts_s = run_up_s + span_s + LATEST_S
        ticks = np.arange(round(lasts_s * TICKS_PER_SECOND)) / TICKS_PER_SECOND
        forces = np.empty((len(ticks), PHASES))
        for phase in range(PHASES):
            gap = speed * (run_up_s + phase / PHASES / TICKS_PER_SECOND)
            plant = Plant(self.model, {**values, "approach": speed, "gap": gap})
            _, signals = plant.follow(np.zeros(len(ticks)), False, self.signals)
            # A contact that is later by a part of a tick is sampled earlier by that part.
            forces[:, PHASES - 1 - phase] = signals[:, 0]
            if phase == 0:
                deflection = signals[:, 1]
        first = int(np.argmax(deflection > 0))
        if first < 2:
            raise InputError(f"{self.model}: expected a contact within {lasts_s:.3g} s, got none")
        wrong = (deflection[first - 1] - deflection[first - 2]) * TICKS_PER_SECOND / speed - 1
        fine_s = 1 / TICKS_PER_SECOND / PHASES
        time_s = (np.arange(forces.size) - PHASES + 1) * fine_s
        part = deflection[first] / (deflection[first] - deflection[first - 1])
        contact_s = (first - part) / TICKS_PER_SECOND
        return Force(time_s - contact_s, forces.ravel()).until(span_s), float(wrong)


@dataclass(frozen=True)
class Fit:
    """A fitted point, the time in s by which the recorded contact is later than the fitted one
    where both pass the level of contact, and the sum of squares."""

    point: Floats
    shift_s: float
    cost: float


def fits_of(machine: Machine, one: Recorded, speed: float, span_s: float, starts: int) -> list[Fit]:
    """Returns the fits whose sum of squares is at most NEARLY_AS_GOOD times the smallest one,
    ordered by it."""
    largest = float(one.force.force.max())
    smooth, ring, count = one.force.smooth(), one.force.ring(), len(machine.guesses)

    def residuals(z: Floats, until_s: float) -> Floats:
        inside = (one.force.time_s > -BEFORE_S) & (one.force.time_s < until_s)
        shift_s = SHIFT_S * z[-1]
        try:
            force, wrong = machine.contact(z[:-1], speed, until_s + 0.01)
        except (InputError, SimulationError):  # no plant, or no contact
            return np.full(inside.sum() + len(ring) + 1 + len(z), 1e3)
        force = force.aligned(one.level)
        off = np.interp(one.force.time_s[inside] - shift_s, force.time_s, force.smooth())
        return np.concatenate([
            (off - smooth[inside]) / (FORCE_SHARE * largest),
            (force.ring(-shift_s) - ring) / (RING_SHARE * largest),
            [np.clip(wrong, -1, 1) / SPEED_WITHIN],
            z,
        ])  # fmt: skip

    def search(z: Floats, until_s: float, steps: int) -> tuple[float, Floats]:
        # least_squares takes differences relative to a variable, so none may be near 0.
        found = least_squares(
            lambda x: residuals(x - OFFSET, until_s), z + OFFSET, diff_step=STEP / OFFSET,
            bounds=(OFFSET - FACTORS_MAX, OFFSET + FACTORS_MAX), max_nfev=steps,
        )  # fmt: skip
        return 2 * float(found.cost), found.x - OFFSET

    rng = np.random.default_rng(1)
    points = 0.6 * np.clip(rng.normal(size=(starts, count + 1)), -3, 3)
    points[0], points[:, -1] = 0.0, 0.0
    early = sorted((search(z, FIRST_STRETCH_S, 25) for z in points), key=lambda f: f[0])
    late = sorted((search(z, span_s, 80) for _, z in early[:KEPT]), key=lambda f: f[0])
    for spread in SPREADS:
        near = [late[k % min(3, len(late))][1] for k in range(len(early[:KEPT]))]
        near = [np.clip(z + spread * rng.normal(size=count + 1), -2, 2) for z in near]
        late = sorted([*late, *(search(z, span_s, 40) for z in near)], key=lambda f: f[0])[:KEPT]
    return [Fit(z[:-1], SHIFT_S * z[-1], c) for c, z in late if c <= NEARLY_AS_GOOD * late[0][0]]


ROWS = (("peak of the samples", "N"), ("impulse of 25 ms", "N s"), ("first loss", "ms"),
        ("settling", "ms"))  # fmt: skip
Row = tuple[float, float, float, float]  # of ROWS; nan for a contact that is not lost, or moves on


def row_of(force: Force, level: ForceLevel, peak: float) -> Row:
    """Returns the figures of a contact. `peak`: its largest sample."""
    found = force.figures(level)
    lost_s = found.ends_s[0] if found.ends_s else np.nan
    settled_s = np.nan if found.settling_s is None else found.settling_s
    return peak, found.impulse_N_s, 1e3 * lost_s, 1e3 * settled_s


def text_of(value: float) -> str:
    """Returns a figure as text."""
    return "none" if np.isnan(value) else plain(value, 4)


@dataclass(frozen=True)
class Table:
    """Figures of the contacts of all fits, one row for each fit and phase of the sampling: the
    best fit first, (n, 4)."""

    rows: Floats

    def ranges(self) -> list[tuple[float, float, float]]:
        """Returns best (of a peak the median), lowest and highest value of each figure."""
        found = []
        for k, column in enumerate(self.rows.T):
            known = column[~np.isnan(column)]
            best = np.median(column[:SAMPLINGS]) if k == 0 else column[0]
            low, high = (known.min(), known.max()) if len(known) else (np.nan, np.nan)
            found.append((float(best), float(low), float(high)))
        return found

    def text(self, beside: Sequence[tuple[str, Row | None]]) -> list[str]:
        """Returns the lines of the table, with further columns (title, values) beside it."""
        columns = [(title, values) for title, values in beside if values is not None]
        lines = [("figure", "unit", *(title for title, _ in columns), "model", "low", "high")]
        for k, ((name, unit), ranged) in enumerate(zip(ROWS, self.ranges(), strict=True)):
            values = [text_of(values[k]) for _, values in columns]
            lines.append((name, unit, *values, *map(text_of, ranged)))
        return aligned(lines, (0, 1))

    def differences(self, measured: Row) -> list[str]:
        """Returns the names of the figures that the model does not reproduce."""
        found = []
        for (name, _), value, (best, low, high) in zip(ROWS, measured, self.ranges(), strict=True):
            if name.startswith("peak"):
                good = low * (1 - IMPULSE_WITHIN) <= value <= high * (1 + IMPULSE_WITHIN)
            elif np.isnan(value) or np.isnan(best):
                good = bool(np.isnan(value) and np.isnan(best))
            else:
                within = IMPULSE_WITHIN if name.startswith("impulse") else TIME_WITHIN
                good = abs(best - value) <= within * value
            if not good:
                found.append(f"{name} ({text_of(best)}, measured {text_of(value)})")
        return found


def table_of(
    machine: Machine, fits: Sequence[Fit], speed: float, evaluated_s: float, one: Recorded
) -> tuple[Table, Force]:
    """Returns the table of the fits at a speed, and the force of the best one."""
    rows: list[Row] = []
    best: Force | None = None
    for fit in fits:
        force = machine.contact(fit.point, speed, evaluated_s)[0].aligned(one.level)
        peaks = force.until(0.1).peaks(one.force.step_s)
        row = row_of(force, one.level, 0.0)
        rows += [(peak, *row[1:]) for peak in peaks]
        best = best or force
    assert best is not None
    return Table(np.array(rows)), best


def draw(path: Path, pairs: Sequence[tuple[str, Recorded | None, Force]]) -> None:
    """Draws measured and predicted forces, for each pair the beginning and the whole."""
    figure, every = plt.subplots(len(pairs), 2, figsize=(11, 3.2 * len(pairs)), squeeze=False)
    for axes, (title, one, force) in zip(every, pairs, strict=True):
        for ax, end_s in zip(axes, (0.1, float(force.time_s[-1])), strict=True):
            drawing.style(ax)
            if one:
                time_ms = 1e3 * one.force.time_s
                ax.plot(time_ms, one.force.force, ".", color=drawing.INK, markersize=2)
                ax.plot(
                    time_ms, one.force.smooth(), color=drawing.INK, linewidth=1, label="measured"
                )
            time_ms = 1e3 * force.time_s
            ax.plot(time_ms, force.force, color=drawing.GOT, linewidth=0.3)
            ax.plot(time_ms, force.smooth(), color=drawing.GOT, linewidth=1.2, label="model")
            ax.set_xlim(-5, 1e3 * end_s)
            ax.set_xlabel("time after the contact, ms")
        drawing.legend(axes[1])
        axes[0].set_ylabel("force, N")
        axes[0].set_title(title, fontsize=9)
    figure.tight_layout()
    drawing.save(figure, path)


def options() -> argparse.Namespace:
    """Returns the options of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n\n")[0])
    parser.add_argument("model", type=Path, help="model with a [machine_controller]")
    parser.add_argument("recording", type=Path, help="CSV or another file, or an imported NPZ")
    parser.add_argument("--map", default="force=F_N:N", help="which column is the force")
    parser.add_argument(
        "--signal", default="sensor.force", help="signal of MODEL that is the force"
    )
    parser.add_argument("--speed", type=float, required=True, help="approach of RECORDING, m/s")
    parser.add_argument("--predict", type=float, required=True, help="speed to predict, m/s")
    parser.add_argument("--against", type=Path, help="recording at the predicted speed")
    parser.add_argument("--span", type=float, default=0.1, help="fitted stretch, s")
    parser.add_argument("--evaluated", type=float, default=4.0, help="stretch of the figures, s")
    parser.add_argument("--starts", type=int, default=24, help="number of starts of the search")
    parser.add_argument(
        "--structure", choices=STRUCTURES, action="append", default=[],
        help="structure that MODEL lacks, repeatable: limits of drive and bus, a dead zone, the "
        "end of a path",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, help="picture of measured and predicted forces")
    return parser.parse_args()


def measured_row(one: Recorded, level: ForceLevel, evaluated_s: float) -> Row:
    """Returns the figures of a recorded contact."""
    force = one.force.until(evaluated_s)
    return row_of(force, level, float(force.until(0.1).force.max()))


def residual_N(one: Recorded, force: Force, span_s: float, shift_s: float) -> float:
    """Returns the rms difference of measured and fitted force after the low pass."""
    inside = (one.force.time_s > -BEFORE_S) & (one.force.time_s < span_s)
    fitted = np.interp(one.force.time_s[inside] - shift_s, force.time_s, force.smooth())
    return float(np.sqrt(np.mean((fitted - one.force.smooth()[inside]) ** 2)))


def main() -> None:
    """Reads the options, and fits a model with the structures that they name."""
    given = options()
    for name in ("speed", "predict", "span", "evaluated", "starts"):
        if not getattr(given, name) > 0:
            raise InputError(f"--{name}: expected a value above 0")
    drawing.check_name(given.out)
    with tempfile.TemporaryDirectory() as folder:
        fit_and_predict(given, with_structures(given.model, given.structure, Path(folder)))


def fit_and_predict(given: argparse.Namespace, model: Path) -> None:
    """Fits a model, predicts and prints."""
    machine = Machine(model, given.signal)
    first = recorded(given.recording, given.map)
    against = recorded(given.against, given.map) if given.against else None
    machine.contact(
        np.zeros(len(machine.guesses)), given.speed, given.span
    )  # refuses a wrong model
    fits = fits_of(machine, first, given.speed, given.span, given.starts)
    fits = [
        fit for fit in fits
        if all(
            abs(machine.contact(fit.point, speed, given.span)[1]) < SPEED_WITHIN
            for speed in (given.speed, given.predict)
        )
    ]  # fmt: skip
    if not fits:
        raise InputError(f"{given.model}: expected a fit that approaches with its speed, got none")
    fitted, fitted_force = table_of(machine, fits, given.speed, given.evaluated, first)
    ahead, ahead_force = table_of(machine, fits, given.predict, given.evaluated, first)
    own = measured_row(first, first.level, given.evaluated)
    other = measured_row(against, first.level, given.evaluated) if against else None
    ratio = given.predict / given.speed

    print(f"recording    {first.name}: {given.speed:g} m/s, {1 / first.force.step_s:.5g} Hz")
    values = machine.values(fits[0].point)
    print(f"fit          the best of {len(fits)} that are nearly as good:")
    print(f"             {', '.join(f'{n} {v:.3g}' for n, v in values.items())}")
    off = residual_N(first, fitted_force, given.span, fits[0].shift_s)
    print(f"residual     {off:.3g} N rms below 166 Hz, first {1e3 * given.span:g} ms")
    print(*fitted.text([("measured", own)]), sep="\n")
    print(f"prediction   {given.predict:g} m/s")
    scaled = (own[0] * ratio, own[1] * ratio, own[2], own[3])
    print(*ahead.text([("measured", other), ("proportional", scaled)]), sep="\n")
    print(f"lacks        {', '.join(fitted.differences(own)) or 'nothing in these figures'}")
    if other:
        print(f"wrong        {', '.join(ahead.differences(other)) or 'no predicted figure'}")
    if given.out:
        fitted_force = Force(fitted_force.time_s + fits[0].shift_s, fitted_force.force)
        titles = (f"{first.name}, {given.speed:g} m/s", f"{given.predict:g} m/s")
        draw(given.out, [(titles[0], first, fitted_force), (titles[1], against, ahead_force)])


if __name__ == "__main__":
    try:
        main()
    except (InputError, OSError) as error:
        print(f"foreign_contact.py: {error}", file=sys.stderr)
        sys.exit(2)
