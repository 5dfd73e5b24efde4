"""Error rates of a cycle program, computed from simulated parts: how often it refuses a good part,
and how often it accepts a bad part of each kind."""

import csv
import json
import os
import shlex
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from forceaxis import paths, progress
from forceaxis._core import InputError, SimulationError
from forceaxis.cycles.outcome import ABORTED, BAD, GOOD, IDLE, PartOutcome, outcome_of
from forceaxis.cycles.part import ElementFigure, figure_of
from forceaxis.cycles.parts import Kind, Part, Parts, draw, read_parts
from forceaxis.cycles.program import Element, Program, read_program, with_program
from forceaxis.cycles.record import element_cells, element_columns
from forceaxis.cycles.statistics import Share, share
from forceaxis.errors import ParameterError
from forceaxis.experiments.runner import RunSite, identity_of, runner_at
from forceaxis.experiments.summary import CYCLE_START
from forceaxis.linear import posterior
from forceaxis.results import json_field, to_json
from forceaxis.words import counted, option_words

PARTS_MOST = 1_000_000
# Name of the group of all good parts. The random numbers of the group depend on its name.
GOOD_GROUP = "good parts"
FILES = ("rates.json", "parts.csv")


@dataclass(frozen=True)
class RatesRequest:
    """The request for a computation of error rates: an experiment with a cycle program, and the
    parts to simulate."""

    experiment: Path
    good: Path  # parts file of the good parts
    bad: Sequence[Path] = ()
    parts: int = 1000  # number of good parts to simulate
    # number of parts of each bad kind; None: the same number as that of good parts
    bad_parts: int | None = None
    seed: int = 0
    program: Path | None = None  # file of a cycle program that replaces that of the experiment
    overrides: Sequence[str] = ()
    # file of a posterior, from which the parameters of the press are drawn anew for each part
    over: str | None = None

    @property
    def all_overrides(self) -> list[str]:
        """The overrides of all simulations, including the override that replaces the cycle
        program."""
        return with_program(self.overrides, self.program)

    def read_program(self) -> Program:
        """Returns the cycle program with which the parts are simulated. Raises InputError."""
        return read_program(self.experiment, self.all_overrides)

    @property
    def bad_count(self) -> int:
        """The number of parts that are simulated of each bad kind."""
        return self.parts if self.bad_parts is None else self.bad_parts

    def command(self, out: Path | None, scheduler: str | None) -> str:
        """Returns the command line that computes the same error rates again."""
        words = option_words(
            good=paths.display(self.good),
            bad=[paths.display(file) for file in self.bad],
            parts=self.parts,
            bad_parts=self.bad_parts,
            seed=self.seed,
            program=None if self.program is None else paths.display(self.program),
            set=list(self.overrides),
            over=self.over,
            out=None if out is None else paths.display(out),
            scheduler=scheduler,
        )
        return shlex.join(["forceaxis", "cycle", "rates", paths.display(self.experiment), *words])


@dataclass(frozen=True)
class PartCounts:
    """Numbers of parts with each result of the press cycle: good, bad, aborted."""

    parts: int
    good: int
    bad: int
    # number of parts whose cycle was aborted by a stop, a fault, a halt or a change of the mode
    aborted: int
    # number of parts whose cycle did not start, or still ran at the end of the experiment
    no_result: int
    failed: int  # number of parts whose simulation ended with an error


@dataclass(frozen=True)
class ElementRefusals:
    """How often one evaluation element refuses a good part, as a fraction of the parts that have
    the verdict good or bad."""

    name: str
    kind: str
    refused: Share


@dataclass(frozen=True)
class GoodRates:
    """How often the cycle program accepts and refuses good parts."""

    counts: PartCounts
    # number of refused parts divided by the number of parts with the verdict good or bad
    refused: Share
    limits: Share  # fraction of the good parts whose cycle did not end as its program intends
    elements: list[ElementRefusals]


@dataclass(frozen=True)
class ElementPasses:
    """How often a bad part would be accepted if the cycle program had only this evaluation
    element."""

    name: str
    kind: str
    passed: Share


@dataclass(frozen=True)
class BadRates:
    """How often the cycle program accepts and refuses the bad parts of one kind."""

    name: str
    weight: float
    counts: PartCounts
    # number of accepted parts divided by the number of parts with the verdict good or bad
    passed: Share
    limits: Share  # fraction of the bad parts whose cycle ended as its program intends
    elements: list[ElementPasses]


@dataclass(frozen=True)
class RatesResult:
    """The error rates of a cycle program, computed from simulated parts."""

    experiment: str
    program: str
    title: str
    seed: int
    good: GoodRates
    bad: list[BadRates]
    # fraction of all bad parts that are accepted; each kind is weighted by its frequency
    bad_passed: float | None
    warnings: list[str]
    runs: int
    # number of simulations that were not repeated, because the journal already contained them
    resumed: int
    inputs_hash: str
    firmware_hash: str
    simulator_hash: str
    where: str
    seconds: float
    # mean computing time in ms of a simulation that was not in the journal
    ms_per_part: float | None = json_field(default=None, omit_none=True)
    command: str = ""  # command line that repeats the computation of the error rates


