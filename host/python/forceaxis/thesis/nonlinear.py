"""The effect of contact and Coulomb friction on stability (thesis section 2.7). It is computed from
simulated runs with several gains and initial gaps."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from forceaxis import _core, paths
from forceaxis.experiments.verdicts import NOT_STABLE
from forceaxis.linear import loops

# Gains and initial gaps of the runs in the table about contact with the workpiece.
# A gain is a multiple of the largest stable gain of the linear loop.
# A gap is the distance in m between robot and workpiece.
GAINS = (0.5, 0.6, 0.7, 0.76, 0.8, 0.84, 0.88, 0.92, 0.96, 1.04, 1.08, 1.12, 1.2, 1.3, 1.5)
GAPS = (0.0, 3e-5, 1e-4, 3e-4, 6e-4, 1e-3, 2e-3, 3e-3, 5e-3, 1e-2, 2e-2)

# Runs with Coulomb friction: friction forces in N (COULOMB), gains and initial gaps.
# Gains and gaps of runs with Coulomb friction are defined in the same way as GAINS and GAPS.
COULOMB = (0.0, 1.0, 2.0, 3.0, 5.0, 8.0)
FRICTION_GAINS = tuple(np.arange(0.96, 1.45, 0.04).round(2).tolist())
FRICTION_GAPS = (0.0, 1e-4, 1e-3, 1e-2)


@dataclass
class ContactMap:
    """Table of the simulated runs that end in a limit cycle. Rows are gains (GAINS), and columns
    are initial gaps (GAPS)."""

    title: str
    limit: float  # largest gain at which the linear, sampled loop is stable
    hz: float  # frequency in Hz of the oscillation at the largest stable gain of the linear loop
    cycles: NDArray[np.bool_]
    command: str  # command line with which the user can repeat one of the runs

    def counts(self, above: bool) -> tuple[int, int]:
        """Returns (number of runs with a limit cycle, number of runs). With `above`, only runs with
        a gain above the critical gain of the linear loop are counted. Otherwise only runs below it
        are counted."""
        part = self.cycles[(np.array(GAINS) > 1) == above]
        return int(part.sum()), part.size


def flexible_robot(b_rf: float) -> tuple[float, float]:
    """Returns (largest stable gain, frequency in Hz of the oscillation at this gain) of the linear
    model of Fig 2.42 in contact."""
    loop = loops.force_loop("fig2_42", overrides={"b_rf": b_rf})
    limit = loop.limit()
    if limit.gain is None or limit.frequency_hz is None:
        raise ValueError("fig2_42: expected a force loop with a gain limit")
    return loop.firmware_gain(limit.gain), limit.frequency_hz


def cycles(
    experiment: str,
    settings: dict[str, float],
    gains: Sequence[float],
    gaps: Sequence[float],
    threads: int,
) -> tuple[NDArray[np.bool_], str]:
    """Runs an experiment with several gains and initial gaps. Returns (array, command line of one
    run). The array is True for each run with a limit cycle. Its rows are gains, and its columns are
    gaps."""
    path = paths.EXPERIMENTS / f"{experiment}.toml"
    texts = [f"{name}={value!r}" for name, value in settings.items()]
    jobs = [
        (str(path), [*texts, f"approach={gap!r}", f"firmware.force_gain={gain:.4f}"])
        for gain in gains
        for gap in gaps
    ]
    verdicts = [r["verdict"] in NOT_STABLE for r in _core.run_many(jobs, threads)]
    sets = [word for text in jobs[-1][1] for word in ("--set", text)]
    command = shlex.join(["forceaxis", "run", paths.display(path), *sets])
    return np.array(verdicts).reshape(len(gains), len(gaps)), command


def contact_maps(threads: int) -> list[ContactMap]:
    """Returns a ContactMap for each of three variants of Fig 2.42. They are a lightly damped arm,
    the arm of the laboratory, and the arm of the laboratory with friction."""
    maps = []
    for title, experiment, b_rf, settings in (
        ("arm lightly damped, b_rf = 60", "fig2_43_settles", 60.0, {}),
        ("arm of Fig 4.26, b_rf = 640", "fig2_43_settles", 640.0, {}),
        ("the same with 5 N of Coulomb friction", "nl_friction", 640.0, {"coulomb": 5.0}),
    ):
        limit, hz = flexible_robot(b_rf)
        gains = [g * limit for g in GAINS]
        found, command = cycles(experiment, {"b_rf": b_rf} | settings, gains, GAPS, threads)
        maps.append(ContactMap(title, limit, hz, found, command))
    return maps


def friction_limits(threads: int) -> list[tuple[float, float]]:
    """Returns (Coulomb force in N, gain) for each force in COULOMB. The gain is the largest one at
    which the runs from all initial gaps settle, relative to the critical gain of the linear
    loop."""
    limit, _ = flexible_robot(640.0)
    gains = [g * limit for g in FRICTION_GAINS]
    rows = []
    for force in COULOMB:
        found, _ = cycles("nl_friction", {"coulomb": force}, gains, FRICTION_GAPS, threads)
        cycling = found.any(axis=1)
        first = int(cycling.argmax()) if cycling.any() else len(gains)
        rows.append((force, FRICTION_GAINS[first - 1] if first else 0.0))
    return rows
