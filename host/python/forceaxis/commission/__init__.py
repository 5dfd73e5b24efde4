"""Commissioning of an axis: measure its frequency responses, fit a model to them, design a force
law, and store the force law in the axis."""
