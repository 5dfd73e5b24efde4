"""Logs of CAN frames with their names from a DBC or an EDS. The frames are packed here, from known
arrays, into the layouts of each program; every expected number is one of these arrays."""

import importlib.util
import struct

import can
import cantools
import numpy as np
import pytest
from forceaxis import paths
from forceaxis.recordings import signal_recording
from verbs import forceaxis

BEGIN_S = 1_778_767_384
STEPS = np.arange(100)
FORCE_N = np.round(-140 + 5.5 * STEPS, 1)
TRAVEL_MM = np.round(0.25 * STEPS, 3)
DBC = f"""\
VERSION ""
NS_ :
BS_:
BU_: Press
BO_ 385 Press: 6 Press
 SG_ Force : 0|16@1- (0.5,10) [0|0] "N" Press
 SG_ Travel : 23|32@0- (0.001,0) [0|0] "mm" Press
BO_ {0x98FF0000} Mux: 3 Press
 SG_ which M : 0|8@1+ (1,0) [0|0] "" Press
 SG_ current m1 : 8|16@1- (0.01,0) [0|0] "A" Press
 SG_ heat m2 : 8|16@1- (1,0) [0|0] "degC" Press
"""
MAPS = ("--map", "force=Force,position=Press.Travel,current=current")


def frames(buses=("can0",)):
    """Returns (time in us, bus, identifier, is extended, data), one message every 5 ms."""
    return sorted(_frames(buses))


def _frames(buses):
    for k in STEPS:
        press = struct.pack("<h", round((FORCE_N[k] - 10) / 0.5)) + struct.pack(
            ">i", round(1e3 * TRAVEL_MM[k])
        )
        mux = struct.pack("<Bh", 1 + k % 2, 100 * k)
        for bus in buses:
            at_us = int(10_000 * k) + 100 * (bus != buses[0])
            yield at_us, bus, 0x181, False, press
            yield at_us + 5000, bus, 0x18FF0000, True, mux
            yield at_us + 5001, bus, 0x701, False, b"\5"


def name(number, is_extended):
    return f"{number:0{8 if is_extended else 3}X}"


def candump_file(folder, form="{s}.{us:06}", **kw):
    lines = [
        f"({form.format(s=BEGIN_S + at // 10**6, us=at % 10**6)}) {bus} {name(i, x)}"
        f"#{data.hex().upper()}"
        for at, bus, i, x, data in frames(**kw)
    ]
    (folder / "candump.log").write_text("\n".join(lines) + "\n")
    return folder / "candump.log"


def screen(folder, stamp="({t:.6f}) ", flags="", ascii_="", begin=0):
    lines = [
        f" {stamp.format(t=begin + at / 1e6)} {bus}  {flags}{name(i, x)}   [{len(data)}]  "
        f"{data.hex(' ').upper()}{ascii_}"
        for at, bus, i, x, data in frames()
    ]
    (folder / "screen.txt").write_text("\n".join(lines) + "\n")
    return folder / "screen.txt"


def dated(folder):
    lines = [
        f" (2026-05-14 14:03:{4 + at // 10**6:02}.{at % 10**6:06})  {bus}  {name(i, x)}   "
        f"[{len(data)}]  {data.hex(' ').upper()}"
        for at, bus, i, x, data in frames()
    ]
    (folder / "screen.txt").write_text("\n".join(lines) + "\n")
    return folder / "screen.txt"


def library(suffix):
    def write(folder):
        with can.Logger(str(folder / f"log.{suffix}")) as log:
            for at, _, number, is_extended, data in frames():
                log.on_message_received(can.Message(
                    timestamp=BEGIN_S + at / 1e6, arbitration_id=number, data=data,
                    is_extended_id=is_extended, channel=0,
                ))  # fmt: skip
        return folder / f"log.{suffix}"

    return write


def asc(folder, head=("base hex  timestamps absolute",), base="x", request=False):
    """An asc file of CANalyzer: its first frame follows the head."""
    lines = ["date Thu May 14 02:03:04.000 pm 2026", *head]
    for at, _, number, is_extended, data in frames():
        text = f"{number:X}" if base == "x" else str(number)
        cells = " ".join(f"{b:02X}" if base == "x" else str(b) for b in data)
        row = f"{at / 1e6:11.6f} 1  {text + 'x' * is_extended:15} {{}}   d {len(data)} {cells}"
        lines += [row.format("TxRq")] * request + [row.format("Tx" if request else "Rx")]
    (folder / "log.asc").write_text("\n".join(lines) + "\n")
    return folder / "log.asc"


def asc_with_requests(folder):
    return asc(folder, request=True)


def decimal_asc(folder):
    return asc(folder, ("base dec  timestamps absolute", "internal events logged"), "d")


