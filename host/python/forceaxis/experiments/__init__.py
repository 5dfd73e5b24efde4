"""Experiments: their files, runs, sweeps, regression tests and plots."""
