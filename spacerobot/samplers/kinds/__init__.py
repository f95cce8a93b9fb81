"""Samplers that ship, one in each file."""
