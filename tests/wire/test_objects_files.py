"""The files generated from the object table, read by third-party programs and by readers written
here from the standards, and compared with the table as tomllib reads it."""

import configparser
import csv
import itertools
import json
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import canopen
import cantools
import pytest
import verbs

ROOT = Path(__file__).resolve().parents[2]
TABLE = ROOT / "firmware/objects/axis_objects.toml"
GENERATED = ROOT / "firmware/objects/generated"
NUMBERS = ROOT / "firmware/objects/numbers.txt"  # names in the order of the numbers
EDS = GENERATED / "forceaxis.eds"
BIN = Path(sys.executable).parent

# CiA 301, table 44: data types, their sizes in bits and ranges.
DATA_TYPES = {
    "i8": (0x02, 8, -(2**7), 2**7 - 1),
    "i16": (0x03, 16, -(2**15), 2**15 - 1),
    "i32": (0x04, 32, -(2**31), 2**31 - 1),
    "u8": (0x05, 8, 0, 2**8 - 1),
    "u16": (0x06, 16, 0, 2**16 - 1),
    "u32": (0x07, 32, 0, 2**32 - 1),
}


CONTENT = tomllib.loads(TABLE.read_text())


def elements():
    """(name, entry, element, index, sub-index) of every object in the order of the numbers, by the
    comment in the table."""
    order = {name: n for n, name in enumerate(NUMBERS.read_text().split())}
    for o in sorted(CONTENT["object"], key=lambda o: order[o["name"]]):
        count = o.get("count", 1)
        for i in range(count):
            index, sub = o["index"], o.get("sub", 0)
            if "index_step" in o:
                index += i * o["index_step"]
            elif "per_index" in o:
                index, sub = index + i // o["per_index"], sub + i % o["per_index"]
            else:
                sub += i
            yield o["name"] + (f"_{i + 1}" if count > 1 else ""), o, i, index, sub


ELEMENTS = list(elements())
AT = {(index, sub): (name, o, i) for name, o, i, index, sub in ELEMENTS}
SPECIALS = {(s["index"], s.get("sub", 0)): s for s in CONTENT["special"]}
INDICES_WITH_SUBS = {index for index, sub in [*AT, *SPECIALS] if sub}


def highest_of(index):
    return max(sub for i, sub in [*AT, *SPECIALS] if i == index)


def default_of(o, i):
    return o["defaults"][i] if "defaults" in o else o.get("default", 0)


def range_of(o):
    _, _, low, high = DATA_TYPES[o["type"]]
    named = o.get("enum_of", o["name"])
    texts = next(e.get("enum") for e in CONTENT["object"] if e["name"] == named)
    if texts:
        return 0, len(texts) - 1
    # A list of values is the range of an object that is written, and of what shows that object.
    shown = o.get("values_of", o["name"])
    listed = next(
        (
            e.get("values", [])
            for e in CONTENT["object"]
            if e["name"] == shown and e["access"] == "rw"
        ),
        [],
    )
    if listed:
        low, high = min(value for value, _ in listed), max(value for value, _ in listed)
    return o.get("min", low), o.get("max", high)


def meaning_of(o):
    """The meaning with the bits of the value."""
    bits = o.get("bits", [])
    if "bits_of" in o:
        name, *keys = o["bits_of"]
        bits = next(e["bits"] for e in CONTENT["object"] if e["name"] == name)
        bits = [bit for bit in bits if bit[1] in keys]
    texts = []
    for number, _, text, *modes in bits:
        shown = ", ".join(map(str, modes[0])) if modes else ""
        plural = "s" if modes and len(modes[0]) > 1 else ""
        texts.append(f"bit {number} {text}" + (f" (mode{plural} {shown})" if shown else ""))
    return o["meaning"] + (": " + ", ".join(texts) if texts else "")


@pytest.fixture(scope="module")
def sheet():
    """The EDS as an ini file, without any CANopen library."""
    parser = configparser.ConfigParser(interpolation=None, strict=True)
    parser.optionxform = str
    parser.read(EDS)
    return parser


def section_of(index, sub):
    return f"{index:04X}sub{sub:X}" if index in INDICES_WITH_SUBS else f"{index:04X}"


# The data sheet, read independently.


def test_every_object_of_the_table_is_in_the_data_sheet(sheet):
    for name, o, i, index, sub in ELEMENTS:
        keys = sheet[section_of(index, sub)]
        number, _, lowest, highest = DATA_TYPES[o["type"]]
        assert int(keys["DataType"], 0) == number, name
        assert int(keys["ObjectType"], 0) == 7, name
        assert keys["AccessType"] == ("rwr" if o.get("mappable") == "sent" else o["access"]), name
        low, high = range_of(o)
        default = default_of(o, i)
        if o["kind"] == "command" and o["access"] == "rw" and not low <= default <= high:
            # It reads as a value that it does not accept: the sheet has no limits.
            assert "LowLimit" not in keys and "HighLimit" not in keys, name
        else:
            assert int(keys.get("LowLimit", str(lowest)), 0) == low, name
            assert int(keys.get("HighLimit", str(highest)), 0) == high, name
        if o["access"] == "wo":
            assert "DefaultValue" not in keys, name
            continue
        text = keys["DefaultValue"]
        assert text.startswith("$NODEID+") == o.get("node_id", False), name
        assert int(text.removeprefix("$NODEID+"), 0) == default, name


