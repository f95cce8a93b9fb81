"""Actuators: base class, shared allocation and detection laws, and one file for each kind that ships."""
