"""Robust tuning: one objective over a common set of samples."""
