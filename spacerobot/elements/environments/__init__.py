"""Kinds of environments that ship, one file each."""
