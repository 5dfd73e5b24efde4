"""Every lumped model of the thesis: its equations, its experiments, and what their texts state."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from forceaxis import _core, linear
from forceaxis.experiments import run as runs
from forceaxis.linear import loops

ROOT = Path(__file__).resolve().parents[3]
MODELS = ROOT / "sim/models"
EXPERIMENTS = ROOT / "sim/experiments"

# Figure 4.26, typed from the print.
M_R, B_R, M_R1, M_R2, K_RF, B_RF = 132.4, 500, 114.5, 17.9, 665000, 640
M_B, K_B, B_B, M_W, K_W, B_W = 500, 3600000, 9500, 6.6, 412700, 8.25
M_S, K_S, B_S, K_G, B_G = 0.14, 110100, 16.5, 25000, 30

RIGID = [("robot", "ground", 0, B_R)]
ON_BASE = [("robot", "base", 0, B_R), ("base", "ground", K_B, B_B)]
ARM = ("robot", "tip", K_RF, B_RF)


def workpiece(k=K_W, b=B_W, to="ground"):
    return ("workpiece", to, k, b)


def grip(arm, k_g):
    return [(arm, "sensor_mass", K_S, B_S), ("sensor_mass", "workpiece", k_g, B_G)]


MASS = {"robot": M_R, "tip": M_R2, "base": M_B, "workpiece": M_W, "sensor_mass": M_S}

# Links (a, b, stiffness, damping) of each figure, and the two ends of the sensor.
LINKS = {
    "fig2_3": ([*RIGID, ("robot", "ground", K_S, B_S)], ("robot", "ground")),
    "fig2_11": ([*RIGID, ARM, ("tip", "ground", K_S, B_S)], ("tip", "ground")),
    "fig2_16a": ([*ON_BASE, ("robot", "ground", K_S, B_S)], ("robot", "ground")),
    "fig2_16b": ([*ON_BASE, ("robot", "base", K_S, B_S)], ("robot", "base")),
    "fig2_26": ([*RIGID, ("robot", "workpiece", K_S, B_S), workpiece()], ("robot", "workpiece")),
    "fig2_29": (
        [*RIGID, ARM, ("tip", "workpiece", K_S, B_S), workpiece()],
        ("tip", "workpiece"),
    ),
    "fig2_35": ([*RIGID, *grip("robot", K_G), workpiece()], ("robot", "sensor_mass")),
    "fig4_14": (
        [*ON_BASE, ARM, *grip("tip", K_G), workpiece(to="base")],
        ("tip", "sensor_mass"),
    ),
    "fig4_14_ground": ([*ON_BASE, ARM, *grip("tip", K_G), workpiece()], ("tip", "sensor_mass")),
    "fig4_21": (
        [*RIGID, ("robot", "workpiece", K_S, B_S), workpiece(4 * K_W, 4 * B_W)],
        ("robot", "workpiece"),
    ),
    "fig4_22": (
        [*RIGID, ("robot", "workpiece", K_S, B_S), workpiece(K_W / 4, B_W / 4)],
        ("robot", "workpiece"),
    ),
    "fig4_24": ([*RIGID, *grip("robot", 1e7), workpiece()], ("robot", "sensor_mass")),
    "fig5_2": ([*RIGID, *grip("robot", 120000), workpiece()], ("robot", "sensor_mass")),
    "fig5_5": (
        [*RIGID, ("robot", "workpiece", K_S, B_S), workpiece(b=20 * B_W)],
        ("robot", "workpiece"),
    ),
}
# The same structure behind another drive.
LIKE = {
    "fig2_40": "fig2_3", "fig2_8": "fig2_3", "fig4_11": "fig2_3",
    "fig2_42": "fig2_11", "fig4_15": "fig2_11", "fig4_17": "fig2_16b",
    "fig2_32": "fig2_26", "fig4_19": "fig2_26",
    "fig2_35_coupled": "fig2_35", "fig4_25": "fig2_35",
}  # fmt: skip
SIMPLE = ("fig2_8", "fig2_32", "fig2_35_coupled")
PERFECT = ("fig2_3", "fig2_11", "fig2_16a", "fig2_16b", "fig2_26", "fig2_29", "fig2_35",
           "fig2_40", "fig2_42")  # fmt: skip


def actuator(name, s):
    """G_af and G_av at s: 1 and 0, the simple actuator of 2.3.3, the motor of 4.1.1."""
    if name in PERFECT:
        return 40.96, 0.0
    if name in SIMPLE:
        lag = 9500 * 600 / (s + 600)
        return lag * 0.0963, -lag
    k_pc, k_pf, a, k_amp, k_cur, k_tach, k_t, k_b = 3.9, 4.2, 942, 15, 0.333, 0.039, 0.5, 0.5
    ind, res, r = 0.0158, 4.5, 0.004043
    loop = ind * s + res + k_amp * k_cur
    g_av = -k_t * (k_amp * k_pf * k_tach * a + k_b * (s + a)) / (r**2 * loop * (s + a))
    return k_t * k_amp * k_pc / (r * loop), g_av


def response(name, s):
    """Sensed force over command voltage, from masses and links by the coupling rule of 2.3.2."""
    links, (sensor_a, sensor_b) = LINKS[LIKE.get(name, name)]
    bodies = [b for b in MASS if any(b in link[:2] for link in links)]
    mass = MASS | ({"robot": M_R1} if "tip" in bodies else {})
    Z = np.diag([mass[b] * s * s for b in bodies]).astype(complex)
    unit = {b: np.eye(len(bodies))[i] for i, b in enumerate(bodies)}
    unit["ground"] = np.zeros(len(bodies))
    for a, b, k, c in links:
        d = unit[a] - unit[b]
        Z += (k + c * s) * np.outer(d, d)
    act = unit["robot"] - unit["base" if "base" in bodies else "ground"]
    x = np.linalg.solve(Z, act)
    g_lf, g_lv = K_S * (unit[sensor_a] - unit[sensor_b]) @ x, s * act @ x
    g_af, g_av = actuator(name, s)
    return g_lf * g_af / (1 - g_av * g_lv)


@pytest.mark.parametrize("name", [*LINKS, *LIKE])
def test_model_is_the_figure(name):
    plant = linear.linearise(name)
    for s in 2j * np.pi * np.geomspace(0.5, 700, 25):
        expected = response(name, s)
        assert abs(plant.at(s) - expected) < 1e-9 * abs(expected)


def test_unloaded_motor():
    plant = linear.linearise("fig4_5", outputs=("drive.tach",))
    J, b = 0.0013, 0.02
    for s in 2j * np.pi * np.geomspace(0.5, 700, 25):
        g_af, g_av = actuator("fig4_5", s)
        v = 0.004043**2 / (J * s + b)
        expected = 0.039 / 0.004043 * v * g_af / (1 - g_av * v)
        assert abs(plant.at(s) - expected) < 2e-4 * abs(expected)  # J / r^2 is rounded in the file


# Force gain and frequency at the limit of the sampled loop, as the files state them. inf: none.
LIMITS = {
    "fig2_3": (14.1, 18), "fig2_8": (25.7, 31), "fig2_11": (9.6, 16), "fig2_16a": (19.7, 21),
    "fig2_16b": (30.2, 30), "fig2_26": (16.9, 17), "fig2_29": (11.3, 15), "fig2_32": (10.1, 46),
    "fig2_35_coupled": (492, 156), "fig4_11": (28.4, 31), "fig4_14": (48.8, 28),
    "fig4_14_ground": (61.6, 27), "fig4_15": (10.7, 25), "fig4_17": (29.4, 36),
    "fig4_19": (10.6, 46), "fig4_21": (30.5, 31), "fig4_22": (13.1, 33), "fig4_24": (10.6, 45),
    "fig4_25": (591, 155), "fig5_2": (25.2, 43), "fig5_5": (34.5, 48),
}  # fmt: skip


@pytest.mark.parametrize("name", LIMITS)
def test_limit_is_what_the_file_says(name):
    gain, hz = LIMITS[name]
    loop = loops.force_loop(name)
    limit = loop.limit()
    assert loop.firmware_gain(limit.gain) == pytest.approx(gain, rel=0.006)
    assert limit.frequency_hz == pytest.approx(hz, abs=0.6)
    shows = tomllib.loads((MODELS / f"{name}.toml").read_text())["shows"]
    assert f"{gain:g}" in shows


def test_colocated_models_have_no_limit_in_continuous_time():
    unlimited = {"fig2_3", "fig2_16a", "fig2_16b", "fig2_26", "fig2_35", "fig2_40"}
    for name in [*LINKS, *LIKE]:
        limit = loops.force_loop(name, timing="continuous").limit()
        assert (limit.gain is None) == (name in unlimited), name


def test_runs_part_at_the_limit():
    """Just below the sampled limit a run from contact settles, just above it does not."""
    names = [n for n in LIMITS if LIMITS[n][0] < 200 and (EXPERIMENTS / f"{n}.toml").exists()]
    jobs = []
    for name in names:
        loop = loops.force_loop(name)
        limit = loop.firmware_gain(loop.limit().gain)
        for factor in (0.9, 1.1):
            jobs.append(
                (
                    str(EXPERIMENTS / f"{name}.toml"),
                    [f"firmware.force_gain={factor * limit}", "experiment.duration_s=20"],
                )
            )
    runs = iter(_core.run_many(jobs, 2))
    for name in names:
        assert (next(runs)["verdict"], next(runs)["verdict"]) == ("stable", "unstable"), name


def frequency(run, column, start, stop):
    """Frequency in Hz of a trace that rings about its final value, from its crossings."""
    t, x = run.columns["time_s"], run.columns[column]
    x = x - x[-1]
    part = (t >= start) & (t <= stop)
    t, x = t[part], x[part]
    i = np.flatnonzero(x[:-1] * x[1:] < 0)
    crossings = t[i] - x[i] * (t[i + 1] - t[i]) / (x[i + 1] - x[i])
    assert len(crossings) >= 3
    return (len(crossings) - 1) / 2 / (crossings[-1] - crossings[0])


# Experiment, column, from, to, Hz as its text says, tolerance.
RINGING = [
    ("fig2_3", "sensor.force", 0.2, 2.0, 15, 0.5),
    ("fig2_16a", "base.position", 4.0, 4.4, 13.5, 0.3),
    ("fig2_26", "workpiece.position", 6.0, 6.5, 45, 0.6),
    ("fig4_14", "base.position", 3.0, 3.3, 12, 0.7),
    ("fig4_14_ground", "base.position", 3.0, 3.3, 12, 0.7),
    ("fig4_15_free", "arm.deflection", 0.1, 0.3, 33, 0.5),
    ("fig4_17", "base.position", 2.0, 2.3, 12, 0.7),
    ("fig4_17_free", "base.position", 0.1, 0.4, 12, 0.7),
    ("fig4_19_free", "workpiece.position", 0.1, 1.0, 39.8, 0.1),
]


@pytest.mark.parametrize(("name", "column", "start", "stop", "hz", "tolerance"), RINGING)
def test_frequency_is_what_the_text_says(name, column, start, stop, hz, tolerance):
    run = runs.run(EXPERIMENTS / f"{name}.toml")
    assert frequency(run, column, start, stop) == pytest.approx(hz, abs=tolerance)


def test_push_on_the_base_disturbs_a_workpiece_on_it_ten_times_as_much():
    swing = {}
    for name in ("fig2_16a", "fig2_16b"):
        columns = runs.run(EXPERIMENTS / f"{name}.toml").columns
        swing[name] = np.ptp(columns["sensor.force"][columns["time_s"] > 4])
    assert swing["fig2_16b"] / swing["fig2_16a"] == pytest.approx(10, rel=0.1)


def test_damping_of_the_struck_workpiece():
    run = runs.run(EXPERIMENTS / "fig4_19_free.toml")
    x, t = run.columns["workpiece.position"], run.columns["time_s"]
    early, late = np.abs(x[(t > 0.2) & (t < 0.3)]).max(), np.abs(x[(t > 0.8) & (t < 0.9)]).max()
    zeta = np.log(early / late) / (2 * np.pi * 39.8 * 0.6)
    assert zeta == pytest.approx(0.0025, rel=0.1)


@pytest.mark.parametrize(("name", "ratio"), [("fig4_5", 0.68), ("fig4_5_measured", 0.85)])
def test_no_load_response(name, ratio):
    columns = runs.run(EXPERIMENTS / f"{name}.toml").columns
    assert columns["drive.tach"][-1] / columns["drive.command"][-1] == pytest.approx(
        ratio, abs=5e-3
    )


# Experiments that are unstable by their text, besides those named *_unstable.
UNSTABLE = {"fig2_3_sampled", "fig2_16a_high", "fig2_35_coupled_stiff", "fig2_43_cycles"}


def test_every_model_has_an_experiment_and_each_verdict_is_its_text():
    used = set()
    for path in sorted(EXPERIMENTS.glob("fig*.toml")):
        text = tomllib.loads(path.read_text())
        assert text["figure"], path.stem
        assert text["shows"], path.stem
        used.add(Path(text["model"]).stem)
        run = runs.run(path)
        assert run.summary["fault"] == "none"
        if "verdict" not in text:
            continue
        unstable = path.stem.endswith("_unstable") or path.stem in UNSTABLE
        assert run.summary["verdict"] == ("unstable" if unstable else "stable"), path.stem
    assert used >= {*LINKS, *LIKE, "fig4_5"} - {"fig2_40"}
    for name in [*LINKS, *LIKE, "fig4_5"]:
        assert tomllib.loads((MODELS / f"{name}.toml").read_text())["shows"], name
