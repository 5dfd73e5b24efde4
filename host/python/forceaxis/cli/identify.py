"""The commands of `forceaxis identify`: the identification procedures of the thesis, and fits of
model parameters to measured responses."""

from __future__ import annotations

import dataclasses
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from forceaxis import paths
from forceaxis._core import InputError
from forceaxis.cli.common import (
    Folder,
    Parameter,
    Slow,
    Subject,
    Verbs,
    as_json,
    done_waiting,
    fitted_lines,
    print_result,
    set_option,
)
from forceaxis.cli.contact import contact
from forceaxis.words import number

if TYPE_CHECKING:
    from forceaxis.identify.procedures import Estimate, EstimateWithInterval
    from forceaxis.identify.resonance import ResonanceResult
    from forceaxis.results import Convertible


class Known(click.ParamType["Estimate"]):
    """Type of an option for a known value above 0, given as VALUE or VALUE+-ERROR. The 95 %
    confidence interval is VALUE-ERROR to VALUE+ERROR."""

    name = "VALUE[+-ERROR]"

    def convert(
        self, value: str | Estimate, param: click.Parameter | None, ctx: click.Context | None
    ) -> Estimate:
        from forceaxis.identify import procedures

        digits, _, error = str(value).replace("±", "+-").partition("+-")
        try:
            known = procedures.Estimate(number(digits), number(error or 0.0))
        except ValueError:
            known = procedures.Estimate(0.0, 0.0)
        if not (1e-30 < known.value < 1e30 and 0 <= known.half < known.value):
            self.fail(
                f"expected VALUE or VALUE+-ERROR with numbers from 1e-30 to 1e30, got {value}",
                param,
                ctx,
            )
        return known


@click.group(
    cls=Verbs,
    epilog="""forceaxis identify decrement workpiece.csv --mass 6.6
    forceaxis identify fit fig4_19 out/measured --fit m_r --fit k_w""",
)
def identify() -> None:
    """Identify parameters of an axis from recordings and measured frequency responses, with 95 %
    confidence intervals.

    decrement, split, tach and motor are the procedures of the thesis (4.1.2, 4.4, 5.2.1). fit
    determines parameters of a model from a frequency response of `forceaxis measure`. contact
    determines them from recordings of first contacts.
    """


identify.add_command(contact)


def show(result: Convertible, as_json: bool, rows: Iterable[tuple[str, str | Estimate]]) -> None:
    """Print the result of an identification as JSON, or as text. The text has one line for each
    pair (name, text) in `rows`."""
    print_result(result, as_json, lambda: "\n".join(f"{name:12} {text}" for name, text in rows))


csv_file = click.argument("data", type=click.Path(dir_okay=False), metavar="DATA.csv")


@identify.command(
    epilog="""forceaxis identify decrement workpiece.csv --mass 6.6
    forceaxis identify decrement base.csv --signal base.position --from-s 0.1 --mass 500+-20"""
)
@csv_file
@click.option(
    "--signal", "column", help="Column of the vibration. Default: the column after time_s."
)
@click.option(
    "--from-s", type=float, default=float("-inf"), help="Start of the time span that is used, s."
)
@click.option(
    "--to-s", type=float, default=float("inf"), help="End of the time span that is used, s."
)
@click.option(
    "--floor",
    type=click.FloatRange(0, 1, min_open=True, max_open=True),
    default=0.05,
    show_default=True,
    help="Smallest amplitude of a cycle that is used, as a fraction of the largest amplitude.",
)
@click.option("--mass", type=Known(), help="Known mass, kg; gives stiffness and damping.")
@click.option("--stiffness", type=Known(), help="Known stiffness, N/m; gives mass and damping.")
@as_json
def decrement(
    data: str,
    column: str | None,
    from_s: float,
    to_s: float,
    floor: float,
    mass: Estimate | None,
    stiffness: Estimate | None,
    as_json: bool,
) -> None:
    """Identify frequency and damping ratio of a decaying vibration from a recording, by the
    logarithmic decrement.

    DATA.csv has a column time_s and a signal of any unit and offset, with at least 3 cycles. A
    damped sine is fitted to the signal. A signal that is not one decaying vibration is refused.
    """
    from forceaxis.identify import procedures

    if mass and stiffness:
        raise click.UsageError(
            "expected either --mass or --stiffness, got both options; remove one, because the "
            "command computes the other quantity"
        )
    found, derived = procedures.decrement(
        data, column, from_s, to_s, floor, mass=mass, stiffness=stiffness
    )
    plain = ("cycles", "decrement_of_ratio", "explained", "noise", "warnings")
    mode = {} if derived is None else vars(derived)
    estimates = {k: v for k, v in vars(found).items() if k not in plain} | mode
    show(
        {name: getattr(found, name) for name in plain}
        | {"decrement_of_ratio": procedures.finite(found.decrement_of_ratio)}
        | {name: e.with_interval() for name, e in estimates.items()},
        as_json,
        [
            ("cycles", f"{found.cycles}"),
            (
                "fit",
                f"explains {100 * found.explained:.5g} % of the record, noise {found.noise:.2g}",
            ),
            ("frequency", f"{found.natural_frequency}, damped {found.damped_frequency}"),
            (
                "decrement",
                f"{found.decrement}, {found.decrement_of_ratio:.5g} by first and last cycle",
            ),
            ("ratio", f"{found.damping_ratio} of damping, exact {found.damping_ratio_exact}"),
            *mode.items(),
            *(("warning", text) for text in found.warnings),
        ],
    )


