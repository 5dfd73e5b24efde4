"""`forceaxis compare`: compare recordings of a real machine with the predictions of an
experiment."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from forceaxis import paths
from forceaxis.cli.common import (
    Folder,
    Slow,
    Subject,
    aligned,
    as_json,
    coloured,
    done_waiting,
    print_json,
    set_option,
)
from forceaxis.recordings.model_error import words_of
from forceaxis.recordings.signal_recording import INPUTS
from forceaxis.words import plain

if TYPE_CHECKING:
    from forceaxis.experiments.compare import ComparedFigure, RecordingComparison


@click.command(
    cls=Slow,
    epilog="""forceaxis recording import scope.csv --map force=Fz:N,code=dac --out touch
    forceaxis compare press/contact.toml touch.npz --over k_w=10%,b_w=30% --out out/compared""",
)
@click.argument("experiment", type=Subject(paths.EXPERIMENTS, as_path=True))
@click.argument(
    "recordings", nargs=-1, required=True, metavar="RECORDING...",
    type=click.Path(dir_okay=False, path_type=Path),
)  # fmt: skip
@click.option(
    "--over", multiple=True, metavar="NAME=PERCENT%,...",
    help="Uncertainty of parameters of the model, NAME=PERCENT% or NAME=LOW..HIGH, or "
    "posterior.json of `forceaxis identify contact`. Repeatable.",
)  # fmt: skip
@click.option(
    "--input", metavar="|".join((*INPUTS, "law")),
    help="Signal of the recording that is the input of the runs, or law for the law of EXPERIMENT. "
    "Default: the first of these signals that the recording has, else law.",
)  # fmt: skip
@click.option(
    "--gap", metavar="NAME",
    help="Parameter of the model that moves the first contact, when recorded commands are the "
    "input. Default: gap, if the model has it.",
)  # fmt: skip
@click.option(
    "--model-error", "model_error", multiple=True, metavar="NAME=PERCENT%,...",
    help="Errors of the model, such as drive=1%,force=2%,position=1%, in percent of the largest "
    "command, of the largest force and of the path; 0 for none. Default: those of posterior.json "
    "in --over.",
)  # fmt: skip
@click.option(
    "--span", "span_s", type=float,
    help="Time after the first contact that is compared, s. Default: all.",
)  # fmt: skip
@click.option(
    "--samples", type=int, default=40, show_default=True,
    help="Number of runs with parameters and noise sampled at random.",
)  # fmt: skip
@click.option(
    "--seed",
    type=int,
    default=1,
    show_default=True,
    help="Seed of the random parameters and noise.",
)
@set_option("As for run.")
@click.option(
    "--out",
    type=Folder(),
    help="Folder for comparison.json, and for each recording a picture (.png, .svg) and the "
    "signals (.npz).",
)
@as_json
def compare(
    experiment: Path,
    recordings: tuple[Path, ...],
    over: tuple[str, ...],
    input: str | None,
    gap: str | None,
    model_error: tuple[str, ...],
    span_s: float | None,
    samples: int,
    seed: int,
    overrides: tuple[str, ...],
    out: Path | None,
    as_json: bool,
) -> None:
    """Compare recordings of a real machine with what EXPERIMENT predicts for them: peak, impulse,
    contact losses and their instants, settling, held force, and the residual of each signal.

    The plant is fed with the recorded DAC codes, voltages, speeds or forces, without the firmware.
    With recorded set-points, or without a recorded input, the firmware's law controls the plant
    instead. Measured and predicted signals are aligned at the first contact. Each measured figure
    has to be within a band. The band follows from the noise, the resolution, --over and
    --model-error. If the machine is as the model says, all bands of a recording together hold 95 %
    of the recordings. If a figure is outside its band, the exit status is 1, and the command says
    with which error of the model all figures would agree.
    """
    from forceaxis.experiments import compare as comparing
    from forceaxis.experiments.prediction import PredictionRequest
    from forceaxis.recordings import model_error as errors

    error = errors.parse(model_error) if model_error else None
    request = PredictionRequest(experiment, over, overrides, input, gap, samples, seed, error)
    compared = [comparing.compare(request, file, span_s) for file in recordings]
    if out:
        from forceaxis.experiments import compare_plots

        compare_plots.write(compared, out)
    done_waiting()
    if as_json:
        print_json([one.result for one in compared])
    else:
        click.echo("\n\n".join(text_of(one.result) for one in compared))
        if out:
            click.echo(f"files        {paths.quoted(out)}")
    if not all(one.result.agrees for one in compared):
        sys.exit(1)


def text_of(result: "RecordingComparison") -> str:
    """Return the table that compares recordings with predictions. The first text line has the
    verdict."""
    outside = [one.figure for one in result.figures if not one.agrees]
    verdict = "agrees" if result.agrees else f"differs in {', '.join(outside)}"
    gap = "" if result.gap_m is None else f", gap {1e3 * result.gap_m:.4g} mm"
    lines = [
        f"recording    {result.recording}: {result.title}",
        f"verdict      {coloured(verdict, 'passed' if result.agrees else 'failed')}",
        f"input        {result.input}, {result.runs} runs, {result.span_s:.4g} s from the first "
        f"contact at {result.touch_s:.6g} s{gap}",
        f"noise        {result.noise_N:.3g} N around {result.zero_N:.3g} N before it",
        *aligned(
            [("figure", "unit", "measured", "predicted", "low", "high", ""),
             *(_row(one) for one in result.figures)], (0, 1, 6),
        ),
    ]  # fmt: skip
    inside = ", ".join(f"{name} {100 * share:.3g} %" for name, share in result.inside.items())
    lines.append(f"inside       samples within their band of 95 %: {inside}")
    if result.model_error:
        lines.append(f"model error  {words_of(result.model_error)}: contained in the bands")
    if result.needed_error:
        given = ",".join(f"{n}={100 * one.share:g}%" for n, one in result.needed_error.items())
        lines.append(
            f"model error  {words_of(result.needed_error)}: with it, all figures would agree "
            f"(--model-error {given})"
        )
    return "\n".join(lines + [f"note         {note}" for note in result.notes])


def _row(one: "ComparedFigure") -> tuple[str, ...]:
    texts = ["" if v is None else plain(v, 4) for v in (one.predicted, one.low, one.high)]
    measured = "never" if one.measured is None else plain(one.measured, 4)
    return (one.figure, one.unit, measured, *texts, "" if one.agrees else "differs")


VERBS = (compare,)
