"""Analysis of a campaign: estimates with confidence intervals, sensitivity, bands, single samples."""
