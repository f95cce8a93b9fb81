"""IPOPT, the interface of programs for it, and a presolve that eliminates determined unknowns."""
