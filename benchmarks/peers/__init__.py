"""The same scenes in spacerobot and in its peers; see ``docs/validation/peers.md``."""
