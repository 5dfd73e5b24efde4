"""forceaxis: firmware for force-controlled machine axes, and the simulator that proves it."""

from forceaxis._core import InputError, Result, SimulationError, judge, run, run_many

__all__ = ["InputError", "Result", "SimulationError", "judge", "run", "run_many"]
