"""The command line of forceaxis, with one module for each group of commands. A command parses
the options, calls the library and prints the result. Only the library computes."""
