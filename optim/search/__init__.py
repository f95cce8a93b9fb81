"""One search: its evaluations, state, cost and progress, and the journal by which it is resumed."""
