"""IPOPT, and what a program must be for it; unknowns that equations determine alone leave it before."""
