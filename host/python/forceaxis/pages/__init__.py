"""Writes HTML pages for the command line. There are pages about a folder of experiments, the design
of a force law, the tuning of an axis, and pressed parts."""
