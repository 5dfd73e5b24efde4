"""Runs experiments with the firmware in this process or in a second process, and repeats recorded
runs."""

import math
import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from forceaxis import _core, objects, paths
from forceaxis._results import PlotTable
from forceaxis.experiments import link, run_result
from forceaxis.experiments.run_result import Array, Columns, ReplayedJournal, RunResult
from forceaxis.experiments.summary import reasons, warnings
from forceaxis.results import JsonObject, to_json
from forceaxis.words import option_words


@dataclass
class Run:
    """A finished run: its result and its trace."""

    experiment: Path  # path of the experiment
    model: Path  # path of the model
    result: RunResult
    columns: Columns  # {column of the trace: values, one for each tick}
    # (time in s, element, state before, state after) for each change of state
    events: list[tuple[float, str, str, str]]
    plot: PlotTable
    shows: str  # text in the experiment file that describes the expected behaviour
    # (time of the change in s, force in N) of each force set-point; may be empty
    setpoints: list[tuple[float, float]]
    impulses: list[tuple[float, str, float]]  # (time in s, body, N s) for each impulse on a body
    contacts: list[str]  # names of the contacts of the model
    signal_units: dict[str, str]  # {signal of the model: unit of the signal}
    overrides: tuple[str, ...]  # overrides of the run as texts NAME=VALUE

    @property
    def title(self) -> str:
        """The title of the experiment, with the number of the figure in the thesis."""
        title, figure = self.result.title, self.result.figure
        return f"Fig {figure}: {title}" if figure else title

    @property
    def time_s(self) -> Array:
        """Returns the time of each tick in s, as an array (n,)."""
        return self.columns["time_s"]

    @property
    def in_plot(self) -> NDArray[np.bool_]:
        """Returns an array (n,) that is True for each tick within the time range of [plot]. If the
        run ended before this range, all entries are True."""
        time_s, plot = self.time_s, self.plot
        start = time_s[0] if plot.from_s is None else plot.from_s
        stop = time_s[-1] if plot.to_s is None else plot.to_s
        inside = (time_s >= start) & (time_s <= stop)
        return np.asarray(inside if inside.any() else ~inside)

    @property
    def units(self) -> dict[str, str]:
        """Returns {object: unit} of the firmware objects in the trace."""
        return self.result.objects

    @property
    def summary(self) -> JsonObject:
        """Returns the result of the run as an object for the JSON output."""
        return to_json(self.result)


def run(
    experiment: str | Path,
    overrides: Sequence[str] = (),
    over: link.LinkOptions | None = None,
    text: str | None = None,
) -> Run:
    """Runs one experiment. `over`: connection to the firmware in a second process. If `over` is
    None, the firmware runs in this process. `text` may then replace the content of the file.

    Raises InputError with file, key and expected value. Raises SimulationError. With `over`, also
    raises LinkError.
    """
    experiment = Path(experiment)
    command = ["forceaxis", "run", paths.display(experiment), *option_words(set=overrides)]
    if over is None:
        return finished(
            experiment, _core.run(str(experiment), list(overrides), text=text), command, overrides
        )
    linked = link.run(over, experiment, overrides)
    done = finished(experiment, linked.result, command + over.words(), overrides)
    done.result = replace(
        done.result,
        link=linked.report,
        refused=linked.refused,
        cycle=linked.cycle,
    )
    return done


def replay(journal: Path) -> Run:
    """Repeats a run of `axis_node` in this process, from the journal that axis_node has written.
    `result.replay` of the returned Run describes the journal.

    A run that is longer than ten minutes has no trace, only a trace hash. Raises InputError.
    """
    result, header = _core.replay(str(journal))
    replayed = ReplayedJournal(
        experiment=header.experiment,
        overrides=header.overrides,
        entries=header.entries,
        ticks=header.ticks,
        trace_hash=header.trace_hash,
        traced=len(result.tick) > 0,
        same=result.trace_hash == header.trace_hash,
    )
    command = ["forceaxis", "replay", paths.display(journal)]
    done = finished(Path(replayed.experiment), result, command)
    ticks = done.result.ticks if replayed.traced else header.replayed
    done.result = replace(done.result, ticks=ticks, replay=replayed)
    return done


def finished(
    experiment: Path,
    result: _core.Result,
    command: Sequence[str],
    overrides: Sequence[str] = (),
) -> Run:
    """Returns the Run for a result of the compiled module. `command`: arguments of the command that
    repeats the run."""
    columns: Columns = {"tick": result.tick, "time_s": result.tick / _core.TICKS_PER_SECOND}
    converters = run_result.read_converters(result.converters)
    found = RunResult(
        experiment=paths.display(experiment),
        title=result.title,
        figure=result.figure,
        verdict=result.verdict or None,
        because=reasons(result.missed, result.metrics, result.fault, converters),
        missed=result.missed,
        warnings=warnings(result.setpoints, result.limited_setpoints, converters),
        fault=result.fault,
        refused=result.refused,
        trace_hash=result.trace_hash,
        edge_margin=result.edge_margin if math.isfinite(result.edge_margin) else None,
        ticks=len(result.tick),
        events=result.event_count,
        energy=result.energy,
        metrics=result.metrics,
        criterion=result.criterion,
        converters=converters,
        objects=result.objects,
        inputs_hash=result.inputs_hash,
        firmware_hash=_core.FIRMWARE_HASH,
        objects_hash=objects.OBJECTS_HASH,
        seed=result.seed,
        command=shlex.join(command),
        cycle=result.cycle,
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
