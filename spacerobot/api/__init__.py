"""Functions of the public namespace and what they return."""
