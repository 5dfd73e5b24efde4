"""Commissioning a live axis: responses measured on it, and what follows from them."""
