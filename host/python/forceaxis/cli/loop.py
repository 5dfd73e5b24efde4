"""`forceaxis loop`, the group of commands that analyse a linear model and its force loop, with the
options that several of these commands have."""

import functools
import inspect
import json
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeVar

import click

from forceaxis import paths
from forceaxis.cli.common import (
    Callback,
    File,
    Parameter,
    Subject,
    Verbs,
    done_waiting,
    fitted_lines,
    mode_option,
    set_option,
)
from forceaxis.results import to_json

Result = TypeVar("Result", bound="Convertible")

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from forceaxis.results import Convertible


@click.group(
    cls=Verbs,
    sections={
        "How large the gain may be": ("limit", "nyquist", "rlocus"),
        "How fast the loop is": ("step", "bode"),
        "What limits it": ("advise", "compliance"),
        "What the model says": ("modes", "poles", "linearise"),
    },
    epilog="""forceaxis loop limit contact --over k_w=30%,m_w=30%
    forceaxis loop advise contact""",
)
def loop() -> None:
    """Analyse a linear model and its force loop: gain limit, margins, responses, what limits the
    bandwidth, modes of vibration."""


def check_drawing(out: Path | None) -> None:
    """Raise InputError if the suffix of `out` is not that of an image file. A command calls this
    function before a long computation."""
    if out:
        from forceaxis import drawing

        drawing.check_name(out)


def draw(out: Path | None, make: Callable[[ModuleType], "Figure"]) -> None:
    """Write the plot that make(plots) draws to the file `out`. If `out` is None, draw nothing.
    `plots` is the module linear.plots, which is loaded only for a plot."""
    if out:
        from forceaxis import drawing
        from forceaxis.linear import plots

        drawing.save(make(plots), out)


def present(
    result: Result, as_json: bool, describe: Callable[[Result], str], out: Path | None = None
) -> None:
    """Print the result of a command as a JSON object, or as the text of `describe` and the path
    of the image file `out`."""
    done_waiting()
    if as_json:
        click.echo(json.dumps(to_json(result), allow_nan=False))
        return
    click.echo(fitted_lines(describe(result)))
    if out:
        click.echo(f"figure       {paths.quoted(out)}")


def _model_options(subject: str, *folders: Path) -> Callable[[Callback], Callback]:
    def add(verb: Callback) -> Callback:
        for decorate in (
            mode_option("modes"),
            set_option("A parameter of the model in its unit (b_m=0.02). Repeatable."),
            click.argument("model", metavar=subject, type=Subject(*folders)),
        ):
            verb = decorate(verb)
        return verb

    return add


# Decorators that add the argument MODEL (or MODEL|EXPERIMENT) and the options --set and --mode to a
# command.
model_options = _model_options("MODEL", paths.MODELS)
subject_options = _model_options("MODEL|EXPERIMENT", paths.MODELS, paths.EXPERIMENTS)


LAWS = click.Choice(
    ["p", "pi", "pd", "lead", "derivative", "stiffness", "damping", "impedance", "bank"]
)


TIMINGS = click.Choice(["continuous", "zoh", "zoh+1"])


def law_options(verb: Callback) -> Callback:
    """Add the options of a control law to a command: --law, the parameters of each law, and the
    gain in two units."""
    for name, text in reversed(
        {
            "--integral-rad-per-s": "w_i of law pi: k (1 + w_i / s).",
            "--derivative-s": "T_d of laws pd and derivative: k (f_d - f - T_d f'). pd "
            "differentiates the measured force; derivative has a sensor of its rate "
            "(LINK.spring_force_rate).",
            "--lead-zero-hz": "w_z of law lead: k (1 + s / w_z) / (1 + s / w_p).",
            "--lead-pole-hz": "w_p of law lead.",
            "--stiffness-n-per-m": "K_fs of laws stiffness and impedance; x from the encoder.",
            "--damping-ns-per-m": "K_fd of laws damping and impedance.",
            "--velocity-gain-vs-per-m": "Velocity gain K_v of the force laws and of stiffness.",
            "--gain": "Gain k of the law, V/N.",
            "--firmware-gain": "Gain as firmware.force_gain, DAC codes per force count.",
        }.items()
    ):
        verb = click.option(name, type=float, help=text)(verb)
    return click.option(
        "--law",
        type=LAWS,
        help="Control law of force, or of force and motion (thesis 1.1.3, 6.2.1). bank: the bank "
        "that an experiment selects. Default: that of the experiment, else p.",
    )(verb)


