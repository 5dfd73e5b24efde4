"""Parameters as files: read back bit for bit, loaded whole or not at all, on any table."""

import copy
import csv
import datetime
import json
import math
import random
from pathlib import Path

import pytest
import tomlkit
import verbs
from forceaxis import _core, toml
from forceaxis._core import InputError
from forceaxis.axis import parameter_file, parameter_set
from forceaxis.axis.axis import Axis
from forceaxis.axis.link import NoAnswer, Refused
from forceaxis.axis.sim import SimLink

ROOT = Path(__file__).resolve().parents[3]
BANK = ROOT / "sim/experiments/hold_biquad.toml"
PLAIN = ROOT / "sim/experiments/session.toml"
# Of an axis that has a bank in force and is otherwise not at its defaults either.
SETTINGS = {
    "bank_gain_2": 1.5,
    "position_min": -70_000,
    "force_jump_max": 20.0,
    "tare_band": 12.5,
    "force_tare": 1.25,
    "calibration_force_2": 75_000,
    "contact_unstable_option": "halve_gain",
    "encoder_increments": 2048,
    "gear_motor_revolutions": 7,
    "feed": 25_000,
    "consumer_heartbeat_2": 0x7F03E8,
    "watchdog": 250,
}
# Entries of a PDO, in the order that CANopen wants.
PDO = {
    "tpdo_cob_id_3": 0xC0000381, "tpdo_mapped_3": 0, "tpdo_mapping_17": 0x60770010,
    "tpdo_mapping_18": 0x60740010, "tpdo_mapping_19": 0x60410010, "tpdo_mapped_3 ": 3,
    "tpdo_inhibit_time_3": 1000, "tpdo_cob_id_3 ": 0x40000381,
}  # fmt: skip


def by_register(name):
    return not name.startswith("tpdo_")


@pytest.fixture
def owned():
    """Axes of experiments, acquired."""
    axes = []

    def make(experiment=PLAIN, **settings):
        axis = Axis(SimLink(experiment, **settings))
        axis.acquire()
        axes.append(axis)
        return axis

    yield make
    for axis in axes:
        axis.close()


def configured(owned):
    axis = owned(BANK)
    axis.set(**SETTINGS)
    for name, raw in PDO.items():
        axis.link.write({name.strip(): raw})
    return axis


def written(tmp_path, text, name="axis.toml"):
    file = tmp_path / name
    file.write_text(text)
    return file


def test_every_raw_value_of_every_parameter_reads_back_bit_for_bit():
    drawn = random.Random(18)
    for known in parameter_file.PARAMETERS:
        raws = [known.min, known.max, known.default]
        raws += [drawn.randint(known.min, known.max) for _ in range(20)]
        lines = [f"v{i} = {parameter_file.text(known, raw, 5)}" for i, raw in enumerate(raws)]
        values = toml.read_text("\n".join(lines)).values()
        assert [parameter_file.raw_value(known, v, 5) for v in values] == raws, known.name


@pytest.mark.parametrize("everything", [False, True])
def test_a_dump_makes_another_axis_the_same(owned, tmp_path, everything):
    first, second = configured(owned), owned()
    second.set(force_gain=3.5, bank_gain_2=9.0, homing_travel=1234, force_tare=-2.0)
    file = written(tmp_path, parameter_set.dump(first, everything))
    assert parameter_set.differences(first, file, measured=True) == []
    before = parameter_set.differences(second, file)
    assert {"force_gain", "homing_travel", "watchdog", "bank_crc_1", "tpdo_mapping_19"} <= {
        d.name for d in before
    }
    loaded = parameter_set.load(second, file)
    assert (loaded.changed, loaded.managed) == (before, [])
    assert loaded.bank == parameter_set.BankState(1, "valid", "fits")
    assert parameter_set.differences(second, file) == []
    # Measurements stay each axis' own until they are asked for.
    assert second.read("force_tare") == -2.0
    parameter_set.load(second, file, measured=True)
    assert parameter_set.read(second) == parameter_set.read(first)


def test_a_dump_says_whose_it_is(owned):
    about = toml.read_text(parameter_set.dump(owned(BANK)))["about"]
    assert about.items() >= {
        "format": 1, "object_table": parameter_file.table_hash(),
        "firmware": _core.FIRMWARE_VERSION, "name": "simulator", "node_id": 1,
        "serial_number": "0x00000000",
    }.items()  # fmt: skip
    assert about["written"] and str(BANK) in about["axis"]


