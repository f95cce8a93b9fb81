"""Tuning methods: evolutionary methods, nonlinear programming and the manual procedure."""
