"""Co-simulation units (FMUs) of plants and firmware, for use in other simulators."""
