"""Makes axes whose parameters nobody else knows, measures them, and judges what was identified.

Run by test_identify.py as a process of its own: `blind_axes.py SEED COUNT FOLDER`. Draws parameters
by SEED, writes each axis's measurement to FOLDER and one line of JSON with what may be known. Then
reads one line of JSON, the estimates, and only then reports the true values: a line of JSON.
"""

import json
import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from forceaxis import linear
from forceaxis.identify import result as measure_result

SPREAD = 0.45  # of the logarithm: 0.64 to 1.57 times nominal
# The model as the laboratory has it, what is unknown of it, and how it is measured.
AXES = [
    (
        "fig4_19",
        ("m_r", "k_w", "b_w", "k_s"),
        {"output": "sensor.spring_force", "band_hz": [2, 150], "bias": 1.0, "level": 0.2}
        | {"set": {"b_w": 100.0}},
    ),
    (
        "fig4_15",
        ("m_r1", "m_r2", "k_rf", "b_rf", "k_s"),
        {"output": "sensor.spring_force", "band_hz": [2, 120], "bias": 1.0, "level": 0.2},
    ),
    (
        "fig4_17",
        ("m_r", "m_b", "k_b", "b_b"),
        {"output": "robot.acceleration", "free": True, "band_hz": [2, 60], "level": 0.3}
        | {"set": {"approach": 0.5}},
    ),
    (
        "fig4_25",
        ("m_r", "k_g", "k_w", "b_w"),
        {"inject": "codes", "output": "adc0", "band_hz": [2, 100], "bias": 205, "level": 40}
        | {"set": {"b_w": 100.0, "force_per_code": 0.3}},
    ),
]


def draw(rng, model, names, given):
    """Parameters {name: value} within SPREAD of the nominal ones."""
    known = linear.facts(model, given).parameters
    return {n: known[n][0] * math.exp(rng.uniform(-SPREAD, SPREAD)) for n in names}


def main(seed, count, folder):
    rng = np.random.default_rng(seed)
    truths, tasks = [], []
    for i in range(count):
        model, names, options = AXES[i % len(AXES)]
        options = options | {"resolution_hz": 2.0, "averages": 8, "seed": int(rng.integers(2**31))}
        truth = draw(rng, model, names, options.get("set", {}))
        done = measure_result.run(model, options, truth)
        done = replace(done, summary=replace(done.summary, plant_set={}, command=""))
        out = Path(folder) / str(i)
        measure_result.write(done, out)
        truths.append(truth)
        tasks.append({"model": model, "fit": names, "response": str(out)})
    print(json.dumps(tasks), flush=True)
    estimates = json.loads(sys.stdin.readline())
    assert len(estimates) == count  # all of them are in before any truth is out
    print(json.dumps(truths))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3])
