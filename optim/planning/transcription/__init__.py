"""Transcription of a motion into a program: collocation, chained phases, initial guesses, meshes."""
