"""Results as JSON: keys, order, absent values, arrays, and back; what differs is refused."""

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from forceaxis import InputError
from forceaxis.results import from_json, json_field, to_json
from numpy.typing import NDArray


@dataclass(frozen=True)
class Row:
    name: str
    gain: float | None = json_field(key="the gain")


@dataclass(frozen=True)
class Found:
    file: Path
    rows: tuple[Row, ...]
    values: dict[str, float]
    best: Row | None
    limits: np.ndarray | None = None
    note: str | None = json_field(omit_none=True)
    count: int = 0


FOUND = Found(Path("a/b"), (Row("P", 1.5), Row("PI", None)), {"k": 2.0}, None)
TABLE = {
    "file": "a/b",
    "rows": [{"name": "P", "the gain": 1.5}, {"name": "PI", "the gain": None}],
    "values": {"k": 2.0},
    "best": None,
    "limits": None,
    "count": 0,
}


def test_a_result_has_its_fields_as_keys_in_their_order():
    assert json.dumps(to_json(FOUND)) == json.dumps(TABLE)


def test_a_note_has_a_key_where_there_is_one():
    noted = dataclasses.replace(FOUND, note="slow", limits=np.array([1.0, 2.0]))
    table = to_json(noted)
    assert list(table) == ["file", "rows", "values", "best", "limits", "count", "note"]
    assert json.dumps([table["note"], table["limits"]]) == '["slow", [1.0, 2.0]]'


@dataclass(frozen=True, kw_only=True)
class Drawn:
    title: str
    row: Row | Found | None = json_field(inline=True)
    limits: NDArray[np.float64]
    name: str


def test_keys_of_an_inline_result_replace_its_field():
    """Of two values of one key the later counts, at the place of the first."""
    drawn = Drawn(title="T", row=Row("P", 1.5), limits=np.array([1.0]), name="PI")
    assert json.dumps(to_json(drawn)) == (
        '{"title": "T", "name": "PI", "the gain": 1.5, "limits": [1.0]}'
    )
    empty = dataclasses.replace(drawn, row=None)
    assert json.dumps(to_json(empty)) == '{"title": "T", "limits": [1.0], "name": "PI"}'


def test_numbers_of_numpy_become_numbers():
    found = dataclasses.replace(FOUND, values={"k": np.float64(2.0)}, count=np.int64(3))
    assert json.dumps(to_json(found)["values"]) == '{"k": 2.0}' and to_json(found)["count"] == 3


def test_json_becomes_the_same_result():
    @dataclass(frozen=True)
    class Kept:
        file: Path
        rows: tuple[Row, ...]
        best: Row | None

    kept = Kept(FOUND.file, FOUND.rows, Row("D", 0.5))
    assert from_json(Kept, json.loads(json.dumps(to_json(kept)))) == kept


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ({"the gain": 1.0}, "name"),
        ({"name": "P", "the gain": "high"}, "gain"),
        ({"name": "P", "the gain": 1.0, "gian": 2.0}, "gian"),
    ],
)
def test_json_of_another_shape_is_refused_in_one_line(table, says):
    with pytest.raises(InputError, match=says) as refused:
        from_json(Row, table, "fit.json")
    assert str(refused.value).startswith("fit.json: ") and "\n" not in str(refused.value)
