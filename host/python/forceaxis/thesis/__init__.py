"""The thesis: its stability tables, figures, quoted numbers and laboratory session, repeated with
the models of its plants."""
