"""Studio: a server that simulates a scenario whenever a number changes, and its page.

It is part of ``viz`` because pages may import tuning, whereas tuning must not import pages.
"""
