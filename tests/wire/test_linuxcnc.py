"""The axis as a component of LinuxCNC's HAL: with a plant in the same thread the trace of a run in
process, and safe outputs in the tick of each failure, when the thread stops, and at the end.

Ticks are counted, not timed: `streamer` of LinuxCNC sets the pins of a tick before the axis, and
`sampler` records the pins of each tick after it. HAL is one for a machine and its modules are in
one folder, so each run has namespaces of its own, which need root, and copies of all files.
"""

import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

import pytest
import verbs
from forceaxis import _core, objects
from forceaxis.axis import parameter_file
from forceaxis.bus.state_names import texts

ROOT = Path(__file__).resolve().parents[2]
PORT = ROOT / "firmware/port/linuxcnc"
EXPERIMENTS = ROOT / "sim/experiments"
HAL_MODULES = Path("/usr/lib/linuxcnc/modules")
STOCK = "hal_lib", "threads", "streamer", "sampler"
# When the first process of the namespaces ends, all others end too.
NAMESPACES = "unshare", "--ipc", "--mount", "--pid", "--fork", "--mount-proc", "--kill-child"
NOBODY = 65534  # rtapi_app refuses to run as root
THREAD = "loadrt threads name1=axis period1=666667"
FAULTS = texts(objects.BY_NAME["fault"])
pytestmark = pytest.mark.long  # tools/setup --all installs linuxcnc-uspace


def build(*command):
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture(scope="module")
def modules():
    build("make", "-C", PORT, "-j2")
    build("cmake", "--build", "--preset", "release", "--target", "plant_hal")
    return [*(HAL_MODULES / f"{name}.so" for name in STOCK), ROOT / "build/linuxcnc/forceaxis.so",
            ROOT / "build/release/tests/wire/plant.so"]  # fmt: skip


@pytest.fixture
def hal(modules):
    """Runs commands of HAL: hal(lines, **files), which returns (status, standard output, error)."""
    # rtapi_app writes as nobody, and pytest closes tmp_path to other users at each of its starts.
    with tempfile.TemporaryDirectory(prefix="forceaxis-hal-") as name:
        yield runner(Path(name), modules)


def runner(folder, modules):
    folder.chmod(0o777)
    (folder / "modules").mkdir()
    for module in modules:
        shutil.copy(module, folder / "modules")
    prefix = () if os.geteuid() == 0 else ("sudo", "-n")
    start = f"mount --bind modules {HAL_MODULES} && exec halrun run.hal"

    def run(lines, **files):
        for name, text in {"run.hal": lines, **files}.items():
            (folder / name.replace("__", ".")).write_text(text.strip() + "\n")
        environment = f"RTAPI_UID={NOBODY}", f"RTAPI_FIFO_PATH={folder}/fifo"
        done = subprocess.run(
            [*prefix, "env", *environment, *NAMESPACES, "sh", "-c", start],
            cwd=folder, capture_output=True, text=True, timeout=120,
        )  # fmt: skip
        return done.returncode, done.stdout, done.stderr

    run.folder = folder
    return run


NETS = """
net encoder plant.encoder-count => forceaxis.encoder-count
net force plant.force-code => forceaxis.force-code
net current plant.current-code => forceaxis.current-code
net enable plant.enable => forceaxis.enable
net limit-pos plant.limit-pos => forceaxis.limit-pos
net limit-neg plant.limit-neg => forceaxis.limit-neg
net index plant.index => forceaxis.index
net home plant.home => forceaxis.home
net code forceaxis.code => plant.code
net amp-enable forceaxis.amp-enable => plant.amp-enable
net brake-release forceaxis.brake-release => plant.brake-release
net fault-code forceaxis.fault-code => plant.fault-code
net limit-reason forceaxis.limit-reason => plant.limit-reason
setp forceaxis.sensor-valid 1
setp forceaxis.drive-fitted 0
"""


