"""Campaigns: how gains do over the whole range of what is not known."""
