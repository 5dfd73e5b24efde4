"""The command line: a module for each family of verbs; nothing is computed here."""