@pytest.mark.parametrize(
    ("name", "written"),
    [
        ("contact", ["force_setpoint", "mode"]),
        (
            "press_hold_retract",
            ["modes_of_operation", "trajectory_velocity", "target_position", "target_force",
             "controlword"],
        ),
    ],
)  # fmt: skip
def test_a_run_has_the_trace_of_the_run_in_process(hal, name, written):
    for part in ("experiments", "models"):
        shutil.copytree(ROOT / "sim" / part, hal.folder / part)
    pins = [n.replace("_", "-") for n in written]
    status, out, error = hal(
        f"""
{THREAD}
loadrt plant experiment=experiments/{name}.toml parameters=axis.toml result=hash
loadrt forceaxis parameters=axis.toml inputs={",".join(written)}
{NETS}
{"".join(f"net {pin} plant.{pin} => forceaxis.in.{pin}{chr(10)}" for pin in pins)}
setp forceaxis.late-ticks-max 0
addf plant.sense axis
addf forceaxis.update axis
addf plant.act axis
start
loadusr -w sh wait.sh
getp forceaxis.refused
""",
        wait__sh="for i in $(seq 600); do [ ! -s hash ] || exit 0; sleep 0.1; done; exit 1",
    )
    assert status == 0, error
    assert int(out.split()[-1], 0) == 0
    expected = _core.run(str(EXPERIMENTS / f"{name}.toml"), []).trace_hash
    assert (hal.folder / "hash").read_text() == expected


# The pins of a tick. In open-loop mode the code is 150 in each tick that is enabled.
GOOD = {"enable": 1, "sensor-valid": 1, "drive-on": 1, "drive-fault": 0, "force-code": 128,
        "in.open-loop-code": 150, "in.mode": 1, "in.fault-reset": 0}  # fmt: skip
TYPES = "bbbbusss"
SHOWN = {"code": "s", "amp-enable": "b", "brake-release": "b", "fault-code": "u", "fault": "b"}
PARAMETERS = "[axis]\nbump_decay_shift = 0\nlatency_ticks = 0\n"
LOAD = f"""
{THREAD}
loadrt forceaxis parameters=axis.toml
"""
RUN = """
setp forceaxis.enable 1
setp forceaxis.sensor-valid 1
setp forceaxis.drive-on 1
setp forceaxis.in.open-loop-code 150
setp forceaxis.in.mode 1
addf forceaxis.update axis
"""


def ticks_of(hal, rows):
    """What the axis outputs in each tick, for rows of pins, one a tick."""
    count = len(rows)
    nets = [f"net in{i} streamer.0.pin.{i} => forceaxis.{pin}" for i, pin in enumerate(GOOD)]
    nets += [f"net out{i} forceaxis.{pin} => sampler.0.pin.{i}" for i, pin in enumerate(SHOWN)]
    status, _, error = hal(
        "\n".join([
            LOAD, f"loadrt streamer depth={count + 10} cfg={TYPES}",
            f"loadrt sampler depth={count + 10} cfg={''.join(SHOWN.values())}", *nets,
            "setp forceaxis.late-ticks-max 0", "loadusr -w halstreamer rows",
            "addf streamer.0 axis", "addf forceaxis.update axis", "addf sampler.0 axis", "start",
            f"loadusr -w halsampler -n {count} samples",
        ]),
        axis__toml=PARAMETERS,
        rows="\n".join(" ".join(str(row[pin]) for pin in GOOD) for row in rows),
    )  # fmt: skip
    assert status == 0, error
    lines = (hal.folder / "samples").read_text().splitlines()
    return [dict(zip(SHOWN, map(int, line.split()), strict=True)) for line in lines], error


RUNNING = {"code": 150, "amp-enable": 1, "brake-release": 1, "fault-code": 0, "fault": 0}


