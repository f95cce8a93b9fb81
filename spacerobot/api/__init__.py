"""Functions of the public namespace and the classes of their results."""
