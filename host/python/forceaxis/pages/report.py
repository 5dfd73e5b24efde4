"""Writes the report, which is one HTML page about all experiments below a folder. The page needs no
further files."""

import multiprocessing
import os
import signal
from collections import Counter
from dataclasses import dataclass
from datetime import UTC, datetime
from multiprocessing.pool import Pool
from pathlib import Path

from forceaxis import _core, objects, paths
from forceaxis.experiments import verdicts
from forceaxis.pages import axes, folder
from forceaxis.pages.template import template
from forceaxis.results import json_field
from forceaxis.thesis import tables


@dataclass(frozen=True)
class ReportSummary:
    """Summary of the report: numbers of experiments and of table cells."""

    report: str  # path of the HTML page
    experiments: int  # number of experiments
    counts: dict[str, int]  # {status of experiments: number of experiments with this status}
    errors: list[str]  # one text line for each experiment that could not be run
    # number of cells of the stability tables whose simulated verdict equals the measured verdict
    matched: int | None = json_field(omit_none=True)
    total: int | None = json_field(omit_none=True)  # number of cells of the stability tables


def workers(threads: int | None) -> Pool:
    """Context manager with a pool of worker processes. Ends the worker processes after an error or
    an interruption."""
    return multiprocessing.get_context("fork").Pool(
        threads or os.cpu_count(), signal.signal, (signal.SIGINT, signal.SIG_IGN)
    )


def write(source: Path | None, out: Path, threads: int | None = None) -> ReportSummary:
    """Runs every experiment below `source`, and writes the page out/index.html.

    If `source` is None, the folder of the thesis is used. Its page also has the stability tables
    and the frequency domain. An experiment that cannot be run has an entry with its error. Raises
    InputError.
    """
    own = source is None or source.resolve() == paths.SIM.resolve()
    experiments = paths.EXPERIMENTS if source is None or own else source
    # A missing fit, an empty folder or an impossible path is reported before the long computations.
    if own:
        tables.evidence()
    else:
        folder.files(experiments)
    with paths.replacing(out, "index.html") as (file,):
        page, summary = _made(experiments, out, threads, own)
        file.write_text(page, encoding="utf-8")
    return summary


def _made(source: Path, out: Path, threads: int | None, own: bool) -> tuple[str, ReportSummary]:
    """Runs the experiments. Returns (text of the HTML page of the report, summary of the
    report)."""
    tables_section = None
    with workers(threads) as pool:
        if own:
            from forceaxis.pages import laboratory

            frequency = laboratory.FrequencyJobs.start(pool)
            jobs = folder.begin(pool, source)
            tables_section = laboratory.tables_section(threads)
            entries = folder.entries(jobs)
            models_section = laboratory.models_section(entries)
            names = vars(tables_section) | vars(frequency.section()) | vars(models_section)
        else:
            entries = folder.entries(folder.begin(pool, source))
            names = {"models": axes.sections(entries)}
    summary = ReportSummary(
        report=paths.display(out / "index.html"),
        experiments=len(entries),
        counts=dict(Counter(entry.status for entry in entries)),
        errors=[f"{paths.display(e.file)}: {e.error}" for e in entries if e.error],
        matched=tables_section.result.matched if tables_section else None,
        total=tables_section.result.total if tables_section else None,
    )
    page = template("report").render(
        title="The laboratory's measurements, run again" if own else source.resolve().name,
        own=own,
        date=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        entries=entries,
        few=not own and len(entries) <= axes.SHOWN_EXPERIMENTS_MAX,
        counts=summary.counts,
        words=folder.STATUSES,
        held_error_max_percent=verdicts.HELD_ERROR_MAX_PERCENT,
        firmware_hash=_core.FIRMWARE_HASH,
        objects_hash=objects.OBJECTS_HASH,
        **names,
    )
    return page, summary
