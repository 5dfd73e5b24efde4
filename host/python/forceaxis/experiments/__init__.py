"""Experiments: runs in process or over a link, their traces, sweeps, regression tests."""
