"""Many plans: fronts of two terms of the cost, slopes by the design, the best design."""