@pytest.mark.parametrize(
    ("wrong", "fault"),
    [
        ({"enable": 0}, "enable_lost"),
        ({"drive-fault": 1}, "drive_fault"),
        ({"drive-on": 0}, "drive_lost"),
        ({"sensor-valid": 0}, "sensor_invalid"),
        ({"force-code": 256}, "adc_range"),
        ({"force-code": 65536 + 128}, "sensor_invalid"),
    ],
)
def test_each_failure_makes_the_outputs_safe_in_its_tick(hal, wrong, fault):
    off = {**GOOD, "in.open-loop-code": 0, "in.mode": 0}
    rows = [off, off, *[GOOD] * 50, {**GOOD, **wrong}, *[GOOD] * 20,
            {**off, "in.fault-reset": 1}, off, *[GOOD] * 20]  # fmt: skip
    ticks, error = ticks_of(hal, rows)
    safe = {"code": 0, "amp-enable": 0, "brake-release": 0, "fault": 1, "fault-code": FAULTS[fault]}
    assert ticks[5:52] == [RUNNING] * 47
    # It stays off until the fault is reset, and code and mode are written again.
    assert ticks[52:73] == [safe] * 21
    assert ticks[-15:] == [RUNNING] * 15
    assert f"forceaxis: fault {FAULTS[fault]}, {fault}\n" in error


def test_a_thread_that_stops_leaves_safe_outputs_and_a_fault(hal):
    status, out, error = hal(
        f"""
{LOAD}
{RUN}
setp forceaxis.late-ticks-max 300
setp forceaxis.command-scale 0.5
start
loadusr -w sleep 0.5
show pin
stop
loadusr -w sleep 1
show pin
start
loadusr -w sleep 0.5
show pin
""",
        axis__toml=PARAMETERS,
    )
    assert status == 0, error
    runs, stopped, again = (pin_values(part) for part in out.split("Component Pins:")[1:4])
    assert (runs["code"], runs["command"]) == ("150", "75")
    assert (stopped["code"], stopped["command"], stopped["amp-enable"]) == ("0", "0", "FALSE")
    assert int(again["fault-code"], 0) == FAULTS["clock_wrong"]
    assert "forceaxis: fault" in error and "clock_wrong" in error


def test_a_disabled_axis_is_late_without_a_fault(hal):
    status, out, error = hal(
        f"""
{LOAD}
{RUN}
setp forceaxis.in.mode 0
setp forceaxis.late-ticks-max 300
start
loadusr -w sleep 0.5
stop
loadusr -w sleep 1
start
loadusr -w sleep 0.5
show pin
""",
        axis__toml=PARAMETERS,
    )
    assert status == 0, error
    found = pin_values(out)
    assert (int(found["fault-code"], 0), found["amp-enable"]) == (0, "FALSE"), error


def pin_values(text):
    """{pin without "forceaxis.": value} of the output of `show pin`."""
    rows = re.findall(r"^ *\d+ +\w+ +(?:IN|OUT) +(\S+) +forceaxis\.(\S+)", text, re.M)
    return {name: value for value, name in rows}


def test_an_unloaded_axis_leaves_safe_signals_and_may_be_loaded_again(hal):
    status, out, error = hal(
        f"""
{LOAD}
net code forceaxis.code
net amp forceaxis.amp-enable
{RUN}
setp forceaxis.late-ticks-max 0
start
loadusr -w sleep 0.3
gets code
gets amp
unload forceaxis
gets code
gets amp
loadrt forceaxis
getp forceaxis.out.force
""",
        axis__toml=PARAMETERS,
    )
    assert status == 0, error
    assert out.split() == ["150", "TRUE", "0", "FALSE", "0"]


def test_a_thread_of_another_period_never_enables_the_axis(hal):
    status, out, error = hal(
        f"""
{LOAD.replace("666667", "1000000")}
{RUN}
setp forceaxis.late-ticks-max 0
start
loadusr -w sleep 0.3
show pin
""",
        axis__toml=PARAMETERS,
    )
    assert status == 0, error
    found = pin_values(out)
    assert (found["code"], found["amp-enable"]) == ("0", "FALSE")
    assert int(found["fault-code"], 0) == FAULTS["clock_wrong"]
    assert error.count("forceaxis: expected a thread of 666667 ns, got 1000000 ns; ") == 1


