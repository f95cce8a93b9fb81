"""Plans made anew in flight."""