def test_the_data_sheet_has_nothing_else(sheet):
    listed = []
    for kind in ("MandatoryObjects", "OptionalObjects", "ManufacturerObjects"):
        count = int(sheet[kind]["SupportedObjects"])
        assert len(sheet[kind]) == count + 1
        listed += [int(sheet[kind][str(i)], 0) for i in range(1, count + 1)]
    assert len(listed) == len(set(listed))
    assert set(listed) == {index for index, _ in [*AT, *SPECIALS]}
    for name in sheet.sections():
        match = re.fullmatch(r"([0-9A-F]{4})(?:sub([0-9A-F]+))?", name)
        if not match:
            continue
        index, sub = int(match[1], 16), int(match[2] or "0", 16)
        assert index in listed
        if (index, sub) in SPECIALS and (sub > 0 or match[2] is None):
            special = SPECIALS[index, sub]
            domain = special["type"] == "domain"
            assert sheet[name]["AccessType"] == special.get("access", "ro")
            assert int(sheet[name]["DataType"], 0) == (0x0F if domain else 0x09)
            assert int(sheet[name]["ObjectType"], 0) == (2 if domain else 7)
        elif match[2] is None and index in INDICES_WITH_SUBS:
            subs = [s for s in sheet.sections() if s.startswith(f"{name}sub")]
            assert int(sheet[name]["SubNumber"], 0) == len(subs)
            assert int(sheet[name]["ObjectType"], 0) in (8, 9)
        elif (index, sub) not in AT:
            # Only the number of sub-indices is not in the table.
            assert sub == 0
            assert sheet[name]["AccessType"] == "const"
            assert int(sheet[name]["DefaultValue"]) == highest_of(index)


def test_the_lists_of_the_data_sheet_follow_the_ranges_of_cia_301(sheet):
    assert {sheet["MandatoryObjects"][k] for k in "123"} == {"0x1000", "0x1001", "0x1018"}
    for key, text in sheet["ManufacturerObjects"].items():
        assert key == "SupportedObjects" or 0x2000 <= int(text, 0) <= 0x5FFF
    for key, text in sheet["OptionalObjects"].items():
        outside = key == "SupportedObjects" or not 0x2000 <= int(text, 0) <= 0x5FFF
        assert outside
    assert set(sheet["DummyUsage"].values()) == {"1"}
    info = sheet["DeviceInfo"]
    assert (info["NrOfRXPDO"], info["NrOfTXPDO"]) == ("4", "4")
    assert info["BaudRate_1000"] == "1" and info["LSS_Supported"] == "1"
    assert int(info["ProductNumber"], 0) == default_of(*AT[0x1018, 2][1:])
    assert sheet["Comments"]["Line3"] == f"SHA-256 {table_hash()}"


def table_hash():
    """As the host's programs are built with it."""
    header = (GENERATED / "axis_objects_meta.h").read_text()
    return re.search(r'AXIS_OBJECTS_HASH "([0-9a-f]{64})"', header)[1]


def test_the_short_hash_begins_the_long_one():
    header = (GENERATED / "axis_objects.h").read_text()
    assert f"AXIS_OBJECTS_HASH32 UINT32_C(0x{table_hash()[:8]})" in header
    assert f'AXIS_OBJECTS_HASH_TEXT "{table_hash()[:8]}"' in header


def test_each_part_keeps_to_its_range():
    for name, o, _, index, _ in ELEMENTS:
        part = o.get("part", "axis")
        assert index < 0xA000, name
        if index < 0x2000:
            assert part == "canopen", name
        if index >= 0x6000:
            assert part == "drive", name


# CiA 301 and CiA 402 by their own names, typed from the standards: index, sub, name, data type.
STANDARD = [
    (0x1000, 0, "Device type", 7),
    (0x1001, 0, "Error register", 5),
    (0x1014, 0, "COB-ID EMCY", 7),
    (0x1017, 0, "Producer heartbeat time", 6),
    (0x1018, 1, "Vendor-ID", 7),
    (0x603F, 0, "Error code", 6),
    (0x6040, 0, "Controlword", 6),
    (0x6041, 0, "Statusword", 6),
    (0x605A, 0, "Quick stop option code", 3),
    (0x6060, 0, "Modes of operation", 2),
    (0x6061, 0, "Modes of operation display", 2),
    (0x6064, 0, "Position actual value", 4),
    (0x606C, 0, "Velocity actual value", 4),
    (0x6071, 0, "Target torque", 3),
    (0x6076, 0, "Motor rated torque", 7),
    (0x6077, 0, "Torque actual value", 3),
    (0x607A, 0, "Target position", 4),
    (0x607D, 1, "Min position limit", 4),
    (0x6081, 0, "Profile velocity", 7),
    (0x6098, 0, "Homing method", 2),
    (0x60FF, 0, "Target velocity", 4),
    (0x6502, 0, "Supported drive modes", 7),
]


