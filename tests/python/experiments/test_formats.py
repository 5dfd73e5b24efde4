"""docs/guide/reference has every table and key that the readers read, and no other."""

import re
import subprocess
import sys
import tomllib
from datetime import date
from pathlib import Path

import pytest
from forceaxis import Experiment, InputError, _core, toml
from forceaxis.experiments import expect

ROOT = Path(__file__).resolve().parents[3]
NEVER_VALID = date(2001, 2, 3)

# A model and an experiment with every table.
MODEL = """
title = "everything"
shows = "each table"
parameters_file = "shared.toml"
[parameters]
m = { value = 10, unit = "kg", source = "a guess", documentation = false }
[[body]]
name = "axis"
mass = "m"
position = 0
velocity = 0
[[body]]
name = "work"
mass = 5
[[structure]]
name = "frame"
ports = ["foot", "head"]
[[structure.mode]]
frequency = 12
damping_ratio = 0.02
modal_mass = 30
shape = [1, 0.5]
[[spring]]
name = "guide"
between = ["axis", "ground"]
stiffness = [100, 200]
breaks = [0.1]
damping = 100
[[spring]]
name = "loaded"
between = ["work", "ground"]
stiffness = [1e5, 2e5]
loads = [10]
[[damper]]
name = "oil"
between = ["work", "ground"]
damping = [100, 50]
breaks = [0.1]
[[contact]]
name = "tip"
between = ["axis", "work"]
stiffness = 1e5
damping = 10
gap = 0.01
[[backlash]]
name = "play"
between = ["axis", "work"]
stiffness = 10
damping = 1
width = 1
[[stop]]
name = "end"
between = ["axis", "ground"]
stiffness = 1e5
damping = 10
low = -1
high = 1
[[friction]]
name = "dry"
between = ["axis", "ground"]
coulomb = 1
stiction = 2
[[brake]]
name = "held"
between = ["axis", "ground"]
holding = 100
release = 0.05
engage = 0.03
[[gravity]]
name = "weight"
body = "work"
acceleration = [0.1, 0.2]
positions = [0, 1]
[[body]]
name = "rotor"
inertia = [1e-4]
r_trans = [0.002]
[[spring]]
name = "belt"
between = ["rotor", "axis"]
stiffness = 1e6
maxwell_stiffness = 1e5
maxwell_time = 0.01
[[contact]]
name = "pad"
between = ["axis", "work"]
stiffness = 1e5
gap = 0.02
maxwell_stiffness = 1e5
maxwell_time = 0.01
[[contact]]
name = "rubber"
between = ["axis", "head"]
stiffness = 1e5
gap = 0.02
hysteresis_stiffness = 1e5
hysteresis_force = 10
[[cogging]]
name = "magnets"
between = ["axis", "ground"]
force = 10
period = 0.03
segments = 8
position = 0.01
from = -0.1
to = 0.1
[[external]]
name = "push"
body = "work"
times = [0.01, 0.02]
forces = [5, 10]
[drive]
type = "dc_motor"
body = "axis"
reaction = "ground"
enable_ticks = 4
[encoder]
body = "axis"
reference = "ground"
scale = 1e5
[switches]
limit_neg = -0.5
limit_pos = 0.5
home_from = -0.1
home_to = 0.1
index = 0
index_every = 0.1
[[adc]]
channel = 0
signal = "tip.force"
creep = 0.001
creep_time = 600
drift = 0.5
drift_time = 300
sensor_limit = 300
filter = 500
conditioning_limit = 280
noise = 0.1
per_count = 2
zero_code = 10
bits = 8
[dac]
bits = 12
range = 10
offset = 0
noise = 0
"""

DRIVES = {
    "dc_motor": """
input = "tach"
k_preamp_cmd = 1
k_preamp_fdbk = 1
a_preamp_fdbk = 100
k_tach = 0.1
k_torque = 0.5
k_back_emf = 0.5
L = 0.01
R = 4
r_trans = 0.01
b_m = 0
k_current = 1
current_feedback_limit = 10
preamp_limit = 10
k_amp = 100
amp_break = 0.1
k_amp_outer = 50
supply_limit = 60
""",
    "first_order": "k_act = 100\na_act = 500\nvelocity_per_volt = 0.1\nforce_limit = 500\n",
    "perfect": "force_per_volt = 10\nforce_limit = 500\n",
    "torque": "current_per_volt = 1\nk_torque = 0.5\nr_trans = 0.01\ncurrent_bandwidth = 4000\n"
    "peak_current = 10\nrated_current = 4\npeak_time = 1\ndamping = 100\n",
    "velocity": "velocity_per_volt = 0.01\nk_torque = 0.5\nr_trans = 0.01\n"
    "current_bandwidth = 4000\npeak_current = 10\nrated_current = 4\npeak_time = 1\n"
    "bandwidth = 200\ndamping_ratio = 0.7\ntuned_mass = 10\n",
    "stepper": "velocity_per_volt = 0.01\nholding_force = 300\nfull_step = 25e-6\n"
    "damping = 50\nsegments = 16\n",
}

