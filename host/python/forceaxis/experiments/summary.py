"""The result of a run as text: verdict with reasons and window, controlled force, energy balance.

Forces are in N and positions in mm if the model has the converters that give the size of a count.
Otherwise forces are in 8-bit counts of the measured force, and positions in encoder counts.
"""

from collections.abc import Sequence
from typing import TypeAlias

from forceaxis import _core
from forceaxis.experiments.run_result import (
    Converter,
    Converters,
    Criterion,
    CycleReport,
    HeldForce,
    LinkReport,
    Metrics,
    MissedLimit,
    RunResult,
)
from forceaxis.words import counted

COUNTED_IN = {"force": "of the force reading at 8 bits", "position": "of the encoder"}
Row: TypeAlias = tuple[str, str]  # (key, text) of one text line


def quantity(value: float, unit: str) -> str:
    """Returns a value with a unit as text. A length in m is shown in mm."""
    return f"{value * 1e3:.3g} mm" if unit == "m" else f"{value:.3g} {unit}"


def size_of_count(what: str, converters: Converters) -> tuple[float, str] | None:
    """Returns (size, unit) of one 8-bit count of the force, or of one count of the position.
    Returns None if the model has no converter for this quantity. `what`: "force" or "position"."""
    if what == "position":
        encoder = converters.get("encoder")
        return (abs(encoder.per_code), encoder.unit) if encoder else None
    reading = converters.get("adc0")
    return (reading.per_8_bit_count, reading.unit) if reading else None


def ripple(
    what: str,
    count: float,
    converters: Converters,
    limit: float | None = None,
    beyond: bool = False,
    kind: str = "ripple",
) -> str:
    """Returns the ripple of the force or of the position as text, with its limit in [verdict].

    `what`: "force" or "position". `count` and `limit` are in counts. `beyond`: True if the ripple
    exceeds the limit. `kind`: "ripple", or "error" for a distance from the set-point.
    """
    of = "" if limit is None else f" of {limit:.3g}"
    plural = "s" * ((count if limit is None else limit) != 1)
    in_counts = f"{count:.3g}{of} count{plural} {COUNTED_IN[what]}"
    size = size_of_count(what, converters)
    if not size:
        return f"{what} {kind} {in_counts}" + (" allowed" if limit is not None else "")
    physical, unit = size
    kept = "" if limit is None else quantity(limit * physical, unit)
    kept = kept and (f" above the {kept} allowed" if beyond else f" of {kept} allowed")
    return f"{what} {kind} {quantity(count * physical, unit)}{kept} ({in_counts})"


def reasons(
    missed: Sequence[MissedLimit], metrics: Metrics, fault: str, converters: Converters
) -> list[str]:
    """Returns the reasons for a verdict other than "stable". There is one text for each limit that
    the run exceeds."""
    return [_missed(limit, metrics, fault, converters) for limit in missed]


# {name of a limit: text about a run that exceeds this limit}
MISSED = {
    "fault": "fault {fault}",
    "setpoint": "no set-point of force at the end",
    "position_setpoint": "no set-point of the position",
    "contact_made_s": "contact made after {value:.3g} s, the window begins at {bound:.3g} s",
    "contact_losses": "contact lost {times} in the window",
    "contact_losses_max": "contact lost {times}, {bound:g} allowed",
    "held_force_error_max_N": "{kept}, error {value:.3g} above {bound:.3g} N",
    "held_force_error_max_percent": "{kept}, error {value:.3g} above {bound:.3g} %",
    "overshoot_max_percent": "overshoot {value:.3g} above {bound:.3g} %",
    "settle_max_s": "settled after {value:.3g} s, above {bound:.3g} s",
    "peak_force_max_N": "peak force {value:.4g} above {bound:.4g} N",
    "peak_force_max_percent": "peak force {value:.4g} above {bound:.4g} % of the set-point",
    "saturated_max_s": "output at an end of its range for {value:.3g} s, above {bound:.3g} s",
    "setpoint_range": "set-point {value:.4g} N beyond the force reading, which ends at {bound:.4g} "
    "N",
    "reading_range": "force reading at an end of its range{range} for {value:.0f} of {ticks} ticks "
    "of the window",
    "output_range": "output at an end of its range for {value:.0f} of {ticks} ticks of the window",
}


