"""The commands `limit`, `rlocus`, `nyquist` and `step` of `forceaxis loop`, which analyse a linear
force loop."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from forceaxis.cli.common import Positive, Slow, as_json
from forceaxis.cli.loop import (
    check_drawing,
    draw,
    drawn,
    free,
    law_option,
    loop,
    loop_output,
    loop_timing,
    over_options,
    present,
    requests_loop,
    subject_options,
    vary,
)

if TYPE_CHECKING:
    from forceaxis.linear.request import LoopRequest


@loop.command(
    cls=Slow,
    short_help="The gain at which the loop becomes unstable, and margins at a gain.",
    epilog="""forceaxis loop limit fig4_19 --set b_m=0.02 --json
    forceaxis loop limit fig4_19 --law lead:zero=40,pole=400 --timing zoh+1
    forceaxis loop limit strike_biquad
    forceaxis loop limit contact --over k_w=30%,m_w=30% --timing both""",
)
@subject_options
@free
@law_option
@over_options
@click.option(
    "--output", default="reading", help="Feed back this signal. Default: the input of ADC 0."
)
@as_json
@requests_loop
def limit(
    request: "LoopRequest", as_json: bool, ranges: tuple[str, ...], visit: str | None
) -> None:
    """Compute the critical gain of the force loop of MODEL|EXPERIMENT: the gain at which the force
    loop becomes unstable.

    With an EXPERIMENT (a path or a name in sim/experiments) the command uses the control law or the
    quantised bank, the gain and the latency of its firmware. Options take precedence. The loop is
    linear: it has the equations of the model in contact, in one combination of states of its
    elements. The command prints every gain at which a closed-loop pole crosses the stability
    boundary, and the largest setting of the firmware below the first of these gains. If a gain is
    given, it also prints the margins and the bandwidth at that gain. A further line appears if the
    law then rounds the command to 0 for every force that the sensor measures. JSON: critical_gain
    in `unit` (null: stable for all gains, or up to known_to, above which rounding errors dominate;
    0: unstable for every gain, see reason), frequency_hz, crossings (those at gain 0 are undamped
    poles of the plant), and `at`.

    With --over, --modes or --timing both, the command analyses a set of plants. It prints the
    largest gain at which all of them are stable, the plant that limits it (`member`), and at the
    given gain the worst value of each figure with its plant.
    """
    from forceaxis.cli.text_loops import describe_limit, describe_limit_of_set
    from forceaxis.linear import limits, sets

    if sets.wanted(request, ranges, visit):
        found = sets.loop_set(request, ranges, visit)
        present(sets.limit_of(found), as_json, describe_limit_of_set)
        return
    loop = request.loop()
    present(limits.limit_result(loop, request.gain_of(loop)), as_json, describe_limit)


@loop.command(
    cls=Slow,
    short_help="Closed-loop poles over the gain, as a plot.",
    epilog="""forceaxis loop rlocus fig4_19 --timing continuous --out locus.png
    forceaxis loop rlocus fig4_19 --vary b_w=8.25,363 --law force_gain=5 --out b_w.png""",
)
@subject_options
@law_option
@vary
@free
@loop_timing
@loop_output
@click.option(
    "--span-hz",
    type=Positive(),
    help="Height of the figure, Hz. Default: the range of the poles around the crossing.",
)
@drawn
@as_json
@requests_loop
def rlocus(
    request: "LoopRequest",
    vary: tuple[str, ...],
    span_hz: float | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Draw the root locus of the force loop of MODEL|EXPERIMENT: the closed-loop poles over the
    gain, with the critical gain.

    The plot shows the upper half-plane in Hz, with x for open-loop poles and o for zeros. The poles
    of a sampled loop are drawn as log(z) / T. A filled diamond is the critical gain of `forceaxis
    loop limit`. A gain in --law, or the gain of an experiment, marks the poles at that gain. JSON:
    loci, each with gains, branches, poles, zeros in 1/s, crossings.
    """
    from forceaxis.cli.text_loops import describe_loci
    from forceaxis.linear import locus

    check_drawing(out)
    loci, result = locus.loci_of(request, vary, span_hz)
    draw(out, lambda plots: plots.rlocus_figure(loci, result))
    present(result, as_json, describe_loci, out)


