"""The command `forceaxis identify contact`."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from forceaxis import paths
from forceaxis.cli.common import (
    Folder,
    Parameter,
    Slow,
    Subject,
    aligned,
    as_json,
    print_result,
    set_option,
    threads,
)
from forceaxis.words import plain

if TYPE_CHECKING:
    from forceaxis.commission.contact_results import ContactFit

STRETCHES_SHOWN = 3
NO_COMMAND = (
    "no command was recorded: speed and command of each contact are unknown, and only the stretch "
    "until the first maximum of the force is used; map the command with `forceaxis recording "
    "import --map code=COLUMN` (or voltage_command, speed_command, force_command)"
)


def rows_of(found: ContactFit) -> list[str]:
    """Return the text lines about parameters that were identified from recorded contacts."""
    table = [["parameter", "value", "95 % from", "to", "unit", "of the prior's deviation", ""]]
    for name, one in found.parameters.items():
        share = one.deviation / one.prior_deviation
        ends = ["-", "-"] if found.rejected else [plain(end, 5) for end in one.interval]
        table.append(
            [name, plain(one.value, 5), *ends, one.unit, f"{100 * share:.2g} %",
             "" if one.told or found.rejected else "not told by the recordings"]
        )  # fmt: skip
    lines = [
        f"recording    {one.file}: {one.contacts} first contacts, each with a place of its own"
        for one in found.recordings
        if one.contacts > 1
    ] + aligned(table, (0, 4, 6))
    lines += [
        f"secant       stiffness of {one.contact} up to {plain(one.force_N, 3)} N: "
        f"{plain(one.value, 5)} N/m, 95 % from {plain(one.interval[0], 5)} to "
        f"{plain(one.interval[1], 5)}"
        for one in found.secants
    ]
    lines += [
        f"warning      {one.file}: {note}; `forceaxis recording import --without-spikes` leaves "
        "them out"
        for one in found.recordings
        for note in one.notes
    ]
    if not found.commanded:
        lines.append(f"warning      {NO_COMMAND}")
    lines += model_rows(found)
    if found.convergence:
        run = found.convergence
        lines.append(
            f"sampling     {run.chains} chains of {run.walkers} walkers and {run.steps} steps, "
            f"R-hat {run.r_hat:.3f}, {run.effective_samples:.0f} effective samples, "
            f"{run.evaluations} simulations"
            + (
                ""
                if run.reached
                else f": not converged after {plain(run.budget_s, 4)} s of processor time; the "
                "widths are lower bounds, and there is no posterior; raise --budget (with the same "
                "--out the chains continue), add a recording, or --fit fewer parameters"
            )
        )
    return lines


def model_rows(found: ContactFit) -> list[str]:
    """Return the text lines that tell whether the model explains the recordings."""
    from forceaxis.recordings.model_error import words_of

    verdict = "the model explains the recordings"
    if found.rejected:
        verdict = "the model is rejected: it does not explain the recordings"
    elif found.p_with_error is not None and found.p_value < 0.001:
        verdict = "an exact model would be rejected"
    elif found.p_value < 0.05:
        verdict = "the model hardly explains the recordings"
    if found.p_with_error is not None and found.rejected:
        verdict += f", even with the largest error of the model, p = {found.p_with_error:.2g}"
    lines = [f"model        p = {found.p_value:.2g}: {verdict}"]
    if found.p_value < 0.05:
        lines += [
            f"{'':12} {one.touch}, {one.signal}: off by {one.worst_deviations:.3g} deviations "
            f"at {one.worst_s:.4g} s, p = {one.p:.2g}"
            for one in found.stretches[:STRETCHES_SHOWN]
        ]
    if found.p_with_error is not None and not found.rejected:
        parts = [words_of(found.model_error)] if found.model_error else []
        if found.freed:
            off = [
                f"{name} {100 * (one.value / one.prior - 1):+.2g} %"
                for name, one in found.parameters.items()
                if name in found.freed
            ]
            parts.insert(0, f"{', '.join(off)}, which were fitted too")
        lines.append(
            f"model error  {'; '.join(parts)}: with it the model explains the recordings, "
            f"p = {found.p_with_error:.2g}, and the widths contain it"
        )
    # If the numbers of the drive explain the recordings, no other element was tried.
    if found.elements or (found.p_value < 0.05 and (found.rejected or not found.freed)):
        lines += element_rows(found)
    return lines


def element_rows(found: ContactFit) -> list[str]:
    """Return the text lines about elements with which the model would explain the recordings
    better, such as friction."""
    if not found.elements:
        return ["lacks        none of the elements that were tried explains the rest"]
    lines = []
    for number, one in enumerate(found.elements, 1):
        values = ", ".join(f"{name} = {plain(value, 4)}" for name, value in one.values.items())
        lines.append(
            f"{'lacks' if number == 1 else '':12} {number}. {one.name}: {one.text} ({values}), "
            f"then p = {one.p:.2g}"
        )
    lines += ["add          " + found.elements[0].toml.replace("\n", "\n" + 13 * " ")]
    return lines


@click.command(
    cls=Slow,
    epilog="""forceaxis recording import touch.csv --map code=dac --map force=Fz:N \\
    --map position=pos:mm --out touch
    forceaxis identify contact press/model.toml touch.npz --fit m_w,k_w,b_w --out out/press
    forceaxis loop limit press/contact.toml --over out/press/posterior.json""",
)
@click.argument("model", type=Subject(paths.MODELS))
@click.argument(
    "recordings", nargs=-1, required=True, metavar="RECORDING...",
    type=click.Path(dir_okay=False, path_type=Path),
)  # fmt: skip
@click.option(
    "--fit", "fitted", multiple=True, required=True, type=Parameter(), metavar="NAME,...",
    help="Parameters to identify, with commas between them. Repeatable.",
)  # fmt: skip
@click.option(
    "--prior", "given", multiple=True, type=Parameter(), metavar="NAME=VALUE+-PERCENT%",
    help="What is known of a parameter, with its standard deviation. Default: the value of MODEL, "
    "with 5 % for masses and drive, 20 % for stiffnesses, a factor of 2 for dampings and of 5 for "
    "the workpiece and other parameters. Repeatable.",
)  # fmt: skip
@set_option("Parameter of MODEL that is not identified.")
@click.option(
    "--model-error", "model_error", multiple=True, metavar="NAME=PERCENT%,...",
    help="Errors of the model, such as drive=1%,force=2%,position=1%, in percent of the largest "
    "command, of the largest force and of the path; 0 for an exact model. Default: the most likely "
    "errors, each at most 5 %.",
)  # fmt: skip
@click.option(
    "--budget", "budget_s", type=click.FloatRange(0), default=60.0, show_default=True,
    help="Processor time of the sampler, s. Its chains are lengthened until they agree.",
)  # fmt: skip
@click.option(
    "--seed",
    type=click.IntRange(0),
    default=0,
    show_default=True,
    help="Seed of the random sampler.",
)
@click.option("--out", type=Folder(), help="Folder for posterior.json and two pictures.")
@threads
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Simulate on the workers of this Dask scheduler, as for sweep. Each batch of simulations "
    "takes some 20 ms more, so this helps for models that are slow to simulate.",
)
@as_json
def contact(
    model: str,
    recordings: tuple[Path, ...],
    fitted: Sequence[str],
    given: Sequence[str],
    overrides: Sequence[str],
    model_error: tuple[str, ...],
    budget_s: float,
    seed: int,
    out: Path | None,
    threads: int | None,
    scheduler: str | None,
    as_json: bool,
) -> None:
    """Identify parameters of the model MODEL from recordings of first contacts, with their
    uncertainty.

    RECORDING is a file of `forceaxis recording import` with the force and, if they were recorded,
    the command and the position. It begins out of contact. After at least 0.5 s out of contact, a
    further contact is fitted with a position of its own. The plant of MODEL is fed with the
    recorded command, so any controller may have made the recording.

    The result is a posterior: samples of plants that explain all recordings and what was known
    before. `loop limit`, `design`, `compare`, `sweep`, `cycle rates` and `tune` take
    out/posterior.json in place of a range of --over. The command names parameters that the
    recordings do not determine: their standard deviation is more than a third of that of their
    prior. A p value says whether an exact model explains the recordings. Below 0.05, the command
    names the parts of the recordings that do not fit, and ranks elements that the model may lack.
    In a model that is nearly right, the parameters of [drive] are then fitted too, unless --set
    gives their values, and it gets an error, which makes the intervals wide. If this error would
    have to be larger than 5 % or --model-error, the model is rejected. If it is rejected, or the
    chains of the sampler do not agree in time, no posterior.json is written, one of an earlier call
    is removed, and the exit status is 1.
    """
    from forceaxis import linear
    from forceaxis.commission import contact_fit
    from forceaxis.recordings import model_error as errors

    order = contact_fit.ContactOrder(
        model, recordings, tuple(n for text in fitted for n in text.split(",")), tuple(given),
        linear.overrides(overrides), seed, threads or os.cpu_count() or 1, out,
        scheduler, errors.parse(model_error) if model_error else None, budget_s,
    )  # fmt: skip
    found = contact_fit.identify(order)
    if out:
        contact_fit.write(found, out)
    print_result(found.result, as_json, lambda: "\n".join(rows_of(found.result)), out)
    if found.result.posterior is None:
        sys.exit(1)
