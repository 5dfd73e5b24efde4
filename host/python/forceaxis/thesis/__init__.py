"""The thesis: its tables, figures, claims and session."""