@identify.command(
    epilog="forceaxis identify split --total-mass 132.4 --stiffness 665000 --frequency-hz 33+-0.1"
)
@click.option("--total-mass", type=Known(), required=True, help="Sum of the masses, kg.")
@click.option(
    "--stiffness",
    type=Known(),
    required=True,
    help="Stiffness of the spring between the masses, N/m.",
)
@click.option(
    "--frequency-hz",
    type=Known(),
    required=True,
    help="Undamped natural frequency in Hz, with both masses free.",
)
@as_json
def split(total_mass: Estimate, stiffness: Estimate, frequency_hz: Estimate, as_json: bool) -> None:
    """Identify two masses that are connected by a spring (thesis 4.4.2). The sum of the masses, the
    stiffness of the spring and the frequency of the vibration are given.

    There are two solutions. The command chooses the one in which the actuator side m_r1 has more
    than half of the mass. The equations assume that both masses are free. With a locked motor
    shaft, as in the measurement of the thesis, the frequency is that of m_r2 alone. The command
    prints the masses for that case too.
    """
    from forceaxis.identify import procedures

    found = procedures.split(total_mass, stiffness, frequency_hz)

    def masses(pair: tuple[Estimate, Estimate]) -> dict[str, EstimateWithInterval]:
        return {name: e.with_interval() for name, e in zip(("m_r1", "m_r2"), pair, strict=True)}

    words = [f"m_r1 {m_r1}, m_r2 {m_r2}" for m_r1, m_r2 in found.solutions]
    show({
        "solutions": [masses(pair) for pair in found.solutions],
        "rule": "m_r1 > m_r2",
        "locked_frequency_hz": found.locked_frequency_hz,
        "if_locked": masses(found.locked),
        },
        as_json,
        [
            ("chosen", f"{words[0]} (the actuator has more than half)"),
            ("other", words[1]),
            ("locked shaft", f"the chosen m_r2 would be at {found.locked_frequency_hz:.5g} Hz"),
            ("", "if {:.5g} Hz was measured so: m_r1 {}, m_r2 {}".format(
                frequency_hz.value, *found.locked)),
        ],
    )  # fmt: skip


def with_offset(verb: Callable[..., None]) -> Callable[..., None]:
    """Add the option --offset to a command that fits a straight line to measured points."""
    return click.option("--offset", is_flag=True, help="Fit a line with an offset, not through 0.")(
        verb
    )


@identify.command(epilog="forceaxis identify tach speeds.csv --offset")
@csv_file
@click.option("--speed", default="speed_rad_per_s", show_default=True, help="Column of the speed.")
@click.option(
    "--tach", default="tach_V", show_default=True, help="Column of the tachometer voltage."
)
@with_offset
@as_json
def tach(data: str, speed: str, tach: str, offset: bool, as_json: bool) -> None:
    """Identify the tachometer constant in V s/rad from a table of speeds and tachometer voltages
    (thesis 4.1.2). The constant is the slope of a straight line."""
    from forceaxis.identify import procedures

    found = procedures.regression_of(data, speed, tach, offset, ("V s/rad", "V"))
    names = ("k_tach", "offset") if offset else ("k_tach",)
    rows = list(zip(names, found, strict=True))
    show({name: e.with_interval() for name, e in rows}, as_json, rows)


