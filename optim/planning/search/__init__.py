"""One solve and many: initial guesses, mesh refinement, stored results, candidates."""
