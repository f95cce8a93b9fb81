"""What a campaign says: estimates with their intervals, what matters, bands, single samples."""
