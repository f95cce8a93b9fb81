"""Kinds of flexible links that ship, one file each."""