def test_what_differs_is_shown_by_name_with_both_values(owned, tmp_path):
    file = written(tmp_path, parameter_set.dump(owned(BANK)))
    ran = verbs.forceaxis("axis", "params", "diff", file, "--on", f"sim:{PLAIN}", "--json")
    rows = {row["name"]: row for row in json.loads(ran.stdout)["differences"]}
    assert ran.returncode == 1
    assert rows["position_gain"] == {
        "name": "position_gain", "axis": 0.0, "file": 4.0, "unit": "code/count",
    }  # fmt: skip
    ran = verbs.forceaxis("axis", "params", "diff", file, "--on", f"sim:{BANK}")
    # The file is of the same axis: nothing differs.
    assert (ran.returncode, ran.stdout, ran.stderr) == (0, "", "")


BAD = {
    "out of range": ("velocity_gain = 20.0", "velocity_gain = 300.0", "velocity_gain: expected"),
    "no number": ("velocity_gain = 20.0", "velocity_gain = 'much'", "velocity_gain: expected"),
    "decimals": ("force_slope = 7500", "force_slope = 7500.5", "without decimals"),
    "unknown text": ('"halve_gain"', '"halve"', "contact_unstable_option: expected one of"),
    "unknown name": (
        "position_gain",
        "position_gian",
        "position_gian: expected the name of an object",
    ),
    "twice": ("bank_gain =", "bank_gain_2 = 0\nbank_gain =", "twice"),
    "too few values": ("bank_gain = [4.37, ", "bank_gain = [", "expected a list of 4"),
    "identity": ("velocity_gain", "stored_node_id = 3\nvelocity_gain", "without node id"),
    "no parameter": ("velocity_gain", "controlword = 15\nvelocity_gain", "can store"),
    "newer format": ("format = 1", "format = 2", "about.format"),
}


@pytest.mark.parametrize("bad", BAD)
def test_a_file_with_one_bad_value_changes_nothing(owned, tmp_path, bad):
    old, new, message = BAD[bad]
    text = parameter_set.dump(configured(owned))
    assert old in text
    file = written(tmp_path, text.replace(old, new, 1))
    axis = owned()
    before = parameter_set.read(axis)
    with pytest.raises(InputError, match=message):
        parameter_set.load(axis, file)
    assert parameter_set.read(axis) == before
    ran = verbs.forceaxis("axis", "params", "load", file, "--on", f"sim:{PLAIN}")
    assert ran.returncode == 2 and len(ran.stderr.splitlines()) == 1


# What only the axis can tell, with what it says of it.
REFUSED = {
    "a bank of other values": ("bank_gain = [4.37", "bank_gain = [4.38", "force_bank.*wrong crc"),
    "an entry that cannot be mapped": ("0x60740010", "0x60740020", "tpdo_mapping_18"),
    "a COB-ID of NMT": ('"$NODEID+0x40000380"', "0x40000000", "tpdo_cob_id_3"),
}


@pytest.mark.parametrize("refused", REFUSED)
def test_a_file_that_the_axis_refuses_changes_nothing(owned, tmp_path, refused):
    old, new, message = REFUSED[refused]
    text = parameter_set.dump(configured(owned))
    assert old in text
    file = written(tmp_path, text.replace(old, new, 1))
    axis = configured(owned)
    axis.set(force_gain=3.5, watchdog=400, force_slope=8000)
    before = parameter_set.read(axis)
    with pytest.raises(Refused, match=message):
        parameter_set.load(axis, file)
    assert parameter_set.read(axis) == before


def test_a_file_is_written_only_to_a_disabled_axis_of_this_table(owned, tmp_path):
    file = written(tmp_path, parameter_set.dump(owned(BANK)))
    axis = owned(BANK, overrides=["firmware.first_motion_test=off"])
    axis.enable("profile position")
    axis.set(watchdog=400)
    with pytest.raises(
        Refused, match="expected a disabled axis, got: the axis is operation enabled"
    ):
        parameter_set.load(axis, file)
    assert axis.read("watchdog") == 400
    found = axis.link.read
    axis.link.read = lambda names: found(names) | {"object_table_hash": 1}
    with pytest.raises(Refused, match=r"expected object table .* got 0x00000001"):
        parameter_set.read(axis)


