"""The studio: a server that simulates a scenario whenever a number changes, and its page.

It stands in ``viz`` because pages may know of tuning, and tuning may not know of pages.
"""
