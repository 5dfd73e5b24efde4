"""A run in words: its verdict with the reason and the window, the force held, its audit.

Quantities are in N and mm where the model's converters say how large a count is; a count is always
one of the force reading, at 8 bits whatever the ADC has, or of the encoder.
"""

import itertools
import shlex

from forceaxis import _core
from forceaxis.experiments import link
from forceaxis.words import counted

OF = {"force": "of the force reading at 8 bits", "position": "of the encoder"}


def quantity(value, unit):
    """A value of the model in words, lengths in mm."""
    return f"{value * 1e3:.3g} mm" if unit == "m" else f"{value:.3g} {unit}"


def size_of_count(what, converters):
    """(size, unit) of a count of "force", at 8 bits, or "position"; None: not converted."""
    if what == "position":
        encoder = converters.get("encoder")
        return encoder and (abs(encoder["per_code"]), encoder["unit"])
    reading = converters.get("adc0")
    return reading and (abs(reading["per_code"]) * 2 ** (reading["bits"] - 8), reading["unit"])


def ripple(what, count, converters, limit=None, beyond=False):
    """The ripple of force or position, beside its limit where there is one."""
    of = "" if limit is None else f" of {limit:.3g}"
    plural = "s" * ((count if limit is None else limit) != 1)
    in_counts = f"{count:.3g}{of} count{plural} {OF[what]}"
    size = size_of_count(what, converters)
    if not size:
        return f"{what} ripple {in_counts}" + (" allowed" if limit is not None else "")
    physical, unit = size
    kept = "" if limit is None else quantity(limit * physical, unit)
    kept = kept and (f" above the {kept} allowed" if beyond else f" of {kept} allowed")
    return f"{what} ripple {quantity(count * physical, unit)}{kept} ({in_counts})"


def reasons(missed, metrics, fault, converters):
    """Why a run is not stable: each limit that it missed (`missed` of a result), in words."""
    return [_missed(one, metrics, fault, converters) for one in missed]


