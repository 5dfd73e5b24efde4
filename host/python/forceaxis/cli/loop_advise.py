"""The commands `advise` and `compliance` of `forceaxis loop`, which compare possible changes of an
axis."""

import shutil
from pathlib import Path

import click

from forceaxis import paths
from forceaxis.cli.common import (
    Callback,
    Parameter,
    Positive,
    Slow,
    Subject,
    as_json,
    mode_option,
    set_option,
    threads,
)
from forceaxis.cli.loop import TIMINGS, check_drawing, drawn, loop, present


def over_options(verb: Callback) -> Callback:
    """Add the options --over (tolerances of parameters) and --modes (states of elements of the
    model) to a command."""
    verb = click.option(
        "--modes",
        type=click.Choice(["visited", "all", "nominal"]),
        default="visited",
        show_default=True,
        help="States of amplifier, contact and friction in which the set of plants is analysed.",
    )(verb)
    return click.option(
        "--over",
        multiple=True,
        type=Parameter(),
        metavar="NAME=PERCENT%|LOW..HIGH",
        help="Tolerance of a parameter; several with commas between them. Repeatable.",
    )(verb)


@loop.command(
    cls=Slow,
    short_help="What limits the bandwidth, and what each change would gain.",
    epilog="""forceaxis loop advise laboratory
    forceaxis loop advise laboratory --over k_w=30%,m_w=30%
    forceaxis loop advise contact --simulate --out advice.png
    forceaxis loop advise nl_stick_slip --linear --mode rail=stuck""",
)
@click.argument(
    "model",
    metavar="MODEL|EXPERIMENT",
    type=Subject(paths.MODELS, paths.EXPERIMENTS),
)
@set_option("A parameter of the model.")
@mode_option("states")
@click.option(
    "--timing",
    type=TIMINGS,
    help="Sampling of the loop. Default: latency_ticks of the experiment, else zoh.",
)
@click.option(
    "--factor",
    type=float,
    default=2.0,
    show_default=True,
    help="Factor by which each stiffness, mass and damping is multiplied and divided.",
)
@click.option(
    "--simulate",
    is_flag=True,
    help="Simulate every row with the firmware where possible. Default: only the present design "
    "and the row with the finer ADC.",
)
@click.option("--linear", is_flag=True, help="Linear analysis only, no simulation.")
@over_options
@threads
@drawn
@as_json
def advise(
    model: str,
    overrides: tuple[str, ...],
    states: tuple[str, ...],
    timing: str | None,
    factor: float,
    simulate: bool,
    linear: bool,
    over: tuple[str, ...],
    modes: str,
    threads: int | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Show what limits the bandwidth of a force loop, and by how much each possible change of the
    axis would increase the bandwidth.

    A change multiplies or divides a stiffness, a mass or a damping by --factor, or uses another
    ADC, sampling or law. The result is a table with one row for each change. Rows are ranked by the
    crossover frequency at half the critical gain. Besides the linear limit, the command prints the
    largest gain at which the simulated firmware is stable, with quantisation and contact loss. It
    simulates EXPERIMENT, or the experiment with the name of MODEL. If there is none, it simulates a
    first contact.

    With --over, rows are ranked by the bandwidth fS of the worst plant of the set, at a gain margin
    of 2.3 and Ms at most 2. One row is a bank designed for the set. Changes that the firmware
    cannot do are marked and come last.
    """
    from forceaxis import linear as models
    from forceaxis.cli.advise_text import describe
    from forceaxis.design import advise as design
    from forceaxis.results import to_json

    check_drawing(out)
    if simulate and linear:
        raise click.UsageError("expected either --simulate or --linear, got both options")
    runs = "all" if simulate else "none" if linear else "present"
    order = design.AdviceOrder(
        model, models.overrides(overrides), timing, factor, runs, threads, over, modes,
        models.states(states),
    )  # fmt: skip
    result = design.advise(order)
    if out:
        from forceaxis import drawing
        from forceaxis.pages import design_plots

        drawing.save(design_plots.advice(result), out)
    width = shutil.get_terminal_size().columns
    present(to_json(result), as_json, lambda _: describe(result, width), out)


@loop.command(
    cls=Slow,
    short_help="Margins over the stiffness of pad, sensor or workpiece.",
    epilog="""forceaxis loop compliance laboratory_grip --out compliance.png
    forceaxis loop compliance laboratory --element k_w --from 1e5 --to 2e6 --points 6 --json
    forceaxis loop compliance nl_friction --mode rail=forward --points 3""",
)
@click.argument(
    "model",
    metavar="MODEL|EXPERIMENT",
    type=Subject(paths.MODELS, paths.EXPERIMENTS),
)
@click.option(
    "--element", help="Name of the stiffness that is varied. Default: that of the contact."
)
@set_option("A parameter of the model.")
@mode_option("states")
@click.option(
    "--over",
    multiple=True,
    type=Parameter(),
    metavar="NAME=PERCENT%|LOW..HIGH",
    help="Set of plants, as in advise. Default: 30 % of mass and stiffness of the workpiece.",
)
@click.option(
    "--from",
    "lowest",
    type=Positive(high=1e12),
    help="Lowest stiffness, N/m. Default: nominal value / 20.",
)
@click.option(
    "--to",
    "highest",
    type=Positive(high=1e12),
    help="Highest stiffness, N/m. Default: 4 x nominal value.",
)
@click.option("--points", type=click.IntRange(2, 40), default=9, show_default=True)
@threads
@drawn
@as_json
def compliance(
    model: str,
    element: str | None,
    overrides: tuple[str, ...],
    states: tuple[str, ...],
    over: tuple[str, ...],
    lowest: float | None,
    highest: float | None,
    points: int,
    threads: int | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Show how the margins of a force loop change with the stiffness of the pad, the sensor or the
    workpiece, to choose between a soft contact and a low gain.

    For each stiffness of one element, the command prints the bandwidth fS over the set of plants.
    It does so for the P law, and for a bank that is designed for this stiffness, at equal margins.
    It also prints the static error of the P law, and the travel of the drive from first contact to
    the set-point. The last values are the largest impacts that the two laws tolerate in a
    simulation with the firmware.
    """
    from forceaxis import linear as models
    from forceaxis.cli.advise_text import describe_compliance
    from forceaxis.design import compliance as soft
    from forceaxis.results import to_json

    check_drawing(out)
    if (lowest is None) != (highest is None):
        raise click.UsageError(
            "expected both --from and --to, got one of these options; give both options or none"
        )
    span = None if lowest is None or highest is None else (lowest, highest)
    order = soft.ComplianceOrder(
        model, element, models.overrides(overrides), over or None, span, points, threads=threads,
        states=models.states(states),
    )  # fmt: skip
    result = soft.compliance(order)
    if out:
        from forceaxis import drawing
        from forceaxis.pages import design_plots

        drawing.save(design_plots.compliance(result), out)
    present(to_json(result), as_json, lambda _: describe_compliance(result), out)
