"""Eight kinds of drive and sensor, each from `forceaxis new` to a tuned axis by commands alone.

`drive_kinds.py [FILE]` prints the table, or writes it to FILE, docs/studies/drive_kinds.md.
"""

import csv
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

Result = dict[str, Any]

# Options of `forceaxis new`. All sensors have 16 bits and 0.1 N of noise, if nothing else is given.
SENSOR = {"--sensor-bits": "16", "--sensor-noise-n": "0.1", "--workpiece-stiffness-n-per-m": "1e6"}
KINDS: dict[str, dict[str, str]] = {
    "velocity drive, screw": {"--drive": "velocity"},
    "velocity drive, belt": {
        "--drive": "velocity", "--pulley-radius-mm": "15", "--moving-mass-kg": "5",
        "--transmission-stiffness-n-per-m": "2e6",
    },
    "torque drive, screw": {"--drive": "torque"},
    "torque drive, linear motor": {
        "--drive": "torque", "--motor": "linear", "--torque-damping-n-s-per-m": "4000",
    },
    "stepper, screw": {"--drive": "stepper"},
    "velocity drive, gear with backlash": {
        "--drive": "velocity", "--transmission-stiffness-n-per-m": "3e7", "--backlash-mm": "0.02",
    },
    "velocity drive, cell of 24 bits at 1 kHz, 2 ms late": {
        "--drive": "velocity", "--sensor-bits": "24", "--sensor-rate-hz": "1000",
        "--sensor-latency-ms": "2",
    },
    "velocity drive on CANopen, cycle of 2 ms": {"--drive": "velocity", "--bus-cycle-ms": "2"},
}  # fmt: skip
OVER = ("--over", "k_w=30%,m_w=30%")
FORCES_N, FORCE_MAX_N = "30,100", "250"
MAP_GAINS, MAP_SETPOINTS = 6, 4
TITLE = f"""# Kinds of drive and sensor

Made by `tests/support/drive_kinds.py`; do not edit. Each kind goes from `forceaxis new` to a tuned
axis by commands alone: the options of `new` are in that file, and no file is edited. The sensors
have 16 bits and 0.1 N of noise, the workpiece has 1 MN/m and 2 kg, and the set is +-30 % of both.

The limit is that of the P law of `contact.toml` from the linear loop, beside the last stable gain
of simulated contacts at a quarter of full scale. The map has {MAP_GAINS} gains up to twice the
limit and {MAP_SETPOINTS} set-points. fS is the bandwidth over the set, of the designed bank and of
P at the same margins. `tune` measures the same axis, and its Ms is measured and predicted.

"""
HEAD = (
    "kind", "limit, codes/count", "last stable run", "stable in the map", "design fS, Hz",
    "P fS, Hz", "held, N of N", "P held, N of N", "tuned fS, Hz", "P tuned fS, Hz",
    "Ms measured", "Ms predicted",
)  # fmt: skip


def command(folder: Path, *words: str) -> Result:
    """Runs a command of forceaxis with --json in a folder, and returns its result."""
    done = subprocess.run(
        [sys.executable, "-m", "forceaxis", *words, "--json"], cwd=folder, capture_output=True,
        text=True, check=False,
    )  # fmt: skip
    if done.returncode:
        raise AssertionError(f"forceaxis {' '.join(words)}: {done.stderr}{done.stdout}")
    result: Result = json.loads(done.stdout)
    return result


def results(name: str, folder: Path) -> dict[str, Result]:
    """Returns the results of all commands for one kind of KINDS."""
    options = [word for pair in (SENSOR | KINDS[name]).items() for word in pair]
    contact, model = "axis/contact.toml", "axis/model.toml"
    found = {"new": command(folder, "new", "axis", "--yes", *options)}
    found["limit"] = command(folder, "loop", "limit", contact)
    most = min(250.0, 2 * found["limit"]["largest_firmware_gain"])
    least = found["new"]["force_gain"]
    gains = f"firmware.force_gain={least}:{most}"
    found["boundary"] = command(
        folder, "sweep", contact, "--bisect", f"{gains}:{most / 200}", "--out", "edge"
    )
    found["map"] = command(
        folder, "sweep", contact, "--grid", f"{gains}:{MAP_GAINS}:log", "--grid",
        f"firmware.force_setpoint=8:32:{MAP_SETPOINTS}", "--out", "map",
    )  # fmt: skip
    found["design"] = command(folder, "design", model, *OVER)
    found["held"] = command(folder, "run", "axis/held.toml")
    found["held_p"] = command(folder, "run", contact)
    found["tune"] = command(
        folder, "tune", "--on", f"sim:{contact}", "--model", model, "--force", FORCES_N, *OVER,
        "--force-max", FORCE_MAX_N, "--out", "tuned",
    )  # fmt: skip
    return found


def boundary(folder: Path) -> float | None:
    """Returns the last stable gain of the sweep, or None if every gain is stable."""
    with (folder / "edge/results.csv").open(newline="") as file:
        found = next(csv.DictReader(file))
    return float(found["boundary"]) if found["boundary"] else None


def row(name: str, found: dict[str, Result], last_stable: float | None) -> tuple[str, ...]:
    """Returns the row of the table for the results of one kind."""
    worst, p, tuned = found["design"]["worst"], found["design"]["p"], found["tune"]
    counts = found["map"]["counts"]

    def held(key: str) -> str:
        force = found[key]["metrics"]["held_force"]
        return f"{force['held_N']:.2f} of {force['setpoint_N']:.2f}"

    return (
        name, f"{found['limit']['firmware_gain']:.3g}",
        "-" if last_stable is None else f"{last_stable:.3g}",
        f"{counts['stable']} of {counts['points']}",
        f"{worst['fS_Hz']:.3g}", f"{p['fS_Hz']:.3g}", held("held"), held("held_p"),
        f"{tuned['worst']['fS_Hz']:.3g}", f"{tuned['p']['fS_Hz']:.3g}",
        f"{tuned['Ms_verified']:.2f}", f"{tuned['Ms_predicted']:.2f}",
    )  # fmt: skip


def study(name: str) -> tuple[dict[str, Result], float | None]:
    """Runs all commands for one kind of KINDS. Returns their results, and boundary()."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        return results(name, folder), boundary(folder)


def table() -> str:
    """Returns the table of all kinds as a page in Markdown."""
    lines = [TITLE, "| " + " | ".join(HEAD) + " |", "|" + " --- |" * len(HEAD)]
    for name in KINDS:
        print(name, file=sys.stderr)
        lines.append("| " + " | ".join(row(name, *study(name))) + " |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    text = table()
    if len(sys.argv) > 1:
        Path(sys.argv[1]).write_text(text)
    else:
        print(text)
