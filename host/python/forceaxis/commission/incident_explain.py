"""Explains an incident. Finds the change of plant, sensor or command that reproduces the last
second before the fault best.

found = explain(incident, ExplainOrder("press/model.toml"))
found.result.causes[0].name, found.result.causes[0].changes

The recorded DAC codes are the input of the simulated plant. Each possible cause has up to three
unknown numbers. These are fitted together with the uncertain parameters of the released machine.
The causes are ranked by the decrease of chi-square minus ln n for each number of the cause, where n
is the number of samples (Schwarz, The Annals of Statistics 6, 1978). In contrast to a Laplace
approximation of the evidence, this rank needs no prior for the size of a change, which is unknown.
"""

import json
import math
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from forceaxis import paths, progress
from forceaxis.commission import contact_check, contact_data, incident_repeat
from forceaxis.commission.contact_fit import REJECTED_BELOW
from forceaxis.commission.incident import Incident
from forceaxis.commission.incident_causes import CHANGED, COMMAND, FittedCause, Released
from forceaxis.linear.plant_facts import Overrides
from forceaxis.results import to_json

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# POSSIBLE_BELOW: largest difference between the best rank and the rank of a possible cause.
# A difference of 10 in rank is a factor of 150 in the probability (Kass and Raftery 1995).
POSSIBLE_BELOW = 10.0
# AGAIN_BELOW: largest difference between the best rank and the rank of a cause with a second fit.
# The second fit of a cause uses the derivatives for the plant with this cause.
AGAIN_BELOW = 50.0
# LARGE_FACTOR: smallest factor of a large change of a parameter.
# A recorded second that cannot exclude a large change does not show what has happened.
LARGE_FACTOR = 1.5
# least number of ticks before the first contact from which the speed is computed
SPEED_TICKS = 15
UNITS = {"gain": "", "offset": "N", "place": "m", "scale": "", "slip": "m"}
FILES = ("explanation.json", "explanation.png", "model.toml", "experiment.toml")


@dataclass(frozen=True)
class CauseChange:
    """A number that a cause changes, in SI units. It has the most likely value and its 95 %
    interval. `released`: value in the released machine, or None if the released machine has no such
    number."""

    name: str
    unit: str
    value: float
    interval: tuple[float, float]
    released: float | None


@dataclass(frozen=True)
class TriedCause:
    """A cause that was fitted, with its changes. `gain`: decrease of chi-square, compared with the
    released machine, minus the penalty. `below`: gain of the best cause minus this gain. `p`: p
    value of the recorded second. `verdict`: "explains", "possible", "incomplete" or "ruled out"."""

    name: str
    text: str
    changes: tuple[CauseChange, ...]
    gain: float
    below: float
    p: float
    verdict: str


@dataclass(frozen=True)
class Explanation:
    """The possible causes of an incident, sorted with the most likely first. `ticks`: number of
    ticks that were compared. `touch_s`: time of the first contact in s relative to the fault (not
    positive), or None if there was no contact. `speed_m_per_s`: speed of the axis at this contact
    or, without a contact, at the fault. `explained`: False if no cause reproduces the recorded
    second (p below 0.001). `repeats`: True if the experiment with the best cause has the same
    fault. None if there is no such experiment."""

    where: str
    fault: str
    model: str
    posterior: str | None
    ticks: int
    touch_s: float | None
    speed_m_per_s: float
    peak_N: float
    explained: bool
    repeats: bool | None
    causes: tuple[TriedCause, ...]


@dataclass(frozen=True)
class ExplainOrder:
    """The request for an explanation: the model of the released machine, overrides of its
    parameters, and optionally the file of its posterior."""

    model: str
    posterior: Path | None = None
    held: Overrides = field(default_factory=dict)


@dataclass(frozen=True)
class Explained:
    """The explanation, and the data for its plot: the fits of the causes, sorted with the best
    first, and the fit of the released machine. `files`: {file name: text} of a model and an
    experiment that repeat the incident."""

    result: Explanation
    fits: tuple[FittedCause, ...]
    released: Released
    files: Mapping[str, str]


def explain(incident: Incident, order: ExplainOrder) -> Explained:
    """Explains an incident. Raises InputError."""
    released = Released(order.model, incident, order.held, order.posterior)
    fits = [released.fit]
    with tempfile.TemporaryDirectory() as folder:
        for number, cause in enumerate(progress.each(released.causes(), "causes")):
            own = Path(folder) / str(number)
            own.mkdir()
            fits.append(released.fitted(cause, own))
        size = len(released.problem.force.values) + len(released.problem.position.values)

        def gain(fit: FittedCause) -> float:
            return 2 * (released.fit.cost - fit.cost) - fit.cause.count * math.log(size)

        fits.sort(key=lambda fit: -gain(fit))
        near = [fit for fit in fits if gain(fit) > gain(fits[0]) - AGAIN_BELOW]
        if len(near) > 1:
            fits[: len(near)] = [released.again(fit) for fit in near]
            fits.sort(key=lambda fit: -gain(fit))
        best = gain(fits[0])
        causes = _untold(tuple(_tried(fit, gain(fit), best) for fit in fits))
        files = incident_repeat.files(incident, released, fits[0])
        repeats = incident_repeat.repeats(incident, files) if files else None
    touch = released.data.touches[0]
    rate, last = released.data.rate_hz, len(touch.volts) - 1
    assert touch.position is not None
    cycle = released.facts.required_drive.bus.cycle_ticks
    # At least two positions, of which a bus brings one in each cycle.
    way = max(SPEED_TICKS, 2 * cycle) * released.data.parts
    end = max(touch.onset, float(touch.position.at[0]) + way)
    speed = contact_data.mean_speed(touch.position, end - way, end)
    result = Explanation(
        where=incident.where,
        fault=incident.fault,
        model=paths.display(released.path),
        posterior=paths.display(order.posterior) if order.posterior else None,
        ticks=int((last - touch.force.at[0]) / released.data.parts) + 1,
        touch_s=(touch.onset - last) / rate if touch.onset < last else None,
        speed_m_per_s=speed * rate,
        peak_N=float(touch.force.values.max()),
        explained=causes[0].p >= REJECTED_BELOW,
        repeats=repeats,
        causes=causes,
    )
    return Explained(result, tuple(fits), released, files)


