"""Verbs of identification: the procedures of 4.4, the fit of parameters."""

import json
import tempfile
from pathlib import Path

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
    set_option,
)


class Known(click.ParamType):
    """VALUE or VALUE+-ERROR, above 0: an earlier measurement, ERROR half of its 95 % interval."""

    name = "VALUE[+-ERROR]"

    def convert(self, value, param, ctx):
        from forceaxis.identify import procedures

        number, _, error = str(value).replace("±", "+-").partition("+-")
        try:
            known = procedures.Estimate(float(number), float(error or 0.0))
        except ValueError:
            known = procedures.Estimate(0.0, 0.0)
        if not (1e-30 < known.value < 1e30 and 0 <= known.half < known.value):
            self.fail(
                f"expected VALUE or VALUE+-ERROR, above 0 (1e-30 to 1e30), got {value}", param, ctx
            )
        return known


@click.group(
    cls=Verbs,
    epilog="""forceaxis identify decrement workpiece.csv --mass 6.6
    forceaxis identify fit fig4_19 out/measured --fit m_r --fit k_w""",
)
def identify():
    """Identify parameters from recordings and measured responses, with 95 % intervals.

    decrement, split, tach and motor are the procedures of the thesis (4.1.2, 4.4, 5.2.1); fit fits
    any parameters of a model to a response that `forceaxis measure` has measured.
    """


def show(result, as_json, rows):
    """Print a procedure's result, or its `rows` of (name, text)."""
    if as_json:
        click.echo(json.dumps(result, allow_nan=False))
    else:
        for name, text in rows:
            click.echo(f"{name:12} {text}")


csv_file = click.argument("data", type=click.Path(dir_okay=False), metavar="DATA.csv")


@identify.command(
    epilog="""forceaxis identify decrement workpiece.csv --mass 6.6
    forceaxis identify decrement base.csv --signal base.position --from-s 0.1 --mass 500+-20"""
)
@csv_file
@click.option("--signal", "column", help="Column of the vibration. Default: the one beside time_s.")
@click.option("--from-s", type=float, default=float("-inf"), help="Use it from this time on.")
@click.option("--to-s", type=float, default=float("inf"), help="Use it up to this time.")
@click.option(
    "--floor",
    type=click.FloatRange(0, 1, min_open=True, max_open=True),
    default=0.05,
    show_default=True,
    help="Fraction of the largest amplitude down to which cycles count.",
)
@click.option("--mass", type=Known(), help="kg; gives stiffness and damping.")
@click.option("--stiffness", type=Known(), help="N/m; gives mass and damping.")
@as_json
def decrement(data, column, from_s, to_s, floor, mass, stiffness, as_json):
    """Frequency and damping of a recorded ring-down, by its logarithmic decrement.

    DATA.csv has a column time_s and a signal of any unit and offset. At least 3 cycles. A damped
    sine is fitted to the record; what is not one vibration that dies out is refused.
    """
    from forceaxis.identify import procedures

    if mass and stiffness:
        raise click.UsageError("expected --mass or --stiffness, not both; the other one follows")
    found, derived = procedures.decrement(
        data, column, (from_s, to_s), floor, mass=mass, stiffness=stiffness
    )
    plain = ("cycles", "decrement_of_ratio", "explained", "noise", "warnings")
    estimates = {k: v for k, v in vars(found).items() if k not in plain} | derived
    show(
        {name: getattr(found, name) for name in plain}
        | {"decrement_of_ratio": procedures.finite(found.decrement_of_ratio)}
        | {name: e.json() for name, e in estimates.items()},
        as_json,
        [
            ("cycles", found.cycles),
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
            *derived.items(),
            *(("warning", text) for text in found.warnings),
        ],
    )


