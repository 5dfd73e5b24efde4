"""The code after a lost contact, in random approaches and strikes: never above contact_loss_cap.

Each case is an experiment on the laboratory's plant, drawn by its number: mode 4 or 10,
latency_ticks, a bump bias that decays in a tick or in seconds, approaches from slow to 200 mm/s,
blows from either side while the axis approaches, touches and presses, excitation at the law's
output or at its set-point. The oracle judges the trace by inputs, outputs and parameters alone.
"""

import random
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from protections import ENABLE, experiment, strike

COUNT_N = 2.5  # of the laboratory's 8-bit reading
CONTACT_COUNT = 2  # the default of contact_force
BANK = """[firmware.bank_1]
gain = 4.37
integral_rad_per_s = 8.0
sections = [[1.394373, -2.718615, 1.362417, -1.741615, 0.779790]]
"""


@dataclass(frozen=True)
class Case:
    """A drawn experiment (TOML) and the parameters that the oracle needs."""

    text: str
    cap: int  # code
    dwell: int  # ticks that the cap holds after a contact, at least


@dataclass(frozen=True)
class Found:
    """Of one run. `worst`: by how many codes the cap was passed, 0 where it held. `judged`: ticks
    in which it was to hold. `peak_N`: the largest reading, which ends at 637 N."""

    worst: int
    judged: int
    losses: int
    peak_N: float


def drawn(number: int) -> Case:
    """The case of this number, 0.., the same on every machine."""
    r = random.Random(f"cap {number}")
    latency, mode = number % 2, (4, 10)[number // 2 % 2]
    shift = r.choice((0, 3, 6, 6, 9, 12))
    cap = r.choice((0, 0, 0, r.randrange(1, 400)))
    dwell_ms = r.choice((300, 300, r.randrange(20, 600)))
    bank = r.random() < 0.3
    lines = [
        "position_gain = 4.0",
        "velocity_gain = 20.0",
        f"latency_ticks = {latency}",
        f"bump_decay_shift = {shift}",
        f"modes_of_operation = {mode}",
        f"approach_velocity_max = '{r.choice((5, 20, 50, 100, 200))} mm/s'",
        f"force_slope = {r.choice((1000, 7500, 100000))}",
        f"target_force = {r.randrange(200, 1000)}",
        f"contact_loss_cap = {cap}",
        f"contact_loss_dwell = {dwell_ms}",
        "force_bank = 1" if bank else f"force_gain = {r.uniform(0.5, 6.0):.2f}",
    ]
    excited = number % 3 == 0
    if excited:
        lines += [
            f"excitation_point = '{r.choice(('output', 'setpoint'))}'",
            f"excitation_code = {r.randrange(20, 400)}",
            f"excitation_force = {r.randrange(1, 20)}",
            "excitation_ramp = 0",
            "excitation_force_min = 0",
            "excitation_force_max = 256",
        ]
    events = ENABLE
    for time_s in sorted(round(r.uniform(0.05, 1.3), 4) for _ in range(r.randrange(1, 4))):
        events += strike(round(r.choice((-1, 1)) * r.uniform(0.3, 4.0), 3), time_s)
    if excited:
        for k in range(3):
            when = f"[[at]]\ntime_s = {0.4 + 0.3 * k:.1f}\n"
            events += f"{when}firmware = {{ excitation_run = 1 }}\n"
    firmware = "\n".join(lines) + "\n" + (BANK if bank else "")
    text = experiment("@", events, duration_s=1.4, sets=f"approach = '{r.uniform(0.2, 6):.2f} mm'")
    text = text.replace("latency_ticks = 0\nbump_decay_shift = 0\n@", firmware)
    return Case(text, cap, int(np.ceil(1.5 * dwell_ms)))


def judge(case: Case, columns: dict[str, np.ndarray]) -> Found:
    """The oracle: from the first reading without contact on, for the dwell, no code presses harder
    than the cap."""
    reading = columns["adc0"].astype(int)
    code, on = columns["dac"].astype(int), columns["out"] != 0
    touching = reading > CONTACT_COUNT
    worst, judged, losses, since = 0, 0, 0, None
    for tick in range(len(reading)):
        if not on[tick]:
            since = None
        elif touching[tick]:
            since = 0
        elif since is not None:
            since += 1
            losses += since == 1
            if since <= case.dwell:
                judged += 1
                worst = max(worst, code[tick] - case.cap)
    return Found(int(worst), judged, losses, float(reading.max() * COUNT_N))


def run(folder: Path, number: int, columns_of: Callable[[Path], dict[str, np.ndarray]]) -> Found:
    """Draws and judges one case; `columns_of` runs a file and gives the columns of its trace."""
    case = drawn(number)
    file = folder / f"{number}.toml"
    file.write_text(case.text)
    return judge(case, columns_of(file))


def main() -> None:
    """cap_study.py FOLDER COUNT: a line of numbers for each case, to compare two firmwares."""
    from forceaxis import _core

    folder, count = Path(sys.argv[1]), int(sys.argv[2])
    for number in range(count):
        found = run(folder, number, lambda file: _core.run(str(file)).columns())
        print(number, found.worst, found.judged, found.losses, found.peak_N)


if __name__ == "__main__":
    main()
