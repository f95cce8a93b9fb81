"""The animated page: what it shows, written as one file, in a notebook, or served live to this computer."""
