"""Kinds of estimators that ship, one file each."""
