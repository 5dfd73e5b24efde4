"""The thesis: its stability tables, figures, quoted numbers and laboratory session, computed again
with models of its plants."""
