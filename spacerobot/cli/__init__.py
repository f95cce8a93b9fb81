"""The command line: the top layer, which prints what the library returns."""
