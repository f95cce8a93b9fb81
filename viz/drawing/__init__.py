"""Drawings: surfaces, their placements over time, their projection and their pixels."""
