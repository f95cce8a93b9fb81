"""Flight code: the periodic laws of a scenario as C99, its test vectors, and its flight in our loop."""
