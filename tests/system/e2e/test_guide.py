"""The guide, typed as it stands: its commands run and print what its pages show."""

import csv
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import click
import guide
import pytest
from forceaxis.cli import main
from forceaxis.experiments import run as runs

TEN_MINUTES = guide.PAGES / "ten_minutes.md"
# What no test machine has; a block that needs it is read by people only.
NEEDED = {
    *("board", "CAN interface", "an IIO device", "gateway", "cluster", "minutes", "terminal"),
    *("release", "sources"),
}


COMPUTES = {"real_machine"}  # for 20 s


# Long pages are executed by test_release.py only, from the wheel.
SHORT = [
    pytest.param(p, id=p.stem, marks=[pytest.mark.beside] if p.stem in COMPUTES else [])
    for p in guide.pages()
    if guide.session(p) == "short" and p != TEN_MINUTES
]


def says(claims):
    for block, printed in claims:
        assert guide.missing(block, printed) is None, (guide.missing(block, printed), printed)


@pytest.mark.parametrize("page", SHORT)
def test_the_commands_of_a_page_print_what_it_shows(page, tmp_path):
    says(guide.play(page, tmp_path))


def test_every_command_of_the_guide_is_run_or_says_what_it_needs():
    for page in guide.pages():
        found = guide.blocks(page)
        assert len(found) * 2 == page.read_text().count("```"), page.name
        assert {b.kind for b in found} <= {"bash", "python", "text", "toml", "yaml"}, page.name
        assert {b.needs for b in found if b.needs} <= NEEDED, page.name
        runs_here = any(b.kind in guide.TYPED and not b.needs for b in found)
        kind = guide.session(page)
        assert kind in ({"short", "long", "vcan"} if runs_here else {None}), page.name
        if kind in ("short", "long"):
            assert any(b.kind == "text" for b in found), f"{page.name} shows no output"


def test_a_page_that_shows_another_line_fails():
    block = guide.Block("text", "verdict      stable\nfault        none\n", None, None)
    assert guide.missing(block, "verdict      stable\nheld\nfault        none \n") is None
    assert guide.missing(block, "fault        none\nverdict      stable\n") == "fault        none"
    assert guide.missing(block, "verdict      unstable\n") == "verdict      stable"


def test_the_time_of_a_step_is_not_compared_and_all_else_of_its_line_is():
    block = guide.Block("text", "9/9 store: stored\n", None, None)
    assert guide.missing(block, "9/9 store: stored (0.1 s)\n") is None
    assert guide.missing(block, "9/9 store: stored (0.1 N)\n") == "9/9 store: stored"
    assert guide.missing(block, "9/9 store: (0.1 s) stored\n") == "9/9 store: stored"


def test_a_searched_number_may_differ_by_what_its_page_says_and_a_word_may_not(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "<!-- within: 5 % or 0.1 -->\n```text\ndesign  20.0 Hz, Ms 1.7  k_w = 280,000, m_w\n```\n"
        "<!-- within: 5 % -->\n```text\nerror 0.01 N\n```\n"
        "```text\nerror 0.01 N\n```\n"
    )
    found, relative, exact = guide.blocks(page)
    for line in (
        "design 20.9 Hz, Ms 1.79 k_w = 268,000, m_w",
        "P\ndesign  19.1 Hz, Ms 1.7   k_w = 293000, m_w",
    ):
        assert guide.missing(found, line) is None
    for line in (
        "design 21.1 Hz, Ms 1.7  k_w = 280,000, m_w",
        "design 20.0 Hz, Ms -1.7  k_w = 280,000, m_w",
        "design 20.0 Hz, Ms 1.7  k_w = 280,999,000, m_w",
        "design 20.0 Hz, Ms 1.7  k_w = 280,000, k_w",
        "design 20.0 Hz, Ms 1.7  k_w = 280,000",
        "design 20.0 Hz, Ms     k_w = 280,000, m_w",
    ):
        assert guide.missing(found, line) == found.text.rstrip()
    assert guide.missing(relative, "error 0.0104 N") is None
    assert guide.missing(relative, "error 0.0106 N") == "error 0.01 N"
    assert guide.missing(exact, "error 0.0100001 N") == "error 0.01 N"
    # A hash is a word, whatever it begins with.
    assert not guide.Block("text", "", None, None, 0.05).says("hash 12ab", "hash 13ab")


@pytest.fixture(scope="module")
def ten_minutes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ten_minutes")
    return folder, guide.play(TEN_MINUTES, folder)


def test_ten_minutes_print_what_the_page_shows(ten_minutes):
    says(ten_minutes[1])
    commands = "".join(b.text for b in guide.blocks(TEN_MINUTES) if b.kind == "bash")
    for verb in ("new", "run", "sweep", "test", "report"):
        assert f"forceaxis {verb} " in commands


def test_the_files_are_where_the_page_says(ten_minutes):
    folder = ten_minutes[0]
    for name in re.findall(r"`(press/[^`]+\.\w+)`", TEN_MINUTES.read_text()):
        assert (folder / name).stat().st_size > 0
    with (folder / "press/map/results.csv").open() as file:
        assert len(list(csv.DictReader(file))) == 16 * 12


