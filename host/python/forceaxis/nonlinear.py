"""What 2.7 says of contact and friction, from sweeps over gain and initial condition."""

from dataclasses import dataclass

import numpy as np

from forceaxis import _core, linear, paths

# Of the linear gain limit; and the gap from which the robot approaches, m.
GAINS = (0.5, 0.6, 0.7, 0.75, 0.8, 0.84, 0.88, 0.92, 0.96, 1.04, 1.08, 1.12, 1.2, 1.3, 1.5)
GAPS = (0.0, 3e-5, 1e-4, 3e-4, 6e-4, 1e-3, 2e-3, 3e-3, 5e-3, 1e-2, 2e-2)


@dataclass
class ContactMap:
    """Which runs cycle, over gain (rows, of the linear limit) and initial gap (columns)."""

    title: str
    limit: float  # linear, sampled
    hz: float
    cycles: np.ndarray
    command: str  # one of its runs


def contact_map(title, settings, threads):
    """Runs of the flexible robot of Fig 2.42 against a rigid workpiece."""
    model, experiment = paths.MODELS / "fig2_42.toml", paths.EXPERIMENTS / "fig2_43_map.toml"
    limit, hz = linear.gain_limit(linear.force_loop(model, settings))
    texts = [f"{name}={value!r}" for name, value in settings.items()]
    jobs = [
        (str(experiment), [*texts, f"approach={gap!r}", f"firmware.force_gain={g * limit:.4f}"])
        for g in GAINS
        for gap in GAPS
    ]
    runs = _core.run_many(jobs, threads)
    cycles = np.array([r["verdict"] == "unstable" for r in runs]).reshape(len(GAINS), len(GAPS))
    command = "forceaxis run " + paths.display(experiment)
    for text in jobs[len(jobs) // 2][1]:
        command += f" --set {text}"
    return ContactMap(title, limit, hz, cycles, command)
