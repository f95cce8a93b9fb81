"""Foundations of every package: errors, files, interrupts, tables, registries, base of scenario sections.

A module belongs here if it knows nothing of robots and several packages need it. It imports no other package
of spacerobot. This file loads nothing.
"""
