"""Tuning methods compared: problems, their cost unit, expected running times and data profiles."""
