"""The recording examples/scope.csv: a first contact of a machine that another program simulates
(hidden_machine.py). It has what the data sheets of examples/stage.toml do not say: dry friction of
the guide, and a softer support of the workpiece. `python tests/support/other_machine.py` writes it.
"""

from pathlib import Path

import hidden_machine

FILE = Path(__file__).resolve().parents[2] / "examples/scope.csv"
FRICTION_N, STIFFNESS_N_PER_M = 8.0, 3.2e5
MACHINE = hidden_machine.Machine(f_c=FRICTION_N, k_w=STIFFNESS_N_PER_M, b_w=120.0, lag_rad_s=1500.0)
SENSORS = hidden_machine.Sensors(per_count=0.05, bits=12, noise=0.3, scale=1e6)


def text():
    """The lines of the recording as a scope writes them in Germany: decimal commas, semicolons."""
    one = hidden_machine.touch(MACHINE, SENSORS, 43, speed=0.03, force=40.0, gain=0.02, ticks=750)
    volts = one.codes * hidden_machine.DAC_VOLTS_PER_CODE
    rows = zip(1e3 * one.time_s, one.force_N, 1e3 * one.position_m, volts, strict=True)
    lines = [f"{t:.3f};{force:.2f};{mm:.3f};{volt:.4f}" for t, force, mm, volt in rows]
    head = "scope;channels 1 to 3\ntime;Fz;position;command\nms;N;mm;V\n"
    return head + "\n".join(lines).replace(".", ",") + "\n"


if __name__ == "__main__":
    FILE.write_text(text())
