"""Kinds of actuators that ship, one file each."""
