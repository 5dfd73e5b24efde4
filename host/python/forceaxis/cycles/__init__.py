"""Cycles in the simulation: one pressed part with its phases, error rates over many parts, and
bounds of the evaluation elements from good parts."""
