"""The Python package's plan: wings in one order, imports down it and in no circle."""

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
PACKAGE = ROOT / "host/python/forceaxis"
# From the ground up; what stands in one line may not import each other's wing.
ORDER = (
    ("_core", "_results", "paths", "words", "progress", "signals"),
    ("objects", "toml", "results", "errors"),
    ("files",),
    ("drawing",),
    ("bus", "chip", "linear"),
    ("recordings",),
    ("experiments", "identify", "axis", "versions"),
    ("cycles", "design", "fmu", "thesis"),
    ("bench", "commission"),
    ("pages",),
    ("cli",),
    ("forceaxis", "gateway", "__main__"),  # the names that scripts import, and the programs
)
LEVEL = {wing: level for level, wings in enumerate(ORDER) for wing in wings}


def modules(package):
    """{dotted name: path} of every module; a folder's name is its __init__.py."""
    found = {}
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(package).with_suffix("").parts
        parts = parts[:-1] if parts[-1] == "__init__" else parts
        found[".".join(("forceaxis", *parts))] = path
    return found


def imported(module, path, known):
    """Names of `known`, or forceaxis._core, that a module imports anywhere, in functions too."""
    folder = module if path.name == "__init__.py" else module.rpartition(".")[0]

    def nearest(name):
        while name not in known and "." in name:
            if name == "forceaxis._core":
                return name
            name = name.rpartition(".")[0]
        return name

    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = folder.split(".")[: 1 - node.level or None] if node.level else []
            origin = ".".join([*above, *filter(None, [node.module])])
            names = [f"{origin}.{alias.name}" for alias in node.names]
        else:
            continue
        yield from (nearest(n) for n in names if n.split(".")[0] == "forceaxis")


def graph(package):
    known = modules(package)
    return {name: set(imported(name, path, known)) - {name} for name, path in known.items()}


def wing(name):
    return (*name.split("."), "forceaxis")[1]


def circles(imports):
    """Sets of modules that reach each other, by Tarjan's algorithm."""
    index, low, stack, found = {}, {}, [], []

    def visit(name):
        index[name] = low[name] = len(index)
        stack.append(name)
        for other in imports.get(name, ()):
            if other not in index:
                visit(other)
                low[name] = min(low[name], low[other])
            elif other in stack:
                low[name] = min(low[name], index[other])
        if low[name] == index[name]:
            at = stack.index(name)
            if len(stack) - at > 1:
                found.append(sorted(stack[at:]))
            del stack[at:]

    for name in imports:
        if name not in index:
            visit(name)
    return found


def complaints(package):
    """Everything that is against the plan, a line each."""
    imports = graph(package)
    lines = [f"circle: {' '.join(circle)}" for circle in circles(imports)]
    for name, others in sorted(imports.items()):
        if wing(name) not in LEVEL:
            lines.append(f"{name}: expected a wing of ORDER")
            continue
        for other in sorted(others):
            low, high = LEVEL.get(wing(other)), LEVEL[wing(name)]
            if wing(other) != wing(name) and (low is None or low >= high):
                lines.append(f"arrow up: {name} imports {other}")
    folders = {p.parent for p in modules(package).values()} - {package}
    for folder in sorted(folders):
        if ast.get_docstring(ast.parse((folder / "__init__.py").read_text())) is None:
            lines.append(f"{folder.name}: expected a docstring that says what it is")
    return lines


def test_the_package_is_as_planned():
    assert complaints(PACKAGE) == []


def test_the_graph_sees_the_package():
    imports = graph(PACKAGE)
    assert "forceaxis.linear.system" in imports["forceaxis.linear"]
    assert "forceaxis.identify.plots" in imports["forceaxis.identify.fit"]  # in a function
    assert "forceaxis._core" in imports["forceaxis.linear.system"]
    assert len(imports) > 60


