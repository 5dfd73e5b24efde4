"""The texts that a user reads keep to the words of docs/glossary.md.

The third column of the glossary lists the words that its terms replace, as phrases that normal
English does not contain in that sense. None of them stands in README.md, in a page of docs or
docs/guide, or in a text of `--help`. Code, the output that a page shows and names of objects are
not prose.
"""

import re
from pathlib import Path

import click
import pytest
from forceaxis.cli import main

ROOT = Path(__file__).resolve().parents[3]
GLOSSARY = ROOT / "docs/glossary.md"
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")),
         *sorted((ROOT / "docs/guide").glob("*.md"))]  # fmt: skip
ROW = re.compile(r"^\| (?P<term>[^|]+) \| (?P<meaning>[^|]+) \|(?: (?P<not>[^|]+))? \|$")
pytestmark = pytest.mark.quick


def rows():
    """(term, meaning, the phrases that it replaces) of each row of the glossary."""
    table = [line for line in GLOSSARY.read_text().splitlines() if line.startswith("|")]
    for line in table[2:]:
        found = ROW.match(line)
        assert found, f"docs/glossary.md: not a row of three columns: {line}"
        phrases = [p.strip() for p in (found["not"] or "").split(",") if p.strip()]
        yield found["term"], found["meaning"], phrases


def replaced():
    """{phrase: the term to write instead}"""
    return {phrase: term for term, _, phrases in rows() for phrase in phrases}


def prose(text):
    """The prose of a Markdown page on one line: no code, no addresses of links, no comments."""
    text = re.sub(r"<!--.*?-->", "", text, flags=re.S)
    text = re.sub(r"^( *)```.*?^\1```$", "", text, flags=re.S | re.M)
    text = re.sub(r"(?<=\n\n)(?: {4}.*\n|\n)+", "", text)  # an indented block of code
    text = re.sub(r"<code>.*?</code>|`[^`]*`", "CODE", text)
    text = re.sub(r"\]\([^)]*\)", "]", text)
    return " ".join(text.split())


def without_third_column(text):
    return re.sub(r"^(\| [^|]+ \| [^|]+ \|).*$", r"\1", text, flags=re.M)


def commands(command, path):
    """(path, command) of a command and of all that it has."""
    yield path, command
    if isinstance(command, click.Group):
        context = click.Context(command)
        for name in command.list_commands(context):
            yield from commands(command.get_command(context, name), f"{path} {name}")


def helps():
    """(where, text) of each text that `--help` shows, without the examples."""
    for heading, rows in main.PAGE.items():
        yield "forceaxis", ". ".join((heading, *rows.values()))
    for path, command in commands(main.cli, "forceaxis"):
        yield path, f"{command.help or ''}\n\n{command.short_help or ''}"
        for parameter in command.params:
            if text := getattr(parameter, "help", None):
                yield f"{path} {parameter.opts[0]}", text


def found_in(where, text, phrases):
    """'where: "phrase", write "term"' for each phrase in the text."""
    text = " ".join(text.split())
    for phrase, term in phrases.items():
        end = r"\b" if phrase[-1].isalnum() else ""
        if re.search(rf"\b{re.escape(phrase)}{end}", text, re.IGNORECASE):
            yield f'{where}: "{phrase}", write "{term}"'


def test_the_rows_of_the_glossary_are_complete_and_in_order():
    found = list(rows())
    assert 80 <= len(found) <= 140
    terms = [re.sub(r"[^a-z0-9 ]", "", term.casefold()) for term, _, _ in found]
    assert terms == sorted(terms)
    assert len(set(terms)) == len(terms)
    for term, meaning, phrases in found:
        assert re.fullmatch(r"[A-Z0-9`].{25,}[^ ]\.", meaning), term
        for phrase in phrases:
            assert re.fullmatch(r"[a-z][a-zA-Z '-]*[a-z]\.?", phrase), (term, phrase)
    phrases = [phrase for _, _, listed in found for phrase in listed]
    assert len(phrases) > 40
    assert len(set(phrases)) == len(phrases)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_page_has_none_of_the_words_that_the_glossary_replaces(page):
    text = page.read_text()
    if page == GLOSSARY:
        text = without_third_column(text)
    assert [*found_in(page.relative_to(ROOT), prose(text), replaced())] == []


def test_the_help_has_none_of_the_words_that_the_glossary_replaces():
    texts = list(helps())
    assert len(texts) > 300
    phrases = replaced()
    assert [line for where, text in texts for line in found_in(where, text, phrases)] == []


def test_a_replaced_word_is_found_in_prose_and_not_in_code():
    phrases = {"puts out": "output"}
    page = "It puts\nout a code.\n"
    assert [*found_in("page", prose(page), phrases)] == ['page: "puts out", write "output"']
    for code in (
        "`puts out`", "```text\nputs out\n```\n", "a\n\n    puts out\n", "[a](puts out)",
        "inputs out", "<!-- puts out -->",
    ):  # fmt: skip
        assert [*found_in("page", prose(code), phrases)] == [], code
