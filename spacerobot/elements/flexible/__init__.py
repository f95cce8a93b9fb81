"""Flexible links: base class, and one file for each kind that ships."""