def _missed(missed: MissedLimit, metrics: Metrics, fault: str, converters: Converters) -> str:
    """Returns a text about a limit that a run exceeds, with value, bound and unit."""
    limit, value, bound = missed.limit, missed.value, missed.bound
    if limit == "contact_held":
        if missed.verdict == "never_in_contact":
            return "never in contact"
        when = "start of the window" if metrics.in_contact else "end"
        return f"not in contact at the {when}"
    if value is None:  # Only the limit settle_max_s can have no measured value.
        return "force not settled before the window"
    if limit in MISSED:
        held, reading = metrics.held_force, converters.get("adc0")
        low, high = reading_range(metrics, reading) if reading else (0.0, 0.0)
        return MISSED[limit].format(
            value=value,
            bound=bound,
            fault=fault,
            times=counted(int(value), "time"),
            ticks=metrics.window_ticks,
            kept=f"{held.held_N:.4g} N of {held.setpoint_N:.4g} N held" if held else "",
            range=f" ({low:.4g} to {high:.4g} {reading.unit})" if reading else "",
        )
    what, kind = limit.split("_")[:2]
    text = ripple(what, value, converters, bound, beyond=True, kind=kind)
    if kind == "error":
        return text
    late = (
        metrics.force_ripple_late_count if what == "force" else metrics.position_ripple_late_count
    )
    falling = missed.verdict == "not_met" and late < value
    return text + (f", {late:.3g} in the second half of the window" if falling else "")


def reading_range(metrics: Metrics, reading: Converter) -> tuple[float, float]:
    """Returns the smallest and the largest force in N that a run could measure. If the sensor
    saturates within the range of the converter, the reading at saturation is the end of the
    measurable range."""
    low, high = reading.range
    end = metrics.reading_end_N
    return (max(low, end), high) if end < 0 else (low, min(high, end or high))


def warnings(
    setpoints: Sequence[tuple[float, float]],
    limited: Sequence[tuple[float, float]],
    converters: Converters,
) -> list[str]:
    """Returns a warning for each force set-point that cannot be reached. It is outside of the range
    of ADC 0, or above the limit of the demanded force. `setpoints`: (time of the change in s, force
    in N). `limited`: (set-point in N, its limit in N)."""
    reading = converters.get("adc0")
    if not reading:
        return []
    low, high = reading.range
    beyond = dict.fromkeys(N for _, N in setpoints if not low <= N <= high)
    return [
        f"set-point {N:.4g} N: expected one within the force reading, {low:.4g} to "
        f"{high:.4g} N; beyond it the force is not controlled"
        for N in beyond
    ] + [
        f"set-point {N:.4g} N: expected at most the limit of the force, {most:.4g} N (force_limit "
        "of rated_force); the axis demands no more"
        for N, most in dict.fromkeys(limited)
    ]


def kept_limits(result: RunResult, criterion: Criterion) -> list[str]:
    """Returns a text for each limit of [verdict] that a stable run keeps, with the value of the
    run."""
    metrics, held, required = result.metrics, result.metrics.held_force, criterion.contact_held
    found = []
    if required:
        found.append("contact held" if required is True else f"{', '.join(required)} held")
    peak_N = metrics.peak_force_N
    saturated_s = metrics.saturated_run_ticks / _core.TICKS_PER_SECOND
    for limit, what, reached, unit in (
        (criterion.held_force_error_max_N, "error", held and abs(held.error_N), " N"),
        (criterion.held_force_error_max_percent, "error", held and held.error_percent, " %"),
        (criterion.overshoot_max_percent, "overshoot", held and held.overshoot_percent, " %"),
        (criterion.settle_max_s, "settled in", held and held.settle_s, " s"),
        (criterion.peak_force_max_N, "peak", peak_N, " N"),
        (
            criterion.peak_force_max_percent,
            "peak",
            held and 100 * peak_N / abs(held.setpoint_N),
            " %",
        ),
        (criterion.contact_losses_max, "losses of contact", metrics.contact_losses_run, ""),
        (criterion.saturated_max_s, "output at an end of its range", saturated_s, " s"),
    ):
        if limit is not None:
            found.append(f"{what} {reached:.3g}{unit} of {limit:.3g}{unit} allowed")
    for what, count, limit in (
        ("force", metrics.force_ripple_count, criterion.force_ripple_max_count),
        ("position", metrics.position_ripple_count, criterion.position_ripple_max_count),
    ):
        if limit is not None:
            found.append(ripple(what, count, result.converters, limit))
    error, limit = metrics.position_error_count, criterion.position_error_max_count
    if limit is not None and error is not None:
        found.append(ripple("position", abs(error), result.converters, limit, kind="error"))
    return found


