"""The table's hash is that of its meaning: what clients rely on changes it, wording does not."""

import importlib
import re
import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
TABLE = "firmware/objects/axis_objects.toml"
TEXT = (ROOT / TABLE).read_text()


@pytest.fixture
def digest_of(tmp_path, monkeypatch):
    """The hash of a table given as text."""
    monkeypatch.syspath_prepend(ROOT / "tools")
    table = importlib.import_module("objects.table")
    shutil.copytree(ROOT / "firmware/objects/released", tmp_path / "released")
    path = tmp_path / "axis_objects.toml"

    def digest_of(text):
        path.write_text(text)
        return table.load_table(path).digest

    return digest_of


def edited(old, new):
    assert old in TEXT, old
    return TEXT.replace(old, new, 1)


def swapped(kind, first, second):
    """The table with two of its [[kind]] entries in each other's places."""
    found = re.findall(rf"^\[\[{kind}\]\]\n(?:(?!\[\[|# ).*\n)*", TEXT, re.M)
    a, b = (next(e for e in found if f'name = "{name}"' in e) for name in (first, second))
    return TEXT.replace(a, "@").replace(b, a).replace("@", b)


GAIN = 'meaning = "proportional gain k_f of the force law: codes per count of force error"\n'
SAME = {
    "a comment": edited("# Mode.", "# Another, comment."),
    "a meaning": edited(GAIN, 'meaning = "gain, k_f"\n'),
    "a title": edited('title = "ADC bits"', 'title = "Bits of the ADC"'),
    "the meaning of a coil": edited("bit 8 of the controlword;", "bit 8;"),
    "the meaning of a text": edited('meaning = "name of the device"', 'meaning = "its name"'),
    "the title of a record": edited('"Identity object"', '"Who it is"'),
    "the order of objects": swapped("object", "force_gain", "watchdog"),
    "the order of coils": swapped("coil", "enable", "store"),
    "the order of texts": swapped("special", "device_name", "software_version"),
    "the order of keys": edited(f'{GAIN}type = "u16"', f'type = "u16"\n{GAIN}'),
    "what is the default of a key": edited(GAIN, f"{GAIN}count = 1\n"),
    "the sentence of a value": edited(
        "the parameter store has failed, or", "the store has failed, or"
    ),
    "a default": edited("default = 6554", "default = 6555"),
    "one of several defaults": edited("[512, 768, 1024, 1280]", "[512, 768, 1024, 1281]"),
    "of what a count is a step": edited('quantity = "force"', 'quantity = "encoder"'),
    "what a change does to a cycle": edited('in_cycle = "ends"', 'in_cycle = "refused"'),
    "whether 0 is refused": edited("not_zero = true\n", ""),
    "a scale written otherwise": edited("scale = 0.00390625", "scale = 390625e-8"),
}
OTHER = {
    "a CANopen index": edited("index = 0x200A\n", "index = 0x23F0\n"),
    "a sub-index": edited("index = 0x1029\nsub = 1", "index = 0x1029\nsub = 2"),
    "a name": edited('name = "force_gain"', 'name = "gain_of_force"'),
    "a kind": edited(
        'name = "following_error_max"\nkind = "parameter"',
        'name = "following_error_max"\nstored = false\nkind = "command"',
    ),
    "a type": edited('were received"\ntype = "u16"', 'were received"\ntype = "u32"'),
    "a unit": edited('unit = "count/s"', 'unit = "m/s"'),
    "a scale": edited("scale = 0.00390625", "scale = 0.0078125"),
    "a minimum": edited("min = 8\nmax = 16", "min = 7\nmax = 16"),
    "a maximum": edited("min = 8\nmax = 16", "min = 8\nmax = 17"),
    "the access": edited(
        'access = "rw"\nindex = 0x2303\nmodbus = 0x01F0', 'access = "wo"\nindex = 0x2303'
    ),
    "when it may be written": edited(
        'modbus = 0x010F\nwritable = "disabled"', 'modbus = 0x010F\nin_cycle = "refused"'
    ),
    "whether it is stored": edited("modbus = 0x010D\nstored = false", "modbus = 0x010D"),
    "a Modbus register": edited("modbus = 0x010C\n", "modbus = 0x03F0\n"),
    "one text more": edited('["noise", "sine"]', '["noise", "sine", "chirp"]'),
    "another text": edited('"raw_step"', '"step"'),
    "texts in another order": edited('["noise", "sine"]', '["sine", "noise"]'),
    "a value's name": edited('[0x5530, "store_failed", ', '[0x5530, "no_store", '),
    "a value": edited('[0x5530, "store_failed", ', '[0x5531, "store_failed", '),
    "following the node id": edited("index = 0x1014\nnode_id = true", "index = 0x1014"),
    "the address of a coil": edited('name = "store"\naddress = 3', 'name = "store"\naddress = 7'),
    "the name of a discrete input": edited(
        'name = "contact"\naddress = 17', 'name = "touched"\naddress = 17'
    ),
    "the address of a text": edited("index = 0x1008\n", "index = 0x1007\n"),
}


@pytest.mark.parametrize("name", SAME)
def test_wording_order_and_defaults_leave_the_hash(digest_of, name):
    assert SAME[name] != TEXT
    assert digest_of(SAME[name]) == digest_of(TEXT)


@pytest.mark.parametrize("name", OTHER)
def test_a_change_of_meaning_changes_the_hash(digest_of, name):
    assert OTHER[name] != TEXT
    assert digest_of(OTHER[name]) != digest_of(TEXT)


def test_every_change_of_meaning_has_a_hash_of_its_own(digest_of):
    digests = {digest_of(text) for text in OTHER.values()}
    assert len(digests) == len(OTHER)
