"""Reliability: the worst case of uncertain parameters, and the probability of rare failures."""
