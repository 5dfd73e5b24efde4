"""Press cycles, simulated or on an axis: one pressed part with its phases, error rates over many
parts, statistics of parts, and bounds of the evaluation elements that are computed from good
parts."""
