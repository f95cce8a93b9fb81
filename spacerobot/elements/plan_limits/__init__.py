"""Kinds of limits of plans that ship, one in each file."""
