"""Version of the package, readable without an import of the public namespace."""

__version__ = "0.1.0"