@identify.command(
    epilog="forceaxis identify split --total-mass 132.4 --stiffness 665000 --frequency-hz 33+-0.1"
)
@click.option("--total-mass", type=Known(), required=True, help="kg, of both masses.")
@click.option("--stiffness", type=Known(), required=True, help="N/m, of the spring between them.")
@click.option(
    "--frequency-hz", type=Known(), required=True, help="Of the mode in free space, undamped."
)
@as_json
def split(total_mass, stiffness, frequency_hz, as_json):
    """Two masses on either side of a spring, from their sum and their frequency (4.4.2).

    Both solutions; chosen is the one whose actuator side m_r1 has more than half of the mass. The
    equations are those of both masses free. With the motor's shaft locked, as the thesis describes
    its measurement, the frequency would be that of m_r2 alone: the masses for that case are
    printed too.
    """
    from forceaxis.identify import procedures

    found = procedures.split(total_mass, stiffness, frequency_hz)
    result = {
        "solutions": [{"m_r1": m_r1.json(), "m_r2": m_r2.json()} for m_r1, m_r2 in found.solutions],
        "rule": "m_r1 > m_r2",
        "locked_frequency_hz": found.locked_frequency_hz,
        "if_locked": {"m_r1": found.locked[0].json(), "m_r2": found.locked[1].json()},
    }
    words = [f"m_r1 {m_r1}, m_r2 {m_r2}" for m_r1, m_r2 in found.solutions]
    show(
        result,
        as_json,
        [
            ("chosen", f"{words[0]} (the actuator has more than half)"),
            ("other", words[1]),
            ("locked shaft", f"the chosen m_r2 would be at {found.locked_frequency_hz:.5g} Hz"),
            ("", "if {:.5g} Hz was measured so: m_r1 {}, m_r2 {}".format(
                frequency_hz.value, *found.locked)),
        ],
    )  # fmt: skip


def with_offset(verb):
    """The option of both regressions."""
    return click.option("--offset", is_flag=True, help="A line with an offset, not through 0.")(
        verb
    )


@identify.command(epilog="forceaxis identify tach speeds.csv --offset")
@csv_file
@click.option("--speed", default="speed_rad_per_s", show_default=True, help="Column, rad/s.")
@click.option("--tach", default="tach_V", show_default=True, help="Column, V.")
@with_offset
@as_json
def tach(data, speed, tach, offset, as_json):
    """Tachometer constant: slope of its voltage over the measured speed (4.1.2)."""
    from forceaxis.identify import procedures

    found = procedures.regression_of(data, speed, tach, offset, ("V s/rad", "V"))
    names = ("k_tach", "offset") if offset else ("k_tach",)
    rows = list(zip(names, found, strict=True))
    show({name: e.json() for name, e in rows}, as_json, rows)


@identify.command(
    epilog="""forceaxis identify motor steady.csv \\
    --k-torque 0.5 --k-back-emf 0.5 --k-tach 0.039+-0.0002 --resistance 4.5+-0.05"""
)
@csv_file
@click.option("--motor", default="motor_V", show_default=True, help="Column, V at the terminals.")
@click.option("--tach", default="tach_V", show_default=True, help="Column, V.")
@click.option("--k-torque", type=Known(), required=True, help="N m/A.")
@click.option("--k-back-emf", type=Known(), required=True, help="V s/rad.")
@click.option("--k-tach", type=Known(), required=True, help="V s/rad.")
@click.option("--resistance", type=Known(), required=True, help="ohm, of motor and leads.")
@with_offset
@as_json
def motor(data, motor, tach, k_torque, k_back_emf, k_tach, resistance, offset, as_json):
    """Motor damping b_m from steady voltages of motor and tachometer, shaft uncoupled (4.1.2).

    V_tach / V_motor = k_t k_tach / (R b_m + k_b k_t) at DC. Errors of the constants count.
    """
    from forceaxis.identify import procedures

    ratio = procedures.regression_of(data, motor, tach, offset, ("V/V", "V"))[0]
    damping = procedures.motor_damping(ratio, k_torque, k_tach, k_back_emf, resistance, data)
    rows = [("ratio", ratio), ("b_m", damping)]
    warnings = []
    if damping.value <= 0:
        warnings.append(
            "b_m below 0: no motor has that; check the constants, ratio <= k_tach / k_b"
        )
    result = {name: e.json() for name, e in rows} | {"warnings": warnings}
    show(result, as_json, rows + [("warning", text) for text in warnings])


