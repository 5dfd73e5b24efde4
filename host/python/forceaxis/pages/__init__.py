"""Writes HTML pages for the command line: about a folder of experiments, about a design of a force
law, or about the tuning of an axis."""
