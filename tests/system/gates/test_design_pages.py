"""Design pages, decisions and CONTRIBUTING.md keep their form, and what they name exists."""

import re
import shutil
import subprocess
import sys
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


def gen_pictures(*arguments):
    command = [sys.executable, ROOT / "tools/gen_pictures.py", *arguments]
    return subprocess.run(command, capture_output=True, text=True)


def test_pictures_of_the_checkout_are_fresh_and_a_stale_one_is_named(tmp_path):
    done = gen_pictures("--check")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    copy = tmp_path / "docs/design"
    copy.mkdir(parents=True)
    for name in ("tick.dot", "tick.svg", "live.dot"):
        shutil.copy(DESIGN / name, copy)
    # Another version of Graphviz places and names things differently.
    moved = re.sub(r' (?:x|y|points|d|id)="[^"]*"', "", (copy / "tick.svg").read_text())
    (copy / "tick.svg").write_text("<!-- another version -->" + moved.partition("?>")[2])
    done = gen_pictures("--check", "--root", tmp_path)
    assert done.returncode == 1
    assert done.stdout.splitlines() == [
        "gen_pictures: docs/design/live.svg is stale: run tools/gen_pictures.py"
    ]
    source = (copy / "tick.dot").read_text()
    for change in (("fw_prepare", "fw_begin"), ("report -> bus", "report -> irq"), ("  wakes", "")):
        assert change[0] in source
        (copy / "tick.dot").write_text(source.replace(*change))
        done = gen_pictures("--check", "--root", tmp_path)
        assert done.stdout.count("tick.svg is stale") == 1, change


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