def _untold(causes: tuple[TriedCause, ...]) -> tuple[TriedCause, ...]:
    """Returns the causes. If the best one is that nothing has changed, but the recorded second
    cannot exclude a large change of plant or sensors, the text of the best one says so. This is so
    if the contact was too short."""
    best, *others = causes
    open_causes = [one.name for one in others if one.verdict == "possible" and _may_be_large(one)]
    if best.name != COMMAND or not open_causes:
        return causes
    text = (
        "no change of plant or sensors shows, but the recorded contact is too short to exclude a "
        f"large one: {', '.join(open_causes)}"
    )
    return (replace(best, text=text, verdict="possible"), *others)


def _may_be_large(cause: TriedCause) -> bool:
    """Returns True if the 95 % interval of a changed number includes a value that differs from the
    released one by the factor LARGE_FACTOR."""
    return any(
        one.released is not None and one.released > 0
        and not (one.released / LARGE_FACTOR < one.interval[0]
                 and one.interval[1] < one.released * LARGE_FACTOR)
        for one in cause.changes
    )  # fmt: skip


def _tried(fit: FittedCause, gain: float, best: float) -> TriedCause:
    p = contact_check.check(fit.problem, fit.point).p
    values, intervals = fit.values(), fit.intervals()
    units = dict(fit.cause.element.units) if fit.cause.element else UNITS
    known = fit.cause.released
    changes = tuple(
        CauseChange(
            name.removeprefix(CHANGED), units[name], value, intervals[name], known.get(name)
        )
        for name, value in values.items()
    )  # fmt: skip
    below = best - gain
    if below > POSSIBLE_BELOW:
        verdict = "ruled out"
    elif p < REJECTED_BELOW:
        verdict = "incomplete"
    else:
        verdict = "explains" if below == 0 else "possible"
    return TriedCause(fit.cause.name, fit.cause.text, changes, gain, below, p, verdict)


def figure(found: Explained) -> "Figure":
    """Returns the plot of the recorded second over the time from the fault. It shows force and
    position as measured, of the released machine, and with the best cause, and the residuals of the
    two models."""
    import matplotlib.pyplot as plt

    from forceaxis.drawing import FAINT, GOT, INK, legend, style

    made, rows = plt.subplots(
        2, 2, sharex=True, figsize=(9, 5), height_ratios=(2, 1), layout="constrained"
    )
    best, base = found.fits[0], found.released.fit
    parts = (("force, N", "force", 1.0), ("position, mm", "position", 1e3))
    for column, (label, signal, scale) in enumerate(parts):
        upper, lower = rows[0][column], rows[1][column]
        joined = getattr(best.problem, signal)
        data = best.problem.data
        ms = 1e3 * (joined.exact - len(data.touches[0].volts) + 1) / data.rate_hz
        upper.plot(ms, scale * joined.values, ".", color=INK, markersize=2.5, label="measured")
        shown = [(best, GOT, best.cause.name)]
        if base is not best:
            shown.insert(0, (base, FAINT, "released machine"))
        for fit, color, name in shown:
            predicted = getattr(fit.problem.predict(fit.point[None]), signal)
            upper.plot(ms, scale * predicted[0], color=color, linewidth=1.0, label=name)
            lower.plot(ms, joined.scaled(predicted)[0], color=color, linewidth=0.7)
        lower.axhline(0, color=FAINT, linewidth=0.6)
        upper.set_ylabel(label, fontsize=8)
        lower.set_ylabel("residual,\nstandard deviations", fontsize=8)
        lower.set_xlabel("time from the fault, ms", fontsize=8)
        style(upper)
        style(lower)
    legend(rows[0][0], loc="upper left")
    made.suptitle(
        f"{found.result.fault.replace('_', ' ')}: {best.cause.text}", fontsize=9, parse_math=False
    )
    plt.close(made)
    return made


def write(found: Explained, folder: Path) -> None:
    """Writes the files FILES to a folder, either all or none. If there is no experiment, writes
    only the first two."""
    with paths.replacing(folder, *FILES[:2], *found.files) as (summary, picture, *texts):
        summary.write_text(json.dumps(to_json(found.result), indent=1) + "\n")
        figure(found).savefig(picture, format="png", dpi=120)
        for file, text in zip(texts, found.files.values(), strict=True):
            file.write_text(text)