# Controllers of the machine, on a drive that follows a velocity.
SENSED = 'signal = "tip.force"\nsetpoint = 50\nspeed_max = 0.1\nfilter = 500\ndelay_ticks = 2\n'
CONTROLLERS = {
    "table": "times = [0, 1]\nspeeds = [0, 0.1]\ninterpolated = true\n",
    "admittance": f"mass = 8\ndamping = 100\n{SENSED}",
    "force_pi": f"damping = 100\nintegral_time = 0.1\n{SENSED}",
}

EXPERIMENT = """
title = "everything"
figure = "0"
shows = "each table"
model = "model.toml"
duration_s = 0.1
seed = 1
[set]
m = 11
[firmware]
force_gain = 1
mode = "force"
[firmware.bank_1]
gain = 1
integral_rad_per_s = 1
velocity_gain = 0
sections = [[1, 0, 0, 0, 0]]
certificate = true
[firmware.shaper_force]
mode_Hz = 20
damping = 0.05
kind = "zvd"
[[at]]
time_s = 0.05
impulse = { body = "work", N_s = 0.1 }
firmware = { force_setpoint = 10 }
sensor = { force = "held" }
drive = { failure = "silent" }
[verdict]
window_s = 0.05
force_ripple_max_count = 5
position_ripple_max_count = 5
contact_held = "tip"
held_force_error_max_N = 5
held_force_error_max_percent = 5
overshoot_max_percent = 5
settle_max_s = 1
[plot]
rows = [["encoder"], ["adc0"]]
from_s = 0
to_s = 0.1
[trace]
objects = ["statusword"]
[expect]
fault = "none"
"""


def model_with(drive):
    """The model with a type of drive, or with the law of a controller of the machine."""
    if drive in CONTROLLERS:
        model = model_with("first_order")
        del model["drive"]["enable_ticks"]
        own = tomllib.loads(CONTROLLERS[drive])
        model["machine_controller"] = {"law": drive, "cycle_ticks": 3} | own
        return model
    model = tomllib.loads(MODEL)
    model["drive"] |= {"type": drive} | tomllib.loads(DRIVES[drive])
    return model


def experiment():
    found = tomllib.loads(EXPERIMENT)
    for table in (found["firmware"], found["at"][0]["firmware"]):
        for number in range(1, 5):
            table.setdefault(f"bank_{number}", {"gain": 1})
        for kind in ("force", "motion"):
            table.setdefault(f"shaper_{kind}", {"mode_Hz": 20})
    return found


def table_of(tables, path):
    """The table at a path of the format, the first of a list."""
    for name in path.split(".") if path else ():
        name = "m" if name == "NAME" else name
        tables = tables[name]
        tables = tables[0] if isinstance(tables, list) else tables
    return tables


def refusal(folder, model, experiment):
    """What is said of the two files; None: they are accepted."""
    for name, text in (("shared", "[parameters]\n"), ("model", toml.write_text(model))):
        file = folder / f"{name}.toml"
        if not file.exists() or file.read_text() != text:
            file.unlink(missing_ok=True)  # a file that is written over goes to the disk at once
            file.write_text(text)
    try:
        Experiment(experiment, folder=folder)
    except InputError as error:
        return str(error)
    return None


def formats():
    """(name, format, drive) of each table with keys of its own."""
    for found in _core.model_format():
        first = "table" if found["path"] == "machine_controller" else next(iter(DRIVES))
        yield "model", found, found["when"].split('"')[1] if found["when"] else first
    for found in _core.experiment_format():
        yield "experiment", found, "dc_motor"


@pytest.mark.parametrize("drive", DRIVES)
def test_the_text_with_everything_is_accepted(tmp_path, drive):
    assert refusal(tmp_path, model_with(drive), experiment()) is None


@pytest.mark.parametrize("law", CONTROLLERS)
def test_a_controller_of_the_machine_with_everything_is_accepted(tmp_path, law):
    refusal(tmp_path, model_with(law), experiment())  # writes the files
    assert _core.Plant(str(tmp_path / "model.toml")).tick == 0


# Keys that another key excludes.
INSTEAD_OF = {
    "forces": ("speeds",),
    "loads": ("breaks",),
    "k_force": ("k_torque", "r_trans"),
    "k_velocity": ("bandwidth", "damping_ratio", "tuned_mass"),
    "integral_time": ("bandwidth", "damping_ratio", "tuned_mass"),
    "tuned_inertia": ("tuned_mass",),
}
NEEDED = {
    "drive.integral_time": {"k_velocity": 100},
    "body.r_trans": {"inertia": [1e-4]},
    "spring.maxwell_time": {"maxwell_stiffness": 1e5},
    "contact.maxwell_time": {"maxwell_stiffness": 1e5},
    "contact.hysteresis_force": {"hysteresis_stiffness": 1e5},
}