# Parameter of the control law for each parameter of the command's function. The names of the
# function's parameters are in lower case, as the library click writes them.
LAW_PARAMETERS = {
    name.lower(): name
    for name in (
        "integral_rad_per_s",
        "derivative_s",
        "lead_zero_hz",
        "lead_pole_hz",
        "stiffness_N_per_m",
        "damping_Ns_per_m",
        "velocity_gain_Vs_per_m",
    )
}


def requests_loop(verb: Callable[..., None]) -> Callable[..., None]:
    """Give a command the parameter `request`, a LoopRequest. The LoopRequest is made from all
    options that are not parameters of the command's own function."""
    own = inspect.signature(verb).parameters

    @functools.wraps(verb)
    def with_request(
        *arguments: Any, overrides: tuple[str, ...], modes: tuple[str, ...], **given: Any
    ) -> None:
        from forceaxis import linear
        from forceaxis.linear.request import LoopRequest

        values = {name: given.pop(option) for option, name in LAW_PARAMETERS.items()}
        request = LoopRequest(
            overrides=linear.overrides(overrides),
            states=linear.states(modes),
            parameters={name: value for name, value in values.items() if value is not None},
            **{name: given.pop(name) for name in [*given] if name not in own},
        )
        verb(*arguments, request=request, **given)

    return with_request


vary = click.option(
    "--vary",
    multiple=True,
    type=Parameter(),
    metavar="NAME=VALUE,VALUE",
    help="Draw one curve for each value of a model parameter. Repeatable: all combinations.",
)


free = click.option("--free", is_flag=True, help="Contacts are open.")


outputs_option = click.option(
    "--output",
    "outputs",
    multiple=True,
    default=["reading"],
    show_default=True,
    help="A signal of the model, reading (the input of ADC 0), adc0, adc1, encoder. Repeatable.",
)


drawn = click.option("--out", type=File(), help="Draw a figure: FILE.png, .svg or .pdf.")


loop_timing = click.option(
    "--timing", type=TIMINGS, help="Default: latency_ticks of the experiment, else zoh."
)


def over_options(verb: Callback) -> Callback:
    """Add the options for a set of plants to a command: --over, --modes and --timing, which also
    accepts "both"."""
    for decorate in (
        click.option(
            "--modes",
            "visit",
            type=click.Choice(["visited", "all", "nominal"]),
            help="States of amplifier, contact and friction that belong to the set. visited: those "
            "that occur in a run of EXPERIMENT; nominal: that of --mode. visited and all have "
            "frictions stuck and sliding, without saturation. Default: visited; all for a MODEL.",
        ),
        click.option(
            "--over",
            "ranges",
            multiple=True,
            type=Parameter(),
            metavar="NAME=RANGE",
            help="Tolerance of a parameter, k_w=30% or m_w=4..9. The set has its corners, random "
            "plants and the result of a search for the worst. Repeatable, or several with commas.",
        ),
        click.option(
            "--timing",
            type=click.Choice([*TIMINGS.choices, "both"]),
            help="zoh: sampled at 1500 Hz with zero-order hold, as the axis; zoh+1: with a latency "
            "of one tick; both: a set of the two. Default: latency_ticks of the experiment, else "
            "zoh.",
        ),
    ):
        verb = decorate(verb)
    return verb


loop_output = click.option(
    "--output", default="reading", show_default=True, help="Signal that is fed back."
)


VERBS = (loop,)
