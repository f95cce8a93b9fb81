"""Kinds of controllers that ship, one file each."""
