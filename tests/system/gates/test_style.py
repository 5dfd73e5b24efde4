"""Formatters and linters agree with every tracked file."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
pytestmark = pytest.mark.quick


def tracked(*patterns):
    done = subprocess.run(
        ["git", "ls-files", "--", *patterns], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return [f for f in done.stdout.splitlines() if "/generated/" not in f and (ROOT / f).exists()]


def complaints(command):
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return (done.stdout + done.stderr) if done.returncode else ""


def test_c_and_cpp_are_formatted():
    files = tracked("*.c", "*.h", "*.cpp", "*.hpp")
    assert len(files) > 30
    assert shutil.which("clang-format")
    assert complaints(["clang-format", "--dry-run", "-Werror", *files]) == ""


def test_python_is_formatted_and_linted():
    ruff = Path(sys.executable).parent / "ruff"
    assert complaints([ruff, "format", "--check"]) == ""
    assert complaints([ruff, "check"]) == ""


@pytest.mark.beside  # ten seconds of processor
def test_cppcheck_finds_nothing_in_the_firmware():
    files = tracked("firmware/**/*.c")
    assert len(files) > 5
    assert (
        complaints(
            ["cppcheck", "--quiet", "--error-exitcode=1", "--std=c11", "--inline-suppr",
             "--enable=warning,performance,portability", "-I.", *files]
        )
        == ""
    )  # fmt: skip


def functions(header):
    """The functions that the text of a header of firmware/fx declares."""
    code = re.sub(r"/\*.*?\*/", "", header, flags=re.S)
    return set(re.findall(r"^(?:static inline )?\w+ \**(fx_\w+)\(", code, flags=re.M))


def uncalled(names, test):
    """Those of the names that the text of a test never calls."""
    code = re.sub(r"//.*", "", test)
    return sorted(name for name in names if not re.search(rf"\b{name}\(", code))


def test_every_function_of_fx_has_a_direct_test():
    names = {n for f in tracked("firmware/fx/*.h") for n in functions((ROOT / f).read_text())}
    tests = ["fx_test.cpp", "fx_rates_test.cpp", "fx_fraction_test.cpp", "bytes_test.cpp"]
    assert len(names) > 40
    assert (
        uncalled(names, "".join((ROOT / "tests/firmware/unit" / t).read_text() for t in tests))
        == []
    )


def test_a_function_of_fx_without_a_test_is_found():
    header = "static inline int32_t fx_new(int32_t x) {\n/* fx_old(x) */\nuint8_t *fx_far(void);\n"
    assert functions(header) == {"fx_new", "fx_far"}
    assert uncalled({"fx_new", "fx_far"}, "fx_far(); // fx_new(1)\nfx_newer(1);") == ["fx_new"]
