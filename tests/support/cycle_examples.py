"""The examples of cycles in sim/experiments, each with a good part and a bad one."""

import numpy as np
from forceaxis.paths import EXPERIMENTS

# The bad parts fail by different means: an element, a limit of force, a limit of travel.
BAD = {
    "press_fit": ("k_bore=80 kN/m",),
    "spring_test": ("solid=7 mm",),
    "snap_fit": ("k_slide=60 kN/m",),
    "leak_plug": ("k_plug=15 kN/m", "k_relaxing=135 kN/m", "relaxation=1.5 s"),
    "polishing": ("k_rim=60 kN/m",),
}
PARTS = [(name, overrides) for name, bad in BAD.items() for overrides in ((), bad)]
IDS = [f"{name}-{kind}" for name in BAD for kind in ("good", "bad")]
BY_ID = dict(zip(IDS, PARTS, strict=True))


def file_of(name):
    return EXPERIMENTS / f"{name}.toml"


def expect_the_same(result, cycle, here):
    """A run elsewhere is that in process: its trace, and state and figures of its cycle."""
    assert result.trace_hash == here.trace_hash
    assert cycle == here.cycle
    assert cycle.cycles == 1 and len(cycle.figures) > 1


def expect_the_same_objects(result, here):
    """The traced objects have the same value after each tick."""
    columns, expected = result.columns(), here.columns()
    assert here.objects
    for name in here.objects:
        assert np.array_equal(columns[name], expected[name]), name