def trc(folder, version="1.1"):
    """A trc file of PCAN-View, as its maker describes versions 1.0, 1.1 and 2.0."""
    head = [f";$FILEVERSION={version}", ";$STARTTIME=46156.585474537", ";"]
    if version == "1.0":
        head = [";####", ";   C:\\log.trc", ";   Start time: 14.05.2026 14:03:05.000.0", ";"]
    if version == "2.0":
        head.insert(2, ";$COLUMNS=N,O,T,I,d,l,D")
    rows = []
    for k, (at, _, number, is_extended, data) in enumerate(frames(), 1):
        cells = data.hex(" ").upper()
        text = name(number, True) if is_extended else f"{number:04X}"
        if version == "1.0":
            rows.append(f"{k:6}) {at / 1e3:9.0f} {text:>8}  {len(data)}  {cells}")
        elif version == "1.1":
            rows.append(f"{k:6}) {at / 1e3:11.1f}  Rx {text:>12}  {len(data)}  {cells}")
        else:
            rows.append(f"{k:7} {at / 1e3:13.3f} DT {text:>12} Rx {len(data)}    {cells}")
    (folder / "log.trc").write_text("\n".join([*head, *rows]) + "\n")
    return folder / "log.trc"


FILES = {
    "candump -l": candump_file,
    "candump -t a": lambda folder: screen(folder, begin=BEGIN_S),
    "candump -t z -x": lambda folder: screen(folder, flags="RX - -  "),
    "candump -a": lambda folder: screen(folder, ascii_="   '.%'"),
    "candump -t A": dated,
    "asc of python-can": library("asc"),
    "asc of CANalyzer": asc,
    "asc with requests": asc_with_requests,
    "decimal asc": decimal_asc,
    "blf": library("blf"),
    "trc of python-can": library("trc"),
    "trc 1.0": lambda folder: trc(folder, "1.0"),
    "trc 1.1": trc,
    "trc 2.0": lambda folder: trc(folder, "2.0"),
}


def run(folder, file, *words):
    (folder / "bus.dbc").write_text(DBC)
    return forceaxis("recording", "import", file, *words, "--out", folder / "made")


def imported(folder, file, *words):
    done = run(folder, file, *words)
    assert done.returncode == 0, done.stderr
    return signal_recording.read(folder / "made.npz"), done.stdout


def refused(folder, file, *words):
    done = run(folder, file, *words)
    assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stdout + done.stderr
    assert not list(folder.glob("made*"))
    return done.stderr


@pytest.mark.parametrize("kind", FILES)
def test_a_log_of_each_program_has_the_signals_of_the_dbc(tmp_path, kind):
    file = FILES[kind](tmp_path)
    found, said = imported(tmp_path, file, "--dbc", tmp_path / "bus.dbc", *MAPS)
    np.testing.assert_allclose(found["force"].values, FORCE_N, atol=1e-12)
    np.testing.assert_allclose(found["position"].values, TRAVEL_MM / 1e3, atol=1e-15)
    np.testing.assert_allclose(found["current"].values, STEPS[::2])  # every second frame has it
    assert [round(s.rate_hz, 3) for s in found] == [100, 100, 50]
    late_s = found["current"].time_s[0] - found["force"].time_s[0]
    assert late_s == pytest.approx(0.005, abs=3e-7)  # python-can writes floats since 1970
    assert "frames without a name: 0x701 (100 frames)" in said
    assert ("100 requests" in said or "300 requests" in said) == (kind == "asc with requests")
    assert found["force"].rate_hz == pytest.approx(100, rel=1e-7)


def test_frames_of_several_buses_are_not_mixed(tmp_path):
    file = candump_file(tmp_path, buses=("can0", "vcan1"))
    dbc = ("--dbc", tmp_path / "bus.dbc")
    said = refused(tmp_path, file, *dbc, "--map", "force=Force")
    assert "can0/Press/Force" in said and "vcan1/Press/Force" in said
    found, _ = imported(tmp_path, file, *dbc, "--map", "force=can0/Press/Force,x=vcan1/Press/Force")
    assert found["x"].time_s[0] - found["force"].time_s[0] == pytest.approx(1e-4, abs=1e-9)


def test_a_log_without_a_dbc_says_what_it_needs(tmp_path):
    file = candump_file(tmp_path)
    said = refused(tmp_path, file, "--map", "force=Force")
    assert "--dbc: expected the file with names" in said and "0x181 (100 frames)" in said
    (tmp_path / "t.csv").write_text("t_s,F_N\n" + "".join(f"{k},{k}\n" for k in range(20)))
    said = refused(tmp_path, tmp_path / "t.csv", "--dbc", tmp_path / "bus.dbc", *MAPS)
    assert "--dbc: expected a log of candump, Vector or PEAK" in said


