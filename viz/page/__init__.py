"""Animated page of results: its data, and the page as a file, in a notebook, or served on this computer."""
