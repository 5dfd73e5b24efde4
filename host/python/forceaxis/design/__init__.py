"""Design of the force law for a set of plants, and the performance of a designed law."""