def answers(folder, values):
    """(value, answer) for each of the values(key) of each key of a model and an experiment, as the
    only mistake. The answer is one line that names the file and the key."""
    for name, found, drive in formats():
        for key in found["keys"]:
            for value in values(key):
                files = {"model": model_with(drive), "experiment": experiment()}
                table = table_of(files[name], found["path"])
                for other in INSTEAD_OF.get(key["key"], ()):
                    table.pop(other, None)
                if name == "model":
                    table.update(NEEDED.get(f"{found['path']}.{key['key']}", {}))
                table[key["key"]] = value
                said = refusal(folder, **files)
                where = f"{found['path']}.{key['key']}".lstrip(".").replace("NAME", "m")
                place = where if name == "experiment" else where.partition(".")[2] or where
                assert said and "\n" not in said and ": expected " in said, (where, value, said)
                assert place.rpartition(".")[2] in said.split(": ")[1], (where, value, said)
                yield value, said


def test_each_key_of_the_reference_is_read(tmp_path):
    """A key that the reader ignores would accept a date."""
    probed = 0
    for _, said in answers(tmp_path, lambda key: [NEVER_VALID]):
        assert "got a date" in said, said
        probed += 1
    assert probed > 150


def wrong_numbers(key):
    """A quantity of another kind, and numbers next to each end of the range of a key."""
    if key["form"] not in ("number", "integer", "number or list"):
        return
    yield "1 m" if key["unit"] == "kg" else "1 kg"
    yield from {"> 0": [0, -1], ">= 0": [-1], "not 0": [0]}.get(key["range"], [])
    if " to " in key["range"]:
        low, high = map(float, key["range"].split(" to "))
        whole = key["form"] == "integer"
        yield from (int(low) - 1, int(high) + 1) if whole else (low - 1e-3, high * 1.001 + 1e-3)


def test_each_number_refuses_another_unit_and_what_is_outside_its_range(tmp_path):
    probed = 0
    for value, said in answers(tmp_path, wrong_numbers):
        _, _, got = said.partition(", got ")
        assert "; " in got, said
        if not isinstance(value, str):
            assert float(re.split("[ ;]", got)[0]) == pytest.approx(value, rel=1e-4), said
        probed += 1
    assert probed > 250


def test_no_key_is_read_that_the_reference_has_not(tmp_path):
    """The reader lists what it takes where a key is not among it."""
    closed = 0
    keys = {}
    for name, found, drive in formats():
        keys.setdefault((name, found["path"]), {})[found["when"]] = [
            key["key"] for key in found["keys"]
        ]
        files = {"model": model_with(drive), "experiment": experiment()}
        table_of(files[name], found["path"])["no_such_key"] = 1
        said = refusal(tmp_path, **files)
        if found["open"]:
            continue
        listed = said.partition("expected one of the keys ")[2].partition(", got ")[0].split(", ")
        common = keys[name, found["path"]][""] if found["when"] else []
        due = common + keys[name, found["path"]][found["when"]]
        if name == "model" and found["path"] in ("drive", "machine_controller") and not common:
            assert listed[: len(due)] == due  # and those of its type
        else:
            assert listed == due, said
        assert '"no_such_key"' in said
        closed += 1
    assert closed > 25


def test_each_key_of_expect_is_read():
    table, number = expect.FORMAT
    for key in table.keys:
        with pytest.raises(InputError, match=rf"x\.toml: expect\.{key.key}: expected"):
            expect.read("x.toml", {key.key: []}, False)
    for key in number.keys:
        given = {"value": 1.0, key.key: "much"}
        with pytest.raises(InputError, match=rf"expect\.final_value\.{key.key}: expected a num"):
            expect.read("x.toml", {"final_value": given}, False)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (
            {"final_vlaue": 1, "setle_s": 2},
            "expected one of verdict, fault, .*, got final_vlaue, setle_s; did you mean final_"
            "value, settle_s\\?; remove or rename these keys",
        ),
        (
            {"final_value": {"valu": 1, "tol": 2}},
            "final_value.valu: expected one of value, .*, got valu, tol; did you mean value\\?",
        ),
        ({"fault": "limit"}, "fault: expected one of none, .*, got 'limit'"),
        ({"verdict": "stabel"}, "got 'stabel'; did you mean stable\\?"),
    ],
)
def test_wrong_keys_of_expect_are_reported_at_once(given, says):
    with pytest.raises(InputError, match=says):
        expect.read("x.toml", given, True)


def test_every_signal_is_in_the_reference(tmp_path):
    sys.path.insert(0, str(ROOT / "tools"))
    try:
        import gen_reference
    finally:
        sys.path.pop(0)
    groups = {"axis": "BODY", "work": "BODY", "rotor": "BODY", "foot": "PORT", "head": "PORT",
              "weight": "GRAVITY", "push": "EXTERNAL", "drive": "drive"}  # fmt: skip
    found = {}
    for drive in DRIVES:
        assert refusal(tmp_path, model_with(drive), experiment()) is None
        result = Experiment(experiment(), folder=tmp_path).run()
        for name in result:
            element, dot, quantity = name.partition(".")
            if dot:
                found[f"{groups.get(element, 'LINK')}.{quantity}"] = result.units[name]
    assert found == {name: unit for name, unit, _ in gen_reference.SIGNALS}


def test_the_reference_is_fresh():
    done = subprocess.run(
        [sys.executable, ROOT / "tools/gen_reference.py", "--check"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
