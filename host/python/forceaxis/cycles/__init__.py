"""Cycles in the simulation: one part with its phases, error rates over many parts, and bounds of
the elements from good parts."""
