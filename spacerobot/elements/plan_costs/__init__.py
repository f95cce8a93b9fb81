"""Kinds of costs of plans that ship, one in each file."""
