"""Commands of `forceaxis axis` that set up the force sensor and record signals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from forceaxis._core import InputError
from forceaxis.cli.axis import axis, lines, shown
from forceaxis.cli.common import Folder, Object, Positive, as_json, print_json, print_result
from forceaxis.cli.live_options import RECORDED, AxisConnection, live, live_over, owned
from forceaxis.results import to_json
from forceaxis.words import number

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from forceaxis.axis.axis import Axis


@axis.command(epilog="forceaxis axis tare --on lcm:1")
@live
@as_json
def tare(connection: AxisConnection, as_json: bool) -> None:
    """Measure the force without load and set this force as the tare, so that the measured force is
    0 without load.

    The axis has to be at standstill and out of contact. The exit status is 1, with the reason, if
    the axis moves, if the measured force is too noisy or if it exceeds tare_band."""
    from forceaxis.axis import actions

    with owned(connection) as axis:
        found = actions.tare(axis)
        print_result(found, as_json, lambda: "\n".join(lines(axis, vars(found))))


@axis.command(
    epilog="""forceaxis axis calibrate --on lcm:1 --point 0,0 --point 20.4,50 --point 40.9,100
    forceaxis axis calibrate --on can0        # asks for the reference forces one after another"""
)
@click.option(
    "--point",
    "given",
    multiple=True,
    metavar="COUNT,N",
    help="Measured force in counts and reference force in N, 2 to 8 times. Default: the command "
    "asks.",
)
@live
@as_json
def calibrate(connection: AxisConnection, given: Sequence[str], as_json: bool) -> None:
    """Calibrate the force sensor: determine force_scale, in N per count, from 2 to 8 forces of a
    reference load cell or of weights.

    The result is the slope of a straight line through these points, with its linearity error. The
    axis is disabled during the calibration. Without --point, type the force that the reference
    shows. The command then reads the sensor. An empty line ends the input. `axis params store`
    keeps the result over a power cut.
    """
    from forceaxis.axis import actions

    points = [point(text) for text in given]
    with owned(connection) as axis:
        if not points:
            points = list(asked(axis, actions.CALIBRATION_POINTS.stop - 1))
        found = actions.calibrate(axis, points)
    if as_json:
        print_json(to_json(found) | {"points": points})
        return
    click.echo(
        f"force_scale {found.force_scale_N_per_count:.6g} N/count, linearity error "
        f"{found.linearity_permille:.3g} per mille of the span"
    )


def point(text: str) -> tuple[float, float]:
    """Return a calibration point from a text "COUNT,N", which has the measured force in counts and
    the reference force in N. Raises InputError for a text that does not have this form."""
    try:
        count, newton = text.split(",")
        return number(count), number(newton)
    except ValueError:
        raise InputError(
            f"--point {text}: expected COUNT,N, a measured force in counts and a reference force "
            "in N, such as 20.4,50"
        ) from None


def asked(axis: Axis, most: int) -> Iterator[tuple[float, float]]:
    """Ask the user for reference forces until the user enters an empty text line, at most `most`
    times. Yield each calibration point as (measured force in counts, reference force in N)."""
    from forceaxis.axis import actions

    for i in range(most):
        text = click.prompt(f"force {i + 1} in N, empty to end", default="", show_default=False)
        if not text.strip():
            return
        try:
            newton = number(text)
        except ValueError:
            raise InputError(f"{text}: expected a force in N as a number") from None
        count = actions.reading(axis)
        click.echo(f"{count:.5g} force counts = {newton:g} N")
        yield count, newton


@axis.command(
    epilog="""forceaxis axis capture --on lcm:1 force dac_code --samples 1500 --out out/rest
    forceaxis axis capture --on can0 force position --trigger "force rising 31" --pretrigger 300"""
)
@click.argument("signals", nargs=-1, required=True, type=Object(), metavar="SIGNAL...")
@click.option(
    "--samples",
    type=click.IntRange(0, 65535),
    default=0,
    help="Number of samples. Default: as many as the memory of the axis can store.",
)
@click.option(
    "--decimation",
    type=click.IntRange(1, 65535),
    default=1,
    help="Number of ticks from one sample to the next.",
)
@click.option(
    "--pretrigger",
    type=click.IntRange(0, 65535),
    default=0,
    help="Number of samples before the trigger.",
)
@click.option(
    "--trigger",
    metavar="CONDITION",
    help='"NAME rising|falling|either LEVEL" (a force also in N), or excitation_start.',
)
@click.option(
    "--timeout",
    type=Positive(0.1, 86400),
    default=30.0,
    show_default=True,
    help="Longest time to wait for the end of the recording, s.",
)
@click.option("--out", type=Folder(), help="Folder for capture.csv, .npz and .png.")
@live_over(RECORDED)
@as_json
def capture(
    connection: AxisConnection,
    signals: Sequence[str],
    samples: int,
    decimation: int,
    pretrigger: int,
    trigger: str | None,
    timeout: float,
    out: Path | None,
    as_json: bool,
) -> None:
    """Record up to 8 signals in the memory of the axis, at up to 1500 samples per second, and print
    minimum, mean, maximum and standard deviation of each signal.

    An axis that another client of the same bus has enabled stays enabled. A recording cannot be
    read over Modbus.
    """
    from forceaxis.axis import quantity, recordings

    with owned(connection, shared=True) as axis:
        settings = quantity.trigger(axis, trigger) if trigger else {}
        where = axis.link.where
        held = axis.capture(
            signals, samples, timeout, decimation=decimation, pretrigger=pretrigger, **settings
        )
    if out:
        recordings.write(held, out, where)
    found = CaptureSummary(
        samples=len(held.raw),
        decimation=held.decimation,
        trigger_sample=held.trigger_sample,
        signals={name: summary(held.values(name)) for name in held.signals},
    )
    print_result(found, as_json, lambda: "\n".join(capture_lines(found)), out)


def capture_lines(found: CaptureSummary) -> Iterator[str]:
    """Yield the text lines about a recording: the number of samples, and the statistics of each
    signal."""
    yield f"{found.samples} samples, trigger at {found.trigger_sample}"
    for name, row in found.signals.items():
        yield f"{name}: " + ", ".join(f"{key} {shown(value)}" for key, value in vars(row).items())


@dataclass(frozen=True)
class SignalSummary:
    """Minimum, mean, maximum and standard deviation of one recorded signal, in the engineering unit
    of the signal."""

    least: float
    mean: float
    most: float
    deviation: float  #: standard deviation of the samples


@dataclass(frozen=True)
class CaptureSummary:
    """Result of `forceaxis axis capture`: number of samples, spacing of samples, and statistics of
    each signal."""

    samples: int
    decimation: int  # number of ticks from one sample to the next
    trigger_sample: int
    signals: dict[str, SignalSummary]


def summary(values: NDArray[np.int64 | np.float64]) -> SignalSummary:
    """Return the minimum, mean, maximum and standard deviation of the samples of one signal."""
    return SignalSummary(
        float(values.min()), float(values.mean()), float(values.max()), float(values.std())
    )