@loop.command(
    cls=Slow,
    short_help="Loop gain as a curve, and margins.",
    epilog="""forceaxis loop nyquist fig4_19 --law force_gain=5 --out nyquist.png
    forceaxis loop nyquist strike_biquad --over k_w=30%,m_w=30% --timing both --out set.png""",
)
@subject_options
@law_option
@free
@over_options
@loop_output
@drawn
@as_json
@requests_loop
def nyquist(
    request: "LoopRequest",
    out: Path | None,
    as_json: bool,
    ranges: tuple[str, ...],
    visit: str | None,
) -> None:
    """Draw the Nyquist plot of the force loop of MODEL|EXPERIMENT, and print the margins of the
    force loop.

    The gain is that of the options, of the experiment, or half the critical gain. JSON: as
    `forceaxis loop limit` at that gain (margins under "at"), and the curve of the loop gain:
    frequency_hz_of_curve, real, imag, magnitude, phase_deg. For a set of plants: the worst values
    under "at", and `curves`, the nominal plant first.
    """
    from forceaxis.cli.text_loops import describe_curves_of_set, describe_nyquist
    from forceaxis.linear import curves, sets

    check_drawing(out)
    if sets.wanted(request, ranges, visit):
        found, of_set = sets.nyquist_of(sets.loop_set(request, ranges, visit))
        draw(out, lambda plots: plots.nyquist_set_figure(found, of_set))
        present(of_set, as_json, describe_curves_of_set, out)
        return
    result = curves.nyquist_of(request)
    draw(out, lambda plots: plots.nyquist_figure(result))
    present(result, as_json, describe_nyquist, out)


@loop.command(
    cls=Slow,
    short_help="Step response: rise time, settling time, overshoot.",
    epilog="""forceaxis loop step fig4_19 --law force_gain=5 --out step.png
    forceaxis loop step fig4_15 --law pd:derivative=0.004,gain=0.01 --timing continuous""",
)
@subject_options
@law_option
@over_options
@loop_output
@click.option("--duration-s", type=float, default=1.0, show_default=True)
@drawn
@as_json
@requests_loop
def step(
    request: "LoopRequest",
    duration_s: float,
    out: Path | None,
    as_json: bool,
    ranges: tuple[str, ...],
    visit: str | None,
) -> None:
    """Compute the response of the closed force loop of MODEL|EXPERIMENT to a step of the set-point,
    with rise time, settling time and overshoot, for the linear model in contact.

    The gain is that of the options, of the experiment, or half the critical gain. At time 0 the
    set-point steps by 1 N, or by 1 in the unit of --output. JSON: time_s, value, and rise_s (10 to
    90 %), settle_s (2 %), overshoot, final and stable. A figure is null if the loop is unstable,
    the final value is 0, or the response takes longer than --duration-s. For a set of plants:
    `members`, the nominal plant first, each with these keys, and the worst values.
    """
    from forceaxis.cli.text_loops import describe_step, describe_step_of_set
    from forceaxis.linear import limits, sets

    check_drawing(out)
    if sets.wanted(request, ranges, visit):
        of_set = sets.step_of(sets.loop_set(request, ranges, visit), duration_s)
        draw(out, lambda plots: plots.step_set_figure(of_set))
        present(of_set, as_json, describe_step_of_set, out)
        return
    loop = request.loop()
    result = limits.step_result(loop, request.drawn_gain(loop), duration_s)
    draw(out, lambda plots: plots.step_response(result))
    present(result, as_json, describe_step, out)
