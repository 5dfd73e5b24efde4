#!/usr/bin/env python3
"""Writes docs/guide/proofs.md from tests/promises.toml, and checks that tests hold each promise.

    tools/promises.py                  writes the page
    tools/promises.py --check          status 1 and one line for each fault: a page that is not
                                       fresh, a promise without a test, an unknown test
    tools/promises.py --results FILE.xml...
                                       the same, and each test of a promise that did not run, was
                                       skipped or failed according to these JUnit files

`tools/test --all` ends with the last of them, on the files of its own run (tools/run_tests.py).
"""

import ast
import re
import sys
import textwrap
import tomllib
from pathlib import Path

import junit

ROOT = Path(__file__).resolve().parents[1]
TABLE = ROOT / "tests/promises.toml"
PAGE = ROOT / "docs/guide/proofs.md"
GENERATED = "<!-- Written by tools/promises.py from tests/promises.toml. -->\n"
HEAD = """\
# What the tests prove

`tools/test --all` runs all tests that are named here, and fails if one of them fails, is skipped or
does not exist. Names with a dot are of GoogleTest.
"""
GTEST = re.compile(r"^\s*TEST(?:_F|_P)?\(\s*(\w+),\s*(\w+)\)", re.M)


def python_tests(path):
    """Names of the tests of a Python file."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
            yield node.name


def known(root=ROOT):
    """{id: file} of all tests in the tree: ids as junit.test_id has them."""
    tests = root / "tests"
    files = {}
    for path in sorted(tests.rglob("test_*.py")):
        where = str(path.relative_to(root))
        files |= {f"{where}::{name}": where for name in python_tests(path)}
    for path in sorted(tests.rglob("*.cpp")):
        where = str(path.relative_to(root))
        text = path.read_text(encoding="utf-8")
        files |= {f"ctest:{suite}.{name}": where for suite, name in GTEST.findall(text)}
    for path in sorted(tests.rglob("CMakeLists.txt")):
        where = str(path.relative_to(root))
        for name in re.findall(r"add_test\(NAME (\w+) ", path.read_text(encoding="utf-8")):
            files[f"ctest:{name}"] = where
    for path in sorted((tests / "firmware/fuzz").glob("*_fuzz.c*")):
        where = str(path.relative_to(root))
        files[f"ctest:fuzz_corpus_{path.stem.removesuffix('_fuzz')}"] = where
        files[f"fuzz:{path.stem}"] = where
    return files


def unknown(rows, tests):
    """The ids of the rows {name: {"tests": [id, ...]}} that no test has, a line each."""
    return [
        f"{name}: {test}: expected a test of the tree"
        for name, row in rows.items()
        for test in row.get("tests", [])
        if test not in tests
    ]


def load(table=TABLE):
    """{first words of a promise: its row of the table}."""
    rows = tomllib.loads(table.read_text(encoding="utf-8"))["promise"]
    return {" ".join(row["text"].split()[:8]): row for row in rows}


def faults(rows, tests):
    """What is wrong with the table itself, a line each."""
    empty = [
        f"{name}: expected at least one test" for name, row in rows.items() if not row["tests"]
    ]
    return empty + unknown(rows, tests)


def unproven(rows, files):
    """The tests of promises that did not run, were skipped or failed, a line each. `files`:
    (JUnit file, JUnit file of the second try or None) of each stage."""
    passed = {}
    for xml, second in files:
        found = {case: good for case, (_, good) in junit.outcomes(xml, case_key).items()}
        again = junit.outcomes(second, case_key) if second else {}
        found |= {case: good for case, (_, good) in again.items()}
        for (test, _), good in found.items():
            passed[test] = passed.get(test, True) and good
    return [
        f"{name}: {test}: " + ("failed or was skipped" if test in passed else "did not run")
        for name, row in rows.items()
        for test in row["tests"]
        if not passed.get(test, False)
    ]


def case_key(case):
    return junit.test_id(case), junit.label(case)


def tests_of(row, tests):
    """The tests of a promise as the page shows them: each file once, with its tests."""
    files = {}
    for test in row["tests"]:
        name = test.partition("::")[2].removeprefix("test_") or test.partition(":")[2]
        files.setdefault(tests[test].removeprefix("tests/"), []).append(name)
    return "; ".join(f"`{file}`: " + ", ".join(f"`{n}`" for n in ns) for file, ns in files.items())


def page(rows, tests):
    """The text of docs/guide/proofs.md."""
    lines, part = [GENERATED + HEAD], None
    for row in rows.values():
        if row["part"] != part:
            part = row["part"]
            lines.append(f"## {part}\n")
        text = textwrap.fill(f"* {' '.join(row['text'].split())}", 116, subsequent_indent="  ")
        lines.append(f"{text}<br>\n  <small>{tests_of(row, tests)}</small>\n")
    return "\n".join(lines)


def main(arguments):
    """Write the page, or say what is wrong. Returns the exit status."""
    rows, tests = load(), known()
    lines = faults(rows, tests)
    match arguments:
        case []:
            if not lines:
                PAGE.write_text(page(rows, tests), encoding="utf-8")
        case ["--check"]:
            if not lines and PAGE.read_text(encoding="utf-8") != page(rows, tests):
                lines.append("docs/guide/proofs.md: not fresh; run tools/promises.py")
        case ["--results", _, *_]:
            lines += unproven(rows, [(Path(file), None) for file in arguments[1:]])
        case _:
            print("promises: expected nothing, --check or --results FILE.xml...", file=sys.stderr)
            return 2
    for line in lines:
        print(f"promises: {line}", file=sys.stderr)
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