def verdict_text(result: RunResult) -> str:
    """Returns the verdict as text, with its reasons and its window."""
    if not result.verdict or not result.criterion:
        return "none, because the experiment has no table [verdict]"
    because = result.because or kept_limits(result, result.criterion)
    window = f"over the last {result.criterion.window_s:g} s"
    return f"{result.verdict}: {', '.join([*because, window])}"


def force_text(held: HeldForce) -> str:
    """Returns set-point, controlled force, error, overshoot and settling time as text."""
    settled = "not settled" if held.settle_s is None else f"settled in {held.settle_s:.3g} s"
    return (
        f"{held.held_N:.4g} N of {held.setpoint_N:.4g} N set-point, error {held.error_N:.3g} N "
        f"({held.error_percent:.3g} %), overshoot {held.overshoot_percent:.3g} %, {settled} "
        f"from {held.from_s:.3g} s on"
    )


def window_text(result: RunResult) -> str:
    """Returns the ripples and contact losses in the window of the verdict as text. Without a
    window, the last second of the run is used."""
    metrics, converters = result.metrics, result.converters
    seconds = result.criterion.window_s if result.criterion else 1
    rows = [
        ripple("force", metrics.force_ripple_count, converters),
        ripple("position", metrics.position_ripple_count, converters),
        f"contact lost {counted(metrics.contact_losses, 'time')}",
    ]
    return f"last {seconds:g} s: {', '.join(rows)}"


def rows(result: RunResult, overrides: Sequence[str] = ()) -> list[Row]:
    """Returns the result of a run as rows (key, text). `overrides`: texts NAME=VALUE of the run."""
    energy, metrics, margin = result.energy, result.metrics, result.edge_margin
    figure = f" (Fig {result.figure})" if result.figure else ""
    found = [("experiment", result.title + figure)]
    if overrides:
        found.append(("changed", ", ".join(overrides)))
    found.append(("verdict", verdict_text(result)))
    found += [("warning", text) for text in result.warnings]
    found.append(("fault", result.fault))
    found += [("refused", f"{r.object} at tick {r.tick}: {r.reason}") for r in result.refused]
    if result.cycle:
        found += cycle_rows(result.cycle)
    if metrics.held_force:
        found.append(("held", force_text(metrics.held_force)))
    found += [
        ("force", f"peak {metrics.peak_force_N:.4g} N, end {metrics.final_force_N:.4g} N"),
        ("window", window_text(result)),
        ("events", f"{result.events} in {result.ticks} ticks"),
        ("energy", f"supplied {energy.supplied_J:.6g} J, residual {energy.residual_J:.2g} J"),
    ]
    if result.link and result.link.statistics and result.objects:
        names = ", ".join(result.objects)
        found.append(("not traced", f"{names}: axis_node does not send objects"))
    edge = "nothing converted" if margin is None else f"{margin:.3g} LSB to the next code"
    found += [("edge margin", edge), ("trace hash", result.trace_hash)]
    if result.link:
        found += link_rows(result.link)
    return [*found, ("again", result.command)]


