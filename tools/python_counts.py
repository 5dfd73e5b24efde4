#!/usr/bin/env python3
"""What of the Python package has types, and what passes between its parts without: counts.

tools/python_counts.py                  a row for each wing, and the sum
tools/python_counts.py --list subscripts linear   file:line of what a column counts, in a wing
"""

import argparse
import ast
import re
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import TypeGuard

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "host/python/forceaxis"
GENERATED = "bus/messages/"
COLUMNS = ("functions", "untyped", "subscripts", "loose", "options", "statements")
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]+")
TOOL_COMMAND = re.compile(r"tools/\w+ --[a-z-]+")


def wing(path: Path, package: Path = PACKAGE) -> str:
    """The folder of the package that a file is in; "forceaxis" for a file beside the folders."""
    parts = path.relative_to(package).parts
    return parts[0] if len(parts) > 1 else "forceaxis"


def sources(package: Path = PACKAGE) -> list[Path]:
    """Every module that a person wrote."""
    return [
        path
        for path in sorted(package.rglob("*.py"))
        if not path.relative_to(package).as_posix().startswith(GENERATED)
    ]


def fully_typed(function: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    """Whether each parameter but self and cls, and the result, has an annotation."""
    a = function.args
    parameters = [*a.posonlyargs, *a.args, *a.kwonlyargs, *filter(None, (a.vararg, a.kwarg))]
    if parameters and parameters[0].arg in ("self", "cls"):
        parameters = parameters[1:]
    has_result = function.returns is not None or (
        function.name == "__init__" and any(p.annotation for p in parameters)
    )
    return has_result and all(p.annotation for p in parameters)


def is_loose(annotation: ast.expr) -> bool:
    """Whether an annotation says nothing: Any, object, or a container without item types."""
    for node in ast.walk(annotation):
        if isinstance(node, ast.Name) and node.id in ("Any", "object"):
            return True
        if isinstance(node, ast.Attribute) and node.attr == "Any":
            return True
    bare = isinstance(annotation, ast.Name) and annotation.id in ("dict", "list", "tuple")
    return bare


def is_loose_alias(node: ast.stmt) -> bool:
    """Whether a statement names a type that says nothing, such as Table = dict[str, Any]."""
    return (
        isinstance(node, ast.Assign | ast.AnnAssign)
        and node.value is not None
        and any(isinstance(part, ast.Subscript) and is_loose(part) for part in ast.walk(node.value))
    )


def documentation(tree: ast.AST) -> set[int]:
    """Identities of the constants that are docstrings."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            first = node.body[0] if node.body else None
            if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
                found.add(id(first.value))
    return found


def executable(node: ast.stmt, docs: set[int]) -> bool:
    """Whether a statement does something: no docstring, no field or annotation without a value."""
    if isinstance(node, ast.Expr) and id(node.value) in docs:
        return False
    return not (isinstance(node, ast.AnnAssign) and node.value is None)


def names_option(text: str) -> bool:
    """Whether a text tells the reader an option of `forceaxis`. An argument of a program that is
    started, such as "--link", and a command of tools/ are no such text."""
    return not OPTION.fullmatch(text) and bool(OPTION.search(TOOL_COMMAND.sub("", text)))


def is_text(node: ast.expr) -> TypeGuard[ast.Constant]:
    """Whether an expression is a constant string."""
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def found(tree: ast.Module) -> Iterator[tuple[str, int]]:
    """(column, line) of everything that is counted in one module."""
    docs = documentation(tree)
    fields = {
        id(statement)
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
        for statement in node.body
        if isinstance(statement, ast.AnnAssign)
    }
    for node in tree.body:
        if is_loose_alias(node):
            yield "loose", node.lineno
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield "functions", node.lineno
            if not fully_typed(node):
                yield "untyped", node.lineno
            a = node.args
            every = [*a.posonlyargs, *a.args, *a.kwonlyargs, *filter(None, (a.vararg, a.kwarg))]
            annotations = [p.annotation for p in every if p.annotation and p.arg != "_"]  # ignored
            annotations += [node.returns] if node.returns else []
            if any(map(is_loose, annotations)):
                yield "loose", node.lineno
        elif isinstance(node, ast.AnnAssign) and is_loose(node.annotation):
            yield "loose", node.lineno
        elif isinstance(node, ast.Subscript) and is_text(node.slice):
            yield "subscripts", node.lineno
        elif is_text(node) and id(node) not in docs and names_option(node.value):
            yield "options", node.lineno
        if isinstance(node, ast.stmt) and id(node) not in fields and executable(node, docs):
            yield "statements", node.lineno


def class_names(package: Path = PACKAGE) -> dict[str, list[str]]:
    """Class names that more than one module defines, each with those modules."""
    places = defaultdict(list)
    for path in sources(package):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(path.relative_to(package).as_posix())
    return {name: files for name, files in sorted(places.items()) if len(files) > 1}


def count(package: Path = PACKAGE) -> dict[str, Counter[str]]:
    """Of each wing, how often each column was found. Annotations of a string slice, such as
    Literal["a"], count as subscripts too."""
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for path in sources(package):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        counts[wing(path, package)].update(column for column, _ in found(tree))
    return counts


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--list", nargs=2, metavar=("COLUMN", "WING"))
    given = parser.parse_args(arguments)
    if given.list:
        column, where = given.list
        for path in sources():
            if wing(path) == where:
                tree = ast.parse(path.read_text(encoding="utf-8"))
                lines = sorted(line for name, line in found(tree) if name == column)
                for line in lines:
                    print(f"{path.relative_to(ROOT)}:{line}")
        return 0
    counts = count()
    print(f"{'wing':12}" + "".join(f"{column:>12}" for column in COLUMNS))
    for name, row in sorted(counts.items()):
        print(f"{name:12}" + "".join(f"{row[column]:>12}" for column in COLUMNS))
    total = sum(counts.values(), Counter())
    print(f"{'sum':12}" + "".join(f"{total[column]:>12}" for column in COLUMNS))
    for name, files in class_names().items():
        print(f"class {name}: {' '.join(files)}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
