"""Experiments: runs of firmware and plant, traces, sweeps over parameters, regression tests."""
