"""Version of the package, which modules inside it read without importing the public namespace."""

__version__ = "0.1.0"
