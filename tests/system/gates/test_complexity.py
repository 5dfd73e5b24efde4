"""Functions have at most so many branches and parameters; those of C and C++ that have more are
listed here with a reason, files of Python in pyproject.toml.

The numbers are those of ruff for Python (pyproject.toml): cyclomatic complexity, where each case of
a switch and each `&&` counts, and parameters. lizard counts both.
"""

import json
import subprocess
import sys
import tomllib
from pathlib import Path

import lizard
import pytest

ROOT = Path(__file__).resolve().parents[3]
COMPLEXITY_MAX = 12
PARAMETERS_MAX = 7
# {reason: {"file without ending: function": its complexity, which may fall and not rise}}
EXCEPTIONS = {
    "one short branch for each address, object, kind, function code or unit: a list of cases": {
        "cycle: is_met": 15,
        "program: has_right_level": 16,
        "drive: cia402_written": 17,
        "object_values: Scales::of": 14,
        "object_values: Scales::of_counts": 26,
        "parameters: parameters_written": 23,
        "bits: modbus_bits_resume": 18,
        "publisher: AxisPublisher::changed": 17,
        "request: modbus_request_bytes": 17,
        "status: cia402_show": 17,
        "switches: SwitchBank::read": 16,
    },
    "checks in the order of the standard or of the protection, each of which ends the function": {
        "blackbox: blackbox_follow": 13,
        "entries: read_entry": 13,
        "first_motion: check_out": 13,
        "modbus_axis: ModbusAxis::check": 18,
        "assembly: Assembly::extend": 13,
        "node: canopen_receive": 14,
        "node: canopen_tick_begin": 13,
        "pdo: check_side": 14,
        "request: begin": 15,
        "sdo_client: SdoClient::receive": 21,
        "verdict: check_contact": 16,
    },
    "a file or text with a refusal for each thing that may be wrong in it": {
        "journal: read_journal": 17,
        "model: read_parameters": 17,
        "node_options: finish_options": 13,
        "object_values: read_object": 17,
        "object_values: read_objects": 17,
        "options: finish_gateway_options": 21,
        "units: parse_unit": 23,
    },
    "a conversation with another program, step by step with the end of each step that fails": {
        "axis: GatewayAxis::set_up_pdo": 20,
        "axis: GatewayAxis::shut_down": 19,
        "commands: GatewayCommands::capture": 14,
        "commands: GatewayCommands::target_of": 14,
        "event_loop: EventLoop::run": 13,
        "exchange: PlantExchange::wait_on": 16,
        "linked_run: LinkedPlants::run": 20,
        "plant_node: run": 13,
    },
    "an algorithm whose steps share their numbers": {
        "crossing: refine": 19,
        "extended: Factors::Factors": 13,
        "linear: linearise": 15,
        "mode: build_mode": 19,
        "network: Network::equations": 20,
        "network: Network::solve_holds": 13,
        "plant_side: PlantSide::act": 18,
        "stepper: Stepper::cross": 15,
        "stepper: Stepper::cross_grid": 18,
        "stepper: Stepper::step": 16,
        "stepper: Stepper::switch_to": 16,
    },
    "a function of the standard FMI, which gives it its parameters": {
        "fmi3: fmi3DoStep": 1,
        "fmi3: fmi3InstantiateCoSimulation": 6,
        "fmi3: fmi3InstantiateScheduledExecution": 1,
    },
    "a function of Python, whose keywords are its parameters and whose threads are in it": {
        "bench: BenchCase::sweep": 14,
        "core: run_many": 19,
        "link: run_linked": 3,
    },
}
LISTED = {name: most for rows in EXCEPTIONS.values() for name, most in rows.items()}
pytestmark = pytest.mark.quick


def name_of(path, function):
    """ "file without ending: function", without the namespaces of the project."""
    parts = function.name.split("::")
    while len(parts) > 1 and parts[0].islower():
        parts = parts[1:]
    return f"{Path(path).stem}: {'::'.join(parts)}"


