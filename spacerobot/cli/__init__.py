"""Command line: the top layer, which prints the library's results."""
