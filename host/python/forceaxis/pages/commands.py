"""The commands of `forceaxis` for the actions that texts of the library recommend to a user."""

import re

# {action that the library names between backticks: command that does this action}
# An action such as `axis.stop()` is a method of the class Axis.
# The library does not know the command line, so it names actions.
ACTIONS = {
    "axis.reset_fault()": "axis reset",
    "axis.start()": "axis start",
    "axis.stop()": "axis stop",
    "convert_log": "recording convert",
    "critical_gain": "loop limit",
    "design_law": "design",
    "dump_parameters": "axis params dump",
    "fit_contact": "identify contact",
    "fit_tables": "thesis tables",
    "import_recording": "recording import",
    "list_objects": "objects",
    "linearise_model": "loop linearise",
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
ON_AN_AXIS = ("axis ", "cycle ")  # first words of the commands that act on one axis


def with_commands(text: str, on: str = "") -> str:
    """Returns the text with commands of `forceaxis` in place of the actions between backticks.
    `on`: the option that selects the axis of the text. Commands that act on one axis get this
    option."""

    def command(named: re.Match[str]) -> str:
        words = ACTIONS[named[1]]
        has_axis = on and words.startswith(ON_AN_AXIS)
        return f"`forceaxis {words} {on}`" if has_axis else f"`forceaxis {words}`"

    return _ACTION.sub(command, text)
