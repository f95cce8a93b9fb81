"""Common parts of all families: sections, contexts, contributions, events, clocks, registry."""
