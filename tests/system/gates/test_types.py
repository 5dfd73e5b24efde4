"""The package's type hints agree with its code, and the public modules have all of them."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest
from forceaxis import _core

ROOT = Path(__file__).resolve().parents[3]
pytestmark = pytest.mark.beside  # ten seconds of processor where nothing is cached


def mypy(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "mypy", *arguments], cwd=ROOT, capture_output=True, text=True
    )


def test_the_package_has_no_type_error():
    done = mypy()
    assert done.returncode == 0, done.stdout + done.stderr


# A use of a field of each result, in which the name of the field has a wrong end.
MISTYPED = (
    "run.metrics.peak_force", "run.criterion.window", "run.missed[0].limits", "run.energy.initial",
    "run.refused[0].object_name", "run.cycle.figures[0].val", 'run.converters["adc0"]["unity"]',
    '_core.run_many([])[0]["verdikt"]', '_core.inputs("contact")["criteria"]',
    '_core.facts("contact")["drive"]["kind"]', '_core.linear("contact", [], [])["E"]',
    '_core.replay("j")[1].entry', '_core.run_linked("c", [], "can", 1)[1].overrun',
    '_core.cycle_program("c").phases[0].ends[0].values', '_core.cycle_program("c").elements[0].low',
    "_core.objects()[0].minimum", "_core.objects()[0].bits[0].name", "_core.coils()[0].text",
    '_core.fmu_variables("unit")[0].units', '_core.fmu_writes("c")["words"]',
    '_core.certificate(1, 12, 2)["hash"]', '_core.model_format()[0]["keys"][0]["ranges"]',
    '_core.DriveMaster({}).feedback()["states"]', 'bench.run(7, 100)["forces"]',
    'bench.sweep((1, 2), (3, 4), 2, 1)["ends"]',
)  # fmt: skip


def test_a_mistyped_field_of_a_result_is_found(tmp_path):
    script = tmp_path / "script.py"
    head = (
        "from pathlib import Path\nfrom forceaxis import _core\nrun = _core.run('c')\n"
        "bench = _core.BenchCase(Path('c'), 'f', 'r', 'w')\nassert run.criterion and run.cycle\n"
    )
    right = ["run.metrics.peak_force_N", '_core.cycle_program("c").elements[0].least']
    script.write_text(head + "\n".join([*right, *MISTYPED]) + "\n")
    done = mypy("--config-file", str(ROOT / "pyproject.toml"), str(script))
    found = {int(line.split(":")[1]) for line in done.stdout.splitlines() if ": error:" in line}
    first = 1 + head.count("\n") + len(right)
    assert found == set(range(first, first + len(MISTYPED))), done.stdout


def test_the_types_of_results_are_those_of_the_compiled_module():
    tool = ROOT / "tools/gen_results.py"
    done = subprocess.run([sys.executable, tool, "--check"], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, ""), done.stdout + done.stderr


def test_scripts_see_the_types(tmp_path):
    """What a wrong script of a user is told, and that nothing else is."""
    script = tmp_path / "script.py"
    script.write_text(
        "from forceaxis import Axis, Experiment, beam, loops\n"
        'result = Experiment.load("contact").run(force_gain=7)\n'
        "held: float | None = result.held_force_N\n"
        'with Axis.sim("contact") as axis:\n'
        '    axis.get("force", 3)\n'
        'beam.Beam("stiff", 1.0, 1.0)\n'
        "result.verdikt\n"
        "loops.force_loop(3)\n"
        "from forceaxis import _core\n"
        "_core.invented(3)\n"
        '_core.facts("contact.toml")["invented"]\n'
    )
    done = mypy("--config-file", str(ROOT / "pyproject.toml"), str(script))
    lines = {int(line.split(":")[1]) for line in done.stdout.splitlines() if ": error:" in line}
    assert lines == {5, 6, 7, 8, 10, 11}, done.stdout


def test_the_compiled_module_is_typed_to_its_end():
    stub = ast.parse((ROOT / "host/python/forceaxis/_core.pyi").read_text())
    declared = {node.name for node in stub.body if isinstance(node, ast.FunctionDef)}
    types = {node.name: node for node in stub.body if isinstance(node, ast.ClassDef)}
    declared |= {name for name, node in types.items() if "TypedDict" not in ast.unparse(node)}
    declared |= {ast.unparse(n.target) for n in stub.body if isinstance(n, ast.AnnAssign)}
    assert declared == {name for name in dir(_core) if not name.startswith("__")}
    for name in declared & set(types):
        members = {getattr(n, "name", "") or ast.unparse(n.target) for n in types[name].body
                   if isinstance(n, ast.FunctionDef | ast.AnnAssign)}  # fmt: skip
        made = {m for m in vars(getattr(_core, name)) if not m.startswith("_")}
        assert {m for m in members if not m.startswith("__")} == made, name


def test_a_public_function_without_types_is_found(tmp_path):
    """The gate can fail."""
    source = tmp_path / "untyped.py"
    source.write_text("def f(x):\n    return x\n")
    done = mypy("--config-file=", "--disallow-untyped-defs", str(source))
    assert done.returncode == 1 and "missing a type annotation" in done.stdout