# The words of a missed limit, by its name.
MISSED = {
    "fault": "fault {fault}",
    "setpoint": "no set-point of force at the end",
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


def _missed(one, metrics, fault, converters):
    """One missed limit in words, with its number, the bound and the unit."""
    limit, value, bound = one["limit"], one["value"], one["bound"]
    if limit == "contact_held":
        if one["verdict"] == "never_in_contact":
            return "never in contact"
        when = "start of the window" if metrics["in_contact"] else "end"
        return f"not in contact at the {when}"
    if limit == "settle_max_s" and value is None:
        return "force not settled before the window"
    if limit in MISSED:
        held, ends = metrics["held_force"], reading_range(converters)
        return MISSED[limit].format(
            value=value,
            bound=bound,
            fault=fault,
            times=counted(int(value), "time"),
            ticks=metrics["window_ticks"],
            kept=f"{held['held_N']:.4g} N of {held['setpoint_N']:.4g} N held" if held else "",
            range=f" ({ends[0]:.4g} to {ends[1]:.4g} {ends[2]})" if ends else "",
        )
    what = limit.split("_")[0]
    text = ripple(what, value, converters, bound, beyond=True)
    late = metrics[f"{what}_ripple_late_count"]
    falling = one["verdict"] == "not_met" and late < value
    return text + (f", {late:.3g} in the second half of the window" if falling else "")


def reading_range(converters):
    """(least, largest, unit) that ADC 0 can read; None: it is not converted."""
    reading = converters.get("adc0")
    if not reading:
        return None
    ends = sorted(
        (code - reading["zero"]) * reading["per_code"] for code in (0, 2 ** reading["bits"] - 1)
    )
    return (*ends, reading["unit"])


def warnings(setpoints, converters):
    """What a run is warned of: set-points, (from time_s, N), that ADC 0 cannot read."""
    ends = reading_range(converters)
    if not ends:
        return []
    beyond = dict.fromkeys(N for _, N in setpoints if not ends[0] <= N <= ends[1])
    return [
        f"set-point {N:.4g} N: expected one within the force reading, {ends[0]:.4g} to "
        f"{ends[1]:.4g} N; beyond it the force is not controlled"
        for N in beyond
    ]


def kept_limits(summary):
    """What a stable run was judged by: every limit of its [verdict] with what it reached."""
    criterion, metrics = summary["criterion"], summary["metrics"]
    held = metrics["held_force"]
    found = []
    if names := criterion["contact_held"]:
        found.append("contact held" if names is True else f"{', '.join(names)} held")
    peak_N = metrics["peak_force_N"]
    saturated_s = metrics["saturated_run_ticks"] / _core.TICKS_PER_SECOND
    for key, what, reached, unit in (
        ("held_force_error_max_N", "error", held and abs(held["error_N"]), "N"),
        ("held_force_error_max_percent", "error", held and held["error_percent"], "%"),
        ("overshoot_max_percent", "overshoot", held and held["overshoot_percent"], "%"),
        ("settle_max_s", "settled in", held and held["settle_s"], "s"),
        ("peak_force_max_N", "peak", peak_N, "N"),
        ("peak_force_max_percent", "peak", held and 100 * peak_N / abs(held["setpoint_N"]), "%"),
        ("contact_losses_max", "losses of contact", metrics["contact_losses_run"], ""),
        ("saturated_max_s", "output at an end of its range", saturated_s, "s"),
    ):
        if (limit := criterion[key]) is not None:
            unit = unit and f" {unit}"
            found.append(f"{what} {reached:.3g}{unit} of {limit:.3g}{unit} allowed")
    for what in ("force", "position"):
        limit = criterion[f"{what}_ripple_max_count"]
        if limit is not None:
            count = metrics[f"{what}_ripple_count"]
            found.append(ripple(what, count, summary["converters"], limit))
    return found


def verdict_text(summary):
    """The verdict, why, and over which window."""
    if not summary["verdict"]:
        return "none asked for, the experiment has no [verdict]"
    because = summary["because"] or kept_limits(summary)
    window = f"over the last {summary['criterion']['window_s']:g} s"
    return f"{summary['verdict']}: {', '.join([*because, window])}"


def describe_force(held):
    """Set-point and force held, one line."""
    settled = "not settled" if held["settle_s"] is None else f"settled in {held['settle_s']:.3g} s"
    return (
        f"{held['held_N']:.4g} N of {held['setpoint_N']:.4g} N set-point, error "
        f"{held['error_N']:.3g} N "
        f"({held['error_percent']:.3g} %), overshoot {held['overshoot_percent']:.3g} %, {settled} "
        f"from {held['from_s']:.3g} s on"
    )


def window_text(summary):
    """What happened in the judged window, or in the last second."""
    criterion, metrics = summary["criterion"], summary["metrics"]
    seconds = criterion["window_s"] if criterion else 1
    rows = [
        ripple(what, metrics[f"{what}_ripple_count"], summary["converters"])
        for what in ("force", "position")
    ]
    lost = f"contact lost {counted(metrics['contact_losses'], 'time')}"
    return f"last {seconds:g} s: {', '.join([*rows, lost])}"


def changed(command):
    """What --set replaced in the experiment's file."""
    words = shlex.split(command)
    return [value for option, value in itertools.pairwise(words) if option == "--set"]


def rows(summary):
    """The summary for a terminal: (key, text), the outcome first."""
    energy, metrics, margin = summary["energy"], summary["metrics"], summary["edge_margin"]
    found = [
        ("experiment", summary["title"] + (f" (Fig {f})" if (f := summary["figure"]) else "")),
        *([("changed", ", ".join(given))] if (given := changed(summary["command"])) else []),
        ("verdict", verdict_text(summary)),
        *(("warning", text) for text in summary["warnings"]),
        ("fault", summary["fault"]),
        *(
            ("refused", f"{r['object']} at tick {r['tick']}: {r['reason']}")
            for r in summary["refused"]
        ),
        *([("held", describe_force(held))] if (held := metrics["held_force"]) else []),
        ("force", f"peak {metrics['peak_force_N']:.4g} N, end {metrics['final_force_N']:.4g} N"),
        ("window", window_text(summary)),
        ("events", f"{summary['events']} in {summary['ticks']} ticks"),
        (
            "energy",
            f"supplied {energy['supplied_J']:.6g} J, residual {energy['residual_J']:.2g} J",
        ),
    ]
    if "link" in summary and summary["objects"]:
        names = ", ".join(summary["objects"])
        found.append(("not traced", f"{names}: objects are read in process only"))
    return [
        *found,
        (
            "edge margin",
            "nothing converted" if margin is None else f"{margin:.3g} LSB to the next code",
        ),
        ("trace hash", summary["trace_hash"]),
        *(link.describe(summary["link"]) if "link" in summary else []),
        ("again", summary["command"]),
    ]


def describe(summary):
    """The rows as lines."""
    return "\n".join(f"{key:12} {value}" for key, value in rows(summary))
