"""Design pages, decisions and CONTRIBUTING.md keep their form, and what they name exists."""

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
DESIGN = ROOT / "docs/design"
DECISIONS = ROOT / "docs/decisions"
PAGES = sorted(DESIGN.glob("*.md"))
SECTIONS = ["Context", "Decision", "Alternatives, and why not", "Consequences"]
MOST_NODES = 15
# Folders whose files a page may name.
TOP = "firmware|sim|host|tools|tests|docs"

pytestmark = pytest.mark.quick


def test_every_page_has_a_picture_and_every_picture_a_page():
    shown = [re.findall(r"!\[[^\]]+\]\((\w+)\.svg\)", p.read_text()) for p in PAGES]
    assert all(shown)
    assert len(shown[PAGES.index(DESIGN / "index.md")]) == 3
    assert sorted(name for names in shown for name in names) == sorted(
        p.stem for p in DESIGN.glob("*.dot")
    )


def test_pictures_render_and_have_few_nodes():
    pictures = sorted(DESIGN.glob("*.dot"))
    for picture in pictures:
        done = subprocess.run(["dot", "-Tplain", picture], capture_output=True, text=True)
        assert (done.returncode, done.stderr) == (0, ""), picture
        nodes = [line for line in done.stdout.splitlines() if line.startswith("node ")]
        assert 3 < len(nodes) <= MOST_NODES, picture


def test_decisions_are_numbered_short_and_listed():
    decisions = sorted(DECISIONS.glob("0*.md"))
    assert len(decisions) >= 40
    index = (DECISIONS / "index.md").read_text()
    for number, page in enumerate(decisions, 1):
        text = page.read_text()
        title, *rest = re.split(r"^#+ ", text, flags=re.M)[1:]
        assert page.name.startswith(f"{number:04d}-")
        assert title.startswith(f"{number}. ")
        assert [part.partition("\n")[0] for part in rest] == SECTIONS, page.name
        assert f"| {number} | [{title.strip().partition('. ')[2]}]({page.name}) |" in index
    assert index.count("| [") == len(decisions)


def named(text):
    """Paths of the tree in code marks, without those that hold a placeholder such as NAME."""
    found = re.findall(rf"`((?:{TOP})/[\w./-]+)`", text)
    return {name for name in found if not re.search(r"NAME|MODULE|NNNN|FOLDER", name)}


def test_files_that_the_pages_name_exist():
    for page in [*PAGES, *sorted(DECISIONS.glob("*.md")), ROOT / "CONTRIBUTING.md"]:
        for name in named(page.read_text()):
            path = ROOT / name
            assert path.exists() or list(path.parent.glob(path.name + ".*")), (page.name, name)


def test_a_file_that_does_not_exist_is_found():
    assert named("`sim/gone.hpp` and `tests/firmware/unit/cia402_NAME_test.cpp`") == {
        "sim/gone.hpp"
    }
    assert not (ROOT / "sim/gone.hpp").exists()
