"""Co-simulation units (FMUs) of plants and firmware, for the simulators of others."""