def test_wrong_files_of_names_are_one_line(tmp_path):
    file = candump_file(tmp_path)
    (tmp_path / "wrong").write_text("[FileInfo]\n[1800]\nnothing\n")
    for kind in ("dbc", "eds"):
        for name in ("none", "wrong"):
            assert name in refused(tmp_path, file, f"--{kind}", tmp_path / name, *MAPS)


def test_frames_of_an_unknown_multiplexer_are_left_out_and_named(tmp_path):
    file = candump_file(tmp_path)
    lines = [line.replace("18FF0000#02", "18FF0000#07") for line in file.read_text().splitlines()]
    file.write_text("\n".join(lines) + "\n")
    found, said = imported(tmp_path, file, "--dbc", tmp_path / "bus.dbc", *MAPS, "--map", "x=which")
    np.testing.assert_allclose(found["current"].values, STEPS[::2])
    np.testing.assert_allclose(found["force"].values, FORCE_N, atol=1e-12)
    np.testing.assert_array_equal(found["x"].values, np.where(STEPS % 2, 7, 1))
    assert "Mux: 50 frames with a multiplexer that the DBC does not have, left out" in said


def test_two_files_of_names_may_repeat_what_does_not_differ(tmp_path):
    file = candump_file(tmp_path)
    press, mux = DBC.index("BO_ 385"), DBC.index(f"BO_ {0x98FF0000}")
    other = 'BO_ 2015 Diag: 8 Press\n SG_ Req : 0|8@1+ (1,0) [0|0] "{}" Press\n'

    def import_(first, second):
        (tmp_path / "a.dbc").write_text(DBC[:mux] + first)
        (tmp_path / "b.dbc").write_text(DBC[:press] + DBC[mux:] + second)
        return "--dbc", tmp_path / "a.dbc", "--dbc", tmp_path / "b.dbc", *MAPS

    for first, second in (
        (DBC[mux:], DBC[press:mux]),  # the same
        (other.format("A"), other.format("V")),  # not in the log
    ):
        found, _ = imported(tmp_path, file, *import_(first, second))
        np.testing.assert_allclose(found["current"].values, STEPS[::2])
        (tmp_path / "made.npz").unlink()
    said = refused(tmp_path, file, *import_("", DBC[press:mux].replace("0.5", "0.25")))
    assert "expected one meaning of 0x181, got Press and Press" in said


@pytest.mark.parametrize(("module", "package"), [("can", "python-can"), ("cantools", "cantools")])
def test_without_its_packages_a_log_names_the_extra(tmp_path, monkeypatch, module, package):
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda n: None if n == module else find(n))
    file = candump_file(tmp_path)
    said = refused(tmp_path, file, "--dbc", tmp_path / "bus.dbc", *MAPS)
    assert f"expected the package {package}" in said and "'forceaxis[can]'" in said


def test_frames_of_another_length_are_no_frames_of_the_message(tmp_path):
    """As with the PDOs of a gateway: the bytes have another meaning than the file states."""
    file = candump_file(tmp_path)
    text = file.read_text()
    dbc = ("--dbc", tmp_path / "bus.dbc")
    file.write_text(text.replace("181#", "181#0102"))
    said = refused(tmp_path, file, *dbc, "--map", "force=Force")
    assert "100 frames with 8 bytes left out, as the message has 6" in run(
        tmp_path, file, *dbc, "--map", "x=current"
    ).stdout and "expected a column" in said  # fmt: skip
    (tmp_path / "made.npz").unlink()
    lines = text.splitlines()
    file.write_text("\n".join([*lines[:30], "no frame at all", *lines[30:-2], lines[-2][:-5]]))
    found, said = imported(tmp_path, file, *dbc, "--map", "x=current")
    assert "2 lines skipped" in said or "1 line skipped" in said
    assert len(found["x"].values) == 50


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda folder: screen(folder, stamp="(000.005000)"), "record with `candump -t a`"),
        (lambda folder: asc(folder, ("base hex  timestamps relative",)), "expected absolute times"),
        (lambda folder: screen(folder, stamp=""), "expected a column of times"),
    ],
)
def test_times_that_are_differences_are_refused(tmp_path, make, said):
    file = make(tmp_path)
    if "-t a" in said:
        lines = file.read_text().splitlines()
        times = ["(000.000000)", "(000.005000)", "(000.000001)"] * 100
        file.write_text("\n".join(
            line.replace("(000.005000)", time) for line, time in zip(lines, times, strict=True)
        ))  # fmt: skip
    assert said in refused(tmp_path, file, "--dbc", tmp_path / "bus.dbc", "--map", "force=Force")


