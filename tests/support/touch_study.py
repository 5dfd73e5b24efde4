"""First contacts of one or two samples, drawn at random: a short half sine, no contact, and then a
contact that is held. Each force is sampled, noisy and rounded as a converter does it.

    python tests/support/touch_study.py 200     # counts of found, told as uncertain, and missed
"""

import math
import sys
from dataclasses import dataclass

import numpy as np
from forceaxis.recordings import touch

BEFORE = (30, 400)  # samples before the first contact
PAUSE = (3, 20)  # samples between the first contact and the next one
HELD_SAMPLES = 200


@dataclass(frozen=True)
class Drawn:
    """A recorded force, and the true instant of its first contact in s. `samples`: number of its
    samples."""

    time_s: np.ndarray
    force_N: np.ndarray
    touch_s: float
    rate_hz: float
    samples: int
    deviations: float


def drawn(seed):
    """Returns a recorded contact at a rate from 50 to 5,000 Hz, with 8 to 24 bits."""
    rng = np.random.default_rng([44, seed])
    rate = math.exp(rng.uniform(math.log(50), math.log(5000)))
    samples = 1 + seed % 2
    quantum = 200.0 / 2 ** int(rng.choice([8, 10, 12, 16, 24]))
    noise = math.exp(rng.uniform(math.log(0.01), math.log(0.3)))
    rounded = math.hypot(noise, quantum / math.sqrt(12))
    deviations = math.exp(rng.uniform(math.log(20), math.log(200)))
    top, held = deviations * rounded, rng.uniform(20, 60)
    first = int(rng.integers(*BEFORE))
    # Times in samples: the first sample in contact is at `first`.
    length = 1.3 if samples == 1 else 1.8
    begin = first - rng.uniform(0.35, 0.85) if samples == 1 else first - rng.uniform(0.3, 0.7)
    again = first + samples - 1 + int(rng.integers(*PAUSE)) + rng.uniform(0, 1)
    at = np.arange(int(again) + HELD_SAMPLES)
    phase = (at - begin) / length
    force = np.where((phase > 0) & (phase < 1), top * np.sin(np.pi * np.clip(phase, 0, 1)), 0.0)
    force += np.where(at > again, held * (1 - np.exp(-(at - again) / 8.0)), 0.0)
    read = force + rng.uniform(-2, 2) + noise * rng.standard_normal(len(at))
    read = quantum * np.floor(read / quantum + 0.5)
    return Drawn(at / rate + 3.0, read, begin / rate + 3.0, rate, samples, deviations)


def found(one):
    """Returns "found" if the first contact is found within a sample, "untold" if it is said that it
    cannot be told, and "missed" otherwise."""
    level = touch.level_of(one.time_s, one.force_N, "force")
    first = touch.first_touch(one.time_s, one.force_N, level)
    if abs(first.time_s - one.touch_s) <= 1 / one.rate_hz:
        return "found"
    return "missed" if first.doubtful_s is None else "untold"


if __name__ == "__main__":
    every = [found(drawn(seed)) for seed in range(int(sys.argv[1]))]
    print({name: every.count(name) for name in ("found", "untold", "missed")})