# Offset 32768 is force 0 of a 16-bit code: -2.5 N times 1000 codes per N are 30268 codes, and a
# count of force is 256 codes. `force` has 8 digits behind the point.
def test_the_force_may_be_a_number_with_scale_and_offset(hal):
    status, out, error = hal(
        f"""
{LOAD.replace("axis.toml", "axis.toml outputs=force,adc_bits,force_gain")}
setp forceaxis.force-scale 1000
setp forceaxis.force-offset 32768
setp forceaxis.force -2.5
setp forceaxis.sensor-valid 1
setp forceaxis.late-ticks-max 0
addf forceaxis.update axis
start
loadusr -w sleep 0.3
show pin
""",
        axis__toml="[axis]\nadc_bits = 16\nforce_gain = 2.5\nforce_zero_code = 32768",
    )
    assert status == 0, error
    found = pin_values(out)
    force = objects.BY_NAME["force"]
    assert int(found["out.force"]) * force.scale == pytest.approx(-2500 / 256)
    assert (found["out.adc-bits"], found["out.force-gain"]) == ("16", str(5 * 128))


def test_a_dumped_parameter_file_is_loaded_with_its_raw_values(hal):
    file = hal.folder / "dump.toml"
    verbs.forceaxis("axis", "params", "dump", file, "--on", "sim:hold_biquad")
    raw = parameter_file.read(file, 1).values
    names = [n for n in raw if objects.BY_NAME[n].part != "canopen"][:32]
    assert {"position_gain", "bank_gain_1", "bank_coefficient_2", "force_bank"} <= set(names)
    status, out, error = hal(
        f"{THREAD}\nloadrt forceaxis parameters=dump.toml outputs={','.join(names)}\nshow pin"
    )
    assert status == 0, error
    found = pin_values(out)
    for name in names:
        assert int(found[f"out.{name.replace('_', '-')}"]) % 2**32 == raw[name] % 2**32, name


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[axis]\nforce_gian = 1", "force_gian: expected a parameter that the axis can store, got"),
        ("[axis]\nmode = 1", "mode: expected a parameter that the axis can store"),
        ("[axis]\nforce_gain = -1", "force_gain: expected a number from 0 to 255.99609375, got -1"),
        ('[axis]\nforce_gain = "5 V"', 'force_gain: expected a number, got "5 V"'),
        ("[drive]\nunsupervised_owner = 'no'", "unsupervised_owner: expected one of"),
        ("force_gain = 1", "force_gain: expected a table such as [axis]"),
        ("[axis\n", "line 1, column 6: expected valid TOML"),
        ("[axis]\nposition_min = 10\nposition_max = 0", "position_m"),
        (
            "[axis]\nforce_gain = 1\n[objects]\nforce_gain = { scale = 1.0 }",
            "force_gain: expected type, unit and scale",
        ),
    ],
)
def test_a_bad_parameter_file_is_one_line_and_no_component(hal, text, says):
    status, _, error = hal(f"{THREAD}\nloadrt forceaxis parameters=axis.toml", axis__toml=text)
    assert status != 0
    (line,) = [x for x in error.splitlines() if x.startswith("forceaxis: axis.toml: ")]
    assert says in line and ";" in line


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ("parameters=none.toml", "forceaxis: none.toml: file: expected a readable file, got none"),
        ("inputs=modus", "forceaxis: inputs: expected the name of an object that can be written"),
        ("inputs=force", "forceaxis: inputs: expected the name of an object that can be written"),
        (
            "outputs=fault_reset",
            "forceaxis: outputs: expected the name of an object that can be read",
        ),
    ],
)
def test_wrong_arguments_are_one_line(hal, arguments, line):
    status, _, error = hal(f"{THREAD}\nloadrt forceaxis {arguments}")
    assert status != 0
    assert [x.startswith(line) for x in error.splitlines()].count(True) == 1


def test_the_page_names_every_pin(hal):
    status, out, error = hal(f"{THREAD}\nloadrt forceaxis\nshow pin\nshow param")
    assert status == 0, error
    pins = set(re.findall(r"forceaxis\.([a-z.-]+)$", out, re.M))
    pins = {p for p in pins if not p.startswith(("in.", "out.", "update."))}
    page = (PORT / "README.md").read_text()
    assert len(pins) == 29
    assert {p for p in pins if f"`{p}`" not in page} == set()
    wired = set(re.findall(r"forceaxis\.([a-z.-]+)", (PORT / "example.hal").read_text()))
    assert wired - pins <= {"in.mode", "in.force-setpoint", "in.fault-reset", "out.force", "update"}
