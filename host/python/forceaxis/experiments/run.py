"""Runs experiments: in this process, with the firmware in another process, or again from a
journal."""

import math
import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from forceaxis import _core, objects, paths
from forceaxis.experiments import link, run_result
from forceaxis.experiments.run_result import Columns, ReplayedJournal, RunResult
from forceaxis.experiments.summary import reasons, warnings
from forceaxis.words import option_words


@dataclass
class Run:
    """A finished run: its result and its trace."""

    experiment: Path
    model: Path
    result: RunResult
    columns: Columns  # one value a tick
    events: list[tuple[float, str, str, str]]  # (time_s, element, from, to)
    plot: dict[str, Any]  # the experiment's table [plot] with its keys of rows, from_s, to_s
    shows: str  # the expected behaviour as described in the file
    # (from time_s, N) of each force set-point; [] without a force
    setpoints: list[tuple[float, float]]
    impulses: list[tuple[float, str, float]]  # (time_s, body, N s)
    contacts: list[str]  # their names
    signal_units: dict[str, str]  # column that is a signal of the model -> its unit
    overrides: tuple[str, ...]  # as given

    @property
    def title(self) -> str:
        """The experiment's title with its figure."""
        title, figure = self.result.title, self.result.figure
        return f"Fig {figure}: {title}" if figure else title

    @property
    def units(self) -> dict[str, str]:
        """Object of [trace] -> its unit."""
        return self.result.objects

    @property
    def summary(self) -> dict[str, Any]:
        """The result as `forceaxis run --json` prints it."""
        return run_result.json_of(self.result)


def run(
    experiment: str | Path,
    overrides: Sequence[str] = (),
    over: link.LinkOptions | None = None,
    text: str | None = None,
) -> Run:
    """Runs the file of one experiment. over: options of a run with the firmware in another process.
    text: replaces the content of the file, only for a run in this process.

    Raises InputError with file, key and the expected value; also LinkError for a run over a
    connection.
    """
    experiment = Path(experiment)
    command = ["forceaxis", "run", paths.display(experiment), *option_words(set=overrides)]
    if over is None:
        return finished(
            experiment, _core.run(str(experiment), list(overrides), text=text), command, overrides
        )
    linked = link.run(over, experiment, overrides)
    done = finished(experiment, linked.result, command + over.words(), overrides)
    done.result = replace(done.result, link=linked.report, refused=linked.refused)
    return done


def replay(journal: Path) -> Run:
    """Repeats a run in this process that `axis_node` has recorded; result.replay describes its
    journal.

    For a session longer than ten minutes only the hash is computed, not the trace.

    Raises InputError.
    """
    result, report = _core.replay(str(journal))
    replayed = report.pop("replayed")
    command = ["forceaxis", "replay", paths.display(journal)]
    done = finished(Path(report["experiment"]), result, command)
    traced = len(result.tick) > 0
    same = done.result.trace_hash == report["trace_hash"]
    about = ReplayedJournal(**report, traced=traced, same=same)
    ticks = done.result.ticks if traced else replayed
    done.result = replace(done.result, ticks=ticks, replay=about)
    return done


def finished(
    experiment: Path,
    result: _core.Result,
    command: Sequence[str],
    overrides: Sequence[str] = (),
) -> Run:
    """The Run from a result of the compiled module."""
    columns: Columns = {"tick": result.tick, "time_s": result.tick / _core.TICKS_PER_SECOND}
    converters = run_result.read_converters(result.converters)
    metrics = run_result.read_metrics(result.metrics)
    missed = run_result.read_missed(result.missed)
    found = RunResult(
        experiment=paths.display(experiment),
        title=result.title,
        figure=result.figure,
        verdict=result.verdict or None,
        because=reasons(missed, metrics, result.fault, converters),
        missed=missed,
        warnings=warnings(result.setpoints, converters),
        fault=result.fault,
        refused=run_result.read_refused(result.refused),
        trace_hash=result.trace_hash,
        edge_margin=result.edge_margin if math.isfinite(result.edge_margin) else None,
        ticks=len(result.tick),
        events=result.event_count,
        energy=run_result.Energy(**result.energy),
        metrics=metrics,
        criterion=run_result.read_criterion(result.criterion),
        converters=converters,
        objects=result.objects,
        inputs_hash=result.inputs_hash,
        firmware_hash=_core.FIRMWARE_HASH,
        objects_hash=objects.OBJECTS_HASH,
        seed=result.seed,
        command=shlex.join(command),
    )
    return Run(
        experiment=experiment,
        model=Path(result.model).resolve(),
        result=found,
        columns=columns | result.columns(),
        events=result.events,
        plot=result.plot,
        shows=result.shows,
        setpoints=result.setpoints,
        impulses=result.impulses,
        contacts=result.contacts,
        signal_units=result.signal_units,
        overrides=tuple(overrides),
    )
