"""docs/guide/python.md has every public name, and examples of Python in the guide pass mypy.

That the page is fresh is tested by tests/python/experiments/test_formats.py, and that its examples
print what it shows by tests/system/e2e/test_guide.py.
"""

import subprocess
import sys
from pathlib import Path

import forceaxis
import guide
import pytest
from forceaxis import gateway, linear

ROOT = Path(__file__).resolve().parents[3]
PAGE = guide.PAGES / "python.md"
pytestmark = pytest.mark.beside  # mypy takes ten seconds of processor where nothing is cached


@pytest.mark.parametrize("module", [forceaxis, linear, gateway], ids=lambda m: m.__name__)
def test_the_page_names_all_public_names(module):
    text = PAGE.read_text()
    spellings = (
        "`{}`",
        "- `{}(",
        "### {}\n",
        "`linear.{}`",
        "`forceaxis.{}`",
        "`forceaxis.gateway.{}`",
    )
    missing = [
        name
        for name in module.__all__
        if not any(spelling.format(name) in text for spelling in spellings)
    ]
    assert missing == []


def examples():
    """{file name: text} of the Python in the guide."""
    return {
        f"{page.stem}_{number}.py": block.text
        for page in [ROOT / "README.md", *guide.pages()]
        for number, block in enumerate(guide.blocks(page))
        if block.kind == "python"
    }


def test_the_examples_have_no_type_error_and_a_wrong_one_is_found(tmp_path):
    texts = examples()
    assert len(texts) >= 8
    wrong = "from forceaxis import Experiment\nExperiment.load('contact').run().verdikt\n"
    for name, text in (texts | {"wrong.py": wrong}).items():
        (tmp_path / name).write_text(text)
    files = [*sorted(tmp_path.glob("*.py")), *sorted((ROOT / "examples").glob("*.py"))]
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--config-file", ROOT / "pyproject.toml", *files],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    errors = [line for line in done.stdout.splitlines() if ": error:" in line]
    assert len(errors) == 1 and "wrong.py:2" in errors[0] and "verdikt" in errors[0], done.stdout
