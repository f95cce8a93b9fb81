"""The command line: the topmost room, which prints what the library returns."""