@dataclass(frozen=True)
class Group:
    """One group of simulated parts: all good parts, or all bad parts of one kind."""

    name: str
    weight: float
    parts: list[Part]
    outcomes: list[PartOutcome]

    @property
    def judged(self) -> list[PartOutcome]:
        """The outcomes of those parts that have the verdict good or bad."""
        return [outcome for outcome in self.outcomes if outcome.is_judged]


@dataclass(frozen=True)
class Rates:
    """Error rates of a cycle program, and the simulated parts from which they were computed."""

    result: RatesResult
    program: Program
    good: Group
    bad: list[Group]


def rates(
    request: RatesRequest,
    out: Path | None = None,
    threads: int | None = None,
    scheduler: str | None = None,
) -> Rates:
    """Simulates good and bad parts. Finished simulations are stored in the folder `out`. A later
    call with the same request, or with a request for more parts, simulates only the missing parts.
    Nothing is stored if `out` is None.

    threads: number of threads, by default one for each core. scheduler: address of a Dask
    scheduler, whose workers simulate the parts. Raises InputError for a mistake in the request or
    in a file, and SimulationError if all simulations of a group fail.
    """
    check(request)
    experiment = request.experiment
    overrides = request.all_overrides
    program = request.read_program()
    identity = identity_of(experiment, overrides)
    good_parts = read_parts(request.good, experiment, overrides)
    bad_parts = [read_parts(name, experiment, overrides) for name in request.bad]
    groups = [_drawn(GOOD_GROUP, good_parts.kinds, request.seed, request.parts)]
    for kind in bad_kinds(bad_parts):
        groups.append(_drawn(f"bad {kind.name}", [kind], request.seed, request.bad_count))

    threads = threads or os.cpu_count() or 1
    started = time.monotonic()
    site, what = RunSite(out, threads, scheduler), "computation of rates"
    every = [part.values for group in groups for part in group.parts]
    if request.over:
        presses = posterior.read(request.over).draws(len(every), request.seed)
        every = [press | part for press, part in zip(presses, every, strict=True)]
    with (
        runner_at(site, experiment, overrides, identity, PartOutcome, outcome_of, what) as runner,
        progress.phase(counted(len(every), "part")),
    ):
        outcomes = runner(every)
    seconds = time.monotonic() - started
    rest = iter(outcomes)
    groups = [replace(group, outcomes=[next(rest) for _ in group.parts]) for group in groups]
    expect_results(groups)

    good, bad = groups[0], [replace(g, name=g.name.removeprefix("bad ")) for g in groups[1:]]
    result = RatesResult(
        experiment=paths.display(experiment),
        program=paths.display(program.file),
        title=program.title,
        seed=request.seed,
        good=good_rates(good.outcomes, program),
        bad=[bad_rates(group, program) for group in bad],
        bad_passed=weighted([(g.weight, _passed(g.judged)) for g in bad]),
        warnings=warnings(groups),
        runs=runner.asked,
        resumed=runner.asked - runner.ran,
        inputs_hash=identity["inputs_hash"],
        firmware_hash=identity["firmware_hash"],
        simulator_hash=identity["simulator_hash"],
        where=scheduler or counted(threads, "thread"),
        seconds=round(seconds, 3),
        ms_per_part=round(1e3 * seconds / runner.ran, 3) if runner.ran else None,
        command=request.command(out, scheduler),
    )
    done = Rates(result, program, good, bad)
    if out is not None:
        write(done, out)
    return done


def check(request: RatesRequest) -> None:
    """Raises ParameterError if a number of parts in the request is not possible."""
    for name, value in (("parts", request.parts), ("bad_parts", request.bad_count)):
        if not 1 <= value <= PARTS_MOST:
            raise ParameterError(name, f"expected 1 to {PARTS_MOST:,} parts, got {value}")
    if request.seed < 0:
        raise ParameterError("seed", f"expected a number of at least 0, got {request.seed}")


def bad_kinds(files: Sequence[Parts]) -> list[Kind]:
    """Returns the kinds of all parts files of bad parts. Raises InputError if two kinds have the
    same name."""
    kinds: list[Kind] = []
    for parts in files:
        for kind in parts.kinds:
            if kind.name in [known.name for known in kinds]:
                raise InputError(
                    f"{parts.file}: kind.name: expected a different name for each kind of bad "
                    f"part in all files, got {kind.name} twice; rename one of the two kinds"
                )
            kinds.append(kind)
    return kinds


def _drawn(group: str, kinds: Sequence[Kind], seed: int, count: int) -> Group:
    """Draws the parts of a group at random. The parts are not simulated here."""
    parts = [draw(kinds, group, seed, i) for i in range(count)]
    return Group(group, sum(kind.weight for kind in kinds), parts, [])


