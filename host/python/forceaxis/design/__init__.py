"""Coefficients of the force law for a set of plants, and what they are worth."""
