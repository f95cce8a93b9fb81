"""Kinds of contacts that ship, one file each."""
