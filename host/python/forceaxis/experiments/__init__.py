"""Experiments: runs in this process or with the firmware in another one, traces, sweeps, regression
tests."""
