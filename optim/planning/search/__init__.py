"""Search for plans: initial guesses, mesh refinement, stored results, candidates."""
