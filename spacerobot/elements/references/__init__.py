"""Kinds of references that ship, one file each."""
