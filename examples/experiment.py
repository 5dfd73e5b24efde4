#!/usr/bin/env python3
"""An experiment from Python: read, changed, run, looked at; then one made from nothing but a dict.

python examples/experiment.py [FOLDER]      the folder gets contact.png
"""

import sys
from pathlib import Path

import numpy as np
from forceaxis import Experiment

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")

# One of the experiments that are installed, or the path of your own.
contact = Experiment.load("contact")
result = contact.run(force_gain=7, force_setpoint="75 N")
print(repr(result))

# Arrays of one value a tick, in the units of result.units.
time_s, force = result.time_s, result["force"]
peak = force.argmax()
print(f"largest reading {force[peak]:.0f} {result.units['force']} at {time_s[peak]:.2f} s")
touches = [e for e in result.events if e.after == "pressed"]
print(f"{len(touches)} touches, the first at {touches[0].time_s:.3f} s")
result.plot(folder / "contact.png")

# The highest gain of a few, by the verdict of each run.
gains = np.linspace(4, 16, 4)
stable = [gain for gain in gains if contact.run(force_gain=gain).stable]
print(f"stable up to a gain of {max(stable):g}")

# The same format as a dict; the model's path is relative to `folder`.
free = Experiment(
    {
        "title": "A harder workpiece",
        "model": contact.model,
        "duration_s": 2.0,
        "set": {"k_w": "2 MN/m"},
        "firmware": {"mode": "force", "force_gain": 5.0, "force_setpoint": "60 N"},
        "verdict": {"contact_held": True, "held_force_error_max_percent": 10},
    }
)
print(repr(free.run()))
