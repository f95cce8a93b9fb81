"""Kinds of goals that ship, one in each file."""
