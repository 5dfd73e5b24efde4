"""Run experiments: in process, over a link, or again from a journal."""

import math
import shlex
from dataclasses import dataclass
from pathlib import Path

from forceaxis import _core, objects, paths
from forceaxis.experiments import link


@dataclass
class Run:
    """A finished run: the summary that `--json` prints, and the trace."""

    experiment: Path
    model: Path
    summary: dict
    columns: dict  # name -> array of one value a tick
    events: list  # (time_s, element, from, to)
    plot: dict  # the experiment's [plot] table
    shows: str  # the expected behaviour, from the file
    units: dict  # object of [trace] -> its unit

    @property
    def title(self):
        """The experiment's title with its figure."""
        figure = self.summary["figure"]
        return f"Fig {figure}: {self.summary['title']}" if figure else self.summary["title"]


def run(experiment, overrides=(), over=None):
    """Run one experiment file; over: a link.Link, with the firmware in another process.

    Raises InputError with file, key and what was expected; with a link also LinkError.
    """
    experiment = Path(experiment)
    if over:
        result, report = link.run(over, experiment, overrides)
    else:
        result, report = _core.run(str(experiment), list(overrides)), None
    command = ["forceaxis", "run", paths.display(experiment)]
    for text in overrides:
        command += ["--set", text]
    if over:
        command += over.words()
    return finished(experiment, result, report, command)


def replay(journal):
    """Repeat in process a run that `axis_node --journal` recorded. Returns (the run, its journal).

    Of a session longer than ten minutes there is no trace, only the hash.

    Raises InputError.
    """
    result, report = _core.replay(str(journal))
    command = ["forceaxis", "replay", paths.display(journal)]
    done = finished(Path(report["experiment"]), result, None, command)
    replayed = report.pop("replayed")
    report["traced"] = len(result.tick) > 0
    if not report["traced"]:
        done.summary["ticks"] = replayed
    return done, report


def finished(experiment, result, report, command):
    """The Run of a result; report: that of its link, or None."""
    columns = {"tick": result.tick, "time_s": result.tick / _core.TICKS_PER_SECOND}
    columns |= result.columns()
    summary = {
        "experiment": paths.display(experiment),
        "title": result.title,
        "figure": result.figure,
        "verdict": result.verdict or None,
        "because": reasons(result.criterion, result.metrics, result.fault)
        if result.verdict == "unstable"
        else [],
        "fault": result.fault,
        "refused": report["refused"] if report else result.refused,
        "trace_hash": result.trace_hash,
        "edge_margin": result.edge_margin if math.isfinite(result.edge_margin) else None,
        "ticks": len(result.tick),
        "events": result.event_count,
        "energy": result.energy,
        "metrics": result.metrics,
        "objects": result.objects,
        "inputs_hash": result.inputs_hash,
        "firmware_hash": _core.FIRMWARE_HASH,
        "objects_hash": objects.OBJECTS_HASH,
        "seed": result.seed,
        "command": shlex.join(command),
    }
    if report:
        summary["link"] = {k: v for k, v in report.items() if k != "refused"}
    model = Path(result.model).resolve()
    return Run(
        experiment,
        model,
        summary,
        columns,
        result.events,
        result.plot,
        result.shows,
        result.objects,
    )


def reasons(criterion, metrics, fault):
    """Why a run is unstable: every limit of its [verdict] that it exceeds, in words."""
    found = [] if fault == "none" else [f"fault {fault}"]
    if criterion["contact_held"]:
        if metrics["peak_force_N"] == 0:
            found.append("never in contact")
        elif metrics["contact_losses"]:
            found.append(f"contact lost {metrics['contact_losses']} times in the window")
        elif not metrics["in_contact"]:
            found.append("not in contact at the end")
    found += force_reasons(criterion, metrics["held_force"])
    for what in ("force", "position"):
        ripple, limit = metrics[f"{what}_ripple_count"], criterion[f"{what}_ripple_max_count"]
        if limit is not None and ripple > limit:
            found.append(f"{what} ripple {ripple:.3g} above {limit:.3g} counts")
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


def describe_force(held):
    """Set-point and force held, one line."""
    settled = "not settled" if held["settle_s"] is None else f"settled in {held['settle_s']:.3g} s"
    return (
        f"{held['held_N']:.4g} N of {held['setpoint_N']:.4g} N, error {held['error_N']:.3g} N "
        f"({held['error_percent']:.3g} %), overshoot {held['overshoot_percent']:.3g} %, {settled} "
        f"from {held['from_s']:.3g} s on"
    )


def not_traced(summary):
    """The line that objects of [trace] have no columns, over a link."""
    if "link" not in summary or not summary["objects"]:
        return []
    return [("not traced", f"{', '.join(summary['objects'])}: objects are read in process only")]


def describe(summary):
    """The summary for a terminal."""
    energy, metrics, margin = summary["energy"], summary["metrics"], summary["edge_margin"]
    verdict, because = summary["verdict"] or "none asked for", summary["because"]
    lines = [
        ("experiment", summary["title"] + (f" (Fig {f})" if (f := summary["figure"]) else "")),
        ("verdict", ": ".join([verdict, *([", ".join(because)] if because else [])])),
        ("fault", summary["fault"]),
        ("force", f"peak {metrics['peak_force_N']:.4g} N, end {metrics['final_force_N']:.4g} N"),
        *([("held", describe_force(held))] if (held := metrics["held_force"]) else []),
        (
            "window",
            f"force ripple {metrics['force_ripple_count']:.3g} counts, position ripple "
            f"{metrics['position_ripple_count']:.3g} counts, contact lost "
            f"{metrics['contact_losses']} times",
        ),
        ("events", f"{summary['events']} in {summary['ticks']} ticks"),
        (
            "energy",
            f"supplied {energy['supplied_J']:.6g} J, residual {energy['residual_J']:.2g} J",
        ),
        *not_traced(summary),
        ("edge margin", "nothing converted" if margin is None else f"{margin:.3g} LSB"),
        ("trace hash", summary["trace_hash"]),
        *(link.describe(summary["link"]) if "link" in summary else []),
        ("again", summary["command"]),
    ]
    lines[3:3] = [
        ("refused", f"{r['object']} at tick {r['tick']}: {r['reason']}") for r in summary["refused"]
    ]
    return "\n".join(f"{key:12} {value}" for key, value in lines)
