"""The quantitative sentences of Chapters 2 to 6 of the thesis, from the file sentences.toml. Each
sentence lists the claims, tests and figures that check it, or has the reason why it cannot be
checked."""

import functools
from dataclasses import dataclass
from pathlib import Path

from forceaxis import paths, toml
from forceaxis.results import from_json

FILE = Path(__file__).with_name("sentences.toml")


@dataclass(frozen=True)
class Sentence:
    """One quantitative sentence of the thesis. It has the claims, tests or figures that check it,
    or the reason why it cannot be checked."""

    says: str  # content of the sentence of the thesis, in other words
    rows: tuple[str, ...] = ()  # names (`what`) of the claims that check the sentence
    # names of tests, such as "tests/FOLDER/FILE.py::NAME" or "ctest:NAME"
    tests: tuple[str, ...] = ()
    figures: tuple[str, ...] = ()  # numbers of those figures of the thesis that the report draws
    reason: str = ""  # reason why the sentence cannot be checked

    @property
    def checked(self) -> bool:
        """True if a claim, a test or a figure checks the sentence."""
        return bool(self.rows or self.tests or self.figures)


@dataclass(frozen=True)
class Section:
    """The quantitative sentences of one section of the thesis."""

    number: str
    sentences: tuple[Sentence, ...]

    @property
    def chapter(self) -> int:
        """Number of the chapter to which the section belongs."""
        return int(self.number.partition(".")[0])


@dataclass(frozen=True)
class _File:
    section: tuple[Section, ...]


@functools.cache
def sections() -> tuple[Section, ...]:
    """Returns the sections of the thesis that have quantitative sentences. Raises InputError for a
    wrong file."""
    return from_json(_File, toml.read(FILE), paths.display(FILE)).section