def places(table, above=()):
    """Keys of every value and table of a TOML document, from the top."""
    for key, value in table.items():
        yield (*above, key)
        if isinstance(value, dict):
            yield from places(value, (*above, key))


ODD = (-1, 1 << 40, 1.5, math.nan, "", "x", True, [], [{}], {}, datetime.date(2020, 1, 1))


def test_whatever_stands_in_a_damaged_file_is_one_line(owned, tmp_path):
    # Each fifteenth place, so that every kind of place is there; each odd value at each of them.
    sound = toml.read_text(parameter_set.dump(configured(owned)))
    sound["about"]["without"] = ["force_gain"]
    refused = 0
    for place in list(places(sound))[::15]:
        for value in ODD:
            damaged = copy.deepcopy(sound)
            table = damaged
            for key in place[:-1]:
                table = table[key]
            table[place[-1]] = value
            file = written(tmp_path, tomlkit.dumps(damaged))
            try:
                parameter_file.read(file, 1)
            except InputError as error:
                refused += 1
                assert "\n" not in str(error)
    assert refused > 50


@pytest.mark.parametrize("error", [NoAnswer("no answer"), KeyboardInterrupt()])
def test_a_load_that_ends_in_between_is_undone(owned, tmp_path, error):
    file = written(tmp_path, parameter_set.dump(configured(owned)))
    axis = owned()
    before, write, count = parameter_set.read(axis), axis.link.write, 0

    def failing(values):
        nonlocal count
        count += 1
        if count == 12:
            raise error
        write(values)

    axis.link.write = failing
    with pytest.raises((Refused, KeyboardInterrupt)) as ended:
        parameter_set.load(axis, file)
    assert str(ended.value) in ("", f"{file}: no answer; all earlier values were restored")
    assert count > 12 and parameter_set.read(axis) == before


def test_a_bank_of_a_design_is_written_over_the_selected_one(owned, tmp_path):
    values = parameter_set.read(owned(BANK))
    names = [
        "adc_bits", "force_scale", "bank_sections_1", "bank_gain_1", "bank_velocity_gain_1",
        "bank_integral_1", *(f"bank_coefficient_{i}" for i in range(1, 16)), "bank_crc_1",
        "certificate_hash_1", "certificate_parts_1", "certificate_date_1",
    ]  # fmt: skip
    lines = [f"{n} = {parameter_file.text(parameter_file.BY_NAME[n], values[n])}" for n in names]
    file = written(tmp_path, "\n".join(["[firmware]", *lines, "force_bank = 1"]), "bank.toml")
    other = BANK.read_text().replace("gain = 4.37", "gain = 2.0").replace("_s = 8.0", "_s = 4.0")
    other = other.replace("../models", f"{ROOT}/sim/models")
    axis = owned(written(tmp_path, other, "other.toml"))
    axis.set(watchdog=400)
    loaded = parameter_set.load(axis, file)
    assert {d.name for d in loaded.changed} == {
        "bank_gain_1", "bank_integral_1", "bank_crc_1", "certificate_hash_1", "certificate_parts_1",
    }  # fmt: skip
    assert loaded.bank.certificate_state == "fits"
    assert axis.get("bank_gain_1", "force_bank", "watchdog") == {
        "bank_gain_1": 4.37109375, "force_bank": 1, "watchdog": 400,
    }  # fmt: skip


def test_values_that_limit_each_other_are_loaded_in_any_order(owned, tmp_path):
    first = owned()
    first.set(position_limit_max=5_000, position_limit_min=4_000, tpdo_sync_start_1=0)
    first.link.write({"consumer_heartbeat_1": 0x0203E8, "consumer_heartbeat_2": 0x0303E8})
    file = written(tmp_path, parameter_set.dump(first))
    second = owned()
    second.set(position_limit_min=-9_000, position_limit_max=-8_000)
    second.link.write({"consumer_heartbeat_1": 0x0303E8, "consumer_heartbeat_2": 0x0203E8})
    parameter_set.load(second, file)
    assert parameter_set.differences(second, file) == []


