"""Recordings of signals of a real machine: the format, the import from files of other programs."""
