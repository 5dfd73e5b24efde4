"""Stored parameters over an upgrade: the firmware compiled with other object tables, sets of one
loaded under the other, and the set of version 0.1.0."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
TABLE = "firmware/objects/axis_objects.toml"
DATA = ROOT / "tests/firmware/unit/data"
pytestmark = pytest.mark.beside

# Opens a store as node 5, writes what it is given, saves if it was given anything, and prints
# store_state, the changes, and every stored parameter by its CANopen address.
PROBE = """
#include <stdio.h>
#include <stdlib.h>
#include "firmware/app/fw.h"
#include "firmware/port/host/store_file.h"
static fw_t fw;
static store_file_t file;
static long read_object(uint16_t object) {
  int32_t value = 0;
  if (fw_object_read(&fw, object, &value) != FW_OK) exit(3);
  return value;
}
int main(int argc, char **argv) {
  const char *wrong = store_file_open(&file, argv[1]);
  if (wrong != NULL) return 4;
  const fw_config_t config = {.memory = &file.memory, .node_id = 5};
  fw_init(&fw, &config);
  printf("state %ld\\n", read_object(AXIS_OBJ_STORE_STATE));
  printf("count %ld\\n", read_object(AXIS_OBJ_STORE_CHANGE_COUNT));
  for (uint16_t i = AXIS_OBJ_STORE_CHANGE_1; i <= AXIS_OBJ_STORE_CHANGE_8; ++i)
    printf("change %lx\\n", read_object(i));
  for (int i = 2; i < argc; ++i) {
    char *end;
    const unsigned long address = strtoul(argv[i], &end, 16);
    const axis_address_t *at = dictionary_address((uint16_t)(address >> 8), (uint8_t)address);
    const int32_t value = (int32_t)strtol(end + 1, NULL, 10);
    if (fw_object_write(&fw, FW_SOURCE_LOCAL, at->value, value) != FW_OK) return 5;
  }
  if (argc > 2) {
    if (fw_object_write(&fw, FW_SOURCE_LOCAL, AXIS_OBJ_STORE_PARAMETERS, 1) != FW_OK) return 6;
    const axis_inputs_t inputs = {0};
    axis_outputs_t outputs;
    while (read_object(AXIS_OBJ_STORE_STATE) == AXIS_STORE_STATE_SAVING)
      fw_tick(&fw, &inputs, &outputs);
    if (read_object(AXIS_OBJ_STORE_STATE) != AXIS_STORE_STATE_SAVED) return 7;
  }
  for (int i = 0; i < AXIS_ADDRESSES_COUNT; ++i) {
    const axis_address_t *a = &axis_addresses[i];
    if (a->what == AXIS_ADDRESS_OBJECT && axis_objects[a->value].stored)
      printf("value %x %ld\\n", a->index << 8 | a->sub, read_object(a->value));
  }
  return 0;
}
"""


class Axis:
    """The firmware built with a table: `edits` are pairs of text in it and what takes its place."""

    def __init__(self, folder, *edits):
        self.folder = folder
        text = (ROOT / TABLE).read_text()
        for old, new in edits:
            assert old in text, old
            text = text.replace(old, new, 1)
        ignored = shutil.ignore_patterns("stm32f4", "blank")
        shutil.copytree(ROOT / "firmware", folder / "firmware", ignore=ignored)
        (folder / TABLE).write_text(text)
        (folder / "probe.c").write_text(PROBE)
        generator = [sys.executable, ROOT / "tools/gen_objects.py", "--root", folder]
        subprocess.run(generator, check=True)
        sources = [
            path
            for path in (folder / "firmware").rglob("*.c")
            if "port" not in path.parts or path.name == "store_file.c"
        ]
        command = ["cc", "-std=c11", "-w", f"-I{folder}", folder / "probe.c", *sources]
        subprocess.run([*command, "-o", folder / "probe"], check=True)

    def run(self, store, **values):
        """(state, changes, {address: value}); values: written and saved, by name."""
        arguments = [f"{self.address(name):x}={value}" for name, value in values.items()]
        done = subprocess.run(
            [self.folder / "probe", store, *arguments], capture_output=True, text=True, check=True
        )
        lines = [line.split() for line in done.stdout.splitlines()]
        changes = [int(line[1], 16) for line in lines if line[0] == "change"]
        changes = [change for change in changes if change]
        assert ["count", str(len(changes))] in lines
        state = int(lines[0][1])
        texts = re.search(r'"store_state"\n(?:.*\n)*?enum = \[(.*)\]', self.table()).group(1)
        found = {int(line[1], 16): int(line[2]) for line in lines if line[0] == "value"}
        return texts.replace('"', "").split(", ")[state], changes, found

    def table(self):
        return (self.folder / TABLE).read_text()

    def address(self, name):
        index = re.search(rf'name = "{name}"\n(?:(?!\[\[).*\n)*?index = (0x\w+)', self.table())
        return int(index.group(1), 16) << 8


@pytest.fixture(scope="module")
def today(tmp_path_factory):
    return Axis(tmp_path_factory.mktemp("today"))


@pytest.fixture
def store(tmp_path, today):
    """A set of today's table in which some parameters differ from their defaults."""
    today.run(tmp_path / "store", **SAVED)
    return tmp_path / "store"


SAVED = {"force_gain": 1280, "adc_bits": 12, "force_tare": -300, "watchdog": 500}
OLD_DEFAULT = 1 << 24
# The first motion is tested unless what is in force is a whole set.
TESTED, NOT_TESTED = {0x231A00: 1}, {0x231A00: 0}


