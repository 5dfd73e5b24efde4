"""Benchmarks: the speed of the simulator and of other simulators, and the tick rate of the
lock-step of plant and firmware over a connection."""