def test_the_boundary_and_the_gain_of_the_file_are_as_the_page_says(ten_minutes):
    text = TEN_MINUTES.read_text()
    boundary = float(re.search(r"at a gain of ([\d.]+\d)", text)[1])
    said = float(re.search(r"the gain of the file, ([\d.]+\d), keeps the rule", text)[1])
    contact = ten_minutes[0] / "press/contact.toml"
    safe = tomllib.loads(contact.read_text())["firmware"]["force_gain"]
    assert safe == pytest.approx(said, abs=5e-4) and 2 * safe < boundary < 2.2 * safe
    # One gain, and the one of the set beside it, wherever the page or the report has a gain of P.
    gains = {float(gain) for gain in re.findall(r"gain (?:of P |of the file, )?(\d+\.\d+)", text)}
    assert gains <= {said, 3.25, 43.75, boundary}
    report = (ten_minutes[0] / "press/report/index.html").read_text()
    assert "P gain for the set <b>3.25</b>" in report

    def verdict(gain):
        return runs.run(contact, [f"firmware.force_gain={gain}"]).summary["verdict"]

    assert [verdict(boundary), verdict(boundary + 0.1)] == ["stable", "unstable"]
    # Between safe gain and boundary nothing is unstable.
    step = (boundary - safe) / 6
    assert {verdict(safe + k * step) for k in range(7)} == {"stable"}


@pytest.fixture(scope="module")
def site():
    done = subprocess.run([guide.ROOT / "tools/guide"], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    return guide.ROOT / "build/guide"


def test_every_page_is_built_and_loads_nothing_from_elsewhere(site):
    sources = [p.relative_to(guide.ROOT / "docs") for p in (guide.ROOT / "docs").rglob("*.md")]
    assert len(sources) > 15
    for source in sources:
        page = (site / source.with_suffix(".html")).read_text()
        loaded = re.findall(r"<(?:script|img|iframe)[^>]*\bsrc=\"([^\"]+)\"", page)
        loaded += re.findall(
            r"<link[^>]*rel=\"(?:stylesheet|icon|preload)\"[^>]*href=\"([^\"]+)\"", page
        )
        assert len(loaded) > 4 and not [name for name in loaded if "//" in name], source
        for name in loaded:
            assert (site / source.parent / name.partition("?")[0]).is_file(), (source, name)


def test_a_broken_link_or_anchor_ends_the_build(tmp_path):
    for name in ("docs", "firmware/port", "examples"):
        shutil.copytree(guide.ROOT / name, tmp_path / name)
    shutil.copy(guide.ROOT / "mkdocs.yml", tmp_path)
    with (tmp_path / "docs/index.md").open("a") as page:
        page.write("\n[gone](guide/gone.md) [elsewhere](guide/ci.md#gone)\n")
    done = subprocess.run(
        [Path(sys.executable).parent / "mkdocs", "build", "--strict"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert done.returncode != 0
    assert "gone.md" in done.stderr and "#gone" in done.stderr


def test_the_readme_says_of_its_picture_what_the_executed_page_prints():
    text = " ".join((guide.ROOT / "README.md").read_text().split())
    said = re.search(
        r"gain (\d+) and set-point (\d+) N\. It enters a limit cycle with peaks of (\d+) N, far "
        r"below the critical gain of ([\d.]+) of linear theory\. Up to a gain of ([\d.]+) it "
        r"settles; `forceaxis new` writes ([\d.]+), with a factor of two to spare",
        text,
    )
    gain, setpoint, peak, critical, settles, spare = map(float, said.groups())
    page = (guide.ROOT / "docs/guide/ten_minutes.md").read_text()
    unstable = page.index(f"force_gain={gain:g} --out press/bounces")
    assert float(re.search(r"peak ([\d.]+) N", page[unstable:]).group(1)) == pytest.approx(
        peak, abs=1
    )
    assert f"of {setpoint:g} N set-point" in page and f"the linear loop to {critical:g}" in page
    stable, bounces = map(float, re.search(r"stable at ([\d.]+), unstable at (\S+)", page).groups())
    assert stable <= settles + 0.05 and bounces > settles and 2 * spare <= settles < gain < critical
    kept = page.index(f"force gain   {spare:.4g};")
    assert re.search(r"verdict +(\w+)", page[kept:]).group(1) == "stable"


def test_the_readme_is_one_screen_whose_links_and_verbs_are_there():
    text = (guide.ROOT / "README.md").read_text()
    assert text.count("\n") < 90
    links = re.findall(r"\]\(([^)#]+)\)", text)
    assert len(links) > 15
    for link in links:
        assert (guide.ROOT / link).is_file(), link
    context = click.Context(main.cli)
    verbs = set(re.findall(r"^    forceaxis (\w+)", text, re.MULTILINE))
    assert len(verbs) > 5
    for verb in verbs:
        assert main.cli.get_command(context, verb), verb