def values_of_0_1_0():
    lines = (DATA / "store_0_1_0.txt").read_text().split("\n")
    pairs = [re.split("[: ]", line) for line in lines if line]
    return {int(index + sub, 16): int(value) for index, sub, value in pairs}


def test_a_reworded_table_loads_everything(today, store, tmp_path):
    other = Axis(
        tmp_path / "other",
        ("# Mode.", "# Modes, another comment."),
        (
            'meaning = "proportional gain k_f of the force law: codes per count of force error"',
            'meaning = "another text"',
        ),
    )
    before = today.run(store)
    assert before[0] == "loaded"
    assert other.run(store) == before


SPARE = """[[object]]
name = "spare"
kind = "parameter"
part = "device"
meaning = "planted"
type = "u16"
unit = "N"
min = 0
max = 100
default = 3
access = "rw"
in_cycle = "free"
index = 0x23F0

[[object]]
name = "modbus_word_order"
"""


def test_removing_an_object_loses_that_one_alone(today, tmp_path):
    later = Axis(tmp_path / "later", ('[[object]]\nname = "modbus_word_order"\n', SPARE))
    _, _, saved = later.run(tmp_path / "store", spare=42, **SAVED)
    assert saved.pop(0x23F000) == 42
    state, changes, found = today.run(tmp_path / "store")
    assert (state, changes) == ("loaded_partly", [0x23F000])
    assert found == saved | TESTED
    # The other way round it is a new parameter, at its default.
    today.run(tmp_path / "store", force_gain=1281)
    state, changes, found = later.run(tmp_path / "store")
    assert (state, changes, found[0x23F000]) == ("loaded", [], 3)


def planted(name, old, new):
    """An edit of the entry of an object."""
    text = (ROOT / TABLE).read_text()
    entry = re.search(rf'^name = "{name}"\n(?:(?!\[\[).*\n)*', text, re.M).group()
    assert old in entry
    return entry, entry.replace(old, new, 1)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("max = 16", "max = 15"),
        ("min = 8", "min = 7"),
        ('type = "u8"', 'type = "u16"'),
        ('unit = "1"', 'unit = "count"\nquantity = "force"'),
        ('unit = "1"', 'unit = "1"\nscale = 2'),
    ],
)
def test_a_change_of_meaning_loses_that_one_alone(today, store, tmp_path, old, new):
    other = Axis(tmp_path / "other", planted("adc_bits", old, new))
    _, _, saved = today.run(store)
    state, changes, found = other.run(store)
    assert (state, changes) == ("loaded_partly", [0x200F00])
    assert found == saved | TESTED | {0x200F00: 8}


def test_another_default_keeps_the_old_value_and_says_so(today, store, tmp_path):
    other = Axis(
        tmp_path / "other",
        planted("output_limit", "default = 2048", "default = 1000"),  # at its default
        planted("adc_bits", "default = 8", "default = 9"),  # chosen: 12
        planted("rpdo_cob_id", "[512, 768, 1024, 1280]", "[513, 768, 1024, 1280]"),
    )
    _, _, saved = today.run(store)
    assert (saved[0x201800], saved[0x140001]) == (2048, 0x205)
    state, changes, found = other.run(store)
    assert state == "loaded_old_defaults"
    assert sorted(changes) == [0x140001 | OLD_DEFAULT, 0x201800 | OLD_DEFAULT]
    assert found == saved
    assert other.run(tmp_path / "empty")[2][0x201800] == 1000


def test_the_set_of_0_1_0_loads(today, tmp_path):
    shutil.copy(DATA / "store_0_1_0.bin", tmp_path / "store")
    state, changes, found = today.run(tmp_path / "store")
    assert (state, changes) == ("loaded", [])
    expected = today.run(tmp_path / "empty")[2] | NOT_TESTED | values_of_0_1_0()
    assert found == expected


def test_the_set_of_0_1_0_under_a_table_that_has_changed(today, tmp_path):
    """What it has and what it omits, since it was at its default: each kept, or reported."""
    other = Axis(
        tmp_path / "other",
        planted("force_tare", "index = 0x200E", "index = 0x23F0"),  # in the set
        planted("following_error_max", "index = 0x201B", "index = 0x23F1"),  # omitted
        planted("adc_bits", "max = 16", "max = 15"),  # in the set
        planted("bump_decay_shift", "max = 12", "max = 11"),  # omitted
        planted("output_limit", "default = 2048", "default = 1000"),  # omitted
        planted("force_gain", "default = 0", "default = 9"),  # in the set
        planted("rpdo_cob_id", "[512, 768, 1024, 1280]", "[512, 769, 1024, 1280]"),  # omitted
    )
    shutil.copy(DATA / "store_0_1_0.bin", tmp_path / "store")
    state, changes, found = other.run(tmp_path / "store")
    assert state == "loaded_partly"
    assert sorted(changes) == [
        *(0x200E00, 0x200F00, 0x201A00, 0x201B00),
        *(0x140101 | OLD_DEFAULT, 0x201800 | OLD_DEFAULT),
    ]
    expected = today.run(tmp_path / "empty")[2] | TESTED | values_of_0_1_0()
    for gone in (0x200E00, 0x201B00):
        del expected[gone]
    assert found == expected | {0x200F00: 8, 0x23F000: 0, 0x23F100: 0}
    names = (tmp_path / "other/firmware/objects/generated/axis_objects_meta.h").read_text()
    assert '{0x200E00, "force_tare"},' in names
    assert '{0x201B00, "following_error_max"},' in names