@pytest.mark.parametrize(("index", "sub", "name", "data_type"), STANDARD)
def test_objects_of_the_standards_have_their_names_and_types(sheet, index, sub, name, data_type):
    keys = sheet[section_of(index, sub)]
    assert keys["ParameterName"] == name
    assert int(keys["DataType"], 0) == data_type


# Third-party programs.


@pytest.mark.parametrize("node", [1, 6, 127])
def test_dcfchk_accepts_the_data_sheet(node):
    done = subprocess.run(
        [BIN / "dcfchk", "-n", str(node), EDS], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_dcfgen_makes_the_files_of_a_master_for_ros2_canopen(tmp_path):
    """Each write that it gives to the axis is of an object that a master may write, in range."""
    for name in ("forceaxis.eds", "forceaxis-bus.yml"):
        shutil.copyfile(GENERATED / name, tmp_path / name)
    done = subprocess.run(
        [BIN / "dcfgen", "-v", "-r", "forceaxis-bus.yml"],
        capture_output=True, text=True, check=False, cwd=tmp_path,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "master.dcf").exists() and (tmp_path / "axis_1.bin").exists()
    line = r"^axis_1: writing (\d) bytes to 0x(\w+)/(\d+): ((?:\w\w ?)+)$"
    writes = re.findall(line, done.stdout, re.MULTILINE)
    assert len(writes) == done.stdout.count("axis_1: writing") > 30
    values = {}
    for size, index, sub, data in writes:
        at = int(index, 16), int(sub)
        name, o, _ = AT[at]
        number, bits, _, _ = DATA_TYPES[o["type"]]
        value = int.from_bytes(bytes.fromhex(data), "little")
        low, high = range_of(o)
        assert o["access"] == "rw" and 8 * int(size) == bits and number, name
        assert low <= value <= high, name
        values[at] = value
    # CiA 301: the axis (node 1) watches the heartbeat of node 127 for three of its 100 ms.
    assert values[0x1016, 1] == 127 << 16 | 300 and values[0x1017, 0] == 100
    # CiA 402: what the driver of ros2_canopen needs is mapped, each object once.
    mappings = [
        at for at in values if at[0] in range(0x1600, 0x1604) or at[0] in range(0x1A00, 0x1A04)
    ]
    mapped = [values[at] >> 16 for at in mappings if 0 < at[1] <= values[at[0], 0]]
    assert sorted(mapped) == [0x6040, 0x6041, 0x6060, 0x6061, 0x6064, 0x606C, 0x6071, 0x6077,
                              0x607A, 0x60FF]  # fmt: skip
    assert values[0x1800, 1] == 0x181 and values[0x1400, 1] == 0x201


def test_dcfchk_would_object(tmp_path):
    """The check above can fail: one limit beyond its type."""
    broken = tmp_path / "broken.eds"
    text = EDS.read_text()
    assert "HighLimit=2047\n" in text
    broken.write_text(text.replace("HighLimit=2047\n", "HighLimit=99999\n", 1))
    done = subprocess.run(
        [BIN / "dcfchk", "-n", "1", broken], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1


def test_dcfgen_makes_a_master_of_the_data_sheet(tmp_path):
    (tmp_path / "bus.yml").write_text(f"""\
master:
  node_id: 32
  sync_period: 2000
  heartbeat_producer: 100
axis_1:
  dcf: {EDS}
  node_id: 1
  heartbeat_consumer: true
  heartbeat_producer: 100
  error_behavior: {{1: 1}}
  rpdo:
    1:
      cob_id: auto
      mapping:
        - {{index: 0x6040, sub_index: 0}}
        - {{index: 0x6071, sub_index: 0}}
  tpdo:
    3: {{cob_id: auto, transmission: 1}}
  sdo:
    - {{index: 0x6076, sub_index: 0, value: 50000}}
axis_2:
  dcf: {EDS}
  node_id: 2
""")
    done = subprocess.run(
        [BIN / "dcfgen", "-v", "-r", "-d", tmp_path, tmp_path / "bus.yml"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    # No complaint about missing objects or objects that cannot be mapped.
    assert "axis" not in done.stderr, done.stderr
    written = re.findall(r"axis_1: writing \d bytes to 0x(\w{4})/(\d+): ([0-9A-F ]+)", done.stdout)
    assert ("1016", "1", "2C 01 20 00") in written
    assert ("6076", "0", "50 C3 00 00") in written
    assert ("1600", "2", "10 00 71 60") in written
    assert ("1802", "1", "81 03 00 00") in written
    assert (tmp_path / "axis_1.bin").stat().st_size > 0
    master = (tmp_path / "master.dcf").read_text()
    assert "NodeID=32" in master


def test_python_canopen_finds_every_object():
    dictionary = canopen.import_od(str(EDS), node_id=5)
    for name, o, i, index, sub in ELEMENTS:
        found = dictionary[index][sub] if index in INDICES_WITH_SUBS else dictionary[index]
        assert found.data_type == DATA_TYPES[o["type"]][0], name
        assert len(found) == DATA_TYPES[o["type"]][1], name
        assert found.readable == (o["access"] != "wo"), name
        assert found.writable == (o["access"] != "ro"), name
        if o["access"] != "wo":
            assert found.default == default_of(o, i) + 5 * o.get("node_id", False), name
        # By name too: no name hides another.
        if index in INDICES_WITH_SUBS:
            assert dictionary[dictionary[index].name][found.name] is found, name
        else:
            assert dictionary[found.name] is found, name
    assert dictionary["Controlword"].index == 0x6040
    assert dictionary["Identity object"]["Product code"].default == default_of(*AT[0x1018, 2][1:])
    assert dictionary.device_information.nr_of_TXPDO == 4
    assert 1_000_000 in dictionary.device_information.allowed_baudrates


def test_python_canopen_reads_the_default_pdos():
    """A node made from the sheet, which answers nothing, maps its PDOs from the defaults."""
    node = canopen.Network().add_node(canopen.RemoteNode(3, str(EDS)))
    for pdos, first in ((node.rpdo, 0x1400), (node.tpdo, 0x1800)):
        assert len(pdos) == 4
        for i in range(4):
            names = mapped_names(first + 0x200 + i)
            pdos[i + 1].read(from_od=True)
            assert [v.od.index for v in pdos[i + 1]] == [n[0] for n in names]
            cob = default_of(*AT[first + i, 1][1:])
            assert pdos[i + 1].cob_id == (cob & 0x7FF) + 3
            assert pdos[i + 1].enabled == (not cob >> 31)


def mapped_names(index):
    """[(index, sub, name)] of a default mapping."""
    found = []
    for sub in range(1, default_of(*AT[index, 0][1:]) + 1):
        value = default_of(*AT[index, sub][1:])
        target = (value >> 16, value >> 8 & 0xFF)
        name, o, _ = AT[target]
        assert value & 0xFF == DATA_TYPES[o["type"]][1], name
        found.append((*target, name))
    return found


# The DBC.


@pytest.fixture(scope="module")
def dbc():
    return cantools.database.load_file(GENERATED / "forceaxis.dbc", strict=True)


@pytest.mark.parametrize("node", range(1, 7))
@pytest.mark.parametrize(("kind", "first"), [("RPDO", 0x1400), ("TPDO", 0x1800)])
@pytest.mark.parametrize("i", range(4))
def test_cantools_knows_each_default_pdo(dbc, node, kind, first, i):
    names = mapped_names(first + 0x200 + i)
    cob = (default_of(*AT[first + i, 1][1:]) & 0x7FF) + node
    message = dbc.get_message_by_frame_id(cob)
    assert message.name == f"AXIS{node}_{kind}{i + 1}"
    assert message.senders == ["HOST" if kind == "RPDO" else f"AXIS{node}"]
    assert [s.name for s in message.signals] == [name for _, _, name in names]
    data, expected = b"", {}
    for index, sub, name in names:
        _, o, _ = AT[index, sub]
        _, bits, low, high = DATA_TYPES[o["type"]]
        signal = message.get_signal_by_name(name)
        assert (signal.length, signal.is_signed) == (bits, low < 0), name
        assert signal.byte_order == "little_endian"
        assert signal.scale == pytest.approx(o.get("scale", 1))
        assert (signal.unit or "1") == o["unit"]
        raw = 3 if signal.choices else (-77 if low < 0 else high - 5)
        data += raw.to_bytes(bits // 8, "little", signed=low < 0)
        expected[name] = raw * o.get("scale", 1)
    assert len(data) == message.length
    assert message.decode(data, decode_choices=False) == pytest.approx(expected)
    assert message.encode(expected, strict=False) == data


def test_cantools_names_modes_and_states(dbc):
    frame = bytes([0x37, 0x06, 0x04])  # TPDO1: operation enabled, force
    assert dbc.decode_message("AXIS2_TPDO1", frame)["modes_of_operation_display"] == "force"
    assert dbc.decode_message("AXIS2_TPDO1", b"\0\0\xf8")["modes_of_operation_display"] == (
        "impedance"
    )
    assert dbc.decode_message(0x706, b"\x05") == {"nmt_state": "operational"}
    assert dbc.decode_message(0x000, b"\x81\x03") == {"nmt_command": "reset_node", "nmt_node": 3}
    assert dbc.decode_message(0x084, bytes.fromhex("1123210600000000"))["emcy_code"] == 0x2311
    lost = dbc.decode_message(0x081, bytes.fromhex("3081110800000000"))
    assert lost == {"emcy_code": "heartbeat_lost", "emcy_register": 0x11, "emcy_info": 8}
    assert dbc.get_message_by_frame_id(0x80).length == 0
    assert dbc.get_message_by_name("AXIS1_TPDO1").cycle_time == default_of(*AT[0x1800, 5][1:])


GATEWAY = CONTENT["gateway"]
MAPPED = [tpdo["objects"] for tpdo in GATEWAY["tpdo"]]


@pytest.fixture(scope="module")
def gateway_dbc():
    return cantools.database.load_file(GENERATED / "forceaxis-gateway.dbc", strict=True)


@pytest.mark.parametrize("node", range(1, 7))
def test_cantools_knows_each_pdo_of_a_gateway(gateway_dbc, dbc, node):
    for i, names in enumerate(MAPPED, 1):
        message = gateway_dbc.get_message_by_frame_id(0x80 + 0x100 * i + node)
        assert (message.name, message.senders) == (f"AXIS{node}_TPDO{i}", [f"AXIS{node}"])
        assert [s.name for s in message.signals] == names
    # The last two carry something else than by default: one DBC cannot describe both.
    for i, differs in enumerate((False, False, True, True), 1):
        default = [s.name for s in dbc.get_message_by_name(f"AXIS{node}_TPDO{i}").signals]
        assert (default != MAPPED[i - 1]) == differs


def test_a_frame_of_a_bus_with_a_gateway_has_one_meaning(gateway_dbc, dbc):
    frames = {m.frame_id: m.name for m in gateway_dbc.messages}
    assert len(frames) == len(gateway_dbc.messages)
    more = {frame: name for frame, name in frames.items() if frame not in {
        m.frame_id for m in dbc.messages
    }}  # fmt: skip
    # Four SDO identifiers of each node, in the order of the gateway's options.
    ways = [f"SDO_{bus}_{way}" for bus in ("MODBUS", "LCM") for way in ("REQUEST", "ANSWER")]
    assert more.pop(0x700 + GATEWAY["node_id"]) == "GATEWAY_HEARTBEAT"
    assert [more[frame] for frame in sorted(more)] == [
        f"AXIS{node}_{way}" for node in range(1, 7) for way in ways
    ]
    assert sorted(more) == list(range(0x680, 0x680 + 24))


def test_the_configuration_of_a_node_behind_a_gateway():
    """python-canopen makes the PDOs from the DCF alone, for another node than the file names."""
    dcf = GENERATED / "forceaxis-gateway.dcf"
    done = subprocess.run(
        [BIN / "dcfchk", "-n", "5", dcf], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    node = canopen.Network().add_node(canopen.RemoteNode(5, str(dcf)))
    node.tpdo.read(from_od=True)
    for i, (tpdo, names) in enumerate(zip(GATEWAY["tpdo"], MAPPED, strict=True), 1):
        found = node.tpdo[i]
        assert (found.cob_id, found.enabled) == (0x80 + 0x100 * i + 5, True)
        assert found.trans_type == tpdo["transmission"]
        entries = {name: (o["index"], o.get("sub", 0)) for name, o, *_ in ELEMENTS}
        assert [(v.index, v.subindex) for v in found.map] == [entries[name] for name in names]
    # Nothing but the values of the four TPDOs differs from the data sheet.
    sheet, configured = (
        [t for t in f.read_text().splitlines() if not t.startswith("ParameterValue=")]
        for f in (EDS, dcf)
    )
    start = configured.index("[DeviceComissioning]")
    del configured[start : configured.index("[DummyUsage]")]
    assert [t for t in configured if t not in sheet] == [
        "FileName=forceaxis-gateway.dcf", "LastEDS=forceaxis.eds",
    ]  # fmt: skip
    assert [t for t in sheet if t not in configured] == ["FileName=forceaxis.eds"]


def test_dcfgen_makes_a_listener_of_a_bus_with_a_gateway(tmp_path):
    """From the DCF, a master receives all four TPDOs; from the EDS only those that are on."""
    for name in ("forceaxis-gateway.dcf", "forceaxis.eds"):
        text = f'master: {{node_id: 10}}\naxis_2: {{dcf: "{GENERATED / name}", node_id: 2}}\n'
        (tmp_path / "bus.yml").write_text(text)
        done = subprocess.run(
            [BIN / "dcfgen", "-r", "-d", tmp_path, tmp_path / "bus.yml"],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert (done.returncode, done.stderr) == (0, "")
        master = configparser.ConfigParser(interpolation=None)
        master.read(tmp_path / "master.dcf")
        carried = {}
        for i in range(int(master["DeviceInfo"]["NrOfRxPDO"])):
            cob, mapping = master[f"{0x1400 + i:X}sub1"], dict(master[f"{0x1600 + i:X}Value"])
            del mapping["nrofentries"]
            bits = [int(entry, 0) & 0xFF for entry in mapping.values()]
            carried[int(cob["DefaultValue"], 0) & 0x7FF] = bits
        objects = {name: o for name, o, *_ in ELEMENTS}
        expected = {
            0x82 + 0x100 * i: [DATA_TYPES[objects[name]["type"]][1] for name in names]
            for i, names in enumerate(MAPPED, 1)
            if i < 3 or name.endswith("dcf")
        }
        assert carried == expected


# The Modbus map.


@pytest.fixture(scope="module")
def modbus():
    with open(GENERATED / "forceaxis-modbus.csv", newline="") as file:
        return list(csv.DictReader(file))


def test_no_registers_overlap(modbus):
    for space in ("holding", "input", "coil", "discrete"):
        rows = [(int(r["address"]), int(r["registers"]), r["name"]) for r in modbus
                if r["space"] == space]  # fmt: skip
        assert rows, space
        assert rows == sorted(rows)
        for (first, width, name), (second, _, other) in itertools.pairwise(rows):
            assert first + width <= second, f"{space}: {name} and {other}"
        assert rows[-1][0] + rows[-1][1] <= 0x10000


def test_the_map_has_the_registers_of_the_table(modbus):
    expected = {}
    for name, o, i, _, _ in ELEMENTS:
        if "modbus" in o:
            width = 2 if o["type"] in ("u32", "i32") else 1
            space = "holding" if o["access"] == "rw" else "input"
            low, high = range_of(o)
            row = (space, o["modbus"] + i * width, width, o["type"], o["access"], low, high)
            expected[name, space] = (*row, float(o.get("scale", 1)), o["unit"], meaning_of(o))
    found = {
        (r["name"], r["space"]): (
            r["space"], int(r["address"]), int(r["registers"]), r["type"], r["access"],
            int(r["min"]), int(r["max"]), float(r["scale"]), r["unit"], r["meaning"],
        )
        for r in modbus
        if r["space"] in ("holding", "input")
    }  # fmt: skip
    assert found == expected


# BUSES: the registers that every axis has at the same place; holding and input.
FIXED = {
    "holding": {0: "controlword", 1: "modes_of_operation", 2: "target_position",
                4: "target_velocity", 6: "target_force", 7: "command_source", 8: "watchdog",
                0x1F0: "store_parameters", 0x1F1: "restore_defaults", 0x1FF: "modbus_word_order"},
    "input": {0: "statusword", 1: "modes_of_operation_display", 2: "error_code",
              3: "position_actual", 5: "velocity_actual", 7: "force_actual", 8: "force_raw",
              9: "dac_code", 10: "tick_count", 12: "overruns", 13: "limit_reason"},
}  # fmt: skip


@pytest.mark.parametrize("space", FIXED)
def test_fixed_registers(modbus, space):
    found = {int(r["address"]): r["name"] for r in modbus if r["space"] == space}
    assert {a: found.get(a) for a in FIXED[space]} == FIXED[space]


# CiA 402, statusword: bits 0 to 15, as the map names them.
STATUSWORD = [
    "ready_to_switch_on",
    "switched_on",
    "operation_enabled",
    "fault",
    "voltage_enabled",
    "quick_stop",
    "switch_on_disabled",
    "warning",
    "manufacturer_8",
    "remote",
    "target_reached",
    "internal_limit_active",
    "mode_12",
    "mode_13",
    "manufacturer_14",
    "manufacturer_15",
]


def in_header(prefix):
    """The names of the C headers, in lower case, and values."""
    header = "".join(path.read_text() for path in GENERATED.glob("*.h"))
    found = re.findall(rf"\bAXIS_{prefix}_(\w+) = (\d+)", header)
    return {name.lower(): int(value) for name, value in found}


# CiA 301 and 402, typed from the standards; FF01h and above are ours.
ERROR_CODES = {
    "supply_wrong": 0x5100, "brownout_reset": 0x5110, "board_unfit": 0x5200,
    "output_wrong": 0x5210, "clock_wrong": 0x5220, "core_fault": 0x6000,
    "none": 0x0000, "store_failed": 0x5530, "source_lost": 0x6010, "main_loop_lost": 0x6100,
    "parameter_refused": 0x6320, "adc_range": 0x7300, "sensor_invalid": 0x7305,
    "overspeed": 0x7310, "can_overrun": 0x8110,
    "can_passive": 0x8120, "heartbeat_lost": 0x8130, "can_off": 0x8140, "pdo_short": 0x8210,
    "pdo_long": 0x8220, "sync_length": 0x8240, "pdo_timeout": 0x8250, "following_error": 0x8611,
    "limit_switches": 0x8612, "contact_lost": 0xFF01, "force_saturated": 0xFF02,
    "drive_not_ready": 0xFF1F, "drive_lost": 0xFF20, "drive_fault": 0xFF21,
    "position_old": 0xFF22, "force_old": 0xFF23,
    "limit_cycle": 0xFF03, "overrun": 0xFF04, "enable_lost": 0xFF05, "force_max": 0xFF06,
    "watchdog_reset": 0xFF07, "stopped": 0xFF08, "owner_unsupervised": 0xFF09,
    "duplicate_node": 0xFF0A, "no_motion": 0x7121, "force_sensor_failed": 0xFF0B,
    "current_sensor_failed": 0xFF0C, "not_standing": 0xFF0D, "amplifier_offset": 0xFF0E,
    "encoder_reversed": 0xFF0F, "runaway": 0xFF10, "force_reversed": 0xFF11,
    "position_gain_zero": 0xFF12, "law_uncertified": 0xFF13, "contact_travel": 0xFF14,
    "no_contact": 0xFF15, "contact_unstable": 0xFF16, "gain_halved": 0xFF17,
    "force_railed": 0xFF1A, "force_stuck": 0xFF1B,
    "calibration_expired": 0xFF1C, "force_disconnected": 0xFF1D, "force_jump": 0xFF1E,
}  # fmt: skip


def test_error_codes_are_those_of_the_standards():
    assert in_header("ERROR_CODE") == ERROR_CODES
    assert set(AT[0x2021, 0][1]["enum"]) <= set(ERROR_CODES)  # each fault has one of its name


@pytest.mark.parametrize("kind", ["coil", "discrete"])
def test_bits_are_those_of_the_map(modbus, kind):
    in_c = in_header(kind.upper())
    assert in_c.pop("count") == len(in_c)
    assert {r["name"]: int(r["address"]) for r in modbus if r["space"] == kind} == in_c
    if kind == "discrete":
        assert [in_c[name] for name in STATUSWORD] == list(range(16))


# The manual's pages.


def test_the_manual_has_every_object_and_register():
    page = (ROOT / "docs/objects/objects.md").read_text()
    man = (ROOT / "docs/objects/forceaxis-objects.7").read_text().replace("\\-", "-")
    modbus = (ROOT / "docs/objects/modbus.md").read_text()
    for name, o, i, index, sub in ELEMENTS:
        if i == 0:
            shown = name if o.get("count", 1) == 1 else f"{o['name']}_1..{o['count']}"
            assert f"| `{shown}` | {index:04x}:{sub:x}" in page
            assert f".B {shown}\n{index:04x}:{sub:x}" in man
        if "modbus" in o:
            assert f"| `{name}` |" in modbus
    # Every row of a table has as many cells as its header.
    for text in (page, modbus):
        for head, body in re.findall(r"^(\|.*)\n\| ---.*\n((?:\|.*\n)+)", text, re.M):
            for row in body.splitlines():
                assert row.count("|") == head.count("|"), row


def test_the_man_page_is_clean():
    groff = shutil.which("groff")
    assert groff, "groff is missing: tools/setup --tests installs groff-base"
    done = subprocess.run(
        [groff, "-man", "-ww", "-b", "-Tutf8", ROOT / "docs/objects/forceaxis-objects.7"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "force_gain" in re.sub(r".\x08", "", done.stdout)


# No object is needed but those of a table.

SMALL = """
[[object]]
name = "alone"
kind = "signal"
meaning = ".begins with a dot; has -dashes"
type = "u8"
unit = "1"
access = "ro"
index = 0x2001

[[object]]
name = "pairs"
kind = "parameter"
meaning = "two to an index, no [[record]] names it"
type = "i16"
unit = "N"
scale = 0.5
min = -4
max = 4
access = "rw"
in_cycle = "free"
index = 0x2002
sub = 1
per_index = 2
count = 4

[[object]]
name = "steps"
kind = "signal"
meaning = "one to an index"
type = "u32"
unit = "1"
access = "ro"
index = 0x2010
index_step = 2
count = 3
"""


def test_a_table_of_few_objects(tmp_path):
    (tmp_path / "firmware/objects").mkdir(parents=True)
    (tmp_path / "firmware/objects/axis_objects.toml").write_text(SMALL)
    released = "firmware/objects/released"
    shutil.copytree(ROOT / released, tmp_path / released)
    generator = ROOT / "tools/gen_objects.py"
    done = subprocess.run(
        [sys.executable, generator, "--root", tmp_path], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    generated = tmp_path / "firmware/objects/generated"
    dictionary = canopen.import_od(str(generated / "forceaxis.eds"))
    assert [hex(i) for i in dictionary if i >= 0x1000] == [
        "0x2001", "0x2002", "0x2003", "0x2010", "0x2012", "0x2014",
    ]  # fmt: skip
    assert (dictionary["Pairs 2"].index, dictionary["Pairs 2"]["Pairs 1"].min) == (0x2003, -4)
    assert dictionary["Steps 3"].index == 0x2014
    assert len(cantools.database.load_file(generated / "forceaxis.dbc").messages) == 1 + 6


# The tables of the firmware.

PROBE = """
#include <stdio.h>
#include "firmware/objects/generated/axis_objects.h"
int main(void) {
  for (int i = 0; i < AXIS_ADDRESSES_COUNT; ++i) {
    const axis_address_t *a = &axis_addresses[i];
    printf("address %d %d %d %d\\n", a->index, a->sub, a->what, a->value);
  }
  for (int i = 0; i < AXIS_HOLDING_COUNT; ++i)
    printf("holding %d %d\\n", axis_holding[i].first, axis_holding[i].object);
  for (int i = 0; i < AXIS_INPUT_COUNT; ++i)
    printf("input %d %d\\n", axis_input[i].first, axis_input[i].object);
  for (int i = 1; i < AXIS_OBJ_COUNT; ++i) {
    const axis_object_t *o = &axis_objects[i];
    printf("object %d %lu %d %d %d\\n", i, (unsigned long)(uint32_t)o->initial, o->stored,
           o->node_id, o->access);
  }
  return 0;
}
"""


def test_the_firmware_has_the_same_addresses(tmp_path):
    """The firmware's tables, compiled and printed; objects count from 1 in the table's order."""
    (tmp_path / "probe.c").write_text(PROBE)
    source = GENERATED / "axis_objects.c"
    command = ["cc", "-std=c11", f"-I{ROOT}", tmp_path / "probe.c", source]
    subprocess.run([*command, "-o", tmp_path / "probe"], check=True)
    shown = subprocess.run([tmp_path / "probe"], capture_output=True, text=True, check=True).stdout
    found = {kind: [] for kind in ("address", "holding", "input", "object")}
    for line in shown.splitlines():
        kind, *numbers = line.split()
        found[kind].append(tuple(map(int, numbers)))
    number_of = {name: n for n, (name, *_) in enumerate(ELEMENTS, 1)}

    addresses = {(index, sub): (0, number_of[name]) for (index, sub), (name, *_) in AT.items()}
    for index in INDICES_WITH_SUBS:
        addresses.setdefault((index, 0), (1, highest_of(index)))
    for special in CONTENT["special"]:
        is_domain, is_read = special["type"] == "domain", special.get("access", "ro") == "ro"
        what = (3 if is_read else 4) if is_domain else 2
        addresses[special["index"], special.get("sub", 0)] = (what, special["index"])
    assert found["address"] == [(*at, *addresses[at]) for at in sorted(addresses)]

    registers = {"holding": [], "input": []}
    for name, o, i, _, _ in ELEMENTS:
        if "modbus" in o:
            width = 2 if o["type"] in ("u32", "i32") else 1
            space = "holding" if o["access"] == "rw" else "input"
            registers[space].append((o["modbus"] + i * width, number_of[name]))
    for space, expected in registers.items():
        assert found[space] == sorted(expected)

    for (name, o, i, _, _), line in zip(ELEMENTS, found["object"], strict=True):
        stored = o.get("stored", o["kind"] == "parameter")
        access = ("rw", "ro", "wo").index(o["access"])
        initial = default_of(o, i) % 2**32
        assert line == (number_of[name], initial, stored, o.get("node_id", False), access), name


# The command line.


def forceaxis(*arguments):
    return verbs.forceaxis(*arguments)


def test_the_verb_writes_the_files(tmp_path):
    names = {"eds": "forceaxis.eds", "dbc": "forceaxis.dbc", "ros2": "forceaxis-bus.yml",
             "gateway_dbc": "forceaxis-gateway.dbc", "gateway_dcf": "forceaxis-gateway.dcf",
             "modbus": "forceaxis-modbus.csv"}  # fmt: skip
    options = [text for kind in names for text in (f"--{kind.replace('_', '-')}", tmp_path / kind)]
    done = forceaxis("objects", *options, "--json")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["objects_hash"] == table_hash()
    for kind, name in names.items():
        assert result["written"][kind] == str(tmp_path / kind)
        assert (tmp_path / kind).read_bytes() == (GENERATED / name).read_bytes()


def test_the_verb_says_where_a_file_cannot_go(tmp_path):
    done = forceaxis("objects", "--eds", tmp_path / "none/x.eds")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1 and "x.eds" in done.stderr


def test_the_verb_shows_addresses():
    done = forceaxis("objects", "target_f")
    assert re.search(r"^target_force +6071:0 +h 0006 +rw ", done.stdout), done.stdout
    (row,) = json.loads(forceaxis("objects", "rpdo_mapping_10", "--json").stdout)
    assert (row["index"], row["sub"], row["modbus"]) == (0x1601, 2, -1)


def test_the_verb_tells_everything_of_one_object():
    shown = forceaxis("objects", "modes_of_operation").stdout
    head, _, others = shown.partition("\nmodes_of_operation_display ")
    assert others
    for text in ("6060h, sub-index 0", "holding register 0x0001", "-8 impedance", "may be mapped"):
        assert text in head
    shown = forceaxis("objects", "tpdo_cob_id_2").stdout
    assert "1801h, sub-index 1: COB-ID used by TPDO" in shown
    assert "+ node id" in shown and "not reached" in shown


@pytest.mark.parametrize(
    "args", [["nosuchthing"], ["force", "--eds", "a.eds"], ["--eds", "a", "--dbc", "./a"]]
)
def test_what_would_be_ignored_is_refused(tmp_path, monkeypatch, args):
    monkeypatch.chdir(tmp_path)
    done = forceaxis("objects", *args)
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
