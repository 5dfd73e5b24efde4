"""The quantitative sentences of Chapters 2 to 6 of the thesis, each with what checks it or the
reason why it cannot be checked. The file sentences.toml contains them."""

import functools
from dataclasses import dataclass
from pathlib import Path

from forceaxis import paths, toml
from forceaxis.results import from_json

FILE = Path(__file__).with_name("sentences.toml")


@dataclass(frozen=True)
class Sentence:
    """One quantitative sentence of the thesis. It has rows, tests or figures, or a reason."""

    says: str  # content of the sentence in our own words
    rows: tuple[str, ...] = ()  # names (`what`) of claims of the check of the thesis
    tests: tuple[str, ...] = ()  # names of tests: "tests/FOLDER/FILE.py::NAME", "ctest:NAME"
    figures: tuple[str, ...] = ()  # figures of the thesis that the report draws, by their number
    reason: str = ""  # reason why the sentence cannot be checked

    @property
    def checked(self) -> bool:
        """True if a row, a test or a figure checks the sentence."""
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
    """Returns the sections of the thesis that have quantitative sentences. Raises InputError."""
    return from_json(_File, toml.read(FILE), paths.display(FILE)).section
