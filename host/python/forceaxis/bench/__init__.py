"""Benchmarks: the simulator and other simulators; the lock-step rate and the raw rate of its
transport."""
