"""forceaxis: firmware for force-controlled machine axes, and a simulator that tests the firmware.

`Experiment` simulates an axis and returns a `Result`. `Axis` controls a real axis. The modules
`linear`, `loops`, `modes`, `beam` and `resonance` compute in the frequency domain. Each module of
the package is loaded when one of its names is first used.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from forceaxis import linear
    from forceaxis._core import InputError, SimulationError, evaluate, run, run_many
    from forceaxis.axis.axis import Axis
    from forceaxis.experiments.experiment import Experiment, Result
    from forceaxis.identify import resonance
    from forceaxis.linear import beam, loops, modes

__all__ = [
    "Axis",
    "Experiment",
    "InputError",
    "Result",
    "SimulationError",
    "beam",
    "evaluate",
    "linear",
    "loops",
    "modes",
    "resonance",
    "run",
    "run_many",
]

# {public name: the module that defines the name}
_MODULES = {
    "beam": "forceaxis.linear.beam",
    "linear": "forceaxis.linear",
    "loops": "forceaxis.linear.loops",
    "modes": "forceaxis.linear.modes",
    "resonance": "forceaxis.identify.resonance",
}
_MEMBERS = {
    "Axis": "forceaxis.axis.axis",
    "Experiment": "forceaxis.experiments.experiment",
    "Result": "forceaxis.experiments.experiment",
    "InputError": "forceaxis._core",
    "SimulationError": "forceaxis._core",
    "evaluate": "forceaxis._core",
    "run": "forceaxis._core",
    "run_many": "forceaxis._core",
}


def __getattr__(name: str) -> Any:
    """Imports the module that defines a public name when the name is first used. Returns its
    value."""
    if name in _MODULES:
        return importlib.import_module(_MODULES[name])
    if name not in _MEMBERS:
        raise AttributeError(f"module 'forceaxis' has no attribute {name!r}")
    value = getattr(importlib.import_module(_MEMBERS[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Lists the public names of this package."""
    return sorted([*globals(), *__all__])
