"""Writes HTML pages for the command line. A page is about a folder of experiments, the design of a
force law, the tuning of an axis, or pressed parts."""
