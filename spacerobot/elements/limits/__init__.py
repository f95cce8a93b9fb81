"""Limits of plans: base class, limits on registered quantities, and one file for each geometric kind."""
