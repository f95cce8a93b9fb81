"""Free-floating space robots that grip and move an object together."""

__version__ = "0.1.0"