@identify.command(
    epilog="""forceaxis identify motor steady.csv \\
    --k-torque 0.5 --k-back-emf 0.5 --k-tach 0.039+-0.0002 --resistance 4.5+-0.05"""
)
@csv_file
@click.option("--motor", default="motor_V", show_default=True, help="Column of the motor voltage.")
@click.option(
    "--tach", default="tach_V", show_default=True, help="Column of the tachometer voltage."
)
@click.option("--k-torque", type=Known(), required=True, help="Torque constant, N m/A.")
@click.option("--k-back-emf", type=Known(), required=True, help="Back-EMF constant, V s/rad.")
@click.option("--k-tach", type=Known(), required=True, help="Tachometer constant, V s/rad.")
@click.option(
    "--resistance", type=Known(), required=True, help="Resistance of motor and leads, ohm."
)
@with_offset
@as_json
def motor(
    data: str,
    motor: str,
    tach: str,
    k_torque: Estimate,
    k_back_emf: Estimate,
    k_tach: Estimate,
    resistance: Estimate,
    offset: bool,
    as_json: bool,
) -> None:
    """Identify the damping b_m of a motor from voltages of motor and tachometer at constant speeds
    (thesis 4.1.2).

    The shaft is uncoupled. At constant speed V_tach / V_motor = k_t k_tach / (R b_m + k_b k_t). The
    errors of the constants enter the confidence interval.
    """
    from forceaxis.identify import procedures

    ratio = procedures.regression_of(data, motor, tach, offset, ("V/V", "V"))[0]
    damping = procedures.motor_damping(ratio, k_torque, k_tach, k_back_emf, resistance, data)
    rows = [("ratio", ratio), ("b_m", damping)]
    warnings: list[str] = []
    if damping.value <= 0:
        warnings.append(
            "b_m below 0: no motor has that; check the constants, ratio <= k_tach / k_b"
        )
    result = {name: e.with_interval() for name, e in rows}
    texts = [("warning", text) for text in warnings]
    show({**result, "warnings": warnings}, as_json, [*rows, *texts])


