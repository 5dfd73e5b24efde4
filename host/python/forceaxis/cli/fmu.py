"""`forceaxis fmu`: the plant or the firmware as a unit (FMU) for another simulator."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, cast

import click

from forceaxis import paths
from forceaxis.cli.common import (
    Callback,
    File,
    Object,
    Subject,
    Verb,
    Verbs,
    as_json,
    print_result,
)
from forceaxis.cli.common import set_option as set_values

if TYPE_CHECKING:
    from forceaxis.fmu.description import Version
    from forceaxis.fmu.unit import Written


def unit_options(set_help: str) -> Callable[[Callback], Callback]:
    """Return a decorator that adds the options that `fmu plant` and `fmu firmware` have in
    common."""

    def add(command: Callback) -> Callback:
        version = click.option(
            "--fmi",
            "version",
            type=click.Choice(("2.0", "3.0")),
            default="2.0",
            show_default=True,
            help="Version of FMI. Nearly every simulator reads 2.0; 3.0 has unsigned integers.",
        )
        out = click.option("--out", type=File(), required=True, help="FMU that is written.")
        return set_values(set_help)(version(out(as_json(command))))

    return add


@click.group(
    cls=Verbs,
    epilog="""forceaxis fmu plant laboratory --out plant.fmu
    forceaxis fmu firmware contact --out firmware.fmu""",
)
def fmu() -> None:
    """Write the plant or the firmware as a co-simulation unit (FMU) of FMI 2.0 or 3.0.

    A unit has the simulator or the unmodified firmware as a library, without Python, and takes any
    step. If another simulator steps first the firmware, then the plant, by ticks of 1/1500 s, it
    computes the same codes in each tick as `forceaxis run`.
    """


@fmu.command(
    cls=Verb,
    epilog="""forceaxis fmu plant laboratory --out plant.fmu
    forceaxis fmu plant laboratory --out plant.fmu
    forceaxis fmu plant press/model.toml --set k_w="280 kN/m" --fmi 3.0 --out plant.fmu""",
)
@click.argument("model", type=Subject(paths.MODELS, as_path=True))
@unit_options("New value of a parameter of the model. Repeatable.")
def plant(model: Path, overrides: tuple[str, ...], version: str, out: Path, as_json: bool) -> None:
    """Write the plant of a model.

    MODEL can also be the path of an experiment. The unit then has its model, its values and its
    seed, but not its events. Inputs are dac_code, amp_enable and brake_release of the firmware, and
    an impulse on each body. Outputs are the codes of encoder, ADCs and switches, and all signals of
    the model in SI units. The parameters of the model and the seed of the noise can be set before
    the initialization.
    """
    from forceaxis.fmu import unit
    from forceaxis.linear.system import overrides as values

    done = unit.write_plant(model, values(overrides), cast("Version", version), out)
    show(done, as_json)


@fmu.command(
    cls=Verb,
    epilog="""forceaxis fmu firmware contact --out firmware.fmu
    forceaxis fmu firmware press/axis.toml --input target_force --fmi 3.0 --out firmware.fmu""",
)
@click.argument("file", type=Subject(paths.EXPERIMENTS, as_path=True), required=False)
@unit_options("As for run: a parameter or an object of the experiment. Repeatable.")
@click.option(
    "--input",
    "inputs",
    multiple=True,
    type=Object(),
    metavar="OBJECT",
    help="Object that is an input, such as target_force, so that a signal can be connected to it. "
    "Repeatable.",
)
def firmware(
    file: Path | None,
    overrides: tuple[str, ...],
    inputs: tuple[str, ...],
    version: str,
    out: Path,
    as_json: bool,
) -> None:
    """Write the firmware of an axis.

    FILE is an experiment or a parameter file of `forceaxis axis params dump`. From an experiment,
    the firmware gets the objects, the later writes and the program. The table [measured] of a
    parameter file is not used. Without FILE, the objects have their defaults. Inputs are the codes
    of encoder, ADCs and switches. Outputs are dac_code, amp_enable and brake_release. The objects
    are variables PART.OBJECT, such as axis.force_setpoint. Signals are outputs. Other objects are
    parameters that can be set at any time.
    """
    from forceaxis.fmu import unit

    done = unit.write_firmware(file, overrides, inputs, cast("Version", version), out)
    show(done, as_json)


def show(done: "Written", as_json: bool) -> None:
    """Print the path of the co-simulation unit (FMU) that was written, and the numbers of its
    variables.
    """

    def text() -> str:
        of = f" of {Path(done.source).name}" if done.source else ""
        return (
            f"unit         {done.kind}{of}, FMI {done.version}\n"
            f"variables    {done.inputs} inputs, {done.outputs} outputs, "
            f"{done.parameters} parameters\n"
            f"platforms    {', '.join(done.platforms)}\n"
            f"files        {paths.quoted(done.file)}"
        )

    print_result(done, as_json, text)


VERBS = (fmu,)
