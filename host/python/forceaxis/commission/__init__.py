"""Commissioning of an axis: measured responses, fitted model, designed and stored force law."""