def functions(path):
    """[(name, complexity, number of parameters)] of the functions above a limit."""
    return [
        (name_of(path, found), found.cyclomatic_complexity, found.parameter_count)
        for found in lizard.analyze_file(str(path)).function_list
        if found.cyclomatic_complexity > COMPLEXITY_MAX or found.parameter_count > PARAMETERS_MAX
    ]


def complaints(above, listed):
    """What is against the limits and the list of exceptions, a line each."""
    lines = []
    for name, complexity, parameters in above:
        if name not in listed:
            lines.append(f"{name}: complexity {complexity}, {parameters} parameters")
        elif complexity > listed[name]:
            lines.append(f"{name}: complexity {complexity}, listed with {listed[name]}")
    names = {name for name, _, _ in above}
    return lines + [
        f"{name}: within the limits, not to be listed" for name in listed.keys() - names
    ]


def test_functions_of_c_and_cpp_keep_the_limits_but_for_those_listed():
    done = subprocess.run(
        ["git", "ls-files", "--", "firmware", "sim", "host"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    paths = [
        ROOT / file
        for file in done.stdout.splitlines()
        if file.endswith((".c", ".h", ".cpp", ".hpp")) and "/generated/" not in file
    ]
    assert len(paths) > 200
    above = [one for path in paths if path.exists() for one in functions(path)]
    assert complaints(above, LISTED) == []


def test_python_has_the_same_limits():
    rules = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["ruff"]["lint"]
    assert {"C901", "PLR0913"} <= set(rules["select"])
    assert rules["mccabe"]["max-complexity"] == COMPLEXITY_MAX
    assert rules["pylint"]["max-args"] == PARAMETERS_MAX


def test_python_files_that_are_listed_need_it():
    rules = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["ruff"]["lint"]
    listed = {
        (file, rule)
        for file, ignored in rules["per-file-ignores"].items()
        for rule in ignored
        if rule in ("C901", "PLR0913") and "*" not in file
    }
    done = subprocess.run(
        [
            Path(sys.executable).parent / "ruff", "check", "--isolated", "--select=C901,PLR0913",
            f"--config=lint.mccabe.max-complexity={COMPLEXITY_MAX}",
            f"--config=lint.pylint.max-args={PARAMETERS_MAX}", "--output-format=json",
            *{file for file, _ in listed},
        ],
        cwd=ROOT, capture_output=True, text=True,
    )  # fmt: skip
    found = {
        (str(Path(one["filename"]).relative_to(ROOT)), one["code"])
        for one in json.loads(done.stdout)
    }
    assert listed - found == set()


def source(branches, parameters):
    names = ", ".join(f"int a{i}" for i in range(parameters))
    return f"namespace x {{\nint f({names}) {{\n{'if (a0) a0++;' * branches}\nreturn a0;\n}}\n}}\n"


@pytest.mark.parametrize(
    ("branches", "parameters", "says"),
    [
        (11, 7, []),
        (12, 1, ["new: f: complexity 13, 1 parameters"]),
        (0, 8, ["new: f: complexity 1, 8 parameters"]),
    ],
)
def test_a_function_above_a_limit_is_found(tmp_path, branches, parameters, says):
    (tmp_path / "new.cpp").write_text(source(branches, parameters))
    assert complaints(functions(tmp_path / "new.cpp"), {}) == says


def test_the_list_of_exceptions_can_only_become_shorter(tmp_path):
    (tmp_path / "new.cpp").write_text(source(14, 1))
    above = functions(tmp_path / "new.cpp")
    assert complaints(above, {"new: f": 15}) == []
    assert complaints(above, {"new: f": 14}) == ["new: f: complexity 15, listed with 14"]
    (line,) = complaints([], {"new: f": 14})
    assert line == "new: f: within the limits, not to be listed"
