"""The commands of `forceaxis` for what texts of the library tell a user to do."""

import re

# Each action that the library names between backticks, and the command that does this action.
# The library does not know the command line.
ACTIONS = {
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
    "reset_fault": "axis reset",
    "run_experiment": "run",
    "start_cycle": "cycle start EXPERIMENT --out FOLDER",
    "start_node": "axis start",
    "stop_axis": "axis stop",
    "test_experiments": "test",
    "write_image": "flash",
    "write_objects": "axis set",
}
_ACTION = re.compile(f"`({'|'.join(ACTIONS)})`")


def with_commands(text: str) -> str:
    """Returns the text in which each action between backticks is replaced by the command of
    `forceaxis` that does it."""
    return _ACTION.sub(lambda named: f"`forceaxis {ACTIONS[named[1]]}`", text)