def test_another_node_gets_the_file_s_pdos_at_its_own_identifiers(owned):
    known = parameter_file.BY_NAME["tpdo_cob_id_1"]
    assert parameter_file.text(known, known.default + 3, 3) == '"$NODEID+0x40000180"'
    # Disabled it still follows the node; at an identifier of its own it stays there.
    assert parameter_file.text(known, 0xC0000183, 3) == '"$NODEID+0xc0000180"'
    assert parameter_file.text(known, 0x400001A0, 3) == "0x400001a0"
    assert parameter_file.raw_value(known, "$NODEID+0x40000180", 9) == 0x40000189


def test_a_dump_of_another_table_is_loaded_by_name(owned, tmp_path):
    text = parameter_set.dump(configured(owned))
    ours = parameter_file.table_hash()
    # An object that has moved to another part, and a range that has grown since.
    text = text.replace(ours, "0x12345678").replace("[drive]", "[motion]")
    grown = text.replace('force_jump_max = { type = "i32", scale = 0.00390625, unit = "count", '
                         "min = 0, max = 65536", 'force_jump_max = { type = "i32", '
                         'scale = 0.00390625, unit = "count", min = 1, max = 32768')  # fmt: skip
    assert grown != text
    axis = owned()
    parameter_set.load(axis, written(tmp_path, grown))
    assert axis.read("force_jump_max") == 20.0
    for old, new in (
        ('feed = { type = "u32", scale = 1.0, unit = "1"',
         'feed = { type = "u32", scale = 1.0, unit = "mm"'),
        ("watchdog", "keep_alive"),
        ("max = 12 }", "max = 24 }"),
    ):  # fmt: skip
        assert old in text
        text = text.replace(old, new)
    other, file = owned(), written(tmp_path, text)
    before = parameter_set.read(other)
    with pytest.raises(InputError) as refusal:
        parameter_set.load(other, file)
    assert parameter_set.read(other) == before
    assert all(word in str(refusal.value) for word in (
        "0x12345678", ours, "feed: expected the description unit 1 of this object", "got unit mm",
        "keep_alive: expected the name of an object",
        "bump_decay_shift: expected the description max 12 of this object",
    ))  # fmt: skip
    parameter_set.load(other, file, skip=("feed", "keep_alive", "bump_decay_shift"))
    assert other.read("force_jump_max") == 20.0 and other.read("feed") == 0


def test_a_file_of_the_table_of_0_1_0(owned, tmp_path):
    """Every stored object of that release, as a dump of its own would have had it."""
    with (ROOT / "firmware/objects/released/0.1.0.csv").open() as file:
        digest = file.readline().split()[-1]
        rows = [r for r in csv.DictReader(file) if r["name"] not in parameter_file.IDENTITY]
    values, meanings = ["[released]"], ["[objects]"]
    for row in rows:
        enum = row["enum"].split(";") if row["enum"] else None
        scale, raw = float(row["scale"]), int(row["default"])
        value = f'"{enum[raw]}"' if enum else raw if scale == 1 else raw * scale
        value = f'"$NODEID+{raw:#x}"' if row["node_id"] == "1" else value
        values.append(f"{row['name']} = {value}")
        texts = f", enum = {json.dumps(enum)}" if enum else ""
        meanings.append(
            f'{row["name"]} = {{ type = "{row["type"]}", scale = {scale}, unit = "{row["unit"]}", '
            f"min = {row['min']}, max = {row['max']}{texts} }}"
        )
    head = ["[about]", "format = 1", f'object_table = "0x{digest}"']
    file = written(tmp_path, "\n".join([*head, *values, *meanings]))
    axis = owned(overrides=["firmware.position_gain=4"])
    changed = {d.name for d in parameter_set.load(axis, file).changed}
    assert "position_gain" in changed and axis.read("position_gain") == 0


def test_an_axis_with_a_store_of_0_1_0_is_dumped_for_another(owned, tmp_path):
    data = ROOT / "tests/firmware/unit/data"
    store = tmp_path / "axis.store"
    store.write_bytes((data / "store_0_1_0.bin").read_bytes())
    with_12_bits = ROOT / "sim/experiments/force_step.toml"  # as the axis that has stored the set
    first, second = owned(with_12_bits, store=store), owned(with_12_bits)
    assert first.read("store_state").startswith("loaded")
    file = written(tmp_path, parameter_set.dump(first))
    parameter_set.load(second, file, measured=True)
    now, addresses = (
        parameter_set.read(second),
        {(o.index, o.sub): o.name for o in parameter_file.PARAMETERS},
    )
    assert now == parameter_set.read(first)
    compared = 0
    for line in (data / "store_0_1_0.txt").read_text().splitlines():
        address, value = line.split()
        name = addresses.get(tuple(int(part, 16) for part in address.split(":")))
        compared += name in now and now[name] == int(value)
    assert compared > 20


