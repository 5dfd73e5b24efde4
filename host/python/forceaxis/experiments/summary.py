"""A run in words: its verdict with the reason and the window, the force held, its audit.

Quantities are in N and mm where the model's converters say how large a count is; a count is always
one of the force reading, at 8 bits whatever the ADC has, or of the encoder.
"""

import itertools
import shlex

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


def reasons(criterion, metrics, fault, converters):
    """Why a run is unstable: every limit of its [verdict] that it exceeds, in words."""
    found = [] if fault == "none" else [f"fault {fault}"]
    if criterion["contact_held"]:
        if metrics["peak_force_N"] == 0:
            found.append("never in contact")
        elif metrics["contact_losses"]:
            found.append(f"contact lost {counted(metrics['contact_losses'], 'time')} in the window")
        elif not metrics["in_contact"]:
            found.append("not in contact at the end")
    found += force_reasons(criterion, metrics["held_force"])
    for what in ("force", "position"):
        count, limit = metrics[f"{what}_ripple_count"], criterion[f"{what}_ripple_max_count"]
        if limit is not None and count > limit:
            found.append(ripple(what, count, converters, limit, beyond=True))
    return found


def force_reasons(criterion, held):
    """Every limit of [verdict] that the force held, see metrics.held_force, exceeds, in words."""
    if held is None:
        return []
    kept = f"{held['held_N']:.4g} N of {held['setpoint_N']:.4g} N held"
    found = []
    limit = criterion["held_force_error_max_N"]
    if limit is not None and abs(held["error_N"]) > limit:
        found.append(f"{kept}, error {abs(held['error_N']):.3g} above {limit:.3g} N")
    for what, limit_key, words in (
        ("error_percent", "held_force_error_max_percent", f"{kept}, error"),
        ("overshoot_percent", "overshoot_max_percent", "overshoot"),
    ):
        limit = criterion[limit_key]
        if limit is not None and held[what] > limit:
            found.append(f"{words} {held[what]:.3g} above {limit:.3g} %")
    limit = criterion["settle_max_s"]
    if limit is not None and held["settle_s"] is None:
        found.append("force not settled before the window")
    elif limit is not None and held["settle_s"] > limit:
        found.append(f"settled after {held['settle_s']:.3g} s, above {limit:.3g} s")
    return found


def kept_limits(summary):
    """What a stable run was judged by: every limit of its [verdict] with what it reached."""
    criterion, metrics = summary["criterion"], summary["metrics"]
    held = metrics["held_force"]
    found = []
    if names := criterion["contact_held"]:
        found.append("contact held" if names is True else f"{', '.join(names)} held")
    for key, reached, unit in (
        ("held_force_error_max_N", held and abs(held["error_N"]), "N"),
        ("held_force_error_max_percent", held and held["error_percent"], "%"),
        ("overshoot_max_percent", held and held["overshoot_percent"], "%"),
        ("settle_max_s", held and held["settle_s"], "s"),
    ):
        if criterion[key] is not None:
            words = {"held": "error", "overshoot": "overshoot", "settle": "settled in"}
            found.append(
                f"{words[key.split('_')[0]]} {reached:.3g} {unit} of {criterion[key]:.3g} {unit} "
                "allowed"
            )
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
