"""The sentences of the thesis: each is checked by what exists, or has the reason why it is not."""

import sys
from collections import Counter
from pathlib import Path

import pytest
from forceaxis import InputError, paths, toml
from forceaxis.thesis import figures, sentences
from forceaxis.thesis.claims import CLAIMS

ROOT = Path(__file__).resolve().parents[3]
ALL = [(section, one) for section in sentences.sections() for one in section.sentences]


def test_every_chapter_has_its_sections_in_order():
    numbers = [section.number for section in sentences.sections()]
    parts = [[int(part) for part in number.split(".")] for number in numbers]
    assert parts == sorted(parts) and len(set(numbers)) == len(numbers)
    assert {section.chapter for section in sentences.sections()} == {2, 3, 4, 5, 6}
    # Sections whose models and measurements the thesis describes in numbers.
    wanted = (
        "2.2.2 2.3.4 2.4.2 2.4.3 2.4.4 2.5.1 2.5.2 2.5.3 2.6 2.7 2.7.1 3.1.2 3.1.3 "
        "3.2.1 3.2.3 3.3.1 3.3.2 4.1.2 4.2 4.3.1 4.3.3 4.3.4 4.3.5 4.3.6 4.3.7 4.4.1 "
        "4.4.2 4.4.3 4.4.6 5.1.1 5.1.2 5.1.3 5.2 5.2.1 6.1.2 6.1.4 6.2.1 "
    )
    assert set(wanted.split()) <= set(numbers)


def test_a_sentence_is_checked_or_says_why_not():
    for section, one in ALL:
        assert one.says.endswith("."), one.says
        assert one.checked == (not one.reason), (section.number, one.says)
    repeated = [says for says, count in Counter((s.number, o.says) for s, o in ALL).items()
                if count > 1]  # fmt: skip
    assert not repeated


def test_rows_of_check_thesis_and_sentences_name_each_other():
    rows = [claim.what for claim in CLAIMS]
    assert len(set(rows)) == len(rows)
    named = {row for _, one in ALL for row in one.rows}
    assert named - set(rows) == set()
    assert set(rows) - named == set()


def test_named_tests_exist(monkeypatch):
    monkeypatch.setattr(sys, "path", [str(ROOT / "tools"), *sys.path])
    import promises

    named = {test for _, one in ALL for test in one.tests}
    assert named - set(promises.known(ROOT)) == set()


def test_named_figures_are_drawn_by_the_report():
    drawn = {figure.figure for figure in figures.thesis_figures()}
    for path in paths.EXPERIMENTS.glob("*.toml"):
        drawn |= {number.strip() for number in toml.read(path).get("figure", "").split(",")}
    named = {figure for _, one in ALL for figure in one.figures}
    assert named - drawn == set()


def test_an_unknown_key_is_refused(monkeypatch, tmp_path):
    file = tmp_path / "sentences.toml"
    file.write_text('[[section]]\nnumber = "2"\nsentences = [{ says = "A.", row = ["b"] }]\n')
    monkeypatch.setattr(sentences, "FILE", file)
    with pytest.raises(InputError, match="row"):
        sentences.sections.__wrapped__()
