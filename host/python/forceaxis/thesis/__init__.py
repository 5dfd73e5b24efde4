"""The thesis: its stability tables, figures, quoted numbers and session, beside ours."""
