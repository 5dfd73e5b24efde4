"""Verbs about changes of an axis."""

import shutil

import click

from forceaxis import paths
from forceaxis.cli.common import (
    Parameter,
    Positive,
    Slow,
    Subject,
    as_json,
    mode_option,
    set_option,
    threads,
)
from forceaxis.cli.models import TIMINGS, check_drawing, drawn, present


def over_options(verb):
    """--over and --modes."""
    verb = click.option(
        "--modes",
        type=click.Choice(["visited", "all", "nominal"]),
        default="visited",
        show_default=True,
        help="Modes of amplifier, contact and friction in which the set is taken.",
    )(verb)
    return click.option(
        "--over",
        multiple=True,
        type=Parameter(),
        metavar="NAME=PERCENT%|LOW..HIGH",
        help="A parameter and how far it may be off; several with commas. Repeatable.",
    )(verb)


@click.command(
    cls=Slow,
    epilog="""forceaxis advise laboratory
    forceaxis advise laboratory --over k_w=30%,m_w=30%
    forceaxis advise sim/experiments/contact.toml --simulate --out advice.png
    forceaxis advise nl_stick_slip --linear --mode rail=stuck""",
)
@click.argument(
    "model",
    metavar="MODEL|EXPERIMENT",
    type=Subject(paths.MODELS, paths.EXPERIMENTS),
)
@set_option("A model parameter.")
@mode_option("states")
@click.option("--timing", type=TIMINGS, help="Default: the experiment's latency_ticks, else zoh.")
@click.option(
    "--factor",
    type=float,
    default=2.0,
    show_default=True,
    help="By how much stiffnesses, masses and dampings are changed, up and down.",
)
@click.option(
    "--simulate",
    is_flag=True,
    help="Run the firmware for every row that it can run, not for the present design and "
    "the finer ADC alone.",
)
@click.option("--linear", is_flag=True, help="Run nothing.")
@over_options
@threads
@drawn
@as_json
def advise(
    model, overrides, states, timing, factor, simulate, linear, over, modes, threads, out, as_json
):
    """What limits the bandwidth of a force loop, and the benefit of each change of the axis.

    Rows are ranked by the crossover at half the critical gain. Beside the linear limit stands the
    largest gain at which the firmware, with quantisation and loss of contact, is stable on the
    experiment given, on that of the model's name, or on a first contact made for it.

    With --over the rows are ranked by the bandwidth fS of the worst member, with the largest gain
    at gain margin 2.3 and |S| up to 2; a bank of the firmware designed for the set is a row. What
    the firmware lacks is marked and comes last.
    """
    from forceaxis import linear as models
    from forceaxis.design import advise as design
    from forceaxis.design import advise_text

    check_drawing(out)
    if simulate and linear:
        raise click.UsageError("expected --simulate or --linear, got both")
    runs = "all" if simulate else "none" if linear else "present"
    result = design.advise(
        model, models.overrides(overrides), timing, factor, runs, threads, over, modes,
        models.states(states),
    )  # fmt: skip
    if out:
        from forceaxis import drawing
        from forceaxis.design import advice_plot

        drawing.save(advice_plot.figure(result), out)
    width = shutil.get_terminal_size().columns
    present(result, as_json, lambda found: advise_text.describe(found, width), out)


@click.command(
    cls=Slow,
    epilog="""forceaxis compliance laboratory_grip --out compliance.png
    forceaxis compliance laboratory --element k_w --from 1e5 --to 2e6 --points 6 --json
    forceaxis compliance nl_friction --mode rail=forward --points 3""",
)
@click.argument(
    "model",
    metavar="MODEL|EXPERIMENT",
    type=Subject(paths.MODELS, paths.EXPERIMENTS),
)
@click.option("--element", help="The stiffness that is varied. Default: the contact's.")
@set_option("A model parameter.")
@mode_option("states")
@click.option(
    "--over",
    multiple=True,
    type=Parameter(),
    metavar="NAME=PERCENT%|LOW..HIGH",
    help="The set, as in advise. Default: mass and stiffness of what is pressed on, 30 %.",
)
@click.option("--from", "lowest", type=Positive(high=1e12), help="N/m. Default: a 20th of it.")
@click.option("--to", "highest", type=Positive(high=1e12), help="N/m. Default: 4 times it.")
@click.option("--points", type=click.IntRange(2, 40), default=9, show_default=True)
@click.option("--adc-bits", type=click.IntRange(8, 16), help="Default: the model's.")
@threads
@drawn
@as_json
def compliance(
    model, element, overrides, states, over, lowest, highest, points, adc_bits, threads, out,
    as_json,
):  # fmt: skip
    """Soft contact or low gain: what the stiffness of a pad, sensor or workpiece is worth.

    For each stiffness of one element: the bandwidth fS over the set of P and of a bank designed for
    it, at the same margins; the static error of P; the way of the drive from touch to the
    set-point; the hardest strike that each survives, simulated with the firmware.
    """
    from forceaxis import linear as models
    from forceaxis.design import compliance as soft

    check_drawing(out)
    if (lowest is None) != (highest is None):
        raise click.UsageError("expected --from and --to together, got one of them")
    span = None if lowest is None else (lowest, highest)
    result = soft.compliance(
        model, element, models.overrides(overrides), over or None, span, points, adc_bits, threads,
        models.states(states),
    )  # fmt: skip
    if out:
        from forceaxis import drawing

        drawing.save(soft.figure(result), out)
    present(result, as_json, soft.describe, out)


VERBS = (advise, compliance)
