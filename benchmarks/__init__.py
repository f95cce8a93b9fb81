"""Benchmarks, each measured in the same run as its baseline."""