# {value of the object cycle_state: reason why no cycle started}
NOT_STARTED = {
    "no_program": "the axis has no program",
    "other_bank": "the program is for another bank",
    "not_homed": "the program has a move to a position, and the axis is not homed",
    "results_full": "too many results wait; use `read_results`",
    "locked": "the axis is locked after bad parts; acknowledge their results with "
    "`read_results`, or write cycle_unlock after cycle_bad_in_row_max parts",
    "not_stored": "the axis has not stored the number of its power-ups yet; try again",
    "beyond_sensor": "a force of the program (force_max, force_above, force_below, zero_force) is "
    "at or beyond the end of what the force sensor can show; lower it, or check adc_bits, "
    "force_zero_code and force_tare",
    "halted": "the axis is halted; write a controlword without the halt bit",
}
# how an experiment starts the cycle whose program it names
CYCLE_START = (
    "an experiment starts one with modes_of_operation = -9 and, under [[at]], the controlwords 6, "
    "7, 15 and 31 one after the other"
)
CYCLE_STATES = {
    "idle": f"no cycle was started: {CYCLE_START}",
    "running": "the cycle still runs at the end of the run",
    "evaluating": "the cycle has ended in the last tick of the run",
    **{state: f"no cycle was started: {why}" for state, why in NOT_STARTED.items()},
}
CYCLE_OUTCOMES = {
    "over_force": "force_max exceeded",
    "over_travel": "travel_max exceeded",
    "over_time": "time_max exceeded",
    "stopped": "stopped",
    "samples_lost": "samples lost",
    "tare_contact": "tare in contact",
    "tare_moving": "no standstill for the tare",
    "tare_band": "tare beyond tare_band",
    "changed": "a value that decides the part was changed",
    "samples_invalid": "a sample at an end of its range or older than cycle_age_max",
}


def why_text(outcome: str, phase: str, invalid_ticks: int) -> str:
    """Returns a text that states why a cycle ended in another way than its program intends, and in
    which phase. `phase`: name of the phase, "" if it is not known."""
    text, ticks = CYCLE_OUTCOMES.get(outcome, outcome), counted(invalid_ticks, "tick")
    where = f" in phase {phase}" if phase else ""
    if outcome == "samples_invalid":
        return f"{ticks}{where} with {text}"
    return f"{text}{where}" + (f"; samples of {ticks} not valid" if invalid_ticks else "")


def cycle_rows(report: CycleReport) -> list[Row]:
    """Returns the last cycle of a run as rows (key, text): the verdict of the part, and the value
    of each evaluation element."""
    state = CYCLE_STATES.get(report.state, report.state)
    if report.failed_phase:
        state += f": {why_text(report.outcome, report.failed_phase, report.invalid_ticks)}"
    found = [("cycle", f"{report.title}: {state}")]
    for figure in report.figures:
        value = f"{figure.value:g}" if not figure.unit else quantity(figure.value, figure.unit)
        text = f"{figure.verdict}, {value}" if figure.verdict != "not reached" else figure.verdict
        found.append((figure.name, text))
    return found


def link_rows(report: LinkReport) -> list[Row]:
    """Returns the report of a run over a connection as rows (key, text)."""
    other = "" if report.same else ", NOT THE PLANT'S"
    found = [
        ("link", f"{report.kind}, {report.where}, {report.real_time:.1f} x real time"),
        ("processes", f"plant {report.pids.plant}, axis {report.pids.axis}"),
        ("axis hash", report.hashes.axis + other),
    ]
    if report.interrupts is not None:
        rate_hz = _core.TICKS_PER_SECOND
        ticks = f"{report.ticks} ticks" + (
            f", {report.late_ticks} late" if report.late_ticks else ""
        )
        found.append(("interrupts", f"{report.interrupts} at {rate_hz} Hz, {ticks}"))
    if counts := report.statistics:
        sent, repeated = counts.plant["sent"], report.repeated
        lost, twice = (counts.plant[k] + counts.axis[k] for k in ("dropped", "doubled"))
        found.append(
            (
                "records",
                f"{sent} sent, {repeated} of them again; {lost} dropped and {twice} doubled by "
                "the injected faults",
            )
        )
    return found


def describe(result: RunResult, overrides: Sequence[str] = ()) -> str:
    """Returns the result of a run as text lines. `overrides`: texts NAME=VALUE of the run."""
    return "\n".join(f"{key:12} {value}" for key, value in rows(result, overrides))
