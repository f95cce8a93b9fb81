"""Pictures of a result: browser animation, figures, report."""
