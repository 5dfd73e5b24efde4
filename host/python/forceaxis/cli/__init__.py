"""The command line of forceaxis, one module for each group of verbs. A verb parses its options,
calls the library and prints the result; it computes nothing itself."""