def test_a_cut_binary_log_says_so(tmp_path):
    file = library("blf")(tmp_path)
    data = file.read_bytes()
    file.write_bytes(data[:-200])
    done = run(tmp_path, file, "--dbc", tmp_path / "bus.dbc", "--map", "force=Force")
    assert "cut off" in done.stdout or done.returncode == 2


EDS = """\
[FileInfo]
FileName=drive.eds
[DeviceInfo]
VendorName=drive
[1800]
ParameterName=TPDO1
ObjectType=9
SubNumber=2
[1800sub0]
ParameterName=n
ObjectType=7
DataType=5
AccessType=const
DefaultValue=1
[1800sub1]
ParameterName=COB-ID
ObjectType=7
DataType=7
AccessType=rw
DefaultValue=$NODEID+0x180
[1A00]
ParameterName=mapping
ObjectType=9
SubNumber=4
[1A00sub0]
ParameterName=n
ObjectType=7
DataType=5
AccessType=rw
DefaultValue=3
[1A00sub1]
ParameterName=1
ObjectType=7
DataType=7
AccessType=rw
DefaultValue=0x60770010
[1A00sub2]
ParameterName=2
ObjectType=7
DataType=7
AccessType=rw
DefaultValue=0x00050008
[1A00sub3]
ParameterName=3
ObjectType=7
DataType=7
AccessType=rw
DefaultValue=0x60640020
[6077]
ParameterName=Torque actual value
ObjectType=7
DataType=3
AccessType=ro
PDOMapping=1
[6064]
ParameterName=Position actual value
ObjectType=7
DataType=4
AccessType=ro
PDOMapping=1
"""


def pdo_log(folder, nodes=(5,)):
    lines = [
        f"({k / 100:.6f}) can0 {0x180 + node:03X}#"
        + (struct.pack("<hB", k - 50, 99) + struct.pack("<i", -1000 * k)).hex()
        for k in STEPS for node in nodes
    ]  # fmt: skip
    (folder / "drive.log").write_text("\n".join(lines) + "\n")
    (folder / "drive.eds").write_text(EDS)
    return folder / "drive.log"


def test_the_pdos_of_an_eds_name_their_objects(tmp_path):
    file, eds = pdo_log(tmp_path), tmp_path / "drive.eds"
    maps = ("--map", "force=Torque actual value:0.5N,position=Position actual value:1um")
    for words in (("--eds", eds), ("--eds", f"5={eds}")):
        found, said = imported(tmp_path, file, *words, *maps)
        np.testing.assert_allclose(found["force"].values, 0.5 * (STEPS - 50))
        np.testing.assert_allclose(found["position"].values, -1e-3 * STEPS)
        assert ("the PDOs are those of node 5" in said) == (words[1] == eds)
    (tmp_path / "made.npz").unlink()
    assert "expected the unit" in refused(tmp_path, file, "--eds", eds, "--map", "force=#2")
    file = pdo_log(tmp_path, (5, 6))
    said = refused(tmp_path, file, "--eds", eds, *maps)
    assert "--eds: expected NODE=" in said and "nodes 5, 6" in said
    both = ("--eds", f"5={eds}", "--eds", f"6={eds}")
    found, _ = imported(tmp_path, file, *both, "--map", "x=node6.TPDO1/Torque actual value:1")
    np.testing.assert_allclose(found["x"].values, STEPS - 50)
    (tmp_path / "made.npz").unlink()
    assert "0x187" not in refused(tmp_path, file, "--eds", f"7={eds}", *maps)


def test_the_files_of_the_product_name_its_own_frames(tmp_path):
    """The DBC and the EDS of an axis give the same numbers, those of cantools."""
    generated = paths.ROOT / "firmware/objects/generated"
    database = cantools.database.load_file(generated / "forceaxis.dbc")
    message = next(m for m in database.messages if m.name == "AXIS3_TPDO3")
    names = [s.name for s in message.signals]
    rng = np.random.default_rng(1)
    raw = [rng.bytes(message.length) for _ in STEPS]
    file = tmp_path / "axis.log"
    file.write_text("".join(
        f"({k / 100:.6f}) can0 {message.frame_id:03X}#{data.hex()}\n" for k, data in enumerate(raw)
    ))  # fmt: skip
    for words in (("--dbc", generated / "forceaxis.dbc"), ("--eds", generated / "forceaxis.eds")):
        maps = [f"x{k}=#{k + 2}:1" for k in range(len(names))]
        found, said = imported(tmp_path, file, *words, "--map", ",".join(maps))
        assert ("node3.TPDO3 is off in" in said) == (words[0] == "--eds")
        for k, one in enumerate(names):
            wanted = [message.decode(d, scaling=False, decode_choices=False)[one] for d in raw]
            scale = message.get_signal_by_name(one).scale if words[0] == "--dbc" else 1
            np.testing.assert_allclose(found[f"x{k}"].values, np.array(wanted) * scale)
