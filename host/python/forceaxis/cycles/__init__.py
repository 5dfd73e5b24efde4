"""Press cycles, simulated or on an axis: simulation of one pressed part, error rates over many
parts, statistics of pressed parts, and bounds of evaluation elements that are computed from good
parts."""
