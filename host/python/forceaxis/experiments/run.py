"""Run experiments: in process, over a link, or again from a journal."""

import math
import shlex
from dataclasses import dataclass
from pathlib import Path

from forceaxis import _core, objects, paths
from forceaxis.experiments import link
from forceaxis.experiments.summary import reasons, warnings


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
    setpoints: list  # (from time_s, N) of each set-point of force; [] where none is read
    impulses: list  # (time_s, body, N s)
    contacts: list  # their names
    signal_units: dict  # column that is a signal of the model -> its unit
    overrides: tuple  # as given

    @property
    def title(self):
        """The experiment's title with its figure."""
        figure = self.summary["figure"]
        return f"Fig {figure}: {self.summary['title']}" if figure else self.summary["title"]


def run(experiment, overrides=(), over=None, text=None):
    """Run one experiment file; over: a link.Link, with the firmware in another process. text: read
    in place of the file's, in process only.

    Raises InputError with file, key and what was expected; with a link also LinkError.
    """
    experiment = Path(experiment)
    if over:
        result, report = link.run(over, experiment, overrides)
    else:
        result, report = _core.run(str(experiment), list(overrides), text=text), None
    command = ["forceaxis", "run", paths.display(experiment)]
    for text in overrides:
        command += ["--set", text]
    if over:
        command += over.words()
    return finished(experiment, result, report, command, overrides)


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


def finished(experiment, result, report, command, overrides=()):
    """The Run of a result; report: that of its link, or None."""
    columns = {"tick": result.tick, "time_s": result.tick / _core.TICKS_PER_SECOND}
    columns |= result.columns()
    summary = {
        "experiment": paths.display(experiment),
        "title": result.title,
        "figure": result.figure,
        "verdict": result.verdict or None,
        "because": reasons(result.missed, result.metrics, result.fault, result.converters),
        "missed": result.missed,
        "warnings": warnings(result.setpoints, result.converters),
        "fault": result.fault,
        "refused": report["refused"] if report else result.refused,
        "trace_hash": result.trace_hash,
        "edge_margin": result.edge_margin if math.isfinite(result.edge_margin) else None,
        "ticks": len(result.tick),
        "events": result.event_count,
        "energy": result.energy,
        "metrics": result.metrics,
        "criterion": result.criterion,
        "converters": result.converters,
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
        result.setpoints,
        result.impulses,
        result.contacts,
        result.signal_units,
        tuple(overrides),
    )