@identify.command(
    cls=Slow,
    epilog="""forceaxis measure fig4_19 --output sensor.force --bias 1 --set b_w=100 \\
    --plant-set m_r=110 --out out/m
    forceaxis identify fit fig4_19 out/m --fit m_r --fit k_w=5e5 --out out/fitted
    forceaxis measure --on sim:press/contact.toml --free --force 60 --force-max 150 --out out/m
    forceaxis identify fit press/model.toml out/m/60N --fit k_w --fit m_w""",
)
@click.argument("model", type=Subject(paths.MODELS))
@click.argument("response", type=click.Path())
@click.option(
    "--fit", "names", multiple=True, required=True, type=Parameter(), metavar="NAME[=START]",
    help="Parameter to fit and its start value. Default: the value of MODEL. Repeatable.",
)  # fmt: skip
@set_option("Parameter of MODEL that is not fitted.")
@click.option("--input", help="Input signal. Default: as recorded; drive.command with a CSV file.")
@click.option("--output", help="Output signal. Default: as recorded; required with a CSV file.")
@click.option(
    "--averages", type=click.IntRange(2), help="Number of averages. Required with a CSV file."
)
@click.option(
    "--dt",
    type=click.FloatRange(0, min_open=True),
    help="Sampling period, s. Default: as recorded; required with a CSV file.",
)
@click.option("--out", type=Folder(), help="Folder for result.json and plot.png.")
@as_json
def fit(
    model: str,
    response: str,
    names: Sequence[str],
    overrides: Sequence[str],
    input: str | None,
    output: str | None,
    averages: int | None,
    dt: float | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Fit parameters of the model MODEL to a measured frequency response, and test whether the
    fitted model explains the response.

    RESPONSE is the folder of `forceaxis measure --out`, or a CSV file with columns frequency_hz,
    coherence and magnitude, phase_deg (or real, imag). For each parameter the command prints its
    95 % confidence interval and a wider interval that is valid for all parameters together. A
    chi-square test shows whether the model explains the data. The command names parameters that
    are poorly determined or nearly indistinguishable. A model that does not explain the data (p <
    0.001) is rejected: its best values are printed, but no intervals, and the exit status is 1. It
    is also 1 if the search for the best values has not converged.

    If MODEL lacks dry friction that was measured, the response is fitted again with a damper in
    its place. The line `friction` then gives the damping in N s/m, the friction in N, and the table
    [[friction]] to add to MODEL. If no damper explains the friction, the response is refused as
    `friction` with exit status 1. --json: "friction" is null or
    {"freed": [{"name", "between", "damping", "newton", "declared"}], "lines": ...}.
    """
    from forceaxis import linear
    from forceaxis.cli.response_text import describe_fit
    from forceaxis.commission import damper_fit
    from forceaxis.commission.refusal import Refusal
    from forceaxis.identify import fit as fit_response

    held = linear.overrides(overrides)
    settings = fit_response.ResponseSettings(input, output, averages, dt)
    measured = fit_response.read_response(response, model, held, settings)
    starts, units = fit_response.starts_of(names, measured)
    for name in starts:
        if name in held:
            raise InputError(
                f"--set: {name}: expected a parameter that is not fitted, got a fitted parameter; "
                f"give the start value as --fit {name}={linear.shown(held[name])}"
            )
    try:
        with tempfile.TemporaryDirectory() as folder:
            found, measured, summary = damper_fit.fit(
                measured, starts, units, response, Path(folder)
            )
            if not summary.rejected and found.converged:
                values = {name: summary.parameters[name].value for name in starts}
                texts = [f"--set {name}={value:.6g}" for name, value in values.items()]
                summary = dataclasses.replace(summary, set=" ".join(texts))
            if out:
                fit_response.write(found, measured, summary, out)
    except Refusal as refusal:
        done_waiting()
        for line in ("to be added to the model:", *refusal.lines.splitlines()):
            if refusal.lines:
                click.echo(line, err=True)
        raise
    print_result(summary, as_json, lambda: fitted_lines("\n".join(describe_fit(summary))), out)
    if summary.rejected or not found.converged:
        sys.exit(1)


@identify.command(
    cls=Slow,
    epilog="""forceaxis measure fig3_11 --out out/tip
    forceaxis identify resonances fig4_11 out/tip --rigid robot.acceleration --modes 2""",
)
@click.argument("model", type=Subject(paths.MODELS))
@click.argument("response", type=click.Path())
@click.option("--rigid", required=True, help="Signal of MODEL that a rigid structure would give.")
@click.option("--modes", type=click.IntRange(1, 50), default=5, show_default=True)
@click.option(
    "--prominence-db",
    type=float,
    default=1.0,
    show_default=True,
    help="Least height of a peak, dB.",
)
@click.option("--refine", is_flag=True, help="Refine the result by least squares in dB.")
@set_option("A parameter of MODEL.")
@as_json
def resonances(
    model: str,
    response: str,
    rigid: str,
    modes: int,
    prominence_db: float,
    refine: bool,
    overrides: Sequence[str],
    as_json: bool,
) -> None:
    """Identify frequencies and damping ratios of the resonances in a measured frequency response
    (procedure of thesis section 4.2).

    MODEL is a rigid body out of contact (fig4_11), whose response the resonances multiply. RESPONSE
    is the folder of `forceaxis measure --out`. Only the magnitude is fitted. The phase matches too
    if the system has minimum phase. JSON: resonances (peak_hz, peak_damping, trough_hz and
    trough_damping or null), rms_db, max_db, phase_error_deg, and zeros, poles (1/s) of the cascade.
    """
    from forceaxis import linear
    from forceaxis.identify import resonance

    result = resonance.of_measurement(
        model, response, rigid, linear.overrides(overrides), modes, prominence_db, refine
    )
    print_result(result, as_json, lambda: fitted_lines(resonances_in_words(result)))


def resonances_in_words(result: ResonanceResult) -> str:
    """Return the text that `forceaxis identify resonances` prints: a table of the resonances, and
    the error of the fitted response."""
    lines = [f"{'peak Hz':>10}{'damping':>10}{'trough Hz':>12}{'damping':>10}"]
    for r in result.resonances:
        line = f"{r.peak_hz:10.4g}{r.peak_damping:10.4f}"
        if r.trough is not None:
            line += "{:12.4g}{:10.4f}".format(*r.trough)
        lines.append(line)
    phase = result.phase_error_deg
    lines.append(
        f"error        {result.rms_db:.3g} dB rms, {result.max_db:.3g} dB at most"
        + ("" if phase is None else f"; phase {phase:.3g} degrees rms")
    )
    return "\n".join(lines)


VERBS = (identify,)