def expect_results(groups: Sequence[Group]) -> None:
    """Raises SimulationError if all simulations of a group of parts have failed. The error rate of
    the group is then unknown."""
    for group in groups:
        first = group.outcomes[0].error
        if first and all(outcome.error for outcome in group.outcomes):
            raise SimulationError(f"{group.name}: all runs failed; the first: {first}")


def counts_of(outcomes: Sequence[PartOutcome]) -> PartCounts:
    """Counts the parts with each result of the cycle: good, bad, aborted."""
    states = [outcome.state for outcome in outcomes]
    failed = sum(bool(outcome.error) for outcome in outcomes)
    good, bad, aborted = (states.count(state) for state in (GOOD, BAD, ABORTED))
    other = len(outcomes) - good - bad - aborted - failed
    return PartCounts(len(outcomes), good, bad, aborted, other, failed)


def good_rates(outcomes: Sequence[PartOutcome], program: Program) -> GoodRates:
    """Returns how often the cycle program accepts and refuses good parts."""
    judged = [outcome for outcome in outcomes if outcome.is_judged]
    of = len(judged)
    return GoodRates(
        counts=counts_of(outcomes),
        refused=share(sum(outcome.state == BAD for outcome in judged), of),
        limits=share(sum(not outcome.is_within_limits for outcome in judged), of),
        elements=[
            ElementRefusals(e.name, e.kind, share(sum(o.verdicts[i] != GOOD for o in judged), of))
            for i, e in enumerate(program.elements)
        ],
    )


def bad_rates(group: Group, program: Program) -> BadRates:
    """Returns how often the cycle program accepts and refuses the bad parts of one kind."""
    judged, of = group.judged, len(group.judged)
    return BadRates(
        name=group.name,
        weight=group.weight,
        counts=counts_of(group.outcomes),
        passed=_passed(judged),
        limits=share(sum(outcome.is_within_limits for outcome in judged), of),
        elements=[
            ElementPasses(e.name, e.kind, share(sum(o.verdicts[i] == GOOD for o in judged), of))
            for i, e in enumerate(program.elements)
        ],
    )


def _passed(judged: Sequence[PartOutcome]) -> Share:
    return share(sum(outcome.state == GOOD for outcome in judged), len(judged))


def weighted(shares: Sequence[tuple[float, Share]]) -> float | None:
    """Returns the weighted mean of several proportions. `shares`: pairs of a weight and a
    proportion. Returns None if one of the proportions is not known."""
    known = [(weight, one.share) for weight, one in shares if one.share is not None]
    if not known or len(known) < len(shares):
        return None
    return sum(weight * value for weight, value in known) / sum(weight for weight, _ in known)


def warnings(groups: Sequence[Group]) -> list[str]:
    """Returns texts that warn of parts without a verdict."""
    found = []
    for group in groups:
        counts = counts_of(group.outcomes)
        idle = sum(outcome.state == IDLE for outcome in group.outcomes)
        late = counts.no_result - idle
        for number, what in (
            (counts.aborted, "aborted"),
            (idle, f"without a cycle ({CYCLE_START})"),
            (late, "without the end of a cycle (duration_s may be too short)"),
            (counts.failed, "failed"),
        ):
            if number:
                error = next((o.error for o in group.outcomes if o.error), "")
                first = f"; the first: {error}" if what == "failed" else ""
                found.append(
                    f"{group.name}: {number} of {counts.parts} {what}, not in the shares{first}"
                )
    return found


def write(done: Rates, out: Path) -> None:
    """Writes the error rates and a table with all parts to two files in the folder `out`. Writes
    either both files or none."""
    with paths.replacing(out, *FILES) as (summary, table):
        summary.write_text(json.dumps(to_json(done.result), indent=2) + "\n")
        with table.open("w", newline="") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            groups = [done.good, *done.bad]
            names = list(dict.fromkeys(n for g in groups for p in g.parts for n in p.values))
            elements = done.program.elements
            writer.writerow([
                "group", "kind", "number", *names, "state", "outcome", "failed_phase", "error",
                *element_columns([element.name for element in elements]),
            ])  # fmt: skip
            for group in groups:
                for i, (part, one) in enumerate(zip(group.parts, group.outcomes, strict=True)):
                    writer.writerow([
                        group.name, part.kind, i, *(part.values.get(name, "") for name in names),
                        one.state, one.outcome, one.failed_phase, one.error,
                        *element_cells(_figures(one, elements)),
                    ])  # fmt: skip


def _figures(outcome: PartOutcome, elements: Sequence[Element]) -> list[ElementFigure]:
    """Returns the results of all evaluation elements for one part. After a failed simulation, these
    results have no values and no verdicts."""
    values: Sequence[float | None] = outcome.values or [None] * len(elements)
    verdicts = outcome.verdicts or [""] * len(elements)
    return [
        figure_of(element, verdict, value)
        for element, verdict, value in zip(elements, verdicts, values, strict=True)
    ]
