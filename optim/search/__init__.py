"""One search: what it asks, keeps, spends and tells, and the journal by which it is taken up again."""
