"""The thesis's report: one page that needs nothing else, with every experiment, figure and cell."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from forceaxis.thesis import claims as thesis
from forceaxis.thesis import figures as thesis_figures

ROOT = Path(__file__).resolve().parents[3]
FORCEAXIS = Path(sys.executable).parent / "forceaxis"


# Every experiment; test_report_folder.py has a few.
pytestmark = [pytest.mark.beside, pytest.mark.long]


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    out = tmp_path_factory.mktemp("report")
    done = subprocess.run(
        [FORCEAXIS, "report", "--out", out, "--json"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return json.loads(done.stdout), (out / "index.html").read_text(), list(out.iterdir())


def test_it_is_one_file_that_refers_to_nothing_outside(page):
    _, html, files = page
    assert [f.name for f in files] == ["index.html"]
    assert not re.findall(r'(?:src|href)="(?!data:|#)', html)
    assert not re.findall(r"url\((?!%23)", html)
    assert len(html) < 6e6


def test_every_experiment_and_figure_is_in_it(page):
    summary, html, _ = page
    names = {p.stem for p in (ROOT / "sim/experiments").glob("*.toml")} - {"tables"}
    assert summary["experiments"] == len(names)
    for name in names:
        assert f"forceaxis run sim/experiments/{name}.toml" in html
    for figure in ("2.41", "2.43", "3.13", "3.14", "4.27", "4.28", "5.1", "5.2", "5.3", "5.8"):
        assert re.search(rf"<h3[^>]*>Fig [0-9a-z., ]*{re.escape(figure)}\b", html), figure
    runs, _, frequency = html.partition('<h2 id="frequency">')
    # plateau, stability and contact maps; three of the runs once more, on top
    assert runs.count('src="data:image/') == len(names) + 3 + 3
    figures = [f.figure for f in thesis_figures.thesis_figures()]
    measured = [p.stem for p in (ROOT / "sim/measurements").glob("*.toml")]
    assert len(measured) == 7
    # and the designs, the advice
    assert frequency.count('src="data:image/') == len(figures) + len(measured) + 2
    for figure in figures:
        assert f'id="fig{figure}"' in frequency
    for name in measured:
        assert f"forceaxis measure {name}" in frequency


def test_every_designed_bank_has_more_bandwidth_than_p(page):
    _, html, _ = page
    table = html.partition('id="designs"')[2].partition("</table>")[0]
    rows = re.findall(r"<tr><td><code>(\w+)</code>.*?</tr>", table, re.DOTALL)
    assert {"fig4_19", "laboratory", "full_axis"} <= set(rows) and len(rows) == 8
    cells = [re.findall(r"<td>([^<]*)</td>", row) for row in table.split("<tr>")[2:]]
    for model, row in zip(rows, cells, strict=True):
        p, designed = float(row[3]), float(row[6])
        assert designed > 1.2 * p or model != "laboratory", (model, row)
        assert row[8] == "-" or float(row[8]) >= 2.3


def test_the_thesis_quotes_stand_beside_ours(page):
    _, html, _ = page
    table = html.partition('id="check_thesis"')[2].partition("</table>")[0]
    assert len(re.findall(r'<td class="(?:same|differs)"', table)) == len(thesis.CLAIMS)
    for quoted in ("12 Hz", "39.8 Hz", "33 Hz", "0.85 V/V", "46 Hz", "2000 Hz", "40 Hz", "120 Hz"):
        assert f"<td>{quoted}</td>" in table


def test_models_elements_and_contact_maps_are_in_it(page):
    _, html, _ = page
    linked = set(re.findall(r'<a[^>]* href="#(\w+)"', html))
    assert len(linked) >= 98 and linked <= set(re.findall(r'<h3 id="(\w+)">', html))
    models = ROOT / "sim/models"
    measured = {"fig3_7", "fig3_8", "fig3_10", "fig3_12"}  # by `forceaxis measure`, no experiment
    for path in [*models.glob("fig*.toml"), *models.glob("nl_*.toml")]:
        if path.stem in measured:
            continue
        assert f"<code>{path.name}</code>" in html
    assert "<td>66 of 66</td>" in html
    for words in ("Contact and friction", "widens the stable region", "one by one"):
        assert words in html


def test_every_cell_stands_beside_the_thesis(page):
    summary, html, _ = page
    tables = html.partition('<h2 id="frequency">')[0]
    cells = re.findall(r'<td class="(same|differs)"', tables)
    assert len(cells) == summary["total"] == 55
    assert cells.count("same") == summary["matched"]
    # A mark has its meaning as a text; where thesis and simulation differ there are two.
    for kind, verdict, mark, rest in re.findall(
        r'<td class="(same|differs)".*?aria-label="(\w+)".*?>(.)</b>(.*?)</td>', tables, re.DOTALL
    ):
        assert mark == {"stable": "✓", "unstable": "✗"}[verdict]
        assert ("aria-label" in rest) == (kind == "differs")


def test_the_page_begins_with_one_axis_what_went_wrong_and_what_mended_it(page):
    _, html, _ = page
    top = html.partition('<p class="score">')[0]
    verdicts = re.findall(r'<a href="#(\w+)">[^<]*</a></h3>\s*<p><b class="mark (\w+)"', top)
    assert verdicts == [
        ("contact_unstable", "unstable"), ("contact", "stable"), ("hold_biquad", "stable"),
    ]  # fmt: skip
    assert "contact lost" in top and "of 75 N, error" in top


def test_the_fit_is_accounted_for(page):
    _, html, _ = page
    for words in ("What was fitted", "Each figure left out", "plateau", "±20 %", "readings"):
        assert words in html
