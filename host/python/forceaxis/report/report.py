"""The report: one page without further files about every experiment below a folder."""

import multiprocessing
import os
import signal
from datetime import UTC, datetime
from importlib import resources
from multiprocessing.pool import Pool
from pathlib import Path
from typing import Any

import jinja2

from forceaxis import _core, drawing, objects, paths, words
from forceaxis.experiments import verdicts
from forceaxis.report import axes, folder

# {status of an experiment: its name on the page}.
WORDS = {
    **verdicts.WORDS,
    "none": "no verdict",
    "differs": "not as expected",
    "error": "not run",
}


def template(name: str) -> str:
    """The text of a file of this package, or of the common style sheet."""
    if name == "page.css":
        return drawing.page_style()
    return resources.files("forceaxis.report").joinpath(name).read_text(encoding="utf-8")


def counts_by_status(entries: list[folder.Entry]) -> dict[str, int]:
    """{status: number of experiments}."""
    found: dict[str, int] = {}
    for entry in entries:
        found[entry.status] = found.get(entry.status, 0) + 1
    return found


def workers(threads: int | None) -> Pool:
    """A pool of processes, which are terminated after an error or an interruption."""
    return multiprocessing.get_context("fork").Pool(
        threads or os.cpu_count(), signal.signal, (signal.SIGINT, signal.SIG_IGN)
    )


def write(source: Any = None, out: Any = None, threads: int | None = None) -> dict[str, Any]:
    """Runs every experiment below `source` and writes out/index.html.

    source None: the folder of the thesis, whose page also has its tables and its frequency domain.
    Returns {"report", "experiments", "counts", "errors"}, for the thesis also {"matched", "total"}.
    An experiment that cannot be run counts as an error and has its own entry. Raises InputError.
    """
    own = source is None or source.resolve() == paths.SIM.resolve()
    if own:
        from forceaxis.report import laboratory

        laboratory.check()
        source = paths.EXPERIMENTS
    else:
        folder.files(source)
    with paths.replacing(out, "index.html") as (file,):  # an impossible path is reported at once
        page, summary = _made(source, out, threads, own)
        file.write_text(page, encoding="utf-8")
    return summary


def _made(source: Path, out: Path, threads: int | None, own: bool) -> tuple[str, dict[str, Any]]:
    """(page, summary)."""
    if own:
        from forceaxis.report import laboratory
    with workers(threads) as pool:
        if own:
            frequency = laboratory.begin(pool)
        begun = folder.begin(pool, source)
        values = laboratory.values(threads) if own else {}
        entries = folder.ended(begun)
        if own:
            values |= laboratory.ended(frequency) | laboratory.by_model(entries)
        else:
            values = {"models": axes.described(entries)}
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(template),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["plain"] = words.plain
    summary = {
        "report": paths.display(out / "index.html"),
        "experiments": len(entries),
        "counts": counts_by_status(entries),
        "errors": [f"{paths.display(e.file)}: {e.error}" for e in entries if e.error],
    }
    page = environment.get_template("page.html.jinja").render(
        title="The laboratory's measurements, run again" if own else source.resolve().name,
        own=own,
        date=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        entries=entries,
        few=not own and len(entries) <= axes.FEW,
        counts=summary["counts"],
        words=WORDS,
        firmware_hash=_core.FIRMWARE_HASH,
        objects_hash=objects.OBJECTS_HASH,
        **values,
    )
    if own:
        summary |= {key: values["result"][key] for key in ("matched", "total")}
    return page, summary
