"""Formatters and linters agree with every tracked file."""

import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


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
