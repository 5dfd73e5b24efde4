"""Recordings of signals of a real machine: their format, and their import from other programs."""
