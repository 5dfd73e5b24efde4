"""Computes the stability tables, figures and quoted numbers of the thesis again, with models of its
plants. Also repeats its laboratory session."""