def test_what_a_link_does_not_reach_or_manages_itself_is_left_alone(owned, tmp_path):
    first = configured(owned)
    whole = written(tmp_path, parameter_set.dump(first), "whole.toml")
    first.link.manages = lambda name: name.startswith("tpdo_")
    first.link.reaches = lambda name: not name.startswith("rpdo_")
    text = parameter_set.dump(first)
    about = toml.read_text(text)["about"]
    assert {"rpdo_mapping", "tpdo_mapping", "tpdo_cob_id"} < set(about["without"])
    assert "\ntpdo_" not in text and "\nrpdo_" not in text
    # A file without them leaves them as they are.
    second = configured(owned)
    second.link.write({"rpdo_timeout_2": 70})
    loaded = parameter_set.load(second, written(tmp_path, text))
    assert loaded.changed == [] and second.read("rpdo_timeout_2") == 70
    # What a gateway sets up itself is not written by it; what has no register is refused.
    third = owned()
    third.link.manages = first.link.manages
    loaded = parameter_set.load(third, whole)
    assert {"tpdo_cob_id_3", "tpdo_mapping_17"} < set(loaded.managed)
    assert third.read("tpdo_mapped_3") == 2 and third.read("watchdog") == 250
    third.link.manages, third.link.reaches = (lambda name: False), by_register
    with pytest.raises(Refused, match="tpdo_cob_id_1: this object has no Modbus register"):
        parameter_set.load(third, whole)


def test_stored_parameters_are_there_at_the_next_power_up(tmp_path):
    store, file = tmp_path / "axis.store", tmp_path / "axis.toml"
    way = ("--on", f"sim:{PLAIN}@{store}")
    file.write_text("[drive]\nhoming_travel = 4321\n")
    with Axis(SimLink(PLAIN, store=store)) as axis:
        parameter_set.load(axis, file)
        parameter_set.store(axis)
    del axis  # which has the file open
    ran = verbs.forceaxis("axis", "params", "dump", "--json", *way)
    assert json.loads(ran.stdout)["parameters"]["homing_travel"] == 4321
    refused = verbs.forceaxis("axis", "params", "restore", *way)
    assert refused.returncode == 2 and "--yes" in refused.stderr
    assert verbs.forceaxis("axis", "params", "restore", "--yes", *way).returncode == 0
    ran = verbs.forceaxis("axis", "params", "dump", "--json", *way)
    assert "homing_travel" not in json.loads(ran.stdout)["parameters"]
    # An axis without a memory says so.
    ran = verbs.forceaxis("axis", "params", "store", "--on", f"sim:{PLAIN}")
    assert ran.returncode == 1 and "no memory" in ran.stderr


def test_the_verbs_write_files_whole_and_dry_runs_not_at_all(tmp_path):
    file = tmp_path / "bank.toml"
    assert verbs.forceaxis("axis", "params", "dump", file, "--on", f"sim:{BANK}").returncode == 0
    printed = verbs.forceaxis("axis", "params", "dump", "--on", f"sim:{BANK}").stdout
    assert printed == file.read_text()
    ran = verbs.forceaxis(
        "axis", "params", "load", file, "--on", f"sim:{PLAIN}", "--dry-run", "--json"
    )
    result = json.loads(ran.stdout)
    assert result["dry_run"] and result["bank"] == {} and len(result["changes"]) == 17
    ran = verbs.forceaxis("axis", "params", "load", file, "--on", f"sim:{PLAIN}")
    assert ran.stdout.splitlines()[-1] == "force bank 1, bank valid, certificate fits"
    # A folder that is not there: nothing is left half-written.
    ran = verbs.forceaxis(
        "axis", "params", "dump", tmp_path / "no/axis.toml", "--on", f"sim:{PLAIN}"
    )
    assert ran.returncode == 2 and len(ran.stderr.splitlines()) == 1
