"""`forceaxis examples`: copy the files that come with the package."""

from pathlib import Path

import click

from forceaxis.cli.common import Folder, Verb, as_json, print_result
from forceaxis.experiments import examples


@click.command(
    name="examples",
    cls=Verb,
    epilog="""forceaxis examples lab
    forceaxis run lab/sim/experiments/contact.toml""",
)
@click.argument("folder", type=Folder())
@as_json
def examples_(folder: Path, as_json: bool) -> None:
    """Copy the models, experiments, cycles, example programs and firmware images that come with
    forceaxis into FOLDER, to read and to change them. The commands of the guide work in FOLDER.

    FOLDER is created. It may exist, but without the folders sim, examples, tools and build. A
    command also finds models and experiments by their names without a copy."""
    result = examples.copy(folder)
    print_result(result, as_json, lambda: text_of(result), folder)


def text_of(result: examples.CopiedExamples) -> str:
    """Return one text line for each copied folder, with the number of files in the folder."""
    return "\n".join(f"{count:4}  {name}" for name, count in result.files.items())


VERBS = (examples_,)
