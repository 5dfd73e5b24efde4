"""Verbs of a force loop: its limit, root locus, Nyquist plot, step."""

import click

from forceaxis.cli.common import Positive, Verb, as_json
from forceaxis.cli.models import (
    TIMINGS,
    check_drawing,
    draw,
    drawn,
    free,
    law_options,
    loop_output,
    loop_timing,
    model_options,
    present,
    vary,
)


@click.command(
    cls=Verb,
    epilog="""forceaxis limit fig4_19 --set b_m=0.02 --json
    forceaxis limit fig4_19 --law lead --lead-zero-hz 40 --lead-pole-hz 400 --timing zoh+1
    forceaxis limit laboratory --firmware-gain 10""",
)
@model_options
@free
@law_options
@click.option(
    "--timing",
    type=TIMINGS,
    help="zoh: sampled and held at 1500 Hz, as the axis runs; zoh+1: codes act one tick later. "
    "Default: the experiment's latency_ticks, else zoh.",
)
@click.option(
    "--output", default="reading", help="Feed back this signal. Default: what ADC 0 converts."
)
@as_json
def limit(model, as_json, gain, firmware_gain, **given):
    """The critical gain of a force loop around MODEL, a path or a stem of sim/models (fig4_19).

    The loop is linear: the model's equations in one mode, in contact. Prints every gain at which
    a closed-loop pole crosses the stability boundary, the largest setting of the firmware below
    the first, and with --gain or --firmware-gain the margins there. JSON: critical_gain in `unit`
    (null: stable for all gains; 0: unstable however small, see reason), frequency_hz, crossings, of
    which those at gain 0 are undamped poles of the plant.
    """
    from forceaxis.linear import limits

    loop = limits.from_options(model, **given)
    summary = limits.limit_summary(loop, limits.one_gain(loop, gain, firmware_gain))
    present(summary, as_json, limits.describe_limit)


@click.command(
    cls=Verb,
    epilog="""forceaxis rlocus fig4_19 --timing continuous --out locus.png
    forceaxis rlocus fig4_19 --vary b_w=8.25,363 --span-hz 70 --firmware-gain 5 --out b_w.png""",
)
@model_options
@law_options
@vary
@free
@loop_timing
@loop_output
@click.option(
    "--span-hz",
    type=Positive(),
    help="Height of the frame, Hz. Default: the structural dynamics around the crossing.",
)
@drawn
@as_json
def rlocus(model, out, as_json, **given):
    """Root locus of a force loop around MODEL, with its critical gain.

    x: open-loop poles, o: zeros; in Hz, the upper half-plane; of a sampled loop log(z) / T. A
    filled diamond is the critical gain, as `forceaxis limit` gives it; --gain or --firmware-gain
    mark the poles there. JSON: loci, each with gains, branches, poles, zeros in 1/s, crossings.
    """
    from forceaxis.linear import locus

    check_drawing(out)
    loci, summary = locus.loci_of(model, **given)
    draw(out, lambda plots: plots.rlocus(loci, plots.loop_title(summary)))
    present(summary, as_json, locus.describe, out)


@click.command(cls=Verb, epilog="forceaxis nyquist fig4_19 --firmware-gain 5 --out nyquist.png")
@model_options
@law_options
@free
@loop_timing
@loop_output
@drawn
@as_json
def nyquist(model, out, as_json, **given):
    """Nyquist plot of a force loop around MODEL at a gain, by default half the critical one.

    JSON: as `forceaxis limit` with that gain (margins under "at"), and the curve:
    frequency_hz_of_curve, real, imag, magnitude, phase_deg of the loop gain.
    """
    from forceaxis.linear import curves, limits

    check_drawing(out)
    summary = curves.nyquist_of(model, **given)
    draw(out, lambda plots: plots.nyquist_figure(summary))
    present(summary, as_json, limits.describe_limit, out)


@click.command(
    cls=Verb,
    epilog="""forceaxis step fig4_19 --firmware-gain 5 --out step.png
    forceaxis step fig4_15 --law pd --derivative-s 0.004 --gain 0.01 --timing continuous""",
)
@model_options
@law_options
@loop_timing
@loop_output
@click.option("--duration-s", type=float, default=1.0, show_default=True)
@drawn
@as_json
def step(model, gain, firmware_gain, duration_s, out, as_json, **given):
    """Step response of the closed loop around MODEL, linear and in contact.

    The set-point steps by 1 (N, or what --output has) at 0. JSON: time_s, value, and rise_s (10 to
    90 %), settle_s (2 %), overshoot, final and stable; null where the loop is unstable, the
    final value 0, or the response needs longer than --duration-s.
    """
    from forceaxis.linear import limits

    check_drawing(out)
    loop = limits.from_options(model, **given)
    gain = limits.one_gain(loop, gain, firmware_gain)
    result = limits.step_summary(loop, gain, duration_s)
    draw(out, lambda plots: plots.step_response(result))
    present(result, as_json, limits.describe_step, out)


VERBS = (limit, rlocus, nyquist, step)
