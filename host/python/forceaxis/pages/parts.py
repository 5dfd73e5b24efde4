"""The page about pressed parts: shares of good parts, capability, run charts, histograms and
curves."""

from pathlib import Path

from forceaxis import paths
from forceaxis.cycles import statistics_plots
from forceaxis.cycles.capability import PartStatistics
from forceaxis.cycles.statistics_plots import Curves
from forceaxis.pages import pictures
from forceaxis.pages.template import template


def write(file: Path, found: PartStatistics, rows: list[list[str]], curves: Curves) -> None:
    """Writes the page about statistics of parts to a file, completely or not at all. `rows`: table
    of the evaluation elements. Its first row is the header."""
    charts = [
        (element.name, pictures.figure(statistics_plots.element(element)))
        for element in statistics_plots.shown_elements(found)
    ]
    html = template("parts").render(
        s=found,
        rows=rows,
        charts=charts,
        curves=pictures.figure(statistics_plots.overlay(curves)) if curves else None,
    )
    with paths.replacing(file.parent, file.name) as (fresh,):
        fresh.write_text(html, encoding="utf-8")
