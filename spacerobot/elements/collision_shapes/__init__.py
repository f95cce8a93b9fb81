"""Collision shapes: one file for each kind."""
