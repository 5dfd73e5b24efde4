"""forceaxis: firmware for force-controlled machine axes, and the simulator that proves it."""

import importlib

from forceaxis._core import InputError, Result, SimulationError, judge, run, run_many

__all__ = ["InputError", "Result", "SimulationError", "judge", "run", "run_many"]

# Modules by the names that scripts import them by; loaded when first used.
_MODULES = {
    "beam": "forceaxis.linear.beam",
    "loops": "forceaxis.linear.loops",
    "modes": "forceaxis.linear.modes",
    "resonance": "forceaxis.identify.resonance",
}


def __getattr__(name):
    if name not in _MODULES:
        raise AttributeError(f"module 'forceaxis' has no attribute {name!r}")
    return importlib.import_module(_MODULES[name])
