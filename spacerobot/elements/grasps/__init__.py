"""Kinds of grasps that ship, one file each."""
