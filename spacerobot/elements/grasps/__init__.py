"""Grasps: base classes, capture and release, and one file for each kind that ships."""
