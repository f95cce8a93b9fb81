"""Descriptions of robots and objects: find, read, check and write URDF."""
