"""Certificates of banks: what their hash is of, and what an experiment without one is held at."""

import importlib
import struct
import zlib
from pathlib import Path

import forceaxis
import numpy as np
import pytest
from forceaxis import _core, objects

ROOT = Path(__file__).resolve().parents[3]
TABLE = "firmware/objects/axis_objects.toml"
TEXT = (ROOT / TABLE).read_text()


@pytest.fixture
def signature_of(tmp_path, monkeypatch):
    """The law's signature in a table given as text."""
    monkeypatch.syspath_prepend(ROOT / "tools")
    table = importlib.import_module("objects.table")
    meaning = importlib.import_module("objects.meaning")
    (tmp_path / "released").symlink_to(ROOT / "firmware/objects/released")

    def signature_of(text):
        path = tmp_path / "axis_objects.toml"
        path.write_text(text)
        return meaning.law_signature(table.load_table(path).entries)

    return signature_of


def edited(old, new):
    assert TEXT.count(old) == 1, old
    return TEXT.replace(old, new)


ADC_BITS = TEXT[TEXT.index('name = "adc_bits"') :].split("\n\n")[0]
NEW = """[[object]]
name = "brightness"
kind = "parameter"
meaning = "of the display"
type = "u16"
unit = "1"
min = 0
max = 100
access = "rw"
in_cycle = "free"
index = 0x23F0

# Recorder.

[[object]]"""


@pytest.mark.parametrize(
    "text",
    [
        edited("# Recorder.\n\n[[object]]", NEW),
        edited(ADC_BITS, ADC_BITS.replace("max = 16", "max = 15")),
        edited(ADC_BITS, ADC_BITS.replace('meaning = "', 'meaning = "width: ')),
    ],
    ids=["an object elsewhere", "a range", "a wording"],
)
def test_what_does_not_change_the_law_voids_no_certificate(signature_of, text):
    assert signature_of(text) == signature_of(TEXT)


@pytest.mark.parametrize(
    "text",
    [
        edited(ADC_BITS, ADC_BITS.replace('"adc_bits"', '"adc_width"')),
        edited(ADC_BITS, ADC_BITS.replace('type = "u8"', 'type = "u16"')),
        edited(ADC_BITS, ADC_BITS.replace('unit = "', 'unit = "x')),
        edited(ADC_BITS, ADC_BITS + "\nscale = 2"),
        edited(ADC_BITS, ADC_BITS.replace("law = true", "law = false")),
    ],
    ids=["a name", "a type", "a unit", "a scale", "an object less"],
)
def test_another_meaning_of_what_the_law_reads_voids_them(signature_of, text):
    assert signature_of(text) != signature_of(TEXT)


def test_the_hash_that_a_design_writes(signature_of):
    words = 0x12345678, 12, 2_500_000, 1, signature_of(TEXT)
    written = _core.certificate(*words[:3])
    assert written["certificate_hash"] == zlib.crc32(struct.pack("<5I", *words))
    assert set(written) == {"certificate_hash", "certificate_parts"}
    assert {f"{name}_4" for name in written} <= set(objects.BY_NAME)


def held_N(folder, *edits):
    text = (ROOT / "sim/experiments/hold_biquad.toml").read_text()
    for old, new in (("../models", f"{ROOT}/sim/models"), *edits):
        assert old in text
        text = text.replace(old, new)
    file = folder / "hold.toml"
    file.write_text(text)
    result = forceaxis.run(str(file))
    assert (result.fault, result.refused) == ("none", [])
    return np.mean(result.columns()["sensor.force"][-500:])


BANK = "[firmware.bank_1]\n"


def test_a_bank_without_a_certificate_is_held_at_reduced_force(tmp_path):
    """75 N are asked for, of a force_limit of 100 N; half of it is permitted."""
    assert held_N(tmp_path) == pytest.approx(75, abs=0.6)
    without = (BANK, f"{BANK}certificate = false\n")
    assert held_N(tmp_path, without) == pytest.approx(50, abs=1.3)
    more = ("force_bank = 1\n", "force_bank = 1\nuncertified_force = 700\n")
    assert held_N(tmp_path, without, more) == pytest.approx(70, abs=1.3)


def test_an_experiment_is_certified_for_the_sensor_that_it_states(tmp_path):
    """Half the newtons per count: the same bank, the same per mille, half the force."""
    scale = ("force_bank = 1\n", 'force_bank = 1\nforce_scale = "5 N"\nrated_force = "200 N"\n')
    assert held_N(tmp_path, scale) == pytest.approx(75, abs=0.6)
