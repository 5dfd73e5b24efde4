"""`forceaxis loop`: the group of commands that analyse a linear model and its force loop. The
module also has the options that several of these commands share."""

import contextlib
import functools
import inspect
import shlex
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click.shell_completion import CompletionItem

from forceaxis import paths
from forceaxis.cli import moved
from forceaxis.cli.common import (
    Callback,
    File,
    Parameter,
    Subject,
    Verbs,
    done_waiting,
    fitted_lines,
    mode_option,
    print_json,
    set_option,
)
from forceaxis.errors import ParameterError

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
    """Print the result of a command as a JSON object, or as the text that `describe` returns. If
    the command wrote the image file `out`, the last text line has the path of this file."""
    if as_json:
        print_json(result)
        return
    done_waiting()
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


# Decorators that add --set, --mode and the argument MODEL (or MODEL|EXPERIMENT) to a command.
model_options = _model_options("MODEL", paths.MODELS)
subject_options = _model_options("MODEL|EXPERIMENT", paths.MODELS, paths.EXPERIMENTS)


TIMINGS = click.Choice(["continuous", "zoh", "zoh+1"])


class Law(click.ParamType[str]):
    """Type of the option --law, which is the text of a control law or the path of a file. A shell
    can complete the names of control laws, the keys of their parameters, and file names."""

    name = "law"

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        from forceaxis.linear import law_text, loops

        if ":" in incomplete or "=" in incomplete:
            end = max(incomplete.rfind(mark) for mark in ":,") + 1
            texts = [f"{incomplete[:end]}{key}=" for key in law_text.KEYS]
        else:
            texts = [*loops.LAWS, *(f"{key}=" for key in ("gain", "force_gain"))]
        found = [CompletionItem(text) for text in texts if text.startswith(incomplete)]
        return found or [CompletionItem(incomplete, type="file")]


def one_law(context: click.Context, option: click.Parameter, texts: tuple[str, ...]) -> str | None:
    """Return the value of the option --law. Raises BadParameter if the option is given several
    times. If the given texts are about the same control law, the message shows them joined in one
    option."""
    if len(texts) < 2:
        return next(iter(texts), None)
    from forceaxis.linear.law_text import parse_law

    merged = moved.with_one_law([word for text in texts for word in ("--law", text)])
    names = {text.partition(":")[0] for text in texts if ":" in text or "=" not in text}
    example = ""
    with contextlib.suppress(ParameterError):
        parse_law(merged[1])
        example = f", as {shlex.join(merged)}" if len(names) < 2 else ""
    raise click.BadParameter(
        f"expected one law with all its keys{example}, got {len(texts)}: {' and '.join(texts)}",
        context,
        option,
    )


law_option = click.option(
    "--law",
    type=Law(),
    multiple=True,
    callback=one_law,
    metavar="NAME:KEY=VALUE,...|FILE",
    help="Control law: p; pi:integral=RAD_PER_S, k (1 + integral / s); pd:derivative=S, which "
    "differentiates the measured force; lead:zero=HZ,pole=HZ; derivative:derivative=S with a "
    "sensor of the rate (LINK.spring_force_rate); stiffness:stiffness=N_PER_M, "
    "damping:damping=NS_PER_M and impedance with both, from the encoder (thesis 1.1.3, 6.2.1); "
    "bank: the bank that an experiment selects. Each also takes its gain, gain=V_PER_N or "
    "force_gain=CODES_PER_COUNT as firmware.force_gain, and force laws and stiffness "
    "velocity_gain=VS_PER_M. Without NAME, as in force_gain=5: the law of the experiment, else p. "
    "FILE: law and gain, without the latency, of an experiment, of the bank.toml of "
    "`forceaxis design`, of the design.json of `forceaxis tune` or of a dump of "
    "`forceaxis axis params`.",
)


def requests_loop(verb: Callable[..., None]) -> Callable[..., None]:
    """Return a command whose function receives a LoopRequest as its parameter `request`. The values
    of all options that are not parameters of this function become fields of the LoopRequest."""
    own = inspect.signature(verb).parameters

    @functools.wraps(verb)
    def with_request(
        *arguments: Any,
        overrides: tuple[str, ...],
        modes: tuple[str, ...],
        law: str | None,
        **given: Any,
    ) -> None:
        from forceaxis import linear
        from forceaxis.design import law_file
        from forceaxis.linear.law_text import LawText
        from forceaxis.linear.request import LoopRequest

        chosen = LawText() if law is None else law_file.law_of(law)
        request = LoopRequest(
            overrides=linear.overrides(overrides),
            states=linear.states(modes),
            **vars(chosen),
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
    "--timing",
    type=TIMINGS,
    help="Sampling of the loop. Default: latency_ticks of the experiment, else zoh.",
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
