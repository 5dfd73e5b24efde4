"""Benchmarks. They measure the speed of the simulator and of other simulators, and the tick rate of
plant and firmware that run in lock-step over a connection."""
