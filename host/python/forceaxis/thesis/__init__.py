"""The thesis: its stability tables, figures, quoted numbers and laboratory session. All of them are
computed again with models of its plants."""
