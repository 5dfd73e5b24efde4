"""`forceaxis axis health`: compare an axis with the same axis at its release."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from forceaxis import paths
from forceaxis.cli.axis import axis
from forceaxis.cli.common import (
    Slow,
    Subject,
    aligned,
    as_json,
    coloured,
    done_waiting,
    print_result,
    set_option,
)
from forceaxis.words import plain

if TYPE_CHECKING:
    from forceaxis.commission.health import Health


@axis.command(
    cls=Slow,
    epilog="""forceaxis axis health press/model.toml today.npz --released out/press/posterior.json
    forceaxis axis health press/model.toml out/today/30N --released out/release/30N --json""",
)
@click.argument("model", type=Subject(paths.MODELS))
@click.argument("today", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--released", required=True, type=click.Path(path_type=Path), metavar="FILE",
    help="posterior.json of `forceaxis identify contact`, or a folder of `forceaxis measure`.",
)  # fmt: skip
@click.option(
    "--level", type=click.FloatRange(1e-6, 0.5), default=0.05, show_default=True,
    help="Probability with which an unchanged machine is reported as changed.",
)  # fmt: skip
@set_option("Parameter of MODEL whose value is known: it is excluded as the cause.")
@as_json
def health(
    model: str,
    today: tuple[Path, ...],
    released: Path,
    level: float,
    overrides: tuple[str, ...],
    as_json: bool,
) -> None:
    """Compare the measurement TODAY with the measurement that was made when the axis was released,
    and name the parameter that has changed.

    If the release has a posterior, TODAY is one or more recordings of first contacts (`forceaxis
    recording import`). If the release has a folder of `forceaxis measure`, TODAY is such a folder
    that was measured with the same options, and with the same --level if the axis has dry friction.
    MODEL defines which parameters can have changed. A change below 1 % counts as none. The exit
    status is 0 for a healthy axis and 1 for drift, so cron and CI can use it.
    """
    from forceaxis import linear
    from forceaxis.commission import health as comparing

    order = comparing.HealthOrder(model, today, released, linear.overrides(overrides), level)
    found = comparing.health(order)
    done_waiting()
    levels = levels_text(today, released)
    print_result(found, as_json, lambda: "\n".join([*rows_of(found), *levels]))
    if not found.healthy:
        sys.exit(1)


def levels_text(today: Sequence[Path], released: Path) -> list[str]:
    """Return a text line if two responses of an axis were measured with different amplitudes, or
    nothing: dry friction makes a response depend on the amplitude."""
    from forceaxis.identify import result

    levels = [result.amplitude_of(folder) for folder in (*today, released)]
    if len(levels) != 2 or None in levels or levels[0] == levels[1]:
        return []
    return [
        f"hint         today {levels[0]:g} codes, at the release {levels[1]:g}: with dry friction "
        "or backlash a response changes with the amplitude; measure both with the same --level"
    ]


def rows_of(found: Health) -> list[str]:
    """Return the text lines about a health check: the verdict, and the table of the parameters."""
    if found.healthy:
        verdict = coloured("healthy", "passed")
    elif found.moved:
        verdict = coloured("drift", "failed") + f": {', '.join(found.moved)} moved"
    else:
        verdict = coloured("drift", "failed") + ": no single parameter explains the change"
    lines = [
        f"health       {verdict}",
        f"p value      {found.p_value:.3g}, drift below {found.level:g}; apart from the parameters "
        f"{found.other_p:.3g}",
    ]
    if found.alike:
        lines.append(f"or           {', '.join(found.alike)}: a change explains nearly as much")
        lines.append("hint         --set NAME=VALUE excludes a parameter that you have measured")
    table = [("parameter", "change", "95 %", "p", "")]
    for name, one in found.parameters.items():
        low, high = one.interval
        row = (f"x {plain(one.change, 4)}", f"{plain(low, 4)} to {plain(high, 4)}", f"{one.p:.2g}")
        state = "moved" if name in found.moved else ""
        table.append((name, *row, state) if one.told else (name, "not told", "", "", ""))
    return [*lines, *aligned(table, (0, 1, 2, 4))]