PLANTED = {
    "circle": (
        {
            "linear/a.py": "from forceaxis.linear import b\n",
            "linear/b.py": "import forceaxis.linear.a\n",
        },
        "circle: forceaxis.linear.a forceaxis.linear.b",
    ),
    "lazy circle": (
        {
            "linear/a.py": "from forceaxis.linear.b import f\n",
            "linear/b.py": "def f():\n    from forceaxis.linear import a\n",
        },
        "circle: forceaxis.linear.a forceaxis.linear.b",
    ),
    "arrow up": (
        {"linear/a.py": "def f():\n    from forceaxis.cli import main\n", "cli/main.py": ""},
        "arrow up: forceaxis.linear.a imports forceaxis.cli.main",
    ),
    "arrow aside": (
        {"bus/a.py": "from forceaxis.linear import a\n", "linear/a.py": ""},
        "arrow up: forceaxis.bus.a imports forceaxis.linear.a",
    ),
    "public name": (
        {"linear/a.py": "from forceaxis import run\n"},
        "arrow up: forceaxis.linear.a imports forceaxis",
    ),
    "relative import": (
        {"bus/a.py": "from ..linear import a\n", "linear/a.py": ""},
        "arrow up: forceaxis.bus.a imports forceaxis.linear.a",
    ),
    "unknown wing": ({"attic.py": ""}, "forceaxis.attic: expected a wing of ORDER"),
    "a wing without a word": ({"bus/__init__.py": ""}, "bus: expected a docstring that says what"),
}


@pytest.mark.parametrize("name", PLANTED)
def test_what_is_planted_is_found(tmp_path, name):
    files, says = PLANTED[name]
    package = tmp_path / "forceaxis"
    wings = {f"{Path(f).parent}/__init__.py": '"""A wing."""\n' for f in files if "/" in f}
    for file, text in ({"__init__.py": ""} | wings | files).items():
        (package / file).parent.mkdir(parents=True, exist_ok=True)
        (package / file).write_text(text)
    (complaint,) = complaints(package)
    assert complaint.startswith(says)


def test_what_follows_the_plan_is_not_found(tmp_path):
    package = tmp_path / "forceaxis"
    for file, text in {
        "__init__.py": "from forceaxis._core import run\n",
        "cli/__init__.py": '"""Verbs."""\n',
        "cli/main.py": "def f():\n    from forceaxis.linear import a\n",
        "linear/__init__.py": '"""Loops."""\n\nfrom forceaxis.linear.a import b\n',
        "linear/a.py": "from forceaxis import _core\n",
    }.items():
        (package / file).parent.mkdir(parents=True, exist_ok=True)
        (package / file).write_text(text)
    assert complaints(package) == []


def absent(text):
    """Names of the package that a program imports and that are not there."""
    for node in ast.walk(ast.parse(text)):
        if not isinstance(node, ast.ImportFrom) or (node.module or "").split(".")[0] != "forceaxis":
            continue
        for alias in node.names:
            try:
                if not hasattr(importlib.import_module(node.module), alias.name):
                    importlib.import_module(f"{node.module}.{alias.name}")
            except ImportError:
                yield f"{node.module}.{alias.name}"


def test_what_programs_import_is_there():
    """Some of them run only in a guest or at an axis."""
    programs = [
        p for folder in ("tests", "tools", "examples") for p in ROOT.glob(f"{folder}/**/*.py")
    ]
    found = {str(p): list(absent(p.read_text(encoding="utf-8"))) for p in programs}
    assert len(found) > 100 and not {p: names for p, names in found.items() if names}


def test_an_import_of_what_has_moved_is_found():
    moved = "def f():\n    from forceaxis.bus.gateway import Session\n"
    assert list(absent(moved + "from forceaxis.gateway import Session, Sessions\n")) == [
        "forceaxis.gateway.Sessions", "forceaxis.bus.gateway.Session",
    ]  # fmt: skip


def python(script):
    return subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)


def test_public_names():
    done = python(
        "import forceaxis\n"
        "from forceaxis import beam, gateway, linear, loops, modes, resonance\n"
        "from forceaxis.gateway import Session, trigger_on\n"
        "assert gateway.Session is Session and callable(forceaxis.run)\n"
        "plant = linear.linearise('fig4_19')\n"
        "assert isinstance(plant, linear.System) and linear.find_model('fig4_19').exists()\n"
        "assert forceaxis.loops is loops and loops.force_loop('fig4_19').limit().gain > 0\n"
        "assert modes.modes('fig4_19').modes and beam.Beam(1.0, 1.0, 1.0).poles(1).size\n"
        "assert resonance.fit and not hasattr(forceaxis, 'nothing')\n"
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("arguments", [["--help"], ["objects", "force_gain"], ["run", "--help"]])
def test_what_is_not_used_is_not_loaded(arguments):
    done = python(
        "import sys\n"
        "from forceaxis.cli import main\n"
        f"main.cli({arguments!r}, standalone_mode=False)\n"
        "print('loaded', *{'scipy', 'matplotlib', 'textual', 'control'} & set(sys.modules))\n"
    )
    assert done.stdout.endswith("loaded\n"), done.stdout[-200:] + done.stderr
