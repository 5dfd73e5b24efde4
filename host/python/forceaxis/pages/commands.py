"""The commands of `forceaxis` that do the actions which texts of the library recommend to a
user."""

import re

# {action: command that does it}. Texts of the library name actions between backticks.
# An action such as `axis.stop()` is a method of the class Axis.
# The library names actions in its texts, because it does not know the command line.
ACTIONS = {
    "axis.reset_fault()": "axis reset",
    "axis.start()": "axis start",
    "axis.stop()": "axis stop",
    "critical_gain": "loop limit",
    "design_law": "design",
    "dump_parameters": "axis params dump",
    "fit_contact": "identify contact",
    "fit_tables": "thesis tables",
    "import_recording": "recording import",
    "list_objects": "objects",
    "linearise_model": "loop linearise",
    "list_columns": "recording info",
    "load_program": "cycle load",
    "measure_response": "measure",
    "new_axis": "new NAME",
    "plant_unit": "fmu plant",
    "read_incident": "axis incident",
    "read_results": "cycle result EXPERIMENT --out FOLDER",
    "run_experiment": "run",
    "start_cycle": "cycle start EXPERIMENT --out FOLDER",
    "test_experiments": "test",
    "write_image": "flash",
    "write_objects": "axis set",
}
_ACTION = re.compile(f"`({'|'.join(map(re.escape, ACTIONS))})`")
ON_AN_AXIS = ("axis ", "cycle ")  # first words of those commands that act on one axis


def with_commands(text: str, on: str = "") -> str:
    """Replaces the actions between backticks in a text by commands of `forceaxis`. `on`: option
    that selects an axis on the command line. It is added to commands that act on one axis."""

    def command(named: re.Match[str]) -> str:
        words = ACTIONS[named[1]]
        has_axis = on and words.startswith(ON_AN_AXIS)
        return f"`forceaxis {words} {on}`" if has_axis else f"`forceaxis {words}`"

    return _ACTION.sub(command, text)
