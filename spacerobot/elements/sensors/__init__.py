"""Kinds of sensors that ship, one file each."""
