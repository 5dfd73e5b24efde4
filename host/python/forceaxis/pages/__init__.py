"""HTML pages about a folder of experiments, a design or a tuning, which the command line writes."""
