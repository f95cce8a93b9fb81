"""Rollouts of a campaign: draws and sets of gains in, rows of numbers and series out."""
