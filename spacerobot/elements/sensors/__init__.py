"""Sensors: base classes, sampled measurements with errors, and one file for each kind that ships."""
