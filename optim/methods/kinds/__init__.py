"""Tuning methods, one in each file."""
