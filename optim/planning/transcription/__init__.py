"""Transcription of a motion into a program: collocation, chained phases, first guesses, meshes."""
