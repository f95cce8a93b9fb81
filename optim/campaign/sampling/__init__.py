"""Sampling: uncertain parameters of a scene, and points of their distributions."""
