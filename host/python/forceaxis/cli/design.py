"""`forceaxis design`: design a force law for a set of plants."""

import contextlib
import itertools
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import click

from forceaxis import paths
from forceaxis.cli import common
from forceaxis.cli.common import (
    Folder,
    Parameter,
    Subject,
    Verb,
    as_json,
    mode_option,
    set_option,
    threads,
)

if TYPE_CHECKING:
    from forceaxis.design.outcome import DesignOrder


class Newtons(click.ParamType[tuple[float, ...]]):
    """Type of an option for one or more forces in N. Commas separate the forces, as in "30,75"."""

    name = "newtons"

    def convert(
        self, value: str, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        number = common.Positive()
        return tuple(number.convert(text, param, ctx) for text in str(value).split(","))


@click.command(
    cls=Verb,
    epilog="""forceaxis design laboratory --over k_w=30%,m_w=30% --ms 2 --out out/law
    forceaxis design laboratory --over k_w=30%,m_w=30% --pareto bandwidth,ms --out out/front
    forceaxis design press/model.toml --over k_w=30% --force 30,75 --approach 5 --out out/law
    forceaxis design contact --over k_w=30% --adc-bits 12 --json
    forceaxis design press/model.toml --over k_s=30% --mode seals=forward
    forceaxis design press/model.toml --measured out/m/free --measured out/m/30N \\
    --measured out/m/150N --over k_w=30%,m_w=30% --out out/law""",
)
@click.argument(
    "text",
    metavar="MODEL|EXPERIMENT",
    type=Subject(paths.MODELS, paths.EXPERIMENTS),
)
@click.option(
    "--over",
    multiple=True,
    type=Parameter(),
    metavar="NAME=PERCENT%|LOW..HIGH",
    help="Tolerance of a model parameter; commas separate several tolerances. Repeatable.",
)
@click.option(
    "--modes",
    type=click.Choice(["visited", "all"]),
    default="visited",
    show_default=True,
    help="States of amplifier, contact and friction for which the law is designed. visited: those "
    "that occur in a simulated contact, with frictions stuck and sliding.",
)
@click.option(
    "--ms", type=float, default=2.0, show_default=True,
    help="Largest permitted Ms; 1.1 times as much at latency 1.",
)  # fmt: skip
@click.option(
    "--gain-margin", type=float, default=2.3, show_default=True, help="Least gain margin."
)
@click.option(
    "--adc-bits", type=int, help="Resolution of the force ADC, 8 to 16 bits, at the same range. "
    "Default: that of the model.",
)  # fmt: skip
@click.option(
    "--hf-gain", type=common.Positive(), metavar="CODES",
    help="Largest gain at high frequency, DAC codes per force count; it amplifies the measurement "
    "noise. Default: 80, or more if the noise of the model permits it; at most 15 per code of the "
    "ADC.",
)  # fmt: skip
@click.option(
    "--ramp", "ramp_s", type=common.Positive(), metavar="S",
    help="Rise time of the set-point that the force has to follow without overshoot, s. Default: "
    "0.2 over the bandwidth of a PI law, at least 0.1.",
)  # fmt: skip
@click.option(
    "--latency",
    type=click.Choice(["both", "0", "1"]),
    default="both",
    show_default=True,
    help="Values of latency_ticks for which the design has to keep its margins.",
)
@set_option("A parameter of the model in its unit (b_w=363). Repeatable.")
@mode_option("states")
@click.option(
    "--measured", multiple=True, metavar="FOLDER",
    help="Folder of `forceaxis measure --out`; MODEL is fitted to it first. Repeatable.",
)  # fmt: skip
@click.option(
    "--prior", "priors", multiple=True, type=Parameter(), metavar="NAME=VALUE[+-PERCENT%]",
    help="With --measured: known value and error of a parameter (m_w=4.1+-2%). Repeatable.",
)  # fmt: skip
@click.option(
    "--force", "forces_N", multiple=True, type=Newtons(), metavar="N[,N...]",
    help="Force set-points of the simulated contacts, N: --force 75 or --force 30,100. Repeatable. "
    "Default: three within the ranges of sensor and drive.",
)  # fmt: skip
@click.option(
    "--approach", "approach_mm_per_s", type=common.Positive(), metavar="MM/S",
    help="Speed of the simulated approaches, mm/s. Default: that of EXPERIMENT, else 20.",
)  # fmt: skip
@click.option(
    "--simulate/--no-simulate", default=True, help="Simulate with the firmware. Default: yes."
)
@click.option(
    "--pareto",
    metavar="bandwidth,ms|hf|gain_margin",
    help="Print the trade-off between bandwidth and a second figure: one design for each value of "
    "the second. --out gets tradeoff.png and tradeoff.json.",
)
@click.option("--out", type=Folder(), help="New folder for the results.")
@threads
@as_json
def design(
    text: str,
    over: tuple[str, ...],
    modes: str,
    ms: float,
    gain_margin: float,
    adc_bits: int | None,
    hf_gain: float | None,
    ramp_s: float | None,
    latency: str,
    overrides: tuple[str, ...],
    states: tuple[str, ...],
    measured: tuple[str, ...],
    priors: tuple[str, ...],
    forces_N: tuple[tuple[float, ...], ...],
    approach_mm_per_s: float | None,
    simulate: bool,
    pareto: str | None,
    out: Path | None,
    threads: int | None,
    as_json: bool,
) -> None:
    """Design a force law: find the filter bank with the largest bandwidth that keeps the required
    margins for all plants within the tolerances of MODEL.

    The law is a bank of the firmware: gain, integral action and up to three second-order sections,
    with coefficients rounded as the firmware stores them. It keeps the margins for every corner of
    the set of plants, in every mode and for each latency, and |T| stays above -3 dB within its
    bandwidth. The command takes the smallest structure whose bandwidth is within a few per cent
    of the best.

    Then it simulates the law with the firmware: first contacts at three set-points (or those of
    --force) and two speeds, impacts, and random plants of the set, with dry friction from none to
    twice that of MODEL. After a first contact the force error has to be at most 2 % and the peak at
    most 1.3 set-points, and contact may be lost once more than with a weak law. The gain is reduced
    until every simulated case is stable. Each reduction is printed with its case and the limit.

    fS is the lowest frequency at which |S| reaches -3 dB, for the worst plant. With --measured, the
    parameters of MODEL are fitted to the responses, and the set of plants is widened by their
    confidence intervals. Measured dry friction becomes a damper in that fit. If the fit is
    rejected, the exit status is 1.

    --out writes contact.toml (an experiment, beside a copy of EXPERIMENT), bank.toml (the objects
    of the bank with its certificate, for `axis params load`) and index.html.

    \b
    --json: {"bank": {"force_gain": DAC codes per 8-bit count,
      "integral_rad_per_s": ..., "sections": [[b0, b1, b2, a1, a2], ...],
      "velocity_gain": ...},
     "worst": {"fS_Hz": ..., "fT_Hz": ..., "Ms": ..., "gain_margin": ...,
      "phase_margin_deg": ..., "member": {...}},
     "p": {the same for P at the same margins, and its "force_gain"},
     "simulated": [{"law": "design" | "p", "case": ..., "member": {...},
      "latency_ticks": 0, "verdict": ..., "static_error_percent": ...,
      "missed": [{"limit", "verdict", "value", "bound", "unit"}, ...],
      "peak_N": ..., "losses": ..., "saturated_ms": ..., "settle_ms": ...,
      "overshoot_percent": ...}],
     "structures": [...], "chosen": ..., "limited_by": ...,
     "gain_cuts": [{"force_gain", "failed", "simulated", "case", "why"}],
     "contact_loss": {...}, ...}
    """
    from forceaxis import linear
    from forceaxis.cli import design_text
    from forceaxis.design import for_set, outcome

    order = outcome.DesignOrder(
        text, over, linear.overrides(overrides), modes=modes, states=linear.states(states), ms=ms,
        gain_margin=gain_margin, adc_bits=adc_bits, latency=latency,
        hf_gain=hf_gain, ramp_s=ramp_s, forces_N=tuple(itertools.chain.from_iterable(forces_N)),
        approach_mm_per_s=approach_mm_per_s, simulate=simulate, threads=threads,
    )  # fmt: skip
    if priors and not measured:
        raise click.UsageError(
            "--prior: expected --measured together with this option; add --measured or remove "
            "--prior"
        )
    if measured:
        order = _identified(order, measured, priors)
    if pareto:
        _pareto(order, pareto, out, as_json)
        return
    write_page = None
    if out:
        # The module `design` imports Matplotlib, which takes time.
        from forceaxis.pages import design as page

        write_page = page.write
    with progress_on(sys.stderr) as progress:
        found = for_set.design(order, out, progress, write_page)
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else None
    common.print_result(
        found.result(), as_json, lambda: common.fitted_lines(design_text.describe(found, width))
    )


def _identified(
    order: "DesignOrder", measured: tuple[str, ...], priors: tuple[str, ...]
) -> "DesignOrder":
    """Fit the model to the measured responses. Return a copy of `order`, the request for a design,
    with the fitted parameters, and with their confidence intervals as tolerances. Raises Refusal if
    the fit is rejected."""
    from forceaxis.commission import damper_fit, known
    from forceaxis.commission.refusal import Refusal
    from forceaxis.identify.fit import read_response
    from forceaxis.linear import settings

    model = settings.of(order.text, plant=True).model
    before = known.priors(model, order.over, priors, order.overrides)
    responses = [read_response(folder, model, order.overrides) for folder in measured]
    with tempfile.TemporaryDirectory() as folder:
        found = damper_fit.joint(
            model, before, responses, measured, order.over, order.states, Path(folder)
        )
    if found.rejected:
        raise Refusal(found.rejected, "; ".join(filter(None, (found.text, found.remedy))))
    if found.model != responses[0].model:
        click.echo("fitted with dampers for the dry friction that was measured", err=True)
    assert found.values is not None
    return replace(order, over=found.over, overrides={**order.overrides, **found.values})


def _pareto(order: "DesignOrder", pareto: str, out: Path | None, as_json: bool) -> None:
    from forceaxis.cli import design_text
    from forceaxis.design import files, tradeoff

    against = tradeoff.against_of(pareto)
    if out is not None:
        files.refuse_existing(out)
    with progress_on(sys.stderr) as progress:
        result = tradeoff.tradeoff(order, against, progress)
    if out is not None:
        from forceaxis.pages import design_plots

        design_plots.write_tradeoff(out, result)
    common.print_result(
        result, as_json, lambda: common.fitted_lines(design_text.describe_tradeoff(result))
    )


@contextlib.contextmanager
def progress_on(stream: TextIO) -> Iterator[Callable[[str], None] | None]:
    """Context manager that returns a function. The function shows a text as the progress line of a
    terminal. The context manager returns None if `stream` is not a terminal."""
    if not stream.isatty():
        yield None
        return

    def show(text: str) -> None:
        stream.write(f"\r\033[K{text[:78]}")
        stream.flush()

    try:
        yield show
    finally:
        show("")


VERBS = (design,)
