"""Generators of the shipped URDFs that no publication gives; ``python -m benchmarks.shipped_urdfs``."""