@identify.command(
    cls=Slow,
    epilog="""forceaxis measure fig4_19 --output sensor.force --bias 1 --set b_w=100 \\
    --plant-set m_r=110 --out out/m
    forceaxis identify fit fig4_19 out/m --fit m_r --fit k_w=5e5 --out out/fitted
    forceaxis measure --sim press/contact.toml --free --force 60 --force-max 150 --out out/m
    forceaxis identify fit press/model.toml out/m/60N --fit k_w --fit m_w""",
)
@click.argument("model", type=Subject(paths.MODELS))
@click.argument("response", type=click.Path())
@click.option(
    "--fit", "names", multiple=True, required=True, type=Parameter(), metavar="NAME[=START]",
    help="Parameter to fit, and where to start if not from the model's value. Repeatable.",
)  # fmt: skip
@set_option("Parameter that is held.")
@click.option("--input", help="Signal. Default: as recorded; of a CSV file drive.command.")
@click.option("--output", help="Signal. Default: as recorded; required with a CSV file.")
@click.option("--averages", type=click.IntRange(2), help="Required with a CSV file.")
@click.option(
    "--dt",
    type=click.FloatRange(0, min_open=True),
    help="s a sample. Default: as recorded; required with a CSV file.",
)
@click.option(
    "--scale", type=float, help="What the output was multiplied by. Default: as recorded."
)
@click.option("--out", type=Folder(), help="Folder for result.json and plot.png.")
@as_json
def fit(model, response, names, overrides, out, as_json, **given):
    """Fit parameters of MODEL to a measured frequency response.

    RESPONSE is the folder of `forceaxis measure --out`, or a CSV file with columns frequency_hz,
    coherence and magnitude, phase_deg (or real, imag). Prints for each parameter its 95 % interval
    and a wider one that holds for all at once, whether the model explains the data (chi-square),
    and which parameters are poorly determined or nearly indistinguishable. A model that does not
    (p < 0.001) is rejected: it has best values, but no intervals and nothing to --set.

    Where that is for dry friction that MODEL lacks, it is fitted once more with a damper in the
    place of the friction, of this response alone: the line `friction` says its N s/m, what it is in
    newtons, and the [[friction]] to add. A response whose file tells of friction that no damper
    explains is refused as `friction`, with the same lines and exit status 1. --json: "friction" is
    null or {"freed": [{"name", "between", "damping", "newton", "declared"}], "lines": ...}.
    """
    from forceaxis import linear
    from forceaxis.commission import freed
    from forceaxis.commission.refusal import Refusal
    from forceaxis.identify import fit as fit_response

    held = linear.overrides(overrides)
    measured = fit_response.read_response(response, model, held, **given)
    starts, units = fit_response.starts_of(names, measured)
    for name in starts:
        if name in held:
            raise InputError(
                f"--set: {name}: expected a parameter that is held, it is to be fitted; give where "
                f"to start as --fit {name}={linear.shown(held[name])}"
            )
    try:
        with tempfile.TemporaryDirectory() as folder:
            found, measured, summary = freed.fit(measured, starts, units, response, Path(folder))
            if out:
                fit_response.write(found, measured, summary, out)
    except Refusal as refusal:
        done_waiting()
        for line in ("to be added to the model:", *refusal.lines.splitlines()):
            if refusal.lines:
                click.echo(line, err=True)
        raise
    done_waiting()
    if as_json:
        click.echo(json.dumps(summary, allow_nan=False))
    else:
        lines = [fit_response.describe(summary), *freed.describe(summary)]
        click.echo(fitted_lines("\n".join(lines)))
        if out:
            click.echo(f"files        {paths.quoted(out)}")


@identify.command(
    cls=Slow,
    epilog="""forceaxis measure fig3_11 --out out/tip
    forceaxis identify resonances fig4_11 out/tip --rigid robot.acceleration --modes 2""",
)
@click.argument("model", type=Subject(paths.MODELS))
@click.argument("response", type=click.Path())
@click.option("--rigid", required=True, help="Signal of MODEL that RESPONSE would be if rigid.")
@click.option("--modes", type=click.IntRange(1, 50), default=5, show_default=True)
@click.option(
    "--prominence-db", type=float, default=1.0, show_default=True, help="A peak stands out by this."
)
@click.option("--refine", is_flag=True, help="Least squares in dB after the five steps.")
@set_option("A parameter of MODEL.")
@as_json
def resonances(model, response, rigid, modes, prominence_db, refine, overrides, as_json):
    """The polynomial resonance model of a measured response, by the five steps of 4.2.

    MODEL is the rigid body that the resonances multiply (fig4_11), out of contact; RESPONSE what
    `forceaxis measure --out` wrote. Only magnitudes are fitted; the phase fits too where the data
    are of a minimum-phase system. JSON: resonances (peak_hz, peak_damping, trough_hz and
    trough_damping or null), rms_db, max_db, phase_error_deg, and zeros, poles (1/s) of the cascade.
    """
    from forceaxis import linear
    from forceaxis.identify import resonance

    result = resonance.of_measurement(
        model, response, rigid, linear.overrides(overrides), modes, prominence_db, refine
    )
    done_waiting()
    click.echo(
        json.dumps(result, allow_nan=False) if as_json else fitted_lines(resonance.describe(result))
    )


VERBS = (identify,)
