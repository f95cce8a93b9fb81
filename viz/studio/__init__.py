"""The studio: a server that rolls a scenario out whenever a number changes, for the page beside it.

It stands in ``viz`` because pages may know of tuning, and tuning may not know of pages.
"""
