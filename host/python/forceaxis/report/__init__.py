"""The report: one HTML page of every experiment, figure and table cell."""
